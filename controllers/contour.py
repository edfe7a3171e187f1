"""Contour error: how far a motion runs beside its path, whatever the time it takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.curve import Curve, piece_of
from controllers.polyline import Polyline, nearest_in_order, polyline
from kinematics.array import Array, frozen

ALIKE = 1e-12
"""Share of the path's extent within which two distances are one: a hundred times the rounding of both."""


@dataclass(frozen=True, slots=True)
class Contour:
    """Distance ε to the path, and the path parameter s* of the nearest point; (N,) or (N, B)."""

    error: Array
    s: Array


def contour_error(y: Array, s_reference: Array, curve: Curve) -> Contour:
    """ε = min over s of ‖y(t) − r(s)‖ in a window that only moves forward.

    The window runs from the previous s* to π‖e‖ of path beyond s_reference, e = y − r(s_reference): on a path that
    turns less than half round there, nothing nearer lies beyond. Within it the nearest point of a polyline is taken,
    and the first that may be as near (so a path that runs back over itself is followed in order); from both, Newton on
    (y − r(s))·r′(s) = 0 inside the smooth piece; the first of equals is s*. r(s_reference) is a point of the path too,
    so ε ≤ ‖e‖ always, also where a monotone s* waits for the motion to come back from an overshoot.

    y            (N, d) points of a motion, or (N, B, d) of a batch of runs: m, or rad on turning axes
    s_reference  (N,) path parameter of the point planned at the same instant
    """
    shape, lanes = y.shape[:-1], y.reshape(len(y), -1, y.shape[-1])
    s_reference = np.clip(s_reference, curve.breaks[0], curve.breaks[-1])
    reference = curve.at(s_reference, piece_of(curve, s_reference))[0]
    tracking = np.linalg.norm(lanes - reference[:, None], axis=2)
    line = polyline(curve)
    reach = np.pi * tracking
    first, best = nearest_in_order(lanes, s_reference, reach, line)
    points, reach = lanes.reshape(-1, lanes.shape[-1]), reach.ravel()
    s, distance = _refined(points, curve, line, first, reach)
    apart = np.flatnonzero((line.piece[first[0]] != line.piece[best[0]]) | (best[0] > first[0] + 1))
    other, nearer = _refined(points[apart], curve, line, (best[0][apart], best[1][apart]), reach[apart])
    better = nearer < distance[apart] - ALIKE * line.extent
    s[apart[better]], distance[apart[better]] = other[better], nearer[better]
    forward = np.maximum.accumulate(s.reshape(tracking.shape), axis=0).ravel()
    waits = np.flatnonzero(forward != s)
    if len(waits):
        at = curve.at(forward[waits], piece_of(curve, forward[waits]))[0]
        distance[waits] = np.linalg.norm(points[waits] - at, axis=1)
    return Contour(
        frozen(np.minimum(distance, tracking.ravel()).reshape(shape)),
        frozen(forward.reshape(shape)),
    )


def _refined(y: Array, curve: Curve, line: Polyline, at: tuple[np.ndarray, Array], reach: Array) -> tuple[Array, Array]:
    """s (M,) and ‖y − r(s)‖ by Newton on f(s) = (y − r)·r′, inside the piece and the reach; a step must come nearer.

    f′ = (y − r)·r″ − r′·r′ is the secant of the last two points, or −r′·r′ at first and where the secant would climb.
    """
    edge, share = at
    piece = line.piece[edge]
    s: Array = line.s[edge] + share * (line.s[edge + 1] - line.s[edge])
    way = line.way[edge] + share * (line.way[edge + 1] - line.way[edge])
    # the whole edge at least, since s need not be even along it
    low = np.maximum(curve.breaks[piece], np.minimum(np.interp(way - reach, line.way, line.s), line.s[edge]))
    high = np.minimum(curve.breaks[piece + 1], np.maximum(np.interp(way + reach, line.way, line.s), line.s[edge + 1]))
    miss, f, slope = _projection(y, curve, s, piece)
    damping, active = np.ones(len(s)), np.arange(len(s))
    for _ in range(40):
        size = slope[active]
        step = f[active] / np.maximum(size, 1e-300)
        # a step this short changes the distance by less than its rounding
        active = active[np.abs(step) * np.sqrt(size) > np.maximum(1e-9 * miss[active], 1e-16 * line.extent)]
        active = active[damping[active] > 1e-3]
        if not len(active):
            break
        trial = np.clip(s[active] + f[active] / np.maximum(slope[active], 1e-300), low[active], high[active])
        trial = s[active] + damping[active] * (trial - s[active])
        moved = trial - s[active]
        miss_there, f_there, slope_there = _projection(y[active], curve, trial, piece[active])
        nearer = miss_there < miss[active]
        damping[active[~nearer]] /= 4
        won = active[nearer]
        damping[won] = np.minimum(4 * damping[won], 1.0)
        secant = (f[won] - f_there[nearer]) / moved[nearer]
        # beyond the centre of curvature Newton would climb
        slope[won] = np.where(secant > 0, secant, slope_there[nearer])
        s[won], f[won], miss[won] = trial[nearer], f_there[nearer], miss_there[nearer]
        active = active[moved != 0]
    return s, miss


def _projection(y: Array, curve: Curve, s: Array, piece: np.ndarray) -> tuple[Array, Array, Array]:
    """‖y − r‖, (y − r)·r′ and r′·r′, each (M,)."""
    r, tangent = curve.at(s, piece)
    offset = y - r
    distance: Array = np.linalg.norm(offset, axis=1)
    return distance, (offset * tangent).sum(1), (tangent * tangent).sum(1)
