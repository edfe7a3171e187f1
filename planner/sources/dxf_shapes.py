"""What DXF entities are in space: the strokes of each kind, exact but for ellipses and splines.

Of those, points are so dense that the spline through them stays within a tolerance of the curve.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import atan, hypot, isfinite, pi, radians
from typing import Any

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.path.spline import draw_through, sample_splines
from planner.program.model import MIN_MOVE
from planner.sources.stroke import Chain, Stroke, arc, cross_product, curve, line

FIRST_POINTS, MAX_ROUNDS, MAX_POINTS = 17, 40, 20_000
"""Points to begin with, how often spans are halved, and points at most."""
SPAN_SHARES = np.arange(1, 8) / 8
"""Places of a span at which it is held against the curve."""
NEWTON_STEPS = 2
"""Steps towards the nearest point of the curve: what they leave makes a distance larger, never smaller."""

Curve = Callable[[Array], tuple[Array, Array]]
"""Points (N, 3) and their first derivatives at parameters (N,)."""


def fit_spline(curve: Curve, low: float, high: float, tolerance: float) -> tuple[Array, float]:
    """Points (N, 3) from low to high, and by how much (m) the program's spline through them leaves the curve.

    Spans that leave it by more than the tolerance are halved, and so are their neighbours. Measured at seven places of
    each span, against the nearest point of the curve. Raises MotionError where the curve does not let itself be fitted.
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
    raise MotionError(f"no smooth curve follows it within {tolerance * 1e3:g} mm; explode it into lines and arcs")


def _curve_deviation(curve: Curve, t: Array, points: Array) -> Array:
    """m, the largest distance of each span from the curve."""
    return _measure_places(curve, t, sample_splines(points, SPAN_SHARES)[0], np.arange(len(t) - 1))


def _drawn_deviation(curve: Curve, t: Array, points: Array) -> Array:
    """Measure the largest distance (m) of each span from the curve, on the pieces as they are run."""
    places, span = draw_through(points)
    away = _measure_places(curve, t, places, span)
    worst = np.zeros(len(t) - 1)
    np.maximum.at(worst, span, away)
    return worst


def _measure_places(curve: Curve, t: Array, places: Array, span: np.ndarray) -> Array:
    """m, the largest distance from the curve of places (M, K, 3), each row of them on a span (M,) between t (N+1,)."""
    x = places.reshape(-1, 3)
    share = np.linspace(0.0, 1.0, places.shape[1])
    near = (t[span][:, None] + np.diff(t)[span][:, None] * share).ravel()
    for _ in range(NEWTON_STEPS):
        p, slope = curve(near)
        steep = np.maximum((slope**2).sum(1), np.finfo(float).tiny)
        near = np.clip(near + ((x - p) * slope).sum(1) / steep, t[0], t[-1])
    return np.asarray(np.linalg.norm(x - curve(near)[0], axis=1).reshape(places.shape[:2]).max(1))


MAX_SIZE = 1e5
"""m; no coordinate of a drawing that means something comes near it."""
REQUIRED_ATTRIBUTES = {
    "LINE": ("start", "end"), "CIRCLE": ("center", "radius"), "ARC": ("center", "radius", "start_angle", "end_angle"),
    "ELLIPSE": ("center", "major_axis", "ratio"),
}  # fmt: skip
"""What an entity has to state; ezdxf would take something for what is missing."""


