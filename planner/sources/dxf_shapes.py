"""Strokes of DXF entities: exact for lines and arcs, fitted for ellipses and splines.

The points of a fitted curve are so dense that the spline through them stays within a tolerance of
the curve. An entity of a block is mapped to the drawing before anything is fitted. So a circle in a
block with two different scale factors becomes an ellipse, and a mirrored arc turns the other way.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import atan, hypot, isfinite, pi, radians, tau
from typing import Any, TypeVar

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.path.spline import draw_through, sample_splines
from planner.program.model import MIN_MOVE
from planner.sources.dxf_blocks import Placement
from planner.sources.stroke import Chain, Stroke, arc, cross_product, curve, line

FIRST_POINTS, MAX_ROUNDS, MAX_POINTS = 17, 40, 20_000
"""Points to begin with, how often spans are halved, and points at most."""
SPAN_SHARES = np.arange(1, 8) / 8
"""Places of a span where its distance from the curve is measured."""
NEWTON_STEPS = 2
"""Steps towards the nearest point of the curve.

A remaining error makes the distance larger, never smaller.
"""

Curve = Callable[[Array], tuple[Array, Array]]
"""Points (N, 3) and their first derivatives at parameters (N,)."""
Corner = TypeVar("Corner")


def fit_spline(curve: Curve, low: float, high: float, tolerance: float) -> tuple[Array, float]:
    """Return points (N, 3) from low to high, and the largest distance (m) of the spline through
    them from the curve.

    Spans farther from it than the tolerance are halved, together with their neighbours. The
    distance is measured at seven places of each span, to the nearest point of the curve. Raises
    MotionError where halving does not end.
    """
    t = np.linspace(low, high, FIRST_POINTS)
    for _ in range(MAX_ROUNDS):
        points = curve(t)[0]
        spans = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if not np.isfinite(points).all() or spans.min() == 0 or len(t) > MAX_POINTS:
            break
        off = _curve_deviation(curve, t, points)
        bad = off > tolerance
        if not bad.any():
            off = _drawn_deviation(curve, t, points)
            bad = off > tolerance
        if not bad.any():
            return points, float(off.max())
        bad[1:] |= bad[:-1].copy()
        bad[:-1] |= bad[1:].copy()
        t = np.sort(np.concatenate([t, (t[:-1] + t[1:])[bad] / 2]))
    raise MotionError(
        f"no smooth curve follows it within {tolerance * 1e3:g} mm; explode it into lines and arcs"
    )


def _curve_deviation(curve: Curve, t: Array, points: Array) -> Array:
    """m, the largest distance of each span from the curve."""
    return _measure_places(curve, t, sample_splines(points, SPAN_SHARES)[0], np.arange(len(t) - 1))


def _drawn_deviation(curve: Curve, t: Array, points: Array) -> Array:
    """Measure the largest distance (m) of each span from the curve, on the pieces as they are
    run.
    """
    places, span = draw_through(points)
    away = _measure_places(curve, t, places, span)
    worst = np.zeros(len(t) - 1)
    np.maximum.at(worst, span, away)
    return worst


def _measure_places(curve: Curve, t: Array, places: Array, span: np.ndarray) -> Array:
    """m, the largest distance from the curve of places (M, K, 3), each row of them on a span (M,)
    between t (N+1,).
    """
    x = places.reshape(-1, 3)
    share = np.linspace(0.0, 1.0, places.shape[1])
    near = (t[span][:, None] + np.diff(t)[span][:, None] * share).ravel()
    for _ in range(NEWTON_STEPS):
        p, slope = curve(near)
        steep = np.maximum((slope**2).sum(1), np.finfo(float).tiny)
        near = np.clip(near + ((x - p) * slope).sum(1) / steep, t[0], t[-1])
    return np.asarray(np.linalg.norm(x - curve(near)[0], axis=1).reshape(places.shape[:2]).max(1))


MAX_EXCESS = 1e-3
"""rad by which a stored sweep may exceed a full turn.

