"""LinuxCNC's own planner beside ours on the same files: `python -m benchmarks.evidence.peers.linuxcnc_sim [FILE …]
[--lines N] [--feed F] [--config INI] [--workpiece NAME] [--join WORDS]`.

LinuxCNC runs in simulation, in real time, with the axes' limits of INI (default: those of its own simulated machine in
millimetres), and the positions that it commands are taken at every servo period of 1 ms. Ours plans the same file for
the same limits; order 3 with a jerk besides, which LinuxCNC's planner has none of. Both are held against the limits by
the same differences of positions. Without FILE the workpieces of benchmarks.evidence.workpieces are run: with
G64 P0.02, with G61, with a stop at every join (G61.1), and ours with a blend at each. Of FILEs, which may be folders,
those are run that ours plans. It needs LinuxCNC 2.9, Debian's package linuxcnc-uspace; where that is not installed,
ours is told alone.
"""

import json
import os
import shutil
import subprocess
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.evidence.peers.linuxcnc_suite import (
    PERIOD,
    QUANTITIES,
    Differences,
    Limits,
    build_machine,
    find_files,
    plan_file,
    read_limits,
)
from benchmarks.evidence.published.compared import markdown
from benchmarks.evidence.workpieces import FEED, SHAPES, write_shape
from kinematics.foundation.arrays import Array

SIMULATED = (
    Limits(-0.254, 0.254, 0.03048, 0.508),
    Limits(-0.254, 0.254, 0.03048, 0.508),
    Limits(-0.0508, 0.1016, 0.03048, 0.508),
)
"""LinuxCNC's configs/sim/axis/axis_mm.ini."""
NAMES = ("spiral", "surface", "engraving")
JOINS = ("G64 P0.02", "G61", "G61.1", "blends")
BLEND = 2e-5
"""m; of which LinuxCNC knows none."""
SCALE = 1e6
"""Positions are sampled in nm, since halsampler prints six decimals."""
STARTED, SETTLED = 60.0, 2.0
"""s: within which LinuxCNC has to be up, and that it rests before a file."""

NOBODY = "65534"
"""Its real-time part refuses to be root's."""
PYTHON = "/usr/bin/python3"
"""The one that Debian's module linuxcnc is for."""
CONFIGURATION = """\
[EMC]
VERSION = 1.1
MACHINE = pulsepath
DEBUG = 0
[DISPLAY]
DISPLAY = ./run_files
[TASK]
TASK = milltask
CYCLE_TIME = 0.001
[RS274NGC]
PARAMETER_FILE = sim.var
[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 4.0
BASE_PERIOD = 0
SERVO_PERIOD = 1000000
[HAL]
HALFILE = sim.hal
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.100
TOOL_TABLE = tool.tbl
[KINS]
KINEMATICS = trivkins
JOINTS = 3
[TRAJ]
NO_FORCE_HOMING = 1
COORDINATES = X Y Z
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
DEFAULT_LINEAR_VELOCITY = {fastest}
MAX_LINEAR_VELOCITY = {fastest}
"""
AXIS = """\
[{section}]
TYPE = LINEAR
HOME = 0
MIN_LIMIT = {low}
MAX_LIMIT = {high}
MAX_VELOCITY = {speed}
MAX_ACCELERATION = {acceleration}
FERROR = 10
MIN_FERROR = 10
HOME_SEARCH_VEL = 0
HOME_LATCH_VEL = 0
HOME_SEQUENCE = 0
"""
HAL = """\
loadrt trivkins
loadrt motmod servo_period_nsec=1000000 num_joints=3
loadrt scale count=3
loadrt sampler depth=20000 cfg=fff
addf motion-command-handler servo-thread
addf motion-controller servo-thread
addf scale.0 servo-thread
addf scale.1 servo-thread
addf scale.2 servo-thread
addf sampler.0 servo-thread
setp sampler.0.enable 0
setp scale.0.gain {scale}
setp scale.1.gain {scale}
setp scale.2.gain {scale}
net x joint.0.motor-pos-cmd => joint.0.motor-pos-fb scale.0.in
net y joint.1.motor-pos-cmd => joint.1.motor-pos-fb scale.1.in
net z joint.2.motor-pos-cmd => joint.2.motor-pos-fb scale.2.in
net xs scale.0.out => sampler.0.pin.0
net ys scale.1.out => sampler.0.pin.1
net zs scale.2.out => sampler.0.pin.2
net estop iocontrol.0.user-enable-out iocontrol.0.emc-enable-in
net prepare iocontrol.0.tool-prepare iocontrol.0.tool-prepared
net change iocontrol.0.tool-change iocontrol.0.tool-changed
"""
# Runs inside LinuxCNC as its display, by Debian's Python: each file from zero, its positions sampled.
RUN = '''\
#!{python}
import json, subprocess, sys, time
import linuxcnc

work = json.load(open("work.json"))
command, status, errors = linuxcnc.command(), linuxcnc.stat(), linuxcnc.error_channel()
told = []

def wait(limit):
    """Until the interpreter is idle and nothing moves; what is wrong, if anything."""
    begun = time.time()
    while time.time() - begun < limit:
        status.poll()
        error = errors.poll()
        if error:
            return str(error[1])
        if status.interp_state == linuxcnc.INTERP_IDLE and status.inpos and time.time() - begun > 0.3:
            return ""
        time.sleep(0.02)
    return "not at its end after %g s" % limit

def set_up(mode):
    command.mode(mode)
    command.wait_complete()

command.state(linuxcnc.STATE_ESTOP_RESET)
command.wait_complete()
command.state(linuxcnc.STATE_ON)
command.wait_complete()
command.home(-1)
time.sleep(1)
for k, (file, start) in enumerate(work["files"]):
    set_up(linuxcnc.MODE_MDI)
    for line in ("G54 G92.1 G49 G40 G90 G94 G17 G80 G64", start, "G53 G0 X0 Y0 Z0"):
        command.mdi(line)
        command.wait_complete(30)
        wait(30)
    time.sleep({settled})
    while errors.poll():
        pass
    set_up(linuxcnc.MODE_AUTO)
    command.program_open(file)
    sampler = subprocess.Popen(["halsampler", "-t", "%d.txt" % k])
    time.sleep(0.5)
    subprocess.run(["halcmd", "setp", "sampler.0.enable", "1"])
    command.auto(linuxcnc.AUTO_RUN, 0)
    wrong = wait(work["limit"])
    if wrong:
        command.abort()
        command.wait_complete()
    subprocess.run(["halcmd", "setp", "sampler.0.enable", "0"])
    time.sleep(0.5)
    sampler.terminate()
    sampler.wait()
    told.append(wrong)
json.dump(told, open("told.json", "w"))
'''


