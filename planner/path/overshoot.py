"""Overshoot of splines: how far each curve leaves the polygon of its points, for reports and
warnings.
"""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.facts import tabulate
from kinematics.foundation.table import Table
from planner.path.shape import Overshoot, Piece

# Places of a piece at which its distance is measured.
PIECE_PLACES = 33
# Overshoot, as a share of the shortest chord nearby, above which a user is warned. The arc through
# points 90° apart has 0.2 of its chord.
LARGE_SHARE = 0.5


def measure_overshoot(points: Array, pieces: Sequence[Piece]) -> Overshoot:
    """Measure how far the pieces of a spline through points (N+1, 3) leave their polygon, at
    PIECE_PLACES of each.

    The distance counts to the own chord or the one before or after, whichever is nearest.
    """
    share = np.linspace(0.0, 1.0, PIECE_PLACES)
    x = np.stack([piece.poses(share * piece.length)[:, :3] for piece in pieces])
    span = _find_spans(points, x[:, -1])
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    nearby = np.clip(span[:, None] + [-1, 0, 1], 0, len(chords) - 1)
    away = np.min([_distance(x, points[k], points[k + 1]) for k in nearby.T], 0)
    shortest = chords[nearby].min(1)
    farthest, place = np.unravel_index(int(away.argmax()), away.shape)
    worst = int((away.max(1) / shortest).argmax())
    lengths = np.array([piece.length for piece in pieces])
    return Overshoot(
        segment=pieces[0].segment,
        distance=float(away.max()),
        s=float(lengths[:farthest].sum() + share[place] * lengths[farthest]),
        point=int(span[worst]) + 1,
        beyond=float(away[worst].max()),
        chord=float(shortest[worst]),
    )


def _find_spans(points: Array, ends: Array) -> np.ndarray:
    """(M,) the span of each piece, whose end is one of the points or lies inside a span."""
    spans, span = [], 0
    for end in ends:
        spans.append(span)
        chord = points[span + 1] - points[span]
        if (
            np.linalg.norm(end - points[span + 1]) < 1e-6 * np.linalg.norm(chord)
            and span < len(points) - 2
        ):
            span += 1
    return np.array(spans)


def _distance(x: Array, begin: Array, end: Array) -> Array:
    """(M, K) distance of places (M, K, 3) from lines between points (M, 3)."""
    chord = (end - begin)[:, None]
    along = ((x - begin[:, None]) * chord).sum(-1) / (chord**2).sum(-1)
    nearest = begin[:, None] + np.clip(along, 0.0, 1.0)[..., None] * chord
    return np.asarray(np.linalg.norm(x - nearest, axis=-1))


def overshoot_warnings(overshoots: Sequence[Overshoot]) -> tuple[str, ...]:
    """Return warnings of splines whose overshoot is large against the shortest chord nearby."""
    return tuple(
        f"segment {one.segment}, spline: between points {one.point - 1} and {one.point} the curve is up to "
        f"{1e3 * one.beyond:.4g} mm off the straight lines through its points, {one.beyond / one.chord:.2g} of the "
        f"shortest chord nearby, {1e3 * one.chord:.4g} mm; add points there, or space them more evenly"
        for one in overshoots
        if one.beyond > LARGE_SHARE * one.chord
    )


def describe_overshoot(overshoots: Sequence[Overshoot]) -> str:
    """Return the largest overshoot of all splines, and where it is; "" without splines."""
    if not overshoots:
        return ""
    worst = max(overshoots, key=lambda one: one.distance)
    return (
        f"up to {1e3 * worst.distance:.3g} mm, at {1e3 * worst.s:.3f} mm, segment {worst.segment}"
    )


def overshoot_tables(overshoots: Sequence[Overshoot]) -> tuple[Table, ...]:
    """Return a table of the overshoot of each spline; none where there is no spline."""
    return tabulate(
        "splines: how far they leave the straight lines through their points", overshoots
    )
