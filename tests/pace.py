"""How fast the machine is that the tests run on, so that bounds of time hold on slower ones too."""

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
