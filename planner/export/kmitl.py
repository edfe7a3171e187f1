"""What the formats of the three-armed machine share: who it is, points along its path, and its numbers as text.

[KMITL 2005]: lengths are in units; 500 counts make one, and a digital differential analyser (DDA) runs from listed
point to listed point. Its reader takes seven characters for a number, and counts lines in 16 bits.
"""

from math import ceil

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from kinematics.tripod import Tripod
from planner.actuation import ActuatorPath
from planner.export.format import Source, refuse_compensated

UNIT = 1e-3
"""m. ASSUMPTION: the source does not say what its unit is; this machine's 25 000 pulses per mm fit 500 · 50."""
DIGITS = 7
LAST = 32_767
"""The largest number of a line: Visual Basic's Integer."""


def tripod_of(source: Source, format_: str) -> Tripod:
    """The machine. Raises MotionError for another kind, by name."""
    if not isinstance(source.machine, Tripod):
        kind = type(source.machine).__name__.lower()
        raise MotionError(f"{format_}: machine {source.machine.name} is a {kind}; the format is a tripod's, three arms")
    refuse_compensated(source, format_)
    return source.machine


def length(value: float, what: str) -> float:
    """A positive length that was given as an option. Raises MotionError for another."""
    if not 0 < value < float("inf"):
        raise MotionError(f"kmitl: {what} {value} m must be positive and finite")
    return value


def along(path: ActuatorPath, piece: int, count: int) -> tuple[Array, np.ndarray]:
    """Path length s and piece, each (count + 1,), of equal steps from end to end of a piece."""
    begin, end = path.breaks[piece], path.breaks[piece + 1]
    return begin + (end - begin) * np.arange(count + 1) / count, np.full(count + 1, piece)


def steps(path: ActuatorPath, piece: int, step: float) -> int:
    """How many equal steps of a piece are no longer than `step`."""
    whole = float(path.breaks[piece + 1] - path.breaks[piece]) / step
    return max(1, ceil(whole - 1e-9))


def number(value: float, what: str) -> str:
    """A number in seven characters, as many decimals as fit. Raises MotionError for one that does not."""
    for decimals in range(DIGITS - 2, -1, -1):
        text = f"{value:.{decimals}f}"
        if len(text) <= DIGITS:
            return "0" + text[2:] if text.startswith("-0") and float(text) == 0 else text
    raise MotionError(f"kmitl: {what} {value:.6g} units needs more than {DIGITS} characters; choose a longer unit")


def numbered(count: int, first: int, what: str) -> None:
    """Raises MotionError for more points than the source's numbers reach."""
    if first + count - 1 > LAST:
        raise MotionError(
            f"kmitl: {count} {what}, numbered from {first}; the source counts to {LAST}: list fewer points"
        )
