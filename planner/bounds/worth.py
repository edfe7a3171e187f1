"""The worth of limits on acceleration, jerk and speed along a path, by the multipliers of the dual problem.

A row |r| ≤ B that has the multiplier f saves f dB where B grows. Where another row of the same kind binds beside it,
one alone may not grow by much: b, or c under jerk, moves until the other has no room left.
"""

import numpy as np

from kinematics.foundation.arrays import Array
from planner.bounds.dual import DualCells, Multipliers
from planner.bounds.lower_bound import RowCells
from planner.bounds.rest import bound_rest, leave_rest

PER_CENT = 0.01


def weigh_limits(cells: DualCells, multipliers: Multipliers, took: float) -> tuple[Array, Array]:
    """Return (M, 3, n) s each, per unit of relative change: together and alone.

    Together: what each limit saves that grows with all that bind at the same place. Alone: what it saves that grows by
    itself, for a change of one per cent.

    Of each axis' acceleration and jerk; the third is of speeds, for whichever binds, in its first entry.
    took: s, the cells' unit of time.
    """
    count, axes = len(cells.width), cells.q.shape[3]
    half = took * cells.width[:, None] / 2
    together, alone = np.zeros((2, count, 3, axes))
    together[:, 2, 0] = alone[:, 2, 0] = 2 * (finite(multipliers.speed) * half).sum(1)
    x = np.where(np.isfinite(multipliers.x), multipliers.x, 1.0)
    a, b, c = (x[:, :, k, None] for k in range(3))
    root = np.sqrt(np.maximum(a, 0.0))
    first, second, third = (cells.q[:, :, k] for k in range(3))
    values = first * b + second * a, root * (first * c + 3 * second * b + third * a)
    for kind, (value, slope, size) in enumerate(zip(values, (first, root * first), (1.0, root), strict=True)):
        bounds = (cells.acceleration, cells.jerk)[kind]
        force = finite(multipliers.rows[:, :, kind])
        bound = np.where(force > 0, bounds[0], bounds[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            worth = np.where(np.isfinite(bound), np.abs(force) / size * half[:, :, None], 0.0)
            worth = finite(worth)
            together[:, kind] = worth.sum(1)
            for i in range(axes):
                # by how much the others' values go when the bound of this one grows by one of itself
                rate = slope * (np.sign(force) * bound / slope)[:, :, i : i + 1]
                room = np.where(rate > 0, bounds[0] - value, bounds[1] + value)
                growth = np.where(np.abs(rate) > 0, np.maximum(room, 0.0) / np.abs(rate), np.inf)
                growth[:, :, i] = np.inf
                share = np.minimum(growth.min(-1) / PER_CENT, 1.0)
                alone[:, kind, i] = (worth[:, :, i] * np.where(np.isfinite(share), share, 1.0)).sum(1)
    return together, alone


def weigh_rest(rows: RowCells, side: int, still: int, inner: Array) -> tuple[Array, Array]:
    """Return (3, n) s each, as `weigh_limits`, of a cell next to a rest: of the axis that takes longest to leave it."""
    together, alone = np.zeros((2, 3, rows.ends.shape[3]))
    leaving = leave_rest(rows, side, still)
    longest = int(np.where(leaving.moves, leaving.time, 0.0).argmax())

    def save(kind: int, axes: slice) -> float:
        bounds = [rows.acceleration.copy(), rows.jerk.copy()]
        bounds[kind][:, axes] *= 1 + PER_CENT
        more = leave_rest(rows._replace(acceleration=bounds[0], jerk=bounds[1]), side, still)
        saved = bound_rest(leaving, side, inner) - bound_rest(more, side, inner)
        return saved / PER_CENT if np.isfinite(saved) else 0.0

    for kind in range(2):
        together[kind, longest] = save(kind, slice(None))
        alone[kind, longest] = save(kind, slice(longest, longest + 1))
    return together, alone


def finite(values: Array) -> Array:
    """Return values, with 0 for what is no number."""
    return np.where(np.isfinite(values), values, 0.0)
