"""How fast the machine is that the tests run on, so that bounds of time hold on slower ones and beside other work."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import process_time

LOOP = 300_000
WRITTEN_ON = 0.0175
"""s of CPU that the loop took on the machine that the bounds were written on."""


def slowness() -> float:
    """Times that this machine is slower, 1 at least: by the CPU time of a loop, the least of five."""
    took = []
    for _ in range(5):
        begin = process_time()
        sum(k * k for k in range(LOOP))
        took.append(process_time() - begin)
    return max(1.0, min(took) / WRITTEN_ON)


@contextmanager
def cpu_limit(seconds: float) -> Iterator[None]:
    """Holds what is done inside to s of CPU of this process, on the machine that the bounds were written on."""
    begin = process_time()
    yield
    took = process_time() - begin
    assert took < seconds or took < seconds * slowness(), f"{took:.2f} s of CPU"
