"""A curve as a polyline that is searched in order, for many runs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.curve import Curve
from kinematics.array import Array

SAGITTA = 1e-5
"""Share of the path's extent by which a polyline may be off the curve: it finds the place, Newton the distance."""
EDGES = 8, 1 << 14
"""Edges of a piece, at least and at most."""


@dataclass(frozen=True, slots=True)
class Polyline:
    """Vertices s (V,), r (V, d), way along it (V,), piece of each edge (V − 1,), in m (or rad) like the following.

    sagitta  largest distance of an edge's middle to the curve
    extent   of the whole: the diagonal of the box around it
    """

    s: Array
    r: Array
    way: Array
    piece: np.ndarray
    sagitta: float
    extent: float


def polyline(curve: Curve) -> Polyline:
    """As few edges as the sagitta allows: a straight piece has the least number.

    Halving an edge divides its sagitta by four, so that of `EDGES[0]` edges tells how many are needed.
    """
    pieces = len(curve.breaks) - 1
    edges = np.full(pieces, EDGES[0])
    while True:
        piece = np.repeat(np.arange(pieces), edges)
        share = np.arange(len(piece)) - np.repeat(np.cumsum(edges) - edges, edges)
        length = np.diff(curve.breaks)[piece]
        s = np.append(curve.breaks[piece] + length * share / edges[piece], curve.breaks[-1])
        r = curve.at(s, np.append(piece, piece[-1]))[0]
        off = _beside(curve.at((s[1:] + s[:-1]) / 2, piece)[0], r)
        extent = float(np.linalg.norm(np.ptp(r, axis=0)))
        worst = np.maximum.reduceat(off, np.cumsum(edges) - edges)
        short = (worst > SAGITTA * extent) & (edges < EDGES[1])
        if not short.any():
            break
        wanted = edges * np.sqrt(worst / max(SAGITTA * extent, 1e-300)) * 1.1
        edges = np.where(short, np.clip(np.ceil(wanted), edges + 1, EDGES[1]).astype(int), edges)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(r, axis=0), axis=1))])
    return Polyline(s, r, way, piece, float(off.max()), extent)


def _beside(points: Array, r: Array) -> Array:
    """Distance (V − 1,) of a point to each edge of vertices r (V, d): the parameter need not be even along an edge."""
    side, offset = np.diff(r, axis=0), points - r[:-1]
    share = np.clip((offset * side).sum(1) / np.maximum((side**2).sum(1), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(offset - share[:, None] * side, axis=1))


Found = tuple[np.ndarray, Array]
"""Edge (N · B,) and share along it (N · B,), time first."""


def nearest_in_order(y: Array, s_reference: Array, reach: Array, line: Polyline) -> tuple[Found, Found]:
    """Per point of y (N, B, d), forward only: the first point of the polyline that may be the nearest, and the nearest.

    They are looked for from the first of the instant before up to `reach` (N, B) beyond the planned s (N,). May be:
    within twice the sagitta of the nearest, since either may be off by one. All runs of an instant are searched
    together, each over its own edges.
    """
    instants, runs = reach.shape
    side = np.diff(line.r, axis=0)
    length2 = np.maximum((side**2).sum(1), 1e-300)
    planned = np.clip(np.searchsorted(line.s, s_reference, side="right") - 1, 0, len(side) - 1)
    stop = np.minimum(np.searchsorted(line.way, line.way[planned + 1][:, None] + reach, side="right"), len(side))
    edge = np.clip(np.searchsorted(line.way, line.way[planned[0]] - reach[0], side="right") - 1, 0, planned[0])
    share = np.zeros(runs)
    alike = 2 * line.sagitta
    first = np.empty((instants, runs), np.int64), np.empty((instants, runs))
    best = np.empty((instants, runs), np.int64), np.empty((instants, runs))
    lanes = np.arange(runs)
    for k, point in enumerate(y):
        counts = np.maximum(stop[k] - edge, 1)
        starts = counts.cumsum() - counts
        lane = lanes.repeat(counts)
        at = np.arange(len(lane)) + (edge - starts).repeat(counts)
        offset = point[lane] - line.r[at]
        least = np.zeros(len(lane))
        least[starts] = share
        u = np.minimum(np.maximum((offset * side[at]).sum(1) / length2[at], least), 1.0)
        offset -= u[:, None] * side[at]
        distance = np.sqrt((offset**2).sum(1))
        smallest = np.minimum.reduceat(distance, starts)
        for found, bound in ((best, smallest), (first, smallest + alike)):
            hits = (distance <= bound.repeat(counts)).nonzero()[0]
            chosen = hits[hits.searchsorted(starts)]
            edge, share = at[chosen], u[chosen]
            found[0][k], found[1][k] = edge, share
    return (first[0].ravel(), first[1].ravel()), (best[0].ravel(), best[1].ravel())
