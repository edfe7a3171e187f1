"""Limits of the tool, where the program caps it: ‖ṗ‖, ‖p̈‖, ‖p⃛‖ or ‖ω‖ ≤ cap of the piece.

All are the norm of a vector that a program caps segment by segment: the tool's speed, acceleration
and jerk, and the platform's angular speed.
"""

from collections.abc import Iterable
from functools import cache
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from planner.limits.limit import Limit, LimitState, Quantity, Rows, Term
from planner.path.actuation import MachinePath, Points, make_points


class ToolLimit(Limit):
    """One channel.

    The certificate bounds the square of the norm, which is smooth where the norm is zero.
    """

    unit: ClassVar[tuple[str, float]]
    channels = ("tool",)

    def __init__(self, caps: Iterable[float | None]) -> None:
        self.caps = freeze_array([np.inf if cap is None else cap for cap in caps])
        self.bounds = freeze_array([self.caps.min()])
        self.units = (self.unit,)

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return np.asarray(np.sqrt(np.maximum(high, 0.0)) / self.caps[piece][:, None])

    def report_value(self, value: float, channel: int, piece: int) -> tuple[float, float]:
        return float(np.sqrt(max(value, 0.0))), float(self.caps[piece])

    def _scale(self, factors: Array) -> None:
        self.caps, self.bounds = (
            freeze_array(self.caps * factors[0]),
            freeze_array(self.bounds * factors),
        )


def squared_norm(rates: Quantity, columns: Iterable[int]) -> Quantity:
    """‖·‖² (N, 1) of the vectors that some columns of rates make."""
    parts = (rates[:, k : k + 1] for k in columns)
    return sum((part * part for part in parts), start=0.0)


class ToolSpeed(ToolLimit):
    """ṗ = p′ ṡ of the tool."""

    name, unit = "tool speed", ("mm/s", 1e3)
    terms = frozenset({Term.SD})

    def value(self, motion: LimitState) -> Quantity:
        return squared_norm(motion.tool_rate(1), range(3))

    def rows(self, points: Points) -> Rows:
        along = np.linalg.norm(points.tool_derivatives[1][:, :3], axis=1, keepdims=True)
        return Rows({Term.SD: along}, self.caps[points.piece][:, None])


# Facets over the half turn from pushing to braking; an even number, so that pushing and pure
# bending meet corners.
FACETS = 32


def _facet_normals() -> tuple[Array, Array, float]:
    """Cosines and sines (FACETS,) of the facets' normals, and their distance from the centre of the
    unit circle.
    """
    angles = (np.arange(FACETS) + 0.5) * np.pi / FACETS
    return (
        freeze_array(np.cos(angles)),
        freeze_array(np.sin(angles)),
        float(np.cos(np.pi / (2 * FACETS))),
    )


class ToolAcceleration(ToolLimit):
    """p̈ = p′ s̈ + p″ ṡ² of the platform's origin: in the plane of p′ and p″, a circle of radius a.

    The solvers' rows are the facets of a polygon inscribed in it: with e₁ along p′ and e₂ across,
    for each normal (cos θ, sin θ), |cos θ ‖p′‖ s̈ + (cos θ p″·e₁ + sin θ p″·e₂) ṡ²| ≤ a cos(π/2n)
    with n facets over the half turn. Nothing is lost where the tool only gains speed or only bends,
    elsewhere at most 1 − cos(π/64) = 0.12 % of a, so 0.06 % of time.
    """

    name, unit = "tool acceleration", ("mm/s²", 1e3)
    terms = frozenset({Term.SDD, Term.SD2})

    def value(self, motion: LimitState) -> Quantity:
        return squared_norm(motion.tool_rate(2), range(3))

    def rows(self, points: Points) -> Rows:
        _, p1, p2 = (derivative[:, :3] for derivative in points.tool_derivatives)
        size = np.linalg.norm(p1, axis=1, keepdims=True)
        along = p1 / np.where(size > 0, size, 1.0)
        push = (p2 * along).sum(1, keepdims=True)
        bend = np.linalg.norm(p2 - push * along, axis=1, keepdims=True)
        cosine, sine, near = _facet_normals()
        return Rows(
            {Term.SDD: cosine * size, Term.SD2: cosine * push + sine * bend},
            self._caps(points) * near,
        )

    def _caps(self, points: Points) -> Array:
        return np.repeat(self.caps[points.piece][:, None], FACETS, 1)


# Normals over the half sphere of directions of a jerk in space, where a path leaves its plane.
SPHERE_FACETS = 96


@cache
def _sphere_normals() -> tuple[Array, float]:
    """Normals (SPHERE_FACETS, 3) over a half sphere, and the distance of their planes that keeps
    all of it inside 1.

    They lie on a spiral of equal areas. The distance is the cosine of the largest angle between any
    direction and the nearest normal, at which the corners of the polyhedron lie: those of its dual,
    the normals' convex hull.
    """
    from scipy.spatial import ConvexHull

    rise = (np.arange(SPHERE_FACETS) + 0.5) / SPHERE_FACETS
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(SPHERE_FACETS)
    flat = np.sqrt(1 - rise**2)
    normals = np.stack([flat * np.cos(turn), flat * np.sin(turn), rise], 1)
    faces = ConvexHull(np.concatenate([normals, -normals])).equations
    return freeze_array(normals), float(-faces[:, 3].max())


