"""Which of a pose's several coordinates a path uses: it starts at home's and stays on its branch, turn after turn."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array
from kinematics.machine import Machine
from planner.path.shape import Piece

# Points of a piece that are looked at first, and at most: an axis turns by less than NEAR (rad) from one to the next.
POINTS, MOST, NEAR = 65, 2**16 + 1, np.pi / 4
# How far (rad) a part of a piece may turn an axis: from its middle to the next turn's coordinates are π either way.
WIDEST = 1.5 * np.pi


def branches(machine: Machine, pieces: Sequence[Piece]) -> tuple[list[list[Piece]], list[Array]]:
    """Every piece in as many parts as its axes' turns need, and the coordinates near which each part's are meant.

    A pose alone does not tell turns or elbows. Where the machine has none, each piece is its only part.
    """
    if not machine.branched:
        return [[piece] for piece in pieces], [machine.home_q] * len(pieces)
    rotary = np.array([axis.kind == "rotary" for axis in machine.axes])
    parts: list[list[Piece]] = []
    near: list[Array] = []
    here = machine.home_q
    for piece in pieces:
        q = _followed(machine, piece, here, rotary)
        if not np.isfinite(q).all():  # out of reach: whoever looks at the limits says where
            parts.append([piece])
            near.append(here)
            continue
        here = q[-1]
        count, turning = 1, q[:, rotary]
        while count < len(q) // 2 and max(np.ptp(c, axis=0).max(initial=0.0) for c in _cut(turning, count)) > WIDEST:
            count *= 2
        parts.append(piece.cut(count))
        near += [(cell.min(0) + cell.max(0)) / 2 for cell in _cut(q, count)]
    return parts, near


def _followed(machine: Machine, piece: Piece, here: Array, rotary: np.ndarray) -> Array:
    """Coordinates (M, n) along a piece, from those near `here`, without a jump."""
    points = POINTS
    while True:
        x = _poses(piece, points)
        first = machine.inverse_map(machine.inputs(x[:1], here))
        q = machine.inverse_map(machine.inputs(x, first[0]))
        q[:, rotary] = np.unwrap(q[:, rotary], axis=0)
        if points >= MOST or not np.abs(np.diff(q[:, rotary], axis=0)).max(initial=0.0) > NEAR:
            return q
        points = 2 * points - 1


def _cut(q: Array, count: int) -> list[Array]:
    """In equal parts, each with both its ends (there is a multiple of `count` steps)."""
    step = (len(q) - 1) // count
    return [q[k * step : (k + 1) * step + 1] for k in range(count)]


def _poses(piece: Piece, points: int) -> Array:
    return piece.poses(piece.start + np.linspace(0.0, piece.length, points))
