"""How fast a motion gets at most: bounds on the derivatives of its pieces, over continuous time."""

from math import comb

import numpy as np

from kinematics.array import Array
from kinematics.axis import Axis
from planner.place import Infeasible, Place
from planner.pulses.motion import Motion
from planner.pulses.pieces import Pieces
from planner.pulses.stretches import window

PARTS = 8  # of each piece: the bound's excess falls with their square


def largest(pieces: Pieces, axis: int, times: int) -> tuple[float, float]:
    """Never less than |dᵏq/dtᵏ| of an axis anywhere, k = times (1 or 2), and where (s) it is about reached.

    A polynomial lies within its Bernstein coefficients; each piece is cut in eight, where they are close to it.
    """
    count = len(pieces.start)
    lo = np.tile(np.arange(PARTS) / PARTS, count)
    part = window(np.repeat(pieces.coefficients[axis], PARTS, axis=1), lo, np.full(len(lo), 1 / PARTS))
    for _ in range(times):
        part = part[1:] * np.arange(1, len(part))[:, None]
    degree = len(part) - 1
    bernstein = [[comb(j, i) / comb(degree, i) for i in range(degree + 1)] for j in range(degree + 1)]
    length = np.repeat(pieces.length, PARTS)
    control = abs(np.array(bernstein) @ part) / (length / PARTS) ** times
    nth, worst = np.unravel_index(control.argmax(), control.shape)
    place = np.repeat(pieces.start, PARTS)[worst] + length[worst] * (lo[worst] + nth / degree / PARTS)
    return float(control[nth, worst]), float(place)


def jumps(pieces: Pieces, axis: int) -> tuple[Array, Array]:
    """Where (s) pieces meet, and by how much q̇ jumps there: by rounding, or where the error of a screw bends."""
    c = pieces.coefficients[axis]
    ends = (np.arange(6) @ c / pieces.length)[:-1]
    return pieces.start[1:], abs((c[1] / pieces.length)[1:] - ends)


def too_fast(motion: Motion, axis: Axis, t: float, rate: float, limit: float, remedy: str) -> Infeasible:
    """The refusal of a pulse rate (1/s) at t (s)."""
    place = Place(float(motion.at(np.array([t])).s[0]), t=t, axis=axis.name)
    return Infeasible("pulse rate", axis.name, place, rate, limit, "1/s", remedy)