class ToolJerk(ToolLimit):
    """p⃛ = p′ s⃛ + 3 p″ ṡs̈ + p‴ ṡ³ of the tool: a ball of radius j.

    The solvers' rows are facets of a polyhedron inside it, in the frame of e₁ along p′, e₂ across
    in the plane of p″ and e₃. Along a line there is no loss and on a plane curve at most 0.12 % of
    j, by a polygon as that of the acceleration; in space at most what `_sphere_normals` leaves, 2.3
    %, which is 0.8 % of time.
    """

    name, unit = "tool jerk", ("mm/s³", 1e3)
    terms = frozenset({Term.SDDD, Term.SDSDD, Term.SD3})

    def __init__(self, caps: Iterable[float | None], *, flat: bool = False) -> None:
        """flat: every piece of the path lies in a plane (`lies_in_planes`), so that a polygon
        serves.
        """
        super().__init__(caps)
        cosine, sine, distance = _facet_normals()
        normals: Array = np.stack([cosine, sine, np.zeros(FACETS)], 1)
        if not flat:
            normals, distance = _sphere_normals()
        self._normals, self._near = normals, distance

    def value(self, motion: LimitState) -> Quantity:
        return squared_norm(motion.tool_rate(3), range(3))

    def rows(self, points: Points) -> Rows:
        frame, derivatives = _follow_frame(points)
        terms = {
            term: factor * np.stack([(vector * axis).sum(1) for axis in frame], 1) @ self._normals.T
            for term, vector, factor in zip(
                (Term.SDDD, Term.SDSDD, Term.SD3), derivatives, (1.0, 3.0, 1.0), strict=True
            )
        }
        caps = np.repeat(self.caps[points.piece][:, None], len(self._normals), 1)
        return Rows(terms, caps * self._near)


def _follow_frame(points: Points) -> tuple[list[Array], list[Array]]:
    """e₁ along p′, e₂ across in the plane of p″, e₃; and p′, p″, p‴ of the tool, each (N, 3)."""
    derivatives = [points.tool_derivative(times)[:, :3] for times in (1, 2, 3)]
    p1, p2, p3 = derivatives
    first = _unit(p1)
    across = _cut_along(p2, first)
    # where the path is straight, the third derivative says which way it will bend
    straight = np.linalg.norm(across, axis=1) <= STRAIGHT * np.linalg.norm(p2, axis=1)
    second = _unit(np.where(straight[:, None], _cut_along(p3, first), across))
    return [first, second, np.cross(first, second)], derivatives


def lies_in_planes(path: MachinePath) -> bool:
    """Return whether p‴ of the tool is in the plane of p′ and p″ at places of every piece: arcs and
    lines are so.
    """
    piece = np.repeat(np.arange(len(path.pieces)), len(PLACES))
    s = (path.breaks[:-1, None] + np.diff(path.breaks)[:, None] * PLACES).ravel()
    frame, (_, _, p3) = _follow_frame(make_points(path, s, piece, 3))
    return bool((np.abs((p3 * frame[2]).sum(1)) <= STRAIGHT * np.linalg.norm(p3, axis=1)).all())


def make_tool_jerk(path: MachinePath) -> ToolJerk:
    """Make the limit of a path from the caps of its pieces."""
    caps = [piece.tool_jerk for piece in path.pieces]
    capped = any(cap is not None for cap in caps)
    return ToolJerk(caps, flat=not capped or lies_in_planes(path))


# Shares of a piece at which a path's torsion is sampled.
PLACES = np.array([0.07, 0.31, 0.5, 0.73, 0.97])
# Share of a derivative up to which its part across is rounding.
STRAIGHT = 1e-9


def _cut_along(vectors: Array, first: Array) -> Array:
    """(N, 3) the parts of vectors across unit vectors."""
    return np.asarray(vectors - (vectors * first).sum(1, keepdims=True) * first)


def _unit(vectors: Array) -> Array:
    """(N, 3) of length 1, or 0 where they are."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(size > 0, size, 1.0))


class AngularSpeed(ToolLimit):
    """Ṙ = ω× R, so ‖ω‖² = ½ ‖Ṙ‖² (Frobenius), and ω = ω′ ṡ: the same of R′."""

    name, unit = "angular speed", ("deg/s", 180 / np.pi)
    terms = frozenset({Term.SD})

    def value(self, motion: LimitState) -> Quantity:
        return squared_norm(motion.pose_rate(1), range(3, 12)) * 0.5

    def rows(self, points: Points) -> Rows:
        along = np.linalg.norm(points.pose_derivatives[1][:, 3:], axis=1, keepdims=True) / np.sqrt(
            2
        )
        return Rows({Term.SD: along}, self.caps[points.piece][:, None])
