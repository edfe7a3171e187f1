"""Contour error: how far a motion runs beside its path, whatever the time it takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.curve import Curve
from kinematics.array import Array, frozen

VERTICES = 1 << 14
"""Vertices of the polyline that is searched, at least 64 per piece: nanometres of sagitta on paths of centimetres."""


@dataclass(frozen=True, slots=True)
class Contour:
    """Distance ε (N,) to the path, and the path parameter s* (N,) of the nearest point."""

    error: Array
    s: Array


def contour_error(y: Array, s_reference: Array, curve: Curve) -> Contour:
    """ε = min over s of ‖y(t) − r(s)‖ in a window that only moves forward.

    The window runs from the previous s* to s_reference + π‖e‖, e = y − r(s_reference): on a path that turns less than
    half round there, nothing nearer lies beyond. Within it the nearest point of a fine polyline is taken, the first of
    equals (so a path that runs back over itself is followed in order), then Newton on (y − r(s))·r′(s) = 0 inside the
    smooth piece. r(s_reference) is a point of the path too, so ε ≤ ‖e‖ always, also where a monotone s* waits for the
    motion to come back from an overshoot.

    y            (N, 3) points of the motion, m
    s_reference  (N,) path parameter of the point planned at the same instant
    """
    s_reference = np.clip(s_reference, curve.breaks[0], curve.breaks[-1])
    tracking = np.linalg.norm(y - curve.at(s_reference, _piece(curve, s_reference))[0], axis=1)
    line = _polyline(curve)
    reach = np.pi * tracking
    at = _follow(y, s_reference, reach, line)
    s = np.maximum.accumulate(_refine(y, curve, line, at, reach))
    distance = np.linalg.norm(y - curve.at(s, _piece(curve, s))[0], axis=1)
    return Contour(frozen(np.minimum(distance, tracking)), frozen(s))


@dataclass(frozen=True, slots=True)
class _Polyline:
    """Vertices s (V,) and r (V, 3), piece of each edge (V − 1,), largest distance of an edge's middle to the curve."""

    s: Array
    r: Array
    piece: np.ndarray
    sagitta: float


def _piece(curve: Curve, s: Array) -> np.ndarray:
    return np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)


def _polyline(curve: Curve) -> _Polyline:
    lengths = np.diff(curve.breaks)
    edges = np.maximum(np.ceil(VERTICES * lengths / max(lengths.sum(), 1e-300)).astype(int), 64)
    piece = np.repeat(np.arange(len(lengths)), edges)
    start = np.concatenate([curve.breaks[p] + lengths[p] * np.arange(n) / n for p, n in enumerate(edges)])
    s = np.concatenate([start, curve.breaks[-1:]])
    r = curve.at(s, np.append(piece, piece[-1]))[0]
    middle = curve.at((s[1:] + s[:-1]) / 2, piece)[0]
    return _Polyline(s, r, piece, float(np.linalg.norm(middle - (r[1:] + r[:-1]) / 2, axis=1).max()))


def _follow(y: Array, s_reference: Array, reach: Array, line: _Polyline) -> tuple[np.ndarray, Array]:
    """Edge (N,) and share along it (N,) of the nearest point, forward only."""
    edge, share = np.empty(len(y), np.int64), np.empty(len(y))
    side = np.diff(line.r, axis=0)
    length2 = np.maximum((side**2).sum(1), 1e-300)
    stop = np.minimum(np.searchsorted(line.s, s_reference + reach, side="right"), len(side))
    i = max(int(np.searchsorted(line.s, s_reference[0] - reach[0], side="right")) - 1, 0)
    for k, point in enumerate(y):
        window = slice(i, max(int(stop[k]), i + 1))
        offset = point - line.r[window]
        u = np.minimum(np.maximum((offset * side[window]).sum(1) / length2[window], 0.0), 1.0)
        offset -= u[:, None] * side[window]
        distance = np.sqrt((offset**2).sum(1))
        first = int(np.argmax(distance <= distance.min() + line.sagitta))
        i += first
        edge[k], share[k] = i, u[first]
    return edge, share


def _refine(y: Array, curve: Curve, line: _Polyline, at: tuple[np.ndarray, Array], reach: Array) -> Array:
    """Newton on f(s) = (y − r)·r′, kept inside the piece and the reach; a step must come nearer.

    f′ = (y − r)·r″ − r′·r′ is −r′·r′ at first and the secant of the last two points then.
    """
    edge, share = at
    piece = line.piece[edge]
    s: Array = line.s[edge] + share * (line.s[edge + 1] - line.s[edge])
    low, high = np.maximum(curve.breaks[piece], s - reach), np.minimum(curve.breaks[piece + 1], s + reach)
    miss, f, slope = _projection(y, curve, s, piece)
    damping, active = np.ones(len(s)), np.arange(len(s))
    for _ in range(40):
        step = damping[active] * f[active] / np.maximum(slope[active], 1e-300)
        trial = np.clip(s[active] + step, low[active], high[active])
        moved = trial - s[active]
        miss_there, f_there, _ = _projection(y[active], curve, trial, piece[active])
        nearer = miss_there < miss[active]
        damping[active[~nearer]] /= 4
        won = active[nearer]
        secant = (f[won] - f_there[nearer]) / moved[nearer]
        # beyond the centre of curvature Newton would climb: there the last slope stays
        slope[won] = np.where(secant > 0, secant, slope[won])
        s[won], f[won], miss[won] = trial[nearer], f_there[nearer], miss_there[nearer]
        active = active[(moved != 0) & (damping[active] > 1e-3)]
        if not len(active):
            break
    return s


def _projection(y: Array, curve: Curve, s: Array, piece: np.ndarray) -> tuple[Array, Array, Array]:
    """‖y − r‖, (y − r)·r′ and r′·r′, each (N,)."""
    r, tangent = curve.at(s, piece)
    offset = y - r
    distance: Array = np.linalg.norm(offset, axis=1)
    return distance, (offset * tangent).sum(1), (tangent * tangent).sum(1)