Files round angles to as few as four digits; an arc that short is never stored as more than a full
turn.
"""
ANGLE_ROUNDING = 1e-9
"""rad; a sweep this close to a full turn is one. A larger gap is drawn as it is stored."""


def swept_angle(first: float, last: float) -> float:
    """Return the angle (0 to 2π) from angle `first` to `last`, counter-clockwise (rad).

    Equal angles give 0. Angles that differ by a full turn, or by a rounding more or less, give 2π;
    several full turns count as one.
    """
    sweep = last - first
    turn = sweep % tau
    if sweep > pi and (turn <= MAX_EXCESS or tau - turn <= ANGLE_ROUNDING):
        return tau
    # downwards only the exact full turn: 359.99999° to 0° is a short arc across 0
    if sweep < -pi and abs(sweep - tau * round(sweep / tau)) <= 1e-12:
        return tau
    return turn


def split_b_spline(knots: Array, points: Array, degree: int) -> list[tuple[Array, Array]]:
    """Split a B-spline at inner knots that are repeated `degree` times or more.

    knots   (n + degree + 1,), rising
    points  (n, d) control points

    Returns knots and control points of each part. At a knot repeated `degree` times the curve has a
    corner. At one repeated more often it has a gap: one part ends and the next begins at different
    points.
    """
    low, high = knots[degree], knots[-degree - 1]
    places, first, counts = np.unique(knots, return_index=True, return_counts=True)
    inner = (counts >= degree) & (low < places) & (places < high)

    parts: list[tuple[Array, Array]] = []
    clamp = knots[:0]
    next_knot, next_point = 0, 0
    for place, begin, count in zip(places[inner], first[inner], counts[inner], strict=True):
        end_clamp = np.full(degree + 1, place)
        parts.append(
            (np.concatenate([clamp, knots[next_knot:begin], end_clamp]), points[next_point:begin])
        )
        clamp, next_knot = end_clamp, begin + count
        next_point = (
            next_knot - 1 - degree
        )  # the control point at the knot, or the first one after a gap
    parts.append((np.concatenate([clamp, knots[next_knot:]]), points[next_point:]))
    return parts


KNOT_ROUNDING = 1e-9
"""Share of a spline's range.

Knots that lie this close together are one knot, rounded differently.
"""


def _merge_knots(knots: Array) -> Array:
    """Make knots equal that differ only by rounding."""
    new = np.diff(knots, prepend=-np.inf) > KNOT_ROUNDING * (knots[-1] - knots[0])
    return np.asarray(knots[np.maximum.accumulate(np.where(new, np.arange(len(knots)), 0))])


MAX_SIZE = 1e5
"""m; no meaningful coordinate of a drawing is larger."""
MAX_SHARE = 1e20
"""Largest distance of a bulge's centre from its side, in lengths of the side.

