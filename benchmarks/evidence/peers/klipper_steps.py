"""Our step queues through Klipper's own firmware: `python -m benchmarks.evidence.peers.klipper_steps PLAYER`.

PLAYER is a program around Klipper's `src/stepper.c`, which makes the steps on a board; nothing of it is here. Its
arguments are the number of steppers and the ticks that STEP is high; its board's clock goes from timer to timer. It
reads an export `steps`, calls the firmware's queue_step, set_next_step_dir and reset_step_clock, and prints a line for
each rise of a step pin: stepper, tick, level of DIR; or it ends with an exit code and why the firmware stopped. Each
rise is compared with the plan's pulse: its tick, its direction. Skipped by name where there is no PLAYER.
"""

import subprocess
from argparse import ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.evidence.published.compared import markdown
from kinematics import load_machine
from planner import load_program, plan

PROGRAMS = "bare-circle,circle,arm-square,tripod-circle,traverser-scan,linkage-line"
CLOCK_HZ = 16_000_000
PULSE_TICKS = 2
"""Klipper's usual 100 ns that STEP is high with Trinamic drives, of CLOCK_HZ; with others it is 2 us."""


def step(player: Path, file: Path, axes: int, pulse_ticks: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ticks and levels of DIR at every rise of STEP, of each axis."""
    with file.open() as commands:
        done = subprocess.run(
            [player, str(axes), str(pulse_ticks)], stdin=commands, capture_output=True, text=True, check=False
        )
    if done.returncode:
        raise RuntimeError(f"{file.name}: Klipper's firmware ended with {done.stderr.strip()}")
    found = np.array([line.split() for line in done.stdout.splitlines()], np.int64).reshape(-1, 3)
    return [(mine[:, 1], mine[:, 2]) for mine in (found[found[:, 0] == k] for k in range(axes))]


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("player", type=Path, nargs="?")
    parser.add_argument("--programs", default=PROGRAMS)
    parser.add_argument("--pulse-ticks", type=int, default=PULSE_TICKS)
    asked = parser.parse_args()
    if asked.player is None or not asked.player.is_file():
        print("there is no PLAYER around Klipper's firmware (github.com/Klipper3d/klipper): skipped")
        return
    rows = []
    with TemporaryDirectory() as place:
        folder = Path(place)
        for name in asked.programs.split(","):
            program = load_program(name)
            assert program.machine is not None
            made = plan(program, load_machine(program.machine), clock_hz=CLOCK_HZ)
            for within in (0.0, 1e-6):
                file = folder / "plan.steps"
                made.export("steps", file, within=within, force=True)
                commands = sum(line.startswith("queue_step") for line in file.open())
                late, wrong, pulses = 0, 0, 0
                for (ticks, level), own, axis in zip(
                    step(asked.player.resolve(), file, len(made.pulses.axes), asked.pulse_ticks),
                    made.pulses.axes,
                    made.machine.axes,
                    strict=True,
                ):
                    pulses += len(own)
                    same = min(len(ticks), len(own))
                    wrong += abs(len(ticks) - len(own))
                    wrong += int(((2 * level - 1)[:same] * axis.direction != own.direction[:same]).sum())
                    late = max(late, int(abs(ticks[:same] - own.ticks[:same]).max(initial=0)))
                told = (f"{1e6 * within:g} us", pulses, commands, wrong, f"{1e6 * late / CLOCK_HZ:.3g} us")
                rows.append([name, *map(str, told)])
    print(markdown(("program", "within", "pulses", "commands", "missing or of wrong direction", "most off"), rows))


if __name__ == "__main__":
    main()
