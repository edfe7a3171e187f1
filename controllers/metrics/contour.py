"""Contour error: how far a motion runs beside its path, whatever the timing; and the path as a
curve that it is held against, with what a projection onto it needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from planner.path.actuation import MachinePath
from planner.place import Place
from planner.pulses.motion import AxesMotion

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine

INSTANTS_PER_PIECE, BISECTIONS_OF_PLACE = 64, 52
"""Instants of a piece between which axes may turn back once; halvings until the instant is found to
its rounding.
"""
INSIDE_SHARE = 1e-4
"""Share of a piece by which one goes inside it for the direction at an end where the curve stands
still.
"""


class ReferenceCurve(Protocol):
    """A path r(s) in d dimensions, smooth in each of the pieces between `breaks` (P + 1,)."""

    @property
    def breaks(self) -> Array: ...
    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        """r and r′, each (N, d), at s (N,) seen from inside the given pieces (N,)."""


@dataclass(frozen=True, slots=True)
class PathCurve:
    """The platform's origin along a planned path."""

    path: MachinePath

    @property
    def breaks(self) -> Array:
        return self.path.breaks

    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        return self.path.position_derivatives(s, piece)


@dataclass(frozen=True)
class MotionCurve:
    """The axes along a motion that has no path in space: r = q (n,), and s is the time.

    Where the axes turn back on their way a piece ends, so that what is there and what is back are
    told apart.
    """

    motion: AxesMotion

    @cached_property
    def breaks(self) -> Array:
        knots = np.unique(self.motion.knots)
        share = np.arange(INSTANTS_PER_PIECE) / INSTANTS_PER_PIECE
        t = np.append((knots[:-1, None] + np.diff(knots)[:, None] * share).ravel(), knots[-1])
        speed = self.motion.at(t).qd
        back = (speed[:-1] * speed[1:]).sum(1) < 0
        low, high, forth = t[:-1][back], t[1:][back], speed[:-1][back]
        for _ in range(BISECTIONS_OF_PLACE if back.any() else 0):
            middle = (low + high) / 2
            beyond = (self.motion.at(middle).qd * forth).sum(1) < 0
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        return np.union1d(knots, high)

    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        # q and q̇ are continuous across knots
        state = self.motion.at(s)
        return state.q, state.qd


def piece_of(curve: ReferenceCurve, s: Array) -> np.ndarray:
    """The piece (N,) that each s (N,) is in; a break belongs to the one that it starts."""
    return np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)


def directions(curve: ReferenceCurve, s: Array, piece: np.ndarray) -> Array:
    """Unit tangents t̂ (N, d); zero where the curve stands still throughout, as in a turn on the
    spot.
    """
    low, high = curve.breaks[piece], curve.breaks[piece + 1]
    slope = curve.at(s, piece)[1]
    size = np.linalg.norm(slope, axis=1)
    inner = curve.at(
        np.clip(s, low + INSIDE_SHARE * (high - low), high - INSIDE_SHARE * (high - low)), piece
    )[1]
    inner_size = np.linalg.norm(inner, axis=1)
    resting = size < INSIDE_SHARE * inner_size
    slope, size = np.where(resting[:, None], inner, slope), np.where(resting, inner_size, size)
    return np.asarray(slope / np.where(size > 0, size, 1.0)[:, None])


SAGITTA_SHARE = 1e-5
"""Share of the path's extent by which a polyline may be off the curve: it finds the place, Newton
the distance.
"""
EDGE_COUNTS = 8, 1 << 14
"""Edges of a piece, at least and at most."""


@dataclass(frozen=True, slots=True)
class Polyline:
    """Vertices s (V,), r (V, d), way along it (V,), piece of each edge (V − 1,), in m (or rad) like
    the following.

    sagitta  largest distance of an edge's middle to the curve
    extent   of the whole: the diagonal of the box around it
    """

    s: Array
    r: Array
    way: Array
    piece: np.ndarray
    sagitta: float
    extent: float


