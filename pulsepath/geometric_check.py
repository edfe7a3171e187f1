"""The check of a path that needs no timing: what it violates, or how near it comes to each limit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics import Machine, MotionError, OutOfReach
from planner import Place, Program
from planner.limits import limits_of
from planner.plan import actuate
from planner.standing import POINTS, at_rest, violations


@dataclass(frozen=True, slots=True)
class GeometricCheck:
    """Every violation of travel, tilt or reach, the worst first; where there is none, the largest use of each limit."""

    violations: Sequence[MotionError]
    largest: dict[str, tuple[float, Place]]


def check(program: Program, machine: Machine) -> GeometricCheck:
    """Look at a program's path at 201 places of every piece. Raises MotionError for a path that cannot be drawn."""
    path = actuate(program, machine)
    limits = [limit for limit in limits_of(path, machine.axes, 2) if limit.geometric]
    try:
        found = violations(path, limits)
    except OutOfReach as error:
        return GeometricCheck([error], {})
    if found:
        return GeometricCheck(found, {})
    piece = np.repeat(np.arange(len(path.pieces)), POINTS)
    s = np.linspace(path.breaks[:-1], path.breaks[1:], POINTS, axis=1).ravel()
    state = at_rest(path, s, piece)
    largest = {}
    for limit in limits:
        value = limit.value(state)
        use = limit.use(value, value, piece)
        row, channel = (int(n) for n in np.unravel_index(int(np.argmax(use)), use.shape))
        place = Place(float(s[row]), path.segment(int(piece[row])), None, limit.channels[channel])
        largest[limit.name] = (float(use[row, channel]), place)
    return GeometricCheck([], largest)