@dataclass(frozen=True, slots=True)
class SimulatedRun:
    """What LinuxCNC made of a file. positions (N, 3): m, at every period from the first change to the last."""

    positions: Array
    wrong: str = ""

    @property
    def duration(self) -> float:
        """s."""
        return PERIOD * max(len(self.positions) - 1, 0)


def find_missing() -> str:
    """What keeps LinuxCNC from running here; "" where nothing does."""
    for program in ("linuxcnc", "halsampler"):
        if shutil.which(program) is None:
            return f"{program} is not installed (Debian's package linuxcnc-uspace)"
    found = subprocess.run([PYTHON, "-c", "import linuxcnc"], capture_output=True, text=True, check=False)
    return found.stderr.strip().rpartition("\n")[2] if found.returncode else ""


def write_configuration(folder: Path, limits: Sequence[Limits]) -> Path:
    """A simulated machine of three axes with these limits, in mm."""
    text = CONFIGURATION.format(fastest=1e3 * float(np.linalg.norm([one.speed for one in limits])))
    for k, one in enumerate(limits):
        in_mm = {name: 1e3 * getattr(one, name) for name in ("low", "high", "speed", "acceleration")}
        text += "".join(AXIS.format(section=section, **in_mm) for section in (f"AXIS_{'XYZ'[k]}", f"JOINT_{k}"))
    (folder / "sim.ini").write_text(text)
    (folder / "sim.hal").write_text(HAL.format(scale=SCALE))
    (folder / "tool.tbl").write_text("")
    (folder / "sim.var").write_text("")
    (folder / "run_files").write_text(RUN.replace("{python}", PYTHON).replace("{settled}", str(SETTLED)))
    (folder / "run_files").chmod(0o755)
    return folder / "sim.ini"


