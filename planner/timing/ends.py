"""Speeds at a run's ends that no motion can have."""

import numpy as np

from kinematics.foundation.errors import MotionError
from planner.limits.limit import Term
from planner.timing.problem import POWERS, Problem

# Halvings that find a largest speed: to rounding.
HALVINGS = 50


class TooFast(MotionError):
    """A run's start or end speed ṡ for which the limits leave no room; largest: what can be; both: only
    beside a rest at the other end, whose speed is too high as well.

    Solvers raise it; whoever knows the path says where that is.
    """

    def __init__(self, end: int, speed: float, largest: float, both: bool = False) -> None:
        self.end, self.speed, self.largest, self.both = end, speed, largest, both
        super().__init__(
            f"the {self.name} {speed:.6g} is beyond {largest:.6g}, the largest from which the run can be made"
        )

    @property
    def name(self) -> str:
        return ("start speed", "end speed")[self.end]


def largest_end_speed(problem: Problem, end: int) -> float:
    """The largest speed at an end, up to the problem's, at which the rows without s⃛ leave room there, s̈ being 0.

    A solver keeps such rows inside a run only: at its ends there is nothing to choose between given speeds.
    """
    last = problem.intervals - 1
    there = problem.part(slice(last, last + 1) if end else slice(0, 1))
    low, high = 0.0, problem.speeds[end]
    if _has_room(there, end, high):
        return high
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _has_room(there, end, middle) else (low, middle)
    return low


def _has_room(there: Problem, end: int, speed: float) -> bool:
    """Whether the rows at the start or the end of one interval leave room for a speed."""
    for block in there.around(np.array([speed]), np.array([speed])).blocks:
        side = block.end if end else block.start
        if Term.SDDD in side:
            continue
        used = sum(values[0] * speed ** POWERS[term] for term, values in side.items() if term in POWERS)
        if np.max(block.share(used)) > 1:
            return False
    return True