def polyline(curve: ReferenceCurve) -> Polyline:
    """As few edges as the sagitta allows: a straight piece has the least number.

    Halving an edge divides its sagitta by four, so that of `EDGE_COUNTS[0]` edges tells how many
    are needed.
    """
    pieces = len(curve.breaks) - 1
    edges = np.full(pieces, EDGE_COUNTS[0])
    while True:
        piece = np.repeat(np.arange(pieces), edges)
        share = np.arange(len(piece)) - np.repeat(np.cumsum(edges) - edges, edges)
        length = np.diff(curve.breaks)[piece]
        s = np.append(curve.breaks[piece] + length * share / edges[piece], curve.breaks[-1])
        r = curve.at(s, np.append(piece, piece[-1]))[0]
        off = _edge_distances(curve.at((s[1:] + s[:-1]) / 2, piece)[0], r)
        extent = float(np.linalg.norm(np.ptp(r, axis=0)))
        worst = np.maximum.reduceat(off, np.cumsum(edges) - edges)
        short = (worst > SAGITTA_SHARE * extent) & (edges < EDGE_COUNTS[1])
        if not short.any():
            break
        wanted = edges * np.sqrt(worst / max(SAGITTA_SHARE * extent, 1e-300)) * 1.1
        edges = np.where(
            short, np.clip(np.ceil(wanted), edges + 1, EDGE_COUNTS[1]).astype(int), edges
        )
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(r, axis=0), axis=1))])
    return Polyline(s, r, way, piece, float(off.max()), extent)


