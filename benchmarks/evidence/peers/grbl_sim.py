"""Our G-code through grbl itself: `python -m benchmarks.evidence.peers.grbl_sim [SIMULATOR] [--programs …]`.

SIMULATOR is grbl 1.1 compiled for this computer (grbl-sim's `grbl_sim.exe`, default: the one in PATH). Each plan's
export `g93` is sent by `pulsepath send` over a pseudo terminal, to a grbl with some times the machine's limits of
acceleration: how long its own planner takes, by its own clock, beside the plan, and how many steps the axes are
off at the end. The simulator's two threads race, and a busy computer makes it pause or hang, so the shortest of some
runs is told, and how many came to no end. grbl has three axes. Skipped by name where there is no simulator.
"""

import os
import shutil
import subprocess
import sys
import tty
from argparse import ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.evidence.published.compared import markdown
from controllers.console.grbl import Controller, GcodeLine, open_port
from kinematics import load_machine
from kinematics.machine.axis import directional_bounds
from planner import Plan, load_program, plan

PROGRAMS = "linkage-line"
AXES = 3
FACTORS = (1.0, 2.0, 10.0)
"""Times the machine's acceleration that grbl is told."""
RUNS, RUN_TIMEOUT = 4, 20.0
"""Of each, and s after which one has come to no end."""
JUNCTION_DEVIATION = 1.0
"""mm: so that grbl slows down for no corner between two points."""
END = b"\x06"
"""What ends the simulator."""


def make_settings(made: Plan, factor: float) -> list[GcodeLine]:
    """Steps per mm or degree, speeds and accelerations as grbl is told them; positions of the machine in its status."""
    lines = [f"$11={JUNCTION_DEVIATION}", "$10=1", "$13=0", "$3=0"]
    for k, axis in enumerate(made.machine.axes):
        unit = 1e3 if axis.kind == "linear" else 180 / np.pi
        speed, acceleration = (max(directional_bounds(bound)) for bound in (axis.max_speed, axis.max_acceleration))
        lines.append(f"${100 + k}={1 / (axis.pulse * unit):.6f}")
        lines.append(f"${110 + k}={2 * 60 * speed * unit:.3f}")
        lines.append(f"${120 + k}={factor * acceleration * unit:.3f}")
    return [GcodeLine(0, line) for line in lines]


def run(simulator: Path, made: Plan, file: Path, factor: float, folder: Path) -> tuple[float, int]:
    """s from the first step to the last by grbl's clock, and steps that the axes are off at the end."""
    here, there = os.openpty()
    tty.setraw(here)
    tty.setraw(there)
    steps = folder / "steps.txt"
    process = subprocess.Popen(
        [str(simulator), "-n", "-t", "1", "-r", "1e-3", "-s", str(steps), "-b", str(folder / "blocks.txt")],
        stdin=here,
        stdout=here,
        cwd=folder,
    )
    try:
        port = open_port(os.ttyname(there), 115200)
        controller = Controller(port, "grbl")
        controller.wake()
        controller.stream(make_settings(made, factor))
        port.close()
        sent = [sys.executable, "-m", "pulsepath", "send", str(file), "--port", os.ttyname(there), "--anywhere"]
        done = subprocess.run(sent, capture_output=True, text=True, check=False, timeout=RUN_TIMEOUT)
        if done.returncode:
            raise RuntimeError(f"{file.name}: {done.stderr.strip()}")
        os.write(there, END)
        process.wait(RUN_TIMEOUT)
    finally:
        process.kill()
        os.close(here)
        os.close(there)
    lines = [line.replace(",", " ").split() for line in steps.read_text().splitlines() if line[:1] != "#"]
    table = np.array([line[: AXES + 1] for line in lines if len(line) > AXES], float)
    moving = np.flatnonzero(np.diff(table[:, 1:], axis=0).any(1))
    ways = table[-1, 1:] - table[0, 1:]
    state = made.trajectory.at(np.array([0.0, made.trajectory.duration])).q
    wanted = np.diff(state, axis=0)[0] / [axis.pulse for axis in made.machine.axes]
    off = np.abs(ways[: len(wanted)] - wanted).max()
    return float(table[moving[-1] + 1, 0] - table[moving[0], 0]), int(np.rint(off))


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("simulator", nargs="?", type=Path, default=shutil.which("grbl_sim.exe"))
    parser.add_argument("--programs", default=PROGRAMS)
    asked = parser.parse_args()
    if asked.simulator is None or not Path(asked.simulator).is_file():
        print("there is no grbl_sim.exe (github.com/grbl/grbl-sim in github.com/gnea/grbl): skipped")
        return
    rows = []
    for name in asked.programs.split(","):
        program = load_program(name)
        assert program.machine is not None
        made = plan(program, load_machine(program.machine))
        if len(made.machine.axes) > AXES:
            print(f"{name}: {len(made.machine.axes)} axes, and grbl has {AXES}: skipped")
            continue
        for factor in FACTORS:
            found, hung = [], 0
            for _ in range(RUNS):
                with TemporaryDirectory() as place:
                    file = Path(place) / "plan.ngc"
                    told = made.export("g93", file, letters="XYZ"[: len(made.machine.axes)])
                    lines = sum(1 for _ in file.open())
                    try:
                        found.append(run(Path(asked.simulator).resolve(), made, file, factor, Path(place)))
                    except subprocess.TimeoutExpired:
                        hung += 1
            lasts, off = min(found, default=(np.nan, -1))
            duration = made.trajectory.duration
            numbers = (f"{factor:g}", lines, f"{duration:.3f} s", f"{lasts:.3f} s", off, f"{told.error:.2f}", hung)
            rows.append([name, *map(str, numbers)])
    heading = (
        "program",
        "times the acceleration",
        "lines",
        "plan",
        "grbl",
        "steps off at the end",
        "pulses, as told",
        "hung",
    )
    print(markdown(heading, rows))


if __name__ == "__main__":
    main()
