"""Worth of limits on acceleration, jerk and speed along a path, by the dual multipliers.

A row |r| ≤ B with the multiplier f saves f dB if B grows. Alone, it saves only until another row of
the same kind binds, as b (c under jerk) moves.
"""

import numpy as np

from kinematics.foundation.arrays import Array
from planner.bounds.dual import Multipliers
from planner.bounds.lower_bound import RowCells
from planner.bounds.rest import bound_rest, leave_rest

# Relative change of a limit for which it saves time alone.
PER_CENT = 0.01


def weigh_limits(
    cells: RowCells,
    multipliers: Multipliers,
) -> tuple[Array, Array]:
    """Return the savings (M, 3, n) per unit of relative change (s), together and alone.

    together  of each limit, if all limits that bind at the same place are raised
    alone     of each limit, if only it is raised, by one per cent

    Of the three kinds, acceleration and jerk are by axis. Speed has one value for the limit that
    binds, in the first entry.
    """
    count = len(cells.width)
    axes = cells.ends.shape[3]
    half = cells.width[:, None] / 2
    together = np.zeros((count, 3, axes))
    alone = np.zeros((count, 3, axes))
    speed = (multipliers.speed * half).sum(1)
    together[:, 2, 0] = 2 * speed
    alone[:, 2, 0] = 2 * speed
    a, b, c = np.moveaxis(multipliers.x, 2, 0)[..., None]
    root = np.sqrt(np.maximum(a, 0.0))
    first, second, third = np.moveaxis(cells.ends, 2, 0)
    acceleration = first * b + second * a
    jerk = root * (first * c + 3 * second * b + third * a)
    kinds = (
        (acceleration, first, 1.0, cells.acceleration),
        (jerk, root * first, root, cells.jerk),
    )
    for kind, (value, slope, size, bounds) in enumerate(kinds):
        force = multipliers.rows[:, :, kind]
        bound = np.where(force > 0, bounds[0], bounds[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            worth = np.abs(force) * bound / size * half[:, :, None]
            worth = np.where(np.isfinite(worth), worth, 0.0)
            # of b (of c under jerk), per relative change of an axis' bound
            change = np.sign(force) * bound / slope
            for i in range(axes):
                rate = slope * change[:, :, i : i + 1]
                room = np.where(rate > 0, bounds[0] - value, bounds[1] + value)
                growth = np.maximum(room, 0.0) / np.abs(rate)
                growth[~(np.abs(rate) > 0)] = np.inf
                growth[:, :, i] = np.inf
                share = np.fmin(growth.min(-1) / PER_CENT, 1.0)
                saved = worth[:, :, i] * share
                alone[:, kind, i] = saved.sum(1)
        together[:, kind] = worth.sum(1)
    return together, alone


def weigh_rest(
    rows: RowCells,
    side: int,
    still: int,
    inner: Array,
) -> tuple[Array, Array]:
    """Return the savings (3, n) as `weigh_limits` for a cell next to a rest.

    Only the axis that takes longest to leave the rest has any.
    """
    together, alone = np.zeros((2, *rows.ends.shape[2:]))
    leaving = leave_rest(rows, side, still)
    times = np.where(leaving.moves, leaving.time, 0.0)
    longest = int(times.argmax())

    def save(kind: int, axes: slice) -> float:
        bounds = [rows.acceleration.copy(), rows.jerk.copy()]
        bounds[kind][:, axes] *= 1 + PER_CENT
        raised = rows._replace(acceleration=bounds[0], jerk=bounds[1])
        sooner = leave_rest(raised, side, still)
        saved = bound_rest(leaving, side, inner) - bound_rest(sooner, side, inner)
        return saved / PER_CENT if np.isfinite(saved) else 0.0

    for kind in range(2):
        together[kind, longest] = save(kind, slice(None))
        alone[kind, longest] = save(kind, slice(longest, longest + 1))
    return together, alone
