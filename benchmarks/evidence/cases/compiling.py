"""Seconds of compiling, and signatures, of each kernel that a plan and its bound need."""

import os
from collections import Counter
from collections.abc import Iterator
from tempfile import TemporaryDirectory
from time import thread_time

from benchmarks.evidence.measuring import measure_apart
from benchmarks.evidence.table import Table


def measure(program: str = "circle", machine: str = "hexapod") -> Iterator[Table]:
    """Yield a table of kernels, those first that take longest: compiled anew in one process."""
    seconds, signatures = measure_apart(compile_plan, program, machine).result
    rows = [[name, signatures[name], time] for name, time in seconds.most_common()]
    rows.append(["all", signatures.total(), seconds.total()])
    yield Table("Kernels", ("kernel", "signatures", "processor time (s)"), rows)


def compile_plan(program: str, machine: str) -> tuple[Counter[str], Counter[str]]:
    """Plan with nothing on disk; return seconds and signatures of each kernel."""
    from numba.core import event

    from planner.plan import plan

    begin: list[float] = []
    seconds: Counter[str] = Counter()
    signatures: Counter[str] = Counter()

    class Timer(event.Listener):  # type: ignore[misc]
        def on_start(self, event: event.Event) -> None:
            begin.append(thread_time())

        def on_end(self, event: event.Event) -> None:
            time = thread_time() - begin.pop()
            if begin:  # a helper of numba: part of its kernel
                return
            function = event.data["dispatcher"].py_func
            name = f"{function.__module__}.{function.__qualname__}"
            seconds[name] += time
            signatures[name] += 1

    with TemporaryDirectory() as folder:
        os.environ["NUMBA_CACHE_DIR"] = folder
        event.register("numba:compile", Timer())
        assert plan(program, machine).bound
    return seconds, signatures
