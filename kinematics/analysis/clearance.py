"""Clearance: how far legs stay from each other and from the platforms' discs.

A leg is a capsule: all points within `leg_radius` of a segment of the line between its joint
centres. A platform is a disc: a flat cylinder. Both distances are those of convex bodies, and
exact: what a formula cannot settle (parallel, crossing, shrunk to a point) is settled by the ends.
"""

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import (
    LEAST_POSITIVE,
    Array,
    finite_array,
    freeze_array,
    unit_vectors,
)
from kinematics.foundation.errors import MotionError
from kinematics.foundation.taylor_model import EPS

BISECTIONS_OF_ROOT = 55
"""Until the last place of a parameter in [0, 1]."""


@dataclass(frozen=True, slots=True)
class Disc:
    """A plate in its platform's frame: a cylinder of `radius` and `thickness` (m) about `normal` at
    `centre`.
    """

    radius: float
    thickness: float
    centre: ArrayLike = (0.0, 0.0, 0.0)
    normal: ArrayLike = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        finite_array(self.radius, "disc: radius", (), unit="m", least=LEAST_POSITIVE)
        finite_array(self.thickness, "disc: thickness", (), unit="m", least=0)
        object.__setattr__(
            self, "centre", freeze_array(finite_array(self.centre, "disc: centre", (3,), unit="m"))
        )
        object.__setattr__(
            self, "normal", freeze_array(unit_vectors(self.normal, "disc: normal", (3,)))
        )

    @property
    def numbers(self) -> Array:
        """Centre, normal, radius and thickness (8,)."""
        return np.concatenate(
            [self.centre, self.normal, [self.radius, self.thickness]], dtype=float
        )


