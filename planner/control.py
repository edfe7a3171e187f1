"""Where along a path the actuators lose the platform: singular poses, excluded cell by cell by guaranteed bounds."""

import numpy as np

from kinematics.array import Array
from kinematics.series import Series
from planner.actuation import MachinePath

# Smallest cell, as a share of the part that it is cut from; beyond it a singular pose counts as met.
FINEST = 2.0**-12


def singular(path: MachinePath, ends: Array, piece: np.ndarray) -> tuple[float, int] | None:
    """s and piece of the first place at which the Jacobian is not proved to be nonsingular; None where there is none.

    ends (N+1,), piece (N,): parts of the path, each within a piece. Over a cell with centre c, J = J_c + J_1 τ + J_2 τ²
    with |τ| ≤ 1; with C ≈ J_c⁻¹, ‖|I − C J_c| + |C J_1| + |C| |J_2|‖_∞ < 1 proves J nonsingular all over it. Cells that
    fail are halved.
    """
    low, width = ends[:-1], np.diff(ends)
    least = FINEST * width
    met: list[tuple[float, int]] = []
    while len(low):
        fine = _controlled(path, low, width, piece)
        hopeless = ~fine & (width <= least)
        met += zip((low + width / 2)[hopeless].tolist(), piece[hopeless].tolist(), strict=True)
        # only what lies before the first place that is met
        again = ~fine & ~hopeless & (low < min(met, default=(np.inf, 0))[0])
        half = width[again] / 2
        low, width = np.concatenate([low[again], low[again] + half]), np.concatenate([half, half])
        piece, least = np.tile(piece[again], 2), np.tile(least[again], 2)
    return min(met, default=None)


def _controlled(path: MachinePath, low: Array, width: Array, piece: np.ndarray) -> np.ndarray:
    """(N,) whether the Jacobian is proved to be nonsingular all over each cell."""
    count, half = len(low), width / 2
    # the centres of all cells, then the cells whole
    middle, scale = np.tile(low + half, 2), np.tile(half, 2)
    spread = np.concatenate([np.zeros(count), half])
    s = Series(np.stack([middle, scale]), np.stack([spread, np.zeros(2 * count)]), 2)
    with np.errstate(over="ignore", invalid="ignore"):  # metres beyond reach: unbounded, which proves nothing
        j = path.jacobian(s, np.tile(piece, 2)).padded(2)
    shape = (count, len(path.names), -1)
    at, slope, bend = (
        (j.mid[k, part].reshape(shape), j.rad[k, part].reshape(shape))
        for k, part in ((0, slice(count)), (1, slice(count)), (2, slice(count, None)))
    )
    inverse = np.linalg.pinv(np.where(np.isfinite(at[0]), at[0], 0.0))
    size = np.abs(inverse)
    with np.errstate(invalid="ignore"):
        whole = np.abs(np.eye(shape[1]) - inverse @ at[0]) + size @ at[1]
        whole = whole + np.abs(inverse @ slope[0]) + size @ (slope[1] + np.abs(bend[0]) + bend[1])
        # a little below 1, for the rounding of these lines themselves
        return np.asarray(whole.sum(-1).max(-1) < 1 - 1e-9)
