"""How steady the tool's speed is where a motion claims it constant: proved over continuous time, both ways."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.facts import Fact
from planner.certificate.cells import Cells
from planner.certificate.enclosure import bound_series, enclose
from planner.limits.tool import squared_norm
from planner.place import Place
from planner.trajectory import Trajectory

CONSTANT_SPEED = "constant speed"
"""What it is called in a certificate: the largest deviation that is proved, over the one that is allowed."""
SPEED_TOLERANCE = 1e-9
"""The share by which a constant speed may differ from the one that is asked for."""
# Order of the expansions, cells looked at together, and how often a cell is halved at most.
EXPANSION, CELL_BATCH, MAX_HALVINGS = 6, 1024, 12


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of a motion at exactly `speed` (m/s), from one place to another.

    deviation: the share of it by which the tool's speed differs at most, proved over continuous time
    """

    speed: Annotated[float, Fact("speed_m_s")]
    deviation: Annotated[float, Fact("largest_deviation")]
    since: Annotated[Place, Fact("from")]
    until: Annotated[Place, Fact("to")]


def find_stretches(trajectory: Trajectory, use: Array) -> tuple[Stretch, ...]:
    """Where a motion has the constant speeds that its segments ask for; use (M,): as its certificate has it."""
    path, speed = trajectory.path, trajectory.constant_speeds
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.isfinite(speed), [False]])))
    found = []
    for first, last in zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True):
        start, end = (float(trajectory.knots[k]) for k in (first, last + 1))
        s = float(trajectory.s[last] + trajectory.v[last] * (end - trajectory.knots[last]))
        since = path.place(float(trajectory.s[first]), int(trajectory.piece[first]), start)
        until = path.place(s, int(trajectory.piece[last]), end)
        deviation = SPEED_TOLERANCE * float(use[first : last + 1].max())
        found.append(Stretch(float(speed[first]), deviation, since, until))
    return tuple(found)


def prove_speed_deviation(trajectory: Trajectory) -> tuple[Array, Array, Place]:
    """The share of SPEED_TOLERANCE by which the tool's speed differs from the one claimed, at most in each piece (M,).

    As it is proved, by enclosures of |ṗ|² (planner.certificate.enclosure), as it is met at the cells' ends and
    centres, and the place of the largest.
    """
    speed, lengths = trajectory.constant_speeds, np.diff(trajectory.knots)
    use, attained = np.zeros((2, len(lengths)))
    k = np.flatnonzero(np.isfinite(speed))
    cells = Cells(k, np.zeros(len(k)), lengths[k])
    for halvings in range(MAX_HALVINGS + 1):
        bound, met = _bound_deviation(trajectory, cells, speed[cells.k])
        np.maximum.at(attained, cells.k, met)
        loose = (bound > 1) & (met <= 1) & (halvings < MAX_HALVINGS)
        np.maximum.at(use, cells.k[~loose], bound[~loose])
        if not loose.any():
            break
        cells = cells[loose].parts(2)
    worst = int(np.argmax(use))
    s, piece, t = (values[worst] for values in (trajectory.s, trajectory.piece, trajectory.knots))
    return use, attained, trajectory.path.place(float(s), int(piece), float(t), "tool")


def _bound_deviation(trajectory: Trajectory, cells: Cells, speed: Array) -> tuple[Array, Array]:
    """Over each of N cells, what is proved and what is met."""
    bound, met = np.empty((2, len(cells.k)))
    for first in range(0, len(cells.k), CELL_BATCH):
        chosen = np.arange(first, min(first + CELL_BATCH, len(cells.k)))
        some, asked = cells[chosen], speed[chosen, None]
        with np.errstate(invalid="ignore", over="ignore"):
            low, high = bound_series(
                squared_norm(enclose(trajectory, some, EXPANSION).tool_rate(1), range(3)), len(chosen)
            )
        bound[chosen] = np.maximum(_deviation(low, asked), _deviation(high, asked))[:, 0]
        places = np.concatenate([some.lo, (some.lo + some.hi) / 2, some.hi])
        seen = squared_norm(trajectory.within(np.tile(some.k, 3), places).tool_rate(1), range(3))
        met[chosen] = _deviation(seen, np.tile(asked, (3, 1))).reshape(3, -1).max(0)
    return np.where(np.isnan(bound), np.inf, bound), met


def _deviation(square: Array, speed: Array) -> Array:
    """||ṗ|/v − 1| over SPEED_TOLERANCE, from |ṗ|²."""
    return np.asarray(np.abs(np.sqrt(np.maximum(square, 0.0)) / speed - 1) / SPEED_TOLERANCE)