@dataclass(frozen=True)
class Bodies:
    """What of a machine with legs takes up room.

    base, platform  (n, 3) joint centres in the frames of base and platform, m
    legs            (n,) names
    leg_radius      m, of every leg
    leg_ends        m from either joint centre to where the segment begins; None: leg_radius, so
                    that the capsule's round tips end in the joint centres
    base_disc, platform_disc  the plates, in the frames of base and platform; None: not looked at

    Moving the platform without turning it by v changes no distance by more than ‖v‖: a point of a
    leg, or of a disc, moves by A v with a symmetric A between 0 and 1, so any two of them by (A −
    A') v, and ‖A − A'‖ ≤ 1. Turning it moves the joint at r from its origin by no more than ‖r‖
    times the angle: see `change`.

    A distance is the least of those of all pairs of points that stay where they are in their
    bodies. Where D joins such a pair, ‖D‖¨ ≤ ‖Ḋ‖²/‖D‖ + ‖D̈‖: with K no less than that for any
    pair, d − K τ²/2 is the least of concave functions, so concave, and d lies above its chord less
    K τ (2 − τ)/2 over a cell of τ from 0 to 2: see `bend`.
    """

    base: Array
    platform: Array
    legs: tuple[str, ...]
    leg_radius: float
    leg_ends: float | None = None
    base_disc: Disc | None = None
    platform_disc: Disc | None = None

    def __post_init__(self) -> None:
        finite_array(self.leg_radius, "legs: leg_radius", (), unit="m", least=LEAST_POSITIVE)
        finite_array(self.ends, "legs: leg_ends", (), unit="m", least=0)
        for what, disc in (("base_disc", self.base_disc), ("platform_disc", self.platform_disc)):
            if disc is not None and not isinstance(disc, Disc):
                raise MotionError(f"legs: {what} must be a Disc, not {disc!r:.100}")

    @property
    def ends(self) -> float:
        return self.leg_radius if self.leg_ends is None else self.leg_ends

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(k,) what is near what, in the order of `distances`."""
        discs = [
            name
            for name, disc in (("base", self.base_disc), ("platform", self.platform_disc))
            if disc
        ]
        pairs = [f"{a}–{b}" for a, b in combinations(self.legs, 2)]
        return (*pairs, *(f"{leg}–{disc}" for disc in discs for leg in self.legs))

    @property
    def content(self) -> Hashable:
        """What decides its distances."""
        discs = tuple(
            disc and disc.numbers.tobytes() for disc in (self.base_disc, self.platform_disc)
        )
        return (
            self.legs,
            self.ends,
            self.leg_radius,
            self.base.tobytes(),
            self.platform.tobytes(),
            discs,
        )

    @cached_property
    def contact(self) -> Array:
        """(k,) m: the distance of axes, or of axis and disc, at which the bodies touch."""
        pairs = len(self.legs) * (len(self.legs) - 1) // 2
        return freeze_array(
            self.leg_radius * np.array([2.0] * pairs + [1.0] * (len(self.names) - pairs))
        )

    def distances(self, x: Array) -> Array:
        """Return the distances (N, k) m at poses with the numbers x (N, 12).

        They are between the axes of any two legs, then between legs and discs.
        """
        low, high = self._place_axes(x)
        i, j = np.array(list(combinations(range(len(self.legs)), 2))).T
        parts = [segment_distance(low[:, i], high[:, i], low[:, j], high[:, j])]
        if self.base_disc is not None:
            parts.append(segment_disc_distance(low, high, self.base_disc))
        if self.platform_disc is not None:
            rotation = x[:, 3:].reshape(-1, 3, 3)
            start, end = ((points - x[:, None, :3]) @ rotation for points in (low, high))
            parts.append(segment_disc_distance(start, end, self.platform_disc))
        return np.concatenate(parts, 1)

    def _place_axes(self, x: Array) -> tuple[Array, Array]:
        """Return both ends (N, n, 3) of the segments that the legs surround, in the base frame."""
        turned = self.platform @ x[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2)
        leg = x[:, None, :3] + turned - self.base
        length = _length(leg)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(length > 0, np.minimum(self.ends / length, 0.5), 0.5)
        left_out = share[..., None] * leg
        return self.base + left_out, self.base + leg - left_out

    def change(self, x: Array, way: Array, turn: Array) -> Array:
        """(N, k) m by which no distance changes on any path of the platform from x (N, 12), with
        its origin's way (N,) m and its turn (N,) rad at most.

        Legs i and j: way + turn (‖rᵢ‖ + ‖rⱼ‖);  leg and base: way + turn ‖r‖;  leg and platform, as
                                                 seen from there,
        where the joint in the base moves: way + turn ‖base − origin‖.
        """
        way, turn = way[:, None], turn[:, None]
        arm = turn * _length(self.platform)
        i, j = np.array(list(combinations(range(len(self.legs)), 2))).T
        found = [way + arm[:, i] + arm[:, j]]
        if self.base_disc:
            found.append(way + arm)
        if self.platform_disc:
            found.append(way + turn * (_length(self.base - x[:, None, :3]) + way))
        return np.concatenate(found, 1)

    def bend(
        self,
        x: Array,
        way: Array,
        turn: Array,
        least: Array,
        first: tuple[Array, Array],
        second: tuple[Array, Array],
    ) -> Array:
        """(N, k) that no second derivative of a distance along any path from x (N, 12) is above; ∞
        where it has none.

        way, turn (N,)  of the platform at most, as in `change`
        least (N, k)    no distance is below that
        first, second   ((N,), (N,)) of its origin and its turn, the largest of the first
                        derivatives: those of ‖ṗ‖ and of the angle, and of the second: ‖p̈‖ and
                        Frobenius' norm of R̈

        A leg ℓ of length L at whose ends e is left out has points (1−σ) b + σ j + e (1−2σ) ℓ/L,
        with ‖(ℓ/L)¨ − P ℓ̈/L‖ ≤ 2 ‖ℓ̇‖²/L², P across the leg: their second derivative is A ℓ̈ with
        A between 0 and 1, and no more than 2 e ‖ℓ̇‖²/L². The base as seen from the platform: Rᵀ(b −
        p).
        """
        way, turn, pace, spin, push, swing = (
            each[:, None] for each in (way, turn, *first, *second)
        )
        arm = _length(self.platform)
        joints = x[:, None, :3] + self.platform @ x[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2)
        length = _length(joints - self.base) - (way + turn * arm)
        i, j = np.array(list(combinations(range(len(self.legs)), 2))).T

        def turned(speed: Array) -> Array:
            """What the shortening of legs adds, at speeds ‖ℓ̇‖ (N, n)."""
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.where(
                    length > 2 * self.ends, 2 * self.ends * speed**2 / length**2, np.inf
                )

        speed, bent = pace + spin * arm, turned(pace + spin * arm)
        moves = [pace + spin * (arm[i] + arm[j])]
        bends = [push + swing * (arm[i] + arm[j]) + bent[:, i] + bent[:, j]]
        if self.base_disc:
            moves.append(speed)
            bends.append(push + swing * arm + bent)
        if self.platform_disc:
            reach = _length(self.base - x[:, None, :3]) + way
            moves.append(pace + spin * reach)
            bends.append(push + swing * reach + 2 * spin * pace + turned(moves[-1]))
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.concatenate(moves, 1) ** 2 / np.maximum(least, 0.0) + np.concatenate(
                bends, 1
            )
        return np.where(np.isnan(found), np.inf, found) * (1 + 64 * EPS)


def segment_distance(p0: Array, p1: Array, q0: Array, q1: Array) -> Array:
    """Return the distances (…) of segments p0 p1 and q0 q1, each (…, 3).

    Exact for parallel, crossing and zero-length segments. The nearest points are an end of one
    segment and a point of the other, or lie inside both, where the common perpendicular of the two
    lines meets them: n = u × v, s = (w × v)·n/‖n‖², t = (w × u)·n/‖n‖² with w = q0 − p0. Every
    candidate is a pair of points of the two segments, so none can be too small. Cross products keep
    what a determinant of dot products would lose for nearly parallel lines.
    """
    ends = [
        point_segment_distance(p0, q0, q1),
        point_segment_distance(p1, q0, q1),
        point_segment_distance(q0, p0, p1),
        point_segment_distance(q1, p0, p1),
    ]
    u = p1 - p0
    v = q1 - q0
    w = q0 - p0
    n = np.cross(u, v)
    square = _dot(n, n)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.clip(_dot(np.cross(w, v), n) / square, 0.0, 1.0)
        t = np.clip(_dot(np.cross(w, u), n) / square, 0.0, 1.0)
        inside = _length(w + t[..., None] * v - s[..., None] * u)
    # parallel lines have no common perpendicular: their distance is that of an end
    return np.asarray(np.minimum.reduce([*ends, np.where(square > 0, inside, np.inf)]))


def point_segment_distance(point: Array, start: Array, end: Array) -> Array:
    """Return the distances (…) of points from segments, each (…, 3)."""
    along = end - start
    square = _dot(along, along)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(square > 0, np.clip(_dot(point - start, along) / square, 0.0, 1.0), 0.0)
    return _length(point - start - share[..., None] * along)


def segment_disc_distance(start: Array, end: Array, disc: Disc) -> Array:
    """Return the distances (…) of segments (…, 3) in the disc's frame from the disc; 0 where they
    meet.

    At radius ρ and height h from the centre, a point is √(max(ρ − R, 0)² + max(|h| − T/2, 0)²)
    away. Along a segment the square of it is convex with a continuous slope: the nearest point is
    an end unless the slope changes its sign between them; then it is found by halving.
    """
    low = np.zeros(start.shape[:-1])
    high = np.ones(start.shape[:-1])
    first, falling = _point_disc(start, end, low, disc)
    last, rising = _point_disc(start, end, high, disc)
    least = np.asarray(np.minimum(first, last))
    turns = (falling < 0) & (rising > 0)
    if not turns.any():
        return least
    start, end, low, high = (values[turns] for values in (start, end, low, high))
    for _ in range(BISECTIONS_OF_ROOT):
        middle = (low + high) / 2
        is_before = _point_disc(start, end, middle, disc)[1] < 0
        low = np.where(is_before, middle, low)
        high = np.where(is_before, high, middle)
    least[turns] = np.minimum(
        _point_disc(start, end, low, disc)[0], _point_disc(start, end, high, disc)[0]
    )
    return least


def _point_disc(start: Array, end: Array, s: Array, disc: Disc) -> tuple[Array, Array]:
    """Return the distance (…) of start + s (end − start) from a disc, and half the slope of its
    square.
    """
    normal = np.asarray(disc.normal)
    along = end - start
    point = start - np.asarray(disc.centre) + s[..., None] * along
    height = point @ normal
    flat = point - height[..., None] * normal
    radius = _length(flat)
    above = np.maximum(np.abs(height) - disc.thickness / 2, 0.0)
    aside = np.maximum(radius - disc.radius, 0.0)
    outwards = _dot(flat, along) / np.where(radius > 0, radius, 1.0)
    slope = above * np.sign(height) * (along @ normal) + aside * outwards
    return np.hypot(above, aside), slope


def _dot(one: Array, other: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", one, other))


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(_dot(vectors, vectors)))


def clearance_use(clearance: Array, contact: Array) -> Array:
    """(N, k) contact / distance of axes: 1 where bodies touch."""
    with np.errstate(divide="ignore"):
        return np.asarray(contact / np.maximum(clearance + contact, 0.0))
