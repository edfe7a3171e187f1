"""Runs a grid and keeps what it finds: `python -m benchmarks.sweep servo-rig --out DIR --law 6
--law ff:speed=1`.

`pulsepath compare --from DIR` makes a report of it. `--address` gives the work to an existing Dask
cluster.
"""

import sys
from argparse import ArgumentParser
from pathlib import Path
from time import perf_counter

from benchmarks.sweep import Grid, read_setting, settings_of, sweep
from controllers.laws.registry import LAWS
from controllers.rig_file import load_rig
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun


def main() -> int:
    parser = ArgumentParser(prog="python -m benchmarks.sweep", description=__doc__)
    parser.add_argument("rig", help="preset or file")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        help="folder of the runs, finished ones of which are kept",
    )
    parser.add_argument(
        "--law", action="append", help="over its own gains, or with given ones; default: all laws"
    )
    parser.add_argument("--task", action="append", help="of the rig; default: all")
    parser.add_argument("--seeds", type=int, default=1, help="how many of each")
    parser.add_argument(
        "--address", help="of a Dask scheduler; default: the cores of this computer"
    )
    asked, begin = parser.parse_args(), perf_counter()
    try:
        rig = load_rig(asked.rig)
        laws = asked.law or [names[-1] for names in LAWS]
        settings = [
            one for law in laws for one in ([read_setting(law)] if ":" in law else settings_of(law))
        ]
        tasks = asked.task or [task.name for task in rig.tasks]
        grid = Grid(tuple(settings), tuple(tasks), seeds=tuple(range(asked.seeds)))
        runs = sweep(grid, rig, asked.out, address=asked.address, progress=_tell, tell=_say)
    except MotionError as error:
        _say(f"error: {error}")
        return 2
    failed = sum(bool(result.failure) for result in runs.results.values())
    print(
        f"{count_noun(len(runs.results), 'run')} in {asked.out}, {failed} of them failed; "
        f"{perf_counter() - begin:.1f} s"
    )
    return 0


def _tell(done: int, of: int) -> None:
    _say(f"{done} of {of}")


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