@dataclass(slots=True)
class StrokeMaker:
    """Makes strokes of entities, and remembers what its user has to know.

    metres     of one unit of the drawing
    deviation  m by which splines may leave ellipses and splines of the drawing
    worst      m, the largest by which one does
    nothing    how many lines, arcs and sides of polylines have no length
    flattened  how many entities have a width or a thickness
    """

    metres: float
    deviation: float
    worst: float = 0.0
    nothing: int = 0
    flattened: int = 0
    _kinds: dict[str, Callable[[Any], Iterator[Stroke]]] = field(init=False)

    def __post_init__(self) -> None:
        self._kinds = {
            "LINE": self._line, "ARC": self._arc, "CIRCLE": self._arc, "LWPOLYLINE": self._light,
            "POLYLINE": self._heavy, "ELLIPSE": self._ellipse, "SPLINE": self._spline,
        }  # fmt: skip

    def knows(self, entity: Any) -> bool:
        """Whether an entity is of a kind that becomes strokes."""
        if entity.dxftype() == "POLYLINE":
            return bool(entity.is_2d_polyline or entity.is_3d_polyline)
        return entity.dxftype() in self._kinds

    def strokes(self, entity: Any) -> list[Chain]:
        """Its chains: one, none where it has no length, more where a spline has corners. Raises MotionError."""
        if missing := [name for name in REQUIRED_ATTRIBUTES.get(entity.dxftype(), ()) if not entity.dxf.hasattr(name)]:
            raise MotionError(f"it states no {missing[0]}")
        self.flattened += any(
            entity.dxf.hasattr(name) and entity.dxf.get(name) for name in ("thickness", "const_width")
        )
        found = tuple(self._kinds[entity.dxftype()](entity))
        return [found] if found else []

    def _point(self, place: Any) -> Array:
        point = np.array([place.x * self.metres, place.y * self.metres, place.z * self.metres])
        if not max(map(abs, point.tolist())) <= MAX_SIZE or np.isnan(point).any():
            raise MotionError(f"point ({place.x:g}, {place.y:g}, {place.z:g}) is not a place within {MAX_SIZE:g} m")
        return point

    def _straight(self, start: Array, end: Array) -> Iterator[Stroke]:
        if np.linalg.norm(end - start) > MIN_MOVE:
            yield line(start, end)
        else:
            self.nothing += 1

    def _line(self, entity: Any) -> Iterator[Stroke]:
        yield from self._straight(self._point(entity.dxf.start), self._point(entity.dxf.end))

    def _arc(self, entity: Any) -> Iterator[Stroke]:
        """ARC and CIRCLE: against the clock about the direction of extrusion, which −z turns round."""
        ocs = _object_coordinates(entity)
        ux, uy, normal = _coordinate_axes(ocs)
        centre, radius = self._point(ocs.to_wcs(entity.dxf.center)), entity.dxf.radius * self.metres
        if not 0 <= radius <= MAX_SIZE:
            raise MotionError(f"radius {entity.dxf.radius:g} must not be negative, and be less than {MAX_SIZE:g} m")
        full = entity.dxftype() == "CIRCLE"
        first, last = (0.0, 360.0) if full else (entity.dxf.start_angle, entity.dxf.end_angle)
        if not (isfinite(first) and isfinite(last)):
            raise MotionError(f"angles {first:g} and {last:g} must be finite")
        turn = 360.0 if full else (last - first) % 360.0
        if radius * radians(turn) <= MIN_MOVE:
            self.nothing += 1
            return
        start, end = (
            centre + radius * (np.cos(radians(angle)) * ux + np.sin(radians(angle)) * uy) for angle in (first, last)
        )
        yield arc(start, centre, normal, radians(turn), start if full else end)

    def _light(self, entity: Any) -> Iterator[Stroke]:
        rows = entity.get_points("xyseb")
        self.flattened += any(begin or end for _, _, begin, end, _ in rows)
        points = [(x, y, bulge) for x, y, _, _, bulge in rows]
        yield from self._draw_sides(entity, points, entity.dxf.elevation, bool(entity.closed))

    def _heavy(self, entity: Any) -> Iterator[Stroke]:
        """POLYLINE in a plane or in space; of one that was smoothed the vertices that the smoothing made."""
        rows = [vertex.dxf for vertex in entity.vertices if not vertex.dxf.flags & 16]  # control frame
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
        """Sides of a polyline: a bulge b is the tangent of a quarter of the angle of an arc over the side.

        The centre lies (1 − b²)/(4 b) of the side beside its middle, on its left where b is positive and less than 1.
        """
        ocs = _object_coordinates(entity)
        normal = _coordinate_axes(ocs)[2]
        places = [self._point(ocs.to_wcs((x, y, height))) for x, y, _ in rows]
        for (start, end), (_, _, bulge) in zip(_pair_sides(places, closed), rows, strict=False):
            if not isfinite(bulge):
                raise MotionError(f"bulge {bulge} must be finite")
            side = end - start
            if bulge == 0 or np.linalg.norm(side) <= MIN_MOVE:
                yield from self._straight(start, end)
                continue
            centre = (start + end) / 2 + cross_product(normal, side) * ((1 - bulge**2) / (4 * bulge))
            if not (abs(centre) <= MAX_SIZE).all():  # nor is what is no number
                raise MotionError(f"bulge {bulge:g} makes an arc of a radius beyond {MAX_SIZE:g} m; make it straight")
            yield arc(start, centre, normal, 4 * atan(bulge), end)

    def _ellipse(self, entity: Any) -> Iterator[Stroke]:
        """c + a cos t + b sin t; where both axes are alike an arc, else a curve through points."""
        centre, major = self._point(entity.dxf.center), self._point(entity.dxf.major_axis)
        normal, ratio = _coordinate_axes(_object_coordinates(entity))[2], entity.dxf.ratio
        if not 0 < abs(ratio) <= 1 or np.linalg.norm(major) <= MIN_MOVE:
            raise MotionError(f"axes of {entity.dxf.major_axis.magnitude:g} and {ratio:g} of that make no ellipse")
        minor = cross_product(normal, major) * ratio
        low, high = entity.dxf.get("start_param", 0.0), entity.dxf.get("end_param", 2 * pi)
        if not (isfinite(low) and isfinite(high)):
            raise MotionError(f"parameters {low:g} and {high:g} must be finite")
        turn = (high - low) % (2 * pi)
        full = min(turn, 2 * pi - turn) < 1e-9
        turn = 2 * pi if full else turn

        def trace(t: Array) -> tuple[Array, Array]:
            c, s = np.cos(t)[:, None], np.sin(t)[:, None]
            return centre + c * major + s * minor, c * minor - s * major

        start, end = trace(np.array([low, low if full else low + turn]))[0]
        if ratio == 1:
            yield arc(start, centre, normal, turn, end)
        else:
            yield self._fit_curve(trace, low, low + turn)

    def _spline(self, entity: Any) -> Iterator[Stroke]:
        """A B-spline, rational or not, in parts where it has a corner; straight where its degree is 1."""
        tool = entity.construction_tool()
        degree = tool.degree
        knots, weights = np.array(tool.knots(), float), np.array(tool.weights() or [1.0] * tool.count, float)
        points = np.array([self._point(point) for point in tool.control_points])
        if not (np.isfinite(knots).all() and (np.diff(knots) >= 0).all() and (weights > 0).all() and degree >= 1):
            raise MotionError("its knots must rise, and its weights be positive and finite")
        if degree == 1:
            for start, end in _pair_sides(list(points), False):
                yield from self._straight(start, end)
            return
        from scipy.interpolate import BSpline

        whole = BSpline(knots, np.column_stack([points * weights[:, None], weights]), degree)
        slope = whole.derivative()

        def trace(t: Array) -> tuple[Array, Array]:
            w, dw = whole(t), slope(t)
            place = w[:, :3] / w[:, 3:]
            return place, (dw[:, :3] - place * dw[:, 3:]) / w[:, 3:]

        low, high = knots[degree], knots[-degree - 1]
        inside, times = np.unique(knots[(low < knots) & (knots < high)], return_counts=True)
        breaks = [low, *inside[times >= degree], high]
        for begin, end in pairwise(breaks):
            hair = 1e-12 * (high - low)  # at a corner both sides have a value of their own
            yield self._fit_curve(trace, begin + hair * (begin > low), end - hair * (end < high))

    def _fit_curve(self, along: Curve, low: float, high: float) -> Stroke:
        points, off = fit_spline(along, low, high, self.deviation)
        self.worst = max(self.worst, off)
        return curve(points)


def _object_coordinates(entity: Any) -> Any:
    """The coordinates that an entity with an extrusion is stated in: ezdxf's OCS."""
    from ezdxf.math import OCS

    extrusion = entity.dxf.get("extrusion", (0, 0, 1))
    if not 0 < hypot(*extrusion) < float("inf"):
        raise MotionError("its extrusion is no direction")
    return OCS(extrusion)


def _coordinate_axes(ocs: Any) -> tuple[Array, Array, Array]:
    """Their axes (3,) in the drawing's coordinates."""
    ux, uy, uz = (np.array(list(ocs.to_wcs(axis))) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    return ux, uy, uz


def _pair_sides(places: list[Array], closed: bool) -> Iterator[tuple[Array, Array]]:
    ends = [*places[1:], places[0]] if closed else places[1:]
    return zip(places, ends, strict=False)
