"""Our files through ROS 2's own controller: `python -m benchmarks.evidence.peers.ros_controller PLAYER [--order 2]`.

PLAYER is a program around Trajectory and validate_trajectory_msg of ros2_controllers' joint_trajectory_controller, of
which nothing is here. It reads a line for each of these from its input: the period in ns, the controller's joints and
where they stand, the file's joints, and its points, each as sec, nanosec and the four lists; a list is its length and
its members, and names stand on lines of their own. It prints a row for each period until the last point is reached: ns
from the start, positions, velocities, accelerations of the controller's joints; or it ends with an exit code and why
the controller refuses the file. Each plan's export `ros` is played at periods of 1 and 4 ms and compared with the plan;
files that are spoilt in one place show what is refused. Skipped by name where there is no PLAYER.
"""

import subprocess
from argparse import ArgumentParser
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.evidence.published.compared import markdown
from kinematics import load_machine
from kinematics.foundation.arrays import Array
from kinematics.machine.axis import directional_bounds
from planner import Plan, load_program, plan

PROGRAMS = "bare-circle,circle,arm-square,tripod-circle,traverser-scan,linkage-line"
PERIODS = (1_000_000, 4_000_000)
"""ns"""
LISTS = ("positions", "velocities", "accelerations", "effort")
AWAY = 1e-3
"""m or rad that the joints stand away from the first point."""

Message = dict[str, Any]
FAULTS: dict[str, Callable[[Message], object]] = {
    "a time as the one before": lambda m: m["points"][2].update(time_from_start=m["points"][1]["time_from_start"]),
    "no points": lambda m: m["points"].clear(),
    "a position short": lambda m: m["points"][1]["positions"].pop(),
    "a velocity short": lambda m: m["points"][1]["velocities"].pop(),
    "an acceleration too many": lambda m: m["points"][1]["accelerations"].append(0.0),
    "a velocity of 2e-7 at the end": lambda m: m["points"][-1]["velocities"].__setitem__(0, 2e-7),
    "efforts": lambda m: m["points"][1].update(effort=[0.0] * len(m["joint_names"])),
    "an unknown joint": lambda m: m["joint_names"].__setitem__(0, "nobody"),
    "a joint left out": lambda m: m["joint_names"].pop(),
    "a joint named twice": lambda m: m["joint_names"].__setitem__(1, m["joint_names"][0]),
    "joints in another order": lambda m: m["joint_names"].reverse(),
    "a position that is no number": lambda m: m["points"][1]["positions"].__setitem__(0, np.nan),
    "accelerations left out": lambda m: [point.update(accelerations=[]) for point in m["points"]],
}


def play(player: Path, message: Message, joints: list[str], here: list[float], period: int) -> Array | str:
    """(N, 1 + 3 n) the rows that the controller makes of a file, or why it refuses it."""
    lists = [[point["time_from_start"], *(point[name] for name in LISTS)] for point in message["points"]]
    lines = [str(period), *_write_names(joints), _write_list(here), *_write_names(message["joint_names"])]
    lines += [str(len(lists))]
    lines += [" ".join([f"{when['sec']} {when['nanosec']}", *map(_write_list, rows)]) for when, *rows in lists]
    done = subprocess.run([player], input="\n".join(lines) + "\n", capture_output=True, text=True, check=False)
    if done.returncode:
        return done.stderr.strip()
    return np.array([line.split() for line in done.stdout.splitlines()], float)


def _write_names(names: list[str]) -> list[str]:
    return [str(len(names)), *names]


def _write_list(numbers: list[float]) -> str:
    return " ".join([str(len(numbers)), *(f"{number!r}" for number in numbers)])


def compare(rows: Array, made: Plan) -> tuple[float, float, float]:
    """Pulses from the plan at most, and the largest share of a limit of speed and of acceleration that is used."""
    axes = made.machine.axes
    q, qd, qdd = np.split(rows[:, 1:], 3, axis=1)
    planned = made.trajectory.at(np.minimum(1e-9 * rows[:, 0], made.trajectory.duration)).q
    speed, acceleration = (
        [max(directional_bounds(bound)) for bound in bounds]
        for bounds in ([axis.max_speed for axis in axes], [axis.max_acceleration for axis in axes])
    )
    return (
        float((abs(q - planned) / [axis.pulse for axis in axes]).max()),
        float((abs(qd) / speed).max()),
        float((abs(qdd) / acceleration).max()),
    )


def describe(rows: Array | str, made: Plan) -> str:
    """What becomes of a file that is spoilt."""
    if isinstance(rows, str):
        return f"refused: {rows}"
    off = compare(rows, made)[0]
    return f"taken: {off:.3g} pulses from the plan at most" if np.isfinite(off) else "taken: it commands no numbers"


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("player", nargs="?", type=Path)
    parser.add_argument("--programs", default=PROGRAMS)
    parser.add_argument("--order", type=int, choices=(2, 3))
    parser.add_argument("--tolerance", type=float, help="pulses, of the export; its default where left out")
    asked = parser.parse_args()
    if asked.player is None or not asked.player.is_file():
        print(
            "there is no program around joint_trajectory_controller (github.com/ros-controls/ros2_controllers): skipped"
        )
        return
    import yaml

    rows = []
    for name in asked.programs.split(","):
        program = load_program(name)
        assert program.machine is not None
        made = plan(program, load_machine(program.machine), order=asked.order)
        with TemporaryDirectory() as place:
            stated = made.export("ros", Path(place) / "plan.yaml", tolerance=asked.tolerance).error
            message = yaml.safe_load((Path(place) / "plan.yaml").read_text())
        joints, here = message["joint_names"], message["points"][0]["positions"]
        for period in PERIODS:
            played = play(asked.player, message, joints, here, period)
            if isinstance(played, str):
                raise RuntimeError(f"{name}: joint_trajectory_controller refuses the file: {played}")
            off, speed, acceleration = compare(played, made)
            told = (len(message["points"]), f"{period / 1e6:g} ms", len(played), f"{stated:.4f}", f"{off:.4f}")
            rows.append([name, *map(str, told), f"{100 * speed:.1f} %", f"{100 * acceleration:.1f} %"])
    head = ("program", "points", "period", "rows", "stated, pulses", "off", "speed, of its limit", "acceleration")
    print(markdown(head, rows))
    faults = []
    for fault, spoil in FAULTS.items():
        spoilt = deepcopy(message)
        spoil(spoilt)
        faults.append([fault, describe(play(asked.player, spoilt, joints, here, PERIODS[0]), made)])
    away = play(asked.player, message, joints, [at + AWAY for at in here], PERIODS[0])
    if not isinstance(away, str):
        jump = (abs(away[0, 1 : 1 + len(here)] - here - AWAY) / [axis.pulse for axis in made.machine.axes]).max()
        away = f"taken: the first command is {jump:.0f} pulses from where they stand"
    faults.append([f"joints {1e3 * AWAY:g} mm or mrad away from the first point", away])
    print(markdown((f"{name}, spoilt by", "what the controller does"), faults))


if __name__ == "__main__":
    main()
