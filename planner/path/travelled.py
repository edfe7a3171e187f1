"""How long the way along a path is: the parameter counts more on blends and less on splines (`planner.path.shape`)."""

from collections.abc import Sequence

import numpy as np

from planner.path.shape import Piece

# Panels of a piece, and points of each: exact to degree 31.
PANELS, PANEL_POINTS = 4, 16
# |dp/ds| at an end of a piece below which a turn in place is part of it, whose angle counts as the parameter has it.
MIN_WAY = 0.5


def measure_way(pieces: Sequence[Piece]) -> float:
    """m, ∫ |dp/ds| ds of the tool's tip, or the platform's origin; turns in place count as their parameter does."""
    return sum(_measure_piece(piece) for piece in pieces)


def _measure_piece(piece: Piece) -> float:
    points, weights = np.polynomial.legendre.leggauss(PANEL_POINTS)
    edges = np.linspace(0.0, piece.length, PANELS + 1)
    inside = (edges[:-1, None] + (points + 1) / 2 * piece.length / PANELS).ravel()
    s = piece.start + np.concatenate([[0.0], inside, [piece.length]])
    speed = np.linalg.norm(piece.derivatives(s)[1][:, :3], axis=1)
    if min(speed[0], speed[-1]) < MIN_WAY:
        return piece.length
    return float(np.tile(weights, PANELS) @ speed[1:-1]) * piece.length / (2 * PANELS)
