"""Our rows through emulated EtherCAT drives: `python -m benchmarks.evidence.peers.csp_drive [--programs circle,…]`.

The drive is an emulation of our own, written from what CiA 402 states in public, without code of the export `csp`;
there is no drive and no network in it. Six plans are exported at cycles of 0.25, 1 and 4 ms and played, then again with
one thing wrong. Of machines that state their masses the drives feel the motion's forces, and get torque offsets. Where
the package canopen is installed, its CiA 402 master enables a drive over a virtual CAN bus.
"""

import re
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.evidence.peers.csp_drive.canopen_ import enable_by_canopen
from benchmarks.evidence.peers.csp_drive.drive import TICK
from benchmarks.evidence.peers.csp_drive.master import HELD, MasterSetting, Played, Sheet, Whole, play, read_sheet
from benchmarks.evidence.published.compared import markdown
from kinematics import load_machine
from kinematics.analysis.dynamics import forces
from kinematics.machine.axis import directional_bounds
from planner import Plan, load_program, plan

PROGRAMS = "bare-circle,circle,arm-square,tripod-circle,traverser-scan,linkage-line"
CYCLES = (0.25e-3, 1e-3, 4e-3)
INCREMENTS = 16
ROTOR = 10.0
"""How many times the axis' largest acceleration the rated torque gives the motor without load. ASSUMPTION."""
RATED_SHARE = 2.0
"""The rated torque, of the largest that the motion needs. ASSUMPTION."""
ROOM = 2.0
"""The following error window, of the largest following error in the same motion; and 2 increments."""


@dataclass(frozen=True, slots=True)
class DriveCase:
    """A plan's file at a cycle, how it is played, and what the export states, in increments."""

    name: str
    made: Plan
    sheet: Sheet
    setting: MasterSetting
    straight: float
    parabola: float
    difference: int


def make_case(name: str, made: Plan, cycle: float) -> DriveCase:
    """Export and read a plan, and set the drives as its header and the machine's limits say."""
    axes, trajectory = made.machine.axes, made.trajectory
    pulse, sign = (np.array([getattr(axis, of) for axis in axes]) for of in ("pulse", "direction"))
    scale = sign * INCREMENTS / pulse
    t = cycle * np.arange(int(np.ceil(trajectory.duration / cycle)) + 1 + round(HELD / cycle))
    state = trajectory.at(np.minimum(t, trajectory.duration))
    loads, rated = np.zeros((len(t), len(axes))), None
    fastest = np.array([max(directional_bounds(axis.max_acceleration)) for axis in axes])
    if made.machine.loaded:
        needed = forces(made.machine, state).force
        torque = [float(f"{RATED_SHARE * most:.2g}") for most in abs(needed).max(0)]
        loads, rated = -needed * scale * ROTOR * fastest / torque, ",".join(map(str, torque))
    with TemporaryDirectory() as folder:
        file = Path(folder) / "plan.csv"
        told = made.export("csp", file, cycle=cycle, increments=INCREMENTS, rated=rated)
        sheet = read_sheet(file)
    notes = " ".join(told.notes)
    limits = np.sort(np.array([axis.travel for axis in axes]) * scale[:, None])
    speed = np.array([max(directional_bounds(axis.max_speed)) for axis in axes]) * abs(scale)
    setting = MasterSetting(
        np.arange(len(sheet.rows)),
        np.clip(limits, -(2.0**31), 2.0**31 - 1).astype(np.int64),
        speed,
        fastest * abs(scale) * ROTOR,
        loads,
    )
    return DriveCase(
        name,
        made,
        sheet,
        setting,
        told.error * INCREMENTS,
        float(re.findall(r"measured along parabolas: within (\S+) ", notes)[0]),
        int(re.findall(r"second difference: at most (\d+) ", notes)[0]),
    )


def measure_way(case: DriveCase, played: Played) -> float:
    """Increments between the demands at every cycle of the drives and the plan's motion, at most."""
    axes, trajectory = case.made.machine.axes, case.made.trajectory
    pulse, sign = (np.array([getattr(axis, of) for axis in axes]) for of in ("pulse", "direction"))
    each = len(played.ways[0])
    t = case.sheet.cycle * (np.arange(len(played.ways))[:, None] - 1 + np.arange(each) / each).ravel()
    off = 0.0
    for part, when in zip(np.array_split(played.ways.reshape(len(t), -1), 64), np.array_split(t, 64), strict=True):
        q = trajectory.at(np.clip(when, 0.0, trajectory.duration)).q - case.made.machine.home_q
        off = max(off, float(abs(part - q * sign * INCREMENTS / pulse).max()))
    return off


def find_fastest(sheet: Sheet) -> int:
    """The row with the longest step before it, of what second differences may be."""
    return 1 + int((abs(np.diff(sheet.rows, axis=0)) / sheet.most).max(1).argmax())


