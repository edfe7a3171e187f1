"""How long tests may take: bounds of time that hold on slower machines and beside other work, and
counts of cases.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import process_time

import numpy as np

NUMBERS = np.arange(8.0)
WORK: dict[Callable[[], object], float] = {
    lambda: sum(k * k for k in range(300_000)): 0.0175,
    lambda: {str(k): (float(f"{k}.25"), [k]) for k in range(60_000)}: 0.06,
    lambda: [np.clip(NUMBERS * 2.0, 0.0, 1.0).max() for _ in range(4_000)]: 0.011,
}
"""Arithmetic, making objects, which slows down more beside others that do, and calls of NumPy with
few numbers; and s of CPU that each took on the machine that the bounds were written on.

ASSUMPTION: the last was not measured there. Where Python was as fast as there, drawings of splines
took 1.6 times their bound's share, and these calls 0.018 s.
"""

LONG = os.environ.get("PULSEPATH_LONG_TESTS") == "1"
"""Whether many cases are to be tried where some show the same: before a release, as CONTRIBUTING.md
says.
"""


def slowness() -> float:
    """Times that this machine is slower, 1 at least: by the CPU time of two kinds of work, each the
    least of five.
    """
    return max(
        1.0, *(min(_took(work) for _ in range(5)) / written_on for work, written_on in WORK.items())
    )


def _took(work: Callable[[], object]) -> float:
    begin = process_time()
    work()
    return process_time() - begin


@contextmanager
def cpu_limit(seconds: float) -> Iterator[None]:
    """Holds what is done inside to s of CPU of this process, on the machine that the bounds were
    written on.
    """
    begin = process_time()
    yield
    took = process_time() - begin
    assert took < seconds or took < seconds * slowness(), f"{took:.2f} s of CPU"
