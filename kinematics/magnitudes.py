"""How large and how small quantities may be: far beyond any machine, and well within what arithmetic can hold."""

from math import isfinite, pi

FARTHEST, MOST_TURNS, LONGEST, MOST = 1e5, 10_000, 1e9, 1e15
"""m, turns, s, and any other SI unit: the largest magnitude that a file or a program may state."""
LEAST = 1e-15
"""The smallest of what must be above zero, SI: a motion of a proton's size."""
_MOST = {"m": FARTHEST, "rad": 2 * pi * MOST_TURNS, "s": LONGEST}


def most(unit: str) -> float:
    """The largest magnitude in an SI unit ("m", "rad", "s", "m/s", …)."""
    return _MOST.get(unit, MOST)


def within(value: float, unit: str) -> bool:
    """Whether a number is finite and no larger than its unit allows."""
    return isfinite(value) and abs(value) <= most(unit)