def halve_way(sheet: Sheet, limits: Whole) -> Whole:
    """Position limits that let the axis with the longest way go half of it."""
    way = abs(sheet.rows - sheet.rows[0])
    k = int(way.max(0).argmax())
    half = int(way[:, k].max()) // 2
    changed = limits.copy()
    changed[k] = sheet.rows[0, k] - half, sheet.rows[0, k] + half
    return changed


Change = Callable[[Sheet, MasterSetting], MasterSetting]
FAULTS: dict[str, Change] = {
    "nothing": lambda sheet, setting: setting,
    "a row is lost, where it is fastest": lambda sheet, setting: replace(
        setting, order=np.delete(setting.order, find_fastest(sheet))
    ),
    "a row is sent twice, there": lambda sheet, setting: replace(
        setting, order=np.insert(setting.order, find_fastest(sheet), find_fastest(sheet))
    ),
    "rows lead beyond 0x607D": lambda sheet, setting: replace(setting, limits=halve_way(sheet, setting.limits)),
    "it stands half a window from `starts at`": lambda sheet, setting: replace(setting, away=setting.window // 2),
    "it stands two windows from there": lambda sheet, setting: replace(setting, away=2 * setting.window),
    "0x0F comes before 0x06 and 0x07": lambda sheet, setting: replace(setting, words=(0x0F,)),
    "it is enabled while rows run": lambda sheet, setting: replace(setting, late=find_fastest(sheet)),
    "0x6060 is not set": lambda sheet, setting: replace(setting, mode=0),
    "0x60C2 is twice the cycle": lambda sheet, setting: replace(setting, slower=2),
}
SEEN = ("bit 11", "fault 0x8611", "not enabled at the end", "0x6062 unlike the file")


def find_signs(case: DriveCase, change: Change, window: int) -> Counter[str]:
    """What a master sees of a fault; its following error window is that of the motion without it."""
    setting = change(case.sheet, replace(case.setting, window=window))
    played = play(case.sheet, setting)
    same = len(played.demanded) == len(case.sheet.rows) and bool((played.demanded == case.sheet.rows).all())
    return Counter(
        dict(zip(SEEN, (played.limited, bool(played.errors), not played.enabled, not same), strict=True)),
    )


def describe_case(case: DriveCase) -> tuple[list[str], int]:
    """A row of the table of motions, and the following error window (increments)."""
    setting, rows = case.setting, case.sheet.rows
    straight = play(case.sheet, setting)
    parabola = play(case.sheet, replace(setting, parabola=True))
    without = play(case.sheet, replace(setting, offsets=()))
    wrong = sum(
        int((played.demanded != rows).sum() + (played.actual != rows[-1]).sum()) for played in (straight, parabola)
    )
    twice = abs(np.diff(parabola.demanded, 2, axis=0)).max()
    following = [without, straight]
    if "0x60B2" in case.sheet.columns:
        following.insert(1, play(case.sheet, replace(setting, offsets=("0x60B1",))))
    cells = (
        case.name,
        f"{1e3 * case.sheet.cycle:g} ms",
        len(rows),
        wrong,
        f"{measure_way(case, straight):.2f} / {case.straight:.2f}",
        f"{measure_way(case, parabola):.2f} / {case.parabola:.2f}",
        f"{twice} / {case.difference}",
        " / ".join(f"{played.following.max():.0f}" for played in following),
    )
    return [*map(str, cells)], int(np.ceil(ROOM * max(straight.following.max(), parabola.following.max()))) + 2


HEADER = (
    "program", "cycle", "rows", "off", "straight / stated", "parabolas / stated", "second difference / stated",
    "following error: no offset / velocity / and torque",
)  # fmt: skip


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--programs", default=PROGRAMS)
    asked = parser.parse_args()
    rows, seen, files = [], {fault: Counter[str]() for fault in FAULTS}, 0
    for name in asked.programs.split(","):
        program = load_program(name)
        assert program.machine is not None
        made = plan(program, load_machine(program.machine))
        for cycle in CYCLES:
            case = make_case(name, made, cycle)
            cells, window = describe_case(case)
            rows.append(cells)
            files += 1
            for fault, change in FAULTS.items():
                seen[fault] += find_signs(case, change, window)
    print(markdown(HEADER, rows))
    print(f"\nincrements, {INCREMENTS} a pulse; drives at {1e6 * TICK:g} us\n")
    print(
        markdown(
            (f"what is wrong, in {files} files each", *SEEN),
            [[fault, *(str(of[sign]) for sign in SEEN)] for fault, of in seen.items()],
        )
    )
    print("", *enable_by_canopen(), sep="\n")


if __name__ == "__main__":
    main()