def _edge_distances(points: Array, r: Array) -> Array:
    """Distance (V − 1,) of a point to each edge of vertices r (V, d): the parameter need not be
    even along an edge.
    """
    side, offset = np.diff(r, axis=0), points - r[:-1]
    share = np.clip((offset * side).sum(1) / np.maximum((side**2).sum(1), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(offset - share[:, None] * side, axis=1))


EdgePlaces = tuple[np.ndarray, Array]
"""Edge (N · B,) and share along it (N · B,), time first."""


def nearest_in_order(
    y: Array, s_reference: Array, reach: Array, line: Polyline
) -> tuple[EdgePlaces, EdgePlaces]:
    """Per point of y (N, B, d), forward only: the first point of the polyline that may be the
    nearest, and the nearest.

    They are looked for from the first of the instant before up to `reach` (N, B) beyond the planned
    s (N,). May be: within twice the sagitta of the nearest, since either may be off by one. All
    runs of an instant are searched together, each over its own edges.
    """
    instants, runs = reach.shape
    side = np.diff(line.r, axis=0)
    length2 = np.maximum((side**2).sum(1), 1e-300)
    planned = np.clip(np.searchsorted(line.s, s_reference, side="right") - 1, 0, len(side) - 1)
    stop = np.minimum(
        np.searchsorted(line.way, line.way[planned + 1][:, None] + reach, side="right"), len(side)
    )
    edge = np.clip(
        np.searchsorted(line.way, line.way[planned[0]] - reach[0], side="right") - 1, 0, planned[0]
    )
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


SAME_DISTANCE_SHARE = 1e-12
"""Share of the path's extent within which two distances are one: a hundred times the rounding of
both.
"""


@dataclass(frozen=True, slots=True)
class Contour:
    """Distance ε to the path, and the path parameter s* of the nearest point; (N,) or (N, B)."""

    error: Array
    s: Array


def contour_error(y: Array, s_reference: Array, curve: ReferenceCurve) -> Contour:
    """ε = min over s of ‖y(t) − r(s)‖ in a window that only moves forward.

    The window runs from the previous s* to π‖e‖ of path beyond s_reference, e = y − r(s_reference):
    on a path that turns less than half round there, nothing nearer lies beyond. Within it the
    nearest point of a polyline is taken, and the first that may be as near (so a path that runs
    back over itself is followed in order); from both, Newton on (y − r(s))·r′(s) = 0 inside the
    smooth piece; the first of equals is s*. r(s_reference) is a point of the path too, so ε ≤ ‖e‖
    always, also where a monotone s* waits for the motion to come back from an overshoot.

    y            (N, d) points of a motion, or (N, B, d) of a batch of runs: m, or rad on turning
                 axes
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
    s, distance = _refine_places(points, curve, line, first, reach)
    apart = np.flatnonzero((line.piece[first[0]] != line.piece[best[0]]) | (best[0] > first[0] + 1))
    other, nearer = _refine_places(
        points[apart], curve, line, (best[0][apart], best[1][apart]), reach[apart]
    )
    better = nearer < distance[apart] - SAME_DISTANCE_SHARE * line.extent
    s[apart[better]], distance[apart[better]] = other[better], nearer[better]
    forward = np.maximum.accumulate(s.reshape(tracking.shape), axis=0).ravel()
    waits = np.flatnonzero(forward != s)
    if len(waits):
        at = curve.at(forward[waits], piece_of(curve, forward[waits]))[0]
        distance[waits] = np.linalg.norm(points[waits] - at, axis=1)
    return Contour(
        freeze_array(np.minimum(distance, tracking.ravel()).reshape(shape)),
        freeze_array(forward.reshape(shape)),
    )


def _refine_places(
    y: Array, curve: ReferenceCurve, line: Polyline, at: tuple[np.ndarray, Array], reach: Array
) -> tuple[Array, Array]:
    """s (M,) and ‖y − r(s)‖ by Newton on f(s) = (y − r)·r′, inside the piece and the reach; a step
    must come nearer.

    f′ = (y − r)·r″ − r′·r′ is the secant of the last two points, or −r′·r′ at first and where the
    secant would climb.
    """
    edge, share = at
    piece = line.piece[edge]
    s: Array = line.s[edge] + share * (line.s[edge + 1] - line.s[edge])
    way = line.way[edge] + share * (line.way[edge + 1] - line.way[edge])
    # the whole edge at least, since s need not be even along it
    low = np.maximum(
        curve.breaks[piece], np.minimum(np.interp(way - reach, line.way, line.s), line.s[edge])
    )
    high = np.minimum(
        curve.breaks[piece + 1],
        np.maximum(np.interp(way + reach, line.way, line.s), line.s[edge + 1]),
    )
    miss, f, slope = _projection(y, curve, s, piece)
    damping, active = np.ones(len(s)), np.arange(len(s))
    for _ in range(40):
        size = slope[active]
        step = f[active] / np.maximum(size, 1e-300)
        # a step this short changes the distance by less than its rounding
        active = active[
            np.abs(step) * np.sqrt(size) > np.maximum(1e-9 * miss[active], 1e-16 * line.extent)
        ]
        active = active[damping[active] > 1e-3]
        if not len(active):
            break
        trial = np.clip(
            s[active] + f[active] / np.maximum(slope[active], 1e-300), low[active], high[active]
        )
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


def _projection(
    y: Array, curve: ReferenceCurve, s: Array, piece: np.ndarray
) -> tuple[Array, Array, Array]:
    """‖y − r‖, (y − r)·r′ and r′·r′, each (M,)."""
    r, tangent = curve.at(s, piece)
    offset = y - r
    distance: Array = np.linalg.norm(offset, axis=1)
    return distance, (offset * tangent).sum(1), (tangent * tangent).sum(1)


@dataclass(frozen=True, slots=True)
class PlannedStates:
    """What a motion plans at instants t (N,): axis positions q (N, n); on its curve s (N,) and
    piece (N,).

    path   None: the curve is that of the axes' own positions
    unit   of distances on the curve, m or rad
    place  what to call the k-th instant
    """

    t: Array
    q: Array
    s: Array
    piece: np.ndarray
    curve: ReferenceCurve
    path: MachinePath | None
    unit: str
    place: Callable[[int], Place]


def sample_plan(motion: AxesMotion, machine: Machine, t: Array) -> PlannedStates:
    """Raises MotionError for a motion without a path in space whose axes are of two kinds: they
    have no distance.
    """
    state = motion.at(np.minimum(t, motion.duration))
    path = getattr(motion, "path", None)
    if isinstance(path, MachinePath):
        piece = state.piece  # type: ignore[attr-defined]  # of a trajectory
        return PlannedStates(
            t,
            state.q,
            state.s,
            piece,
            PathCurve(path),
            path,
            "m",
            lambda k: path.place(float(state.s[k]), int(piece[k]), float(t[k])),
        )
    units = {axis.unit for axis in machine.axes}
    if len(units) > 1:
        raise MotionError(
            f"metrics: the motion has no path in space, and axes of machine {machine.name} in m and in rad have no "
            "common distance; plan it on the machine, or take errors per axis"
        )
    curve, since = MotionCurve(motion), np.minimum(t, motion.duration)
    return PlannedStates(
        t,
        state.q,
        since,
        piece_of(curve, since),
        curve,
        None,
        units.pop(),
        lambda k: Place(float(getattr(state, "s", t)[k]), None, float(t[k])),
    )
