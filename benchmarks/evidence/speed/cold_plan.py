"""How long the command `plan` takes from nothing, in new processes, and what of it: `python -m
benchmarks.evidence.speed.cold_plan`.

The bare circle without figures is to take 3 s at most, the bundled program `circle` with figures 8 s, of wall time on
two cores that have nothing else to do. Each is run on both cores, and once on one, where no second process helps: there
every part shows its processor time, which tells more than wall time on a machine that others use. Give a number of
rounds, of which the fastest counts: `python -m benchmarks.evidence.speed.cold_plan 3`. Last, the bare circle with all
kernels compiled anew, in an empty folder: what the first plan after installing costs more.
"""

import json
import os
import resource
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

COMMANDS = {
    "bare circle, no figures": (("bare-circle", "--machine", "hexapod", "--no-figures"), 3.0),
    "circle, with figures": (("circle", "--machine", "hexapod"), 8.0),
}
"""Arguments of `plan`, and s of wall time that it may take."""

# An installed package has its bytecode on disk, also where whoever measures has told Python to write none.
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}

# The command with its steps timed, since the first line of it ran: what a process does before any step is loading.
TIMING_SCRIPT = """\
import json, sys
from contextlib import contextmanager
from time import process_time
import pulsepath.progress as progress
from pulsepath.cli import main
plain, parts = progress.step, []
@contextmanager
def timed(what):
    begin = process_time()
    with plain(what) as tell:
        yield tell
    parts.append((" ".join(word for word in what.split() if not word.isdigit()), process_time() - begin))
progress.step = timed
try:
    main(["plan", *sys.argv[1:]], standalone_mode=False)
finally:
    parts.append(("loading, reading, the rest", process_time() - sum(took for _, took in parts)))
    print(json.dumps(parts), file=sys.stderr)
"""


@dataclass(frozen=True, slots=True)
class TimedRun:
    """s of wall time, and of processor time of all processes; s of processor time of each part, where it was timed."""

    wall: float
    processor: float
    parts: dict[str, float]


def run(arguments: tuple[str, ...], *, timed: bool = False, kernels: Path | None = None) -> TimedRun:
    """A command `plan` in a new process; timed: part by part, on one core; kernels: the folder of compiled ones."""
    environment = ENVIRONMENT if kernels is None else ENVIRONMENT | {"NUMBA_CACHE_DIR": str(kernels)}
    python = ["-c", TIMING_SCRIPT] if timed else ["-m", "pulsepath", "plan"]
    cores = os.sched_getaffinity(0)
    if timed:
        os.sched_setaffinity(0, {min(cores)})  # which the new process has from this one
    try:
        with TemporaryDirectory() as folder:
            before, begin = _children_time(), perf_counter()
            out = str(Path(folder) / "out")
            command = [sys.executable, *python, *arguments, "--out", out]
            done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
            wall, processor = perf_counter() - begin, _children_time() - before
    finally:
        os.sched_setaffinity(0, cores)
    parts: dict[str, float] = {}
    for name, took in json.loads(done.stderr.splitlines()[-1]) if timed else ():
        parts[name] = parts.get(name, 0.0) + took
    return TimedRun(wall, processor, parts)


def _children_time() -> float:
    """s of processor time of all processes that were waited for, and of theirs."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(rounds: int = 1) -> None:
    print(f"load of this machine: {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} cores")
    for name, (arguments, allowed) in COMMANDS.items():
        both = min((run(arguments) for _ in range(rounds)), key=lambda one: one.wall)
        single = min((run(arguments, timed=True) for _ in range(rounds)), key=lambda one: one.processor)
        print(f"{name}: {both.wall:.1f} s of {allowed:g}; processor time {both.processor:.1f} s")
        print(f"    on one core: {single.wall:.1f} s; processor time {single.processor:.1f} s, of it")
        for part, took in single.parts.items():
            print(f"        {part:<50} {took:6.2f} s")
    bare, _ = next(iter(COMMANDS.values()))
    with TemporaryDirectory() as folder:
        anew, kept = (run(bare, kernels=Path(folder)) for _ in range(2))
    print(f"kernels compiled anew: {anew.processor - kept.processor:.0f} s of processor time")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
