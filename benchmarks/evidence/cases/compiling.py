"""Seconds of compiling, and signatures, of each kernel that a plan and its bound need.

The time is wall time: run it on an idle computer.
"""

import os
from collections.abc import Iterator
from tempfile import TemporaryDirectory

from numba.core import event

from benchmarks.evidence.table import Table
from planner.plan import plan


def measure() -> Iterator[Table]:
    """Yield a table of the kernels of the preset circle, with nothing on disk."""
    with TemporaryDirectory() as folder, event.install_recorder("numba:compile") as recorder:
        os.environ["NUMBA_CACHE_DIR"] = folder
        assert plan("circle", "hexapod").bound
    begin: list[float] = []
    times: dict[str, list[float]] = {"all": []}
    for time, step in recorder.buffer:
        if step.is_start:
            begin.append(time)
            continue
        first = begin.pop()
        if not begin:  # else it is a helper of numba: part of its kernel
            for name in (step.data["dispatcher"].py_func.__qualname__, "all"):
                times.setdefault(name, []).append(time - first)
    rows = [[name, len(each), sum(each)] for name, each in times.items()]
    yield Table("", ("kernel", "signatures", "time (s)"), rows)