It is far beyond MAX_SIZE, and finite.
"""
MAX_UNROUNDNESS = 1e-9
"""Share of the radius by which the two half axes of a circle may differ, which is the rounding of
its placement.
"""
REQUIRED_ATTRIBUTES = {
    "LINE": ("start", "end"), "CIRCLE": ("center", "radius"), "ARC": ("center", "radius", "start_angle", "end_angle"),
    "ELLIPSE": ("center", "major_axis", "ratio"),
}  # fmt: skip
"""Attributes that an entity has to state. For a missing one ezdxf would return a default."""


@dataclass(slots=True)
class StrokeMaker:
    """Makes strokes of entities, and counts what the user has to know.

    metres      size of one unit of the drawing
    deviation   m, the largest distance of fitted splines from ellipses and splines of the drawing
    worst       m, the largest such distance so far
    nothing     number of lines, arcs and sides of polylines without length
    flattened   number of entities with a width or a thickness
    """

    metres: float
    deviation: float
    worst: float = 0.0
    nothing: int = 0
    flattened: int = 0
    _placement: Placement | None = None
    _kinds: dict[str, Callable[[Any], Iterator[Stroke]]] = field(init=False)

    def __post_init__(self) -> None:
        self._kinds = {
            "LINE": self._line, "ARC": self._arc, "CIRCLE": self._arc, "LWPOLYLINE": self._light,
            "POLYLINE": self._heavy, "ELLIPSE": self._ellipse, "SPLINE": self._spline,
        }  # fmt: skip

    def knows(self, entity: Any) -> bool:
        """Return True for kinds of entities that become strokes."""
        if entity.dxftype() == "POLYLINE":
            return bool(entity.is_2d_polyline or entity.is_3d_polyline)
        return entity.dxftype() in self._kinds

    def strokes(self, entity: Any, placement: Placement | None = None) -> list[Chain]:
        """Return the chains of an entity: one as a rule, none without length, several where a
        spline has gaps.

        placement: map to the drawing's coordinates, for an entity of a block. Raises MotionError
        for a bad entity.
        """
        if missing := [
            name
            for name in REQUIRED_ATTRIBUTES.get(entity.dxftype(), ())
            if not entity.dxf.hasattr(name)
        ]:
            raise MotionError(f"it states no {missing[0]}")
        self.flattened += any(
            entity.dxf.hasattr(name) and entity.dxf.get(name)
            for name in ("thickness", "const_width")
        )
        self._placement = placement
        chains: list[list[Stroke]] = []
        for stroke in self._kinds[entity.dxftype()](entity):
            if chains and np.linalg.norm(stroke.start - chains[-1][-1].end) <= MIN_MOVE:
                chains[-1].append(stroke)
            else:
                chains.append([stroke])
        return [tuple(chain) for chain in chains]

    def _point(self, place: Any) -> Array:
        """Map a point of an entity to the drawing, in m."""
        placement = self._placement
        if placement is None:
            x, y, z = place.x, place.y, place.z
        else:
            mapped = placement.linear @ [place.x, place.y, place.z] + placement.shift
            x, y, z = mapped.tolist()
        point = np.array([x * self.metres, y * self.metres, z * self.metres])
        if not max(map(abs, point.tolist())) <= MAX_SIZE or np.isnan(point).any():
            raise MotionError(f"point ({x:g}, {y:g}, {z:g}) is not a place within {MAX_SIZE:g} m")
        return point

    def _direction(self, vector: Array) -> Array:
        """Map a vector (3,) of an entity to the drawing, in m."""
        mapped = vector if self._placement is None else self._placement.linear @ vector
        return np.asarray(mapped * self.metres)

    def _straight(self, start: Array, end: Array) -> Iterator[Stroke]:
        if np.linalg.norm(end - start) > MIN_MOVE:
            yield line(start, end)
        else:
            self.nothing += 1

    def _line(self, entity: Any) -> Iterator[Stroke]:
        yield from self._straight(self._point(entity.dxf.start), self._point(entity.dxf.end))

    def _arc(self, entity: Any) -> Iterator[Stroke]:
        """Draw ARC and CIRCLE: counter-clockwise about the extrusion."""
        ocs = _object_coordinates(entity)
        ux, uy, _ = _coordinate_axes(ocs)
        centre, radius = self._point(ocs.to_wcs(entity.dxf.center)), entity.dxf.radius
        if not 0 <= radius * self.metres <= MAX_SIZE:
            raise MotionError(
                f"radius {radius:g} must not be negative, and be less than {MAX_SIZE:g} m"
            )
        full = entity.dxftype() == "CIRCLE"
        first, last = (0.0, 360.0) if full else (entity.dxf.start_angle, entity.dxf.end_angle)
        if not (isfinite(first) and isfinite(last)):
            raise MotionError(f"angles {first:g} and {last:g} must be finite")
        axes = self._direction(radius * ux), self._direction(radius * uy)
        yield from self._conic(
            centre, axes, radians(first), swept_angle(radians(first), radians(last))
        )

    def _light(self, entity: Any) -> Iterator[Stroke]:
        rows = entity.get_points("xyseb")
        self.flattened += any(begin or end for _, _, begin, end, _ in rows)
        points = [(x, y, float(bulge)) for x, y, _, _, bulge in rows]
        yield from self._draw_sides(entity, points, entity.dxf.elevation, bool(entity.closed))

    def _heavy(self, entity: Any) -> Iterator[Stroke]:
        """Draw a POLYLINE in a plane or in space.

        Of a smoothed one the vertices that the smoothing made count.
        """
        rows = [
            vertex.dxf for vertex in entity.vertices if not vertex.dxf.flags & 16
        ]  # control frame
        if entity.is_3d_polyline:
            places = [self._point(row.location) for row in rows]
            for start, end in _pair_sides(places, bool(entity.is_closed)):
                yield from self._straight(start, end)
            return
        self.flattened += any(row.get("start_width", 0) or row.get("end_width", 0) for row in rows)
        elevation = entity.dxf.elevation.z if entity.dxf.hasattr("elevation") else 0.0
        points = [(row.location.x, row.location.y, row.get("bulge", 0.0)) for row in rows]
        yield from self._draw_sides(entity, points, elevation, bool(entity.is_closed))

    def _draw_sides(
        self, entity: Any, rows: Sequence[tuple[float, float, float]], height: float, closed: bool
    ) -> Iterator[Stroke]:
        """Draw the sides of a polyline.

        A bulge b is the tangent of a quarter of the angle of an arc over the side. The centre lies
        (1 − b²)/(4 b) of the side away from its middle, on its left where 0 < b < 1. The arc rises
        b/2 of the side above it.
        """
        ocs = _object_coordinates(entity)
        normal = _coordinate_axes(ocs)[2]
        corners = [ocs.to_wcs((x, y, height)) for x, y, _ in rows]
        places = [self._point(corner) for corner in corners]
        sides = zip(_pair_sides(corners, closed), _pair_sides(places, closed), rows, strict=False)
        for (first, last), (start, end), (_, _, bulge) in sides:
            if not isfinite(bulge):
                raise MotionError(f"bulge {bulge} must be finite")
            if bulge == 0 or np.linalg.norm(end - start) <= MIN_MOVE:
                yield from self._straight(start, end)
                continue
            side = np.array([last.x - first.x, last.y - first.y, last.z - first.z])
            across = cross_product(normal, side)
            height_of_arc = abs(bulge) / 2 * float(np.linalg.norm(self._direction(across)))
            if height_of_arc <= MIN_MOVE:
                yield line(start, end)
                continue
            share = (1 - bulge * bulge) / (4 * bulge)
            aside = across * max(-MAX_SHARE, min(share, MAX_SHARE))
            centre = (start + end) / 2 + self._direction(aside)
            if not (abs(centre) <= MAX_SIZE).all():
                if height_of_arc > self.deviation:
                    raise MotionError(
                        f"bulge {bulge:g} makes an arc of a radius beyond {MAX_SIZE:g} m; make it straight"
                    )
                yield line(start, end)
                continue
            to_start = -side / 2 - aside
            axes = self._direction(to_start), self._direction(cross_product(normal, to_start))
            yield from self._conic(centre, axes, 0.0, 4 * atan(bulge), (start, end))

    def _ellipse(self, entity: Any) -> Iterator[Stroke]:
        """Draw c + a cos t + b sin t, counter-clockwise about the extrusion."""
        centre, ratio = self._point(entity.dxf.center), entity.dxf.ratio
        normal = _coordinate_axes(_object_coordinates(entity))[2]
        long_axis = np.array(list(entity.dxf.major_axis))
        major = self._direction(long_axis)
        minor = self._direction(cross_product(normal, long_axis) * ratio)
        if not 0 < abs(ratio) <= 1 or not np.linalg.norm(major) > MIN_MOVE:
            raise MotionError(
                f"axes of {entity.dxf.major_axis.magnitude:g} and {ratio:g} of that make no ellipse"
            )
        low, high = entity.dxf.get("start_param", 0.0), entity.dxf.get("end_param", tau)
        if not (isfinite(low) and isfinite(high)):
            raise MotionError(f"parameters {low:g} and {high:g} must be finite")
        yield from self._conic(centre, (major, minor), low, swept_angle(low, high))

    def _conic(
        self,
        centre: Array,
        axes: tuple[Array, Array],
        first: float,
        turn: float,
        ends: tuple[Array, Array] | None = None,
    ) -> Iterator[Stroke]:
        """Draw c + u cos t + v sin t for t from `first` to `first` + `turn`: an arc if u and v span
        a circle.

        axes  u and v, conjugate half axes of an ellipse (3,), m
        ends  first and last point, where they are known more exactly than by the formula
        """
        u, v = axes
        size = float(max(np.linalg.norm(u), np.linalg.norm(v)))
        if size * abs(turn) <= MIN_MOVE:
            self.nothing += 1
            return
        if not size <= MAX_SIZE:
            raise MotionError(f"radius {size:g} m must be less than {MAX_SIZE:g} m")
        if abs(turn) == tau:
            start = centre + np.cos(first) * u + np.sin(first) * v
            ends = start, start
        elif ends is None:
            begin, end = (centre + np.cos(t) * u + np.sin(t) * v for t in (first, first + turn))
            ends = begin, end

        skew = max(abs(float(u @ u - v @ v)) / 2, abs(float(u @ v)))
        if skew <= MAX_UNROUNDNESS * size**2:
            normal = cross_product(u, v)
            yield arc(ends[0], centre, normal / np.linalg.norm(normal), turn, ends[1])
            return

        if turn < 0:  # the fit runs upwards: t becomes −t, and v becomes −v
            v, first = -v, -first

        def trace(t: Array) -> tuple[Array, Array]:
            c, s = np.cos(t)[:, None], np.sin(t)[:, None]
            return centre + c * u + s * v, c * v - s * u

        yield self._fit_curve(trace, first, first + abs(turn))

    def _spline(self, entity: Any) -> Iterator[Stroke]:
        """Draw a B-spline, rational or not, in parts where it has a corner or a gap; straight where
        its degree is 1.
        """
        tool = entity.construction_tool()
        degree = tool.degree
        knots, weights = (
            np.array(tool.knots(), float),
            np.array(tool.weights() or [1.0] * tool.count, float),
        )
        points = np.array([self._point(point) for point in tool.control_points])
        if not (
            np.isfinite(knots).all()
            and (np.diff(knots) >= 0).all()
            and (weights > 0).all()
            and degree >= 1
        ):
            raise MotionError("its knots must rise, and its weights be positive and finite")
        weighted = np.column_stack([points * weights[:, None], weights])
        for part_knots, part in split_b_spline(_merge_knots(knots), weighted, degree):
            corners = part[:, :3] / part[:, 3:]
            if degree == 1:
                for start, end in pairwise(corners):
                    yield from self._straight(start, end)
            elif np.linalg.norm(np.diff(corners, axis=0), axis=1).sum() <= MIN_MOVE:
                self.nothing += 1
            else:
                trace = _rational_curve(part_knots, part, degree)
                yield self._fit_curve(trace, part_knots[degree], part_knots[-degree - 1])

    def _fit_curve(self, along: Curve, low: float, high: float) -> Stroke:
        points, off = fit_spline(along, low, high, self.deviation)
        self.worst = max(self.worst, off)
        return curve(points)


def _rational_curve(knots: Array, weighted: Array, degree: int) -> Curve:
    """Return the curve of a rational B-spline from control points times their weights, and the
    weights (n, 4).
    """
    from scipy.interpolate import BSpline

    whole = BSpline(knots, weighted, degree)
    slope = whole.derivative()

    def trace(t: Array) -> tuple[Array, Array]:
        w, dw = whole(t), slope(t)
        place = w[:, :3] / w[:, 3:]
        return place, (dw[:, :3] - place * dw[:, 3:]) / w[:, 3:]

    return trace


def _object_coordinates(entity: Any) -> Any:
    """Return ezdxf's OCS, the coordinates of an entity with an extrusion."""
    from ezdxf.math import OCS

    extrusion = entity.dxf.get("extrusion", (0, 0, 1))
    if not 0 < hypot(*extrusion) < float("inf"):
        raise MotionError("its extrusion is no direction")
    return OCS(extrusion)


def _coordinate_axes(ocs: Any) -> tuple[Array, Array, Array]:
    """Return the axes (3,) of an OCS in the coordinates of the drawing or the block."""
    ux, uy, uz = (np.array(list(ocs.to_wcs(axis))) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    return ux, uy, uz


def _pair_sides(places: list[Corner], closed: bool) -> Iterator[tuple[Corner, Corner]]:
    ends = [*places[1:], places[0]] if closed else places[1:]
    return zip(places, ends, strict=False)