def simulate(
    files: Sequence[Path], limits: Sequence[Limits], unit: str = "mm", limit: float = 600.0
) -> list[SimulatedRun]:
    """LinuxCNC's motion along each file, from zero. limit: s that one may take. Raises RuntimeError where it does not
    come up, with the end of what it says."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o777)  # what is not root's writes here, too
        start = "G21" if unit == "mm" else "G20"
        work = {"files": [[str(file.resolve()), start] for file in files], "limit": limit}
        (folder / "work.json").write_text(json.dumps(work))
        ini = write_configuration(folder, limits)
        wait = STARTED + len(files) * (limit + 30)
        done = subprocess.run(
            ["linuxcnc", "-r", str(ini)],
            cwd=folder,
            env={**os.environ, "HOME": name, **({"RTAPI_UID": NOBODY} if os.geteuid() == 0 else {})},
            capture_output=True,
            text=True,
            timeout=wait,
            check=False,
        )
        if not (folder / "told.json").exists():
            raise RuntimeError("LinuxCNC did not run:\n" + (done.stdout + done.stderr)[-3000:])
        told = json.loads((folder / "told.json").read_text())
        return [_read_run(folder / f"{k}.txt", wrong) for k, wrong in enumerate(told)]


def _read_run(file: Path, wrong: str) -> SimulatedRun:
    """The samples of a file, from where something changes to where nothing does any more."""
    lines = file.read_text().splitlines()
    # the first line of a later file tells of an overrun, since halsampler counts from 0
    rows = np.array([line.split() for line in lines if line.count(" ") >= 3], float)
    if (np.diff(rows[:, 0]) != 1).any():
        return SimulatedRun(np.empty((0, 3)), "samples were lost")
    places = rows[:, 1:4] / SCALE * 1e-3
    moves = np.flatnonzero((np.diff(places, axis=0) != 0).any(1))
    return SimulatedRun(places[moves[0] : moves[-1] + 2] if len(moves) else places[:0], wrong)


def tell_run(run: SimulatedRun, limits: Sequence[Limits]) -> list[str]:
    """Duration and largest uses of LinuxCNC's motion."""
    if run.wrong:
        return [run.wrong.replace("\n", " "), "", ""]
    bounds = np.array([[getattr(one, name) for one in limits] for name in QUANTITIES[:2]])
    differences = Differences(bounds)
    still = np.repeat(run.positions[[0, -1]], 3, axis=0)
    differences.add(np.concatenate([still[:3], run.positions, still[3:]]))
    return [f"{run.duration:.3f}", *(f"{use:.4f}" for use in differences.uses)]


@dataclass(frozen=True, slots=True)
class SimulatedCase:
    """A file that is planned by both: what it and its joins are called."""

    name: str
    joins: str
    file: Path


def write_workpieces(
    folder: Path, names: Sequence[str], joins: Sequence[str], lines: int, feed: float
) -> Iterator[SimulatedCase]:
    """Every workpiece with every kind of join."""
    for name in names:
        plain = write_shape(name, lines, folder / f"{name}.ngc").read_text().replace(f"F{FEED:.0f}", f"F{feed:g}")
        for join in joins:
            file = folder / f"{name}_{join.replace(' ', '_')}.ngc"
            file.write_text(plain.replace("G64 P0.02", "" if join == "blends" else join, 1))
            yield SimulatedCase(name, join, file)


def compare(cases: Sequence[SimulatedCase], limits: Sequence[Limits], unit: str) -> list[list[str]]:
    """A row for each case and planner; of LinuxCNC where it can run, and ours plans the file."""
    machine, rows = build_machine(limits), list[list[str]]()
    ours = [
        [
            plan_file(case.file, machine, order, unit=unit, blend=BLEND if case.joins == "blends" else None)
            for order in (2, 3)
        ]
        for case in cases
    ]
    told = [k for k, case in enumerate(cases) if not ours[k][0].refused and case.joins != "blends"]
    longest = max((ours[k][0].duration for k in told), default=0.0)
    runs = [] if find_missing() else simulate([cases[k].file for k in told], limits, unit, 30 + 5 * longest)
    theirs = dict(zip(told, runs, strict=False))
    for k, case in enumerate(cases):
        if k in theirs:
            rows.append([case.name, case.joins, "LinuxCNC", *tell_run(theirs[k], limits), ""])
        for order, found in zip((2, 3), ours[k], strict=True):
            uses = [f"{use:.4f}" for use in found.sampled[:2]] or ["", ""]
            motion = [found.refused or f"{found.duration:.3f}", *uses, f"{found.proved:.7f}" if uses[0] else ""]
            rows.append([case.name, case.joins, f"ours, order {order}", *motion])
    return rows


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.peers.linuxcnc_sim", description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="G-code, or folders of it; default: the workpieces")
    parser.add_argument("--workpiece", choices=SHAPES, action="append")
    parser.add_argument("--join", choices=JOINS, action="append")
    parser.add_argument("--lines", type=int, default=600)
    parser.add_argument("--feed", type=float, default=FEED, help="mm/min, of the workpieces")
    parser.add_argument("--config", type=Path, help="a configuration of LinuxCNC, whose limits are taken")
    asked = parser.parse_args()
    limits, unit = (list(SIMULATED), "mm") if asked.config is None else read_limits(asked.config)
    with TemporaryDirectory() as folder:
        files = [file for name in asked.files for file in (find_files(name) if name.is_dir() else [name])]
        cases = [SimulatedCase(file.name, "as it says", file) for file in files]
        if not cases:
            names, joins = asked.workpiece or NAMES, asked.join or JOINS
            cases = list(write_workpieces(Path(folder), names, joins, asked.lines, asked.feed))
        rows = compare(cases, limits, unit)
    print(markdown(["file", "joins", "planner", "duration (s)", "speed", "acceleration", "proved"], rows))
    if missing := find_missing():
        print(f"\nLinuxCNC was skipped: {missing}.")


if __name__ == "__main__":
    main()
