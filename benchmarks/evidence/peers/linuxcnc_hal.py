"""Our files through LinuxCNC's own HAL: `python -m benchmarks.evidence.peers.linuxcnc_hal [--programs circle,…]`.

Each plan is exported for halstreamer, in counts and in mm, and streamed by it into a real-time thread of 1 ms, where
halsampler takes every sample back: rows that differ, counts and mm off, samples that were lost; and what becomes of a
line that is none. It needs LinuxCNC 2.9, Debian's package linuxcnc-uspace (simulation, no real-time kernel); where that
is not installed, it says so.
"""

import os
import shutil
import subprocess
from argparse import ArgumentParser
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.evidence.published.compared import markdown
from kinematics import load_machine
from planner import load_program, plan

PROGRAMS = "bare-circle,circle,arm-square,tripod-circle,traverser-scan,linkage-line"
NOBODY = 65534
"""LinuxCNC's real-time part refuses to be root's."""
MORE, DEPTH = 50, 4000
"""Samples behind the last line, and of the stream's buffer."""
STARTED = 2.0
"""s that it takes to fill the buffer, before the thread starts."""


@dataclass(frozen=True, slots=True)
class HalSamples:
    """What came out of HAL: rows, the largest difference from the file's, how many rows differ, and lost samples."""

    rows: int
    off: float
    different: int
    lost: int


def write_script(folder: Path, file: Path, kind: str, axes: int, taken: int) -> Path:
    """What HAL is to do: stream the file, and take so many samples."""
    pins = "\n".join(f"net x{k} streamer.0.pin.{k} sampler.0.pin.{k}" for k in range(axes))
    script = folder / "stream.hal"
    script.write_text(
        f"""loadrt threads name1=servo period1=1000000
loadrt streamer depth={DEPTH} cfg={kind * axes}
loadrt sampler depth={taken + DEPTH} cfg={kind * axes}
addf streamer.0 servo
addf sampler.0 servo
{pins}
loadusr halstreamer {file}
loadusr -w sleep {STARTED}
start
loadusr -w halsampler -n {taken} {folder / "sampled.txt"}
getp sampler.0.overruns
"""
    )
    return script


def run_script(script: Path, taken: int) -> str:
    """What halrun prints."""
    done = subprocess.run(
        ["halrun", "-f", str(script)],
        capture_output=True,
        text=True,
        timeout=60 + 2e-3 * taken,
        env={**os.environ, "HOME": str(script.parent)},
        user=NOBODY if os.geteuid() == 0 else None,
        check=False,
    )
    return done.stdout


def stream(file: Path, kind: str, axes: int, folder: Path) -> HalSamples:
    """A file's rows through streamer and sampler, kind "s" for whole numbers and "f" for others."""
    given = np.loadtxt(file, ndmin=2)
    taken = len(given) + MORE
    printed = run_script(write_script(folder, file, kind, axes, taken), taken).split()
    got = np.loadtxt(folder / "sampled.txt", ndmin=2)
    begin = int(np.argmax((got != got[0]).any(1))) - int(np.argmax((given != given[0]).any(1)))
    there = got[max(begin, 0) :][: len(given)]
    difference = np.abs(there - given[: len(there)])
    limit = 0.0 if kind == "s" else 0.6e-6  # halsampler prints six decimals
    lost = int(printed[-1]) if printed else -1
    return HalSamples(len(there), float(difference.max()), int((difference > limit).any(1).sum()), lost)


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--programs", default=PROGRAMS)
    asked = parser.parse_args()
    if shutil.which("halrun") is None:
        print("LinuxCNC is not installed (Debian's package linuxcnc-uspace): skipped")
        return
    rows = []
    for name in asked.programs.split(","):
        program = load_program(name)
        assert program.machine is not None
        made = plan(program, load_machine(program.machine))
        for unit, kind in (("counts", "s"), ("mm", "f")):
            with TemporaryDirectory() as folder:
                place = Path(folder)
                place.chmod(0o777)  # what is not root's writes here, too
                file = place / "plan.txt"
                told = made.export("halstreamer", file, unit=unit)
                found = stream(file, kind, len(made.machine.axes), place)
                lines = sum(1 for _ in file.open())
            told_of = (lines, found.rows, found.different, f"{found.off:.2g}", found.lost, f"{told.error:.3g}")
            rows.append([name, unit, *map(str, told_of)])
    heading = ("program", "unit", "lines", "rows back", "that differ", "most off", "lost", "pulses from the plan")
    print(markdown(heading, rows))
    with TemporaryDirectory() as folder:
        place = Path(folder)
        place.chmod(0o777)
        file = place / "plan.txt"
        file.write_text("0 0\n1 1\n2 two\n3 3\n")
        run_script(write_script(place, file, "f", 2, 100), 100)
        took = (place / "sampled.txt").read_text().split("\n")
    seen = ", ".join(dict.fromkeys(line.strip() for line in took if line))
    print(f"\nof the lines 0 0, 1 1, 2 two, 3 3 come out: {seen}")


if __name__ == "__main__":
    main()
