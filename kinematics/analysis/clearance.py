"""Clearance: how far legs stay from each other and from the platforms' discs.

A leg is a capsule: all points within `leg_radius` of a segment of the line between its joint centres. A platform is a
disc: a flat cylinder. Both distances are those of convex bodies, and exact: what a formula cannot settle (parallel,
crossing, shrunk to a point) is settled by the ends.
"""

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import LEAST_POSITIVE, Array, finite_array, freeze_array, unit_vectors
from kinematics.foundation.errors import MotionError
from kinematics.foundation.kernels import Floats1, Floats2, Strided1, call_light, kernel
from kinematics.foundation.taylor_model import EPS

FEW_POSES = 64
"""Poses that are not worth loading the compiler."""
BISECTIONS_OF_ROOT = 55
"""Until the last place of a parameter in [0, 1]."""


@dataclass(frozen=True, slots=True)
class Disc:
    """A plate in its platform's frame: a cylinder of `radius` and `thickness` (m) about `normal` at `centre`."""

    radius: float
    thickness: float
    centre: ArrayLike = (0.0, 0.0, 0.0)
    normal: ArrayLike = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        finite_array(self.radius, "disc: radius", (), unit="m", least=LEAST_POSITIVE)
        finite_array(self.thickness, "disc: thickness", (), unit="m", least=0)
        object.__setattr__(self, "centre", freeze_array(finite_array(self.centre, "disc: centre", (3,), unit="m")))
        object.__setattr__(self, "normal", freeze_array(unit_vectors(self.normal, "disc: normal", (3,))))

    @property
    def numbers(self) -> Array:
        """(1, 8) centre, normal, radius and thickness."""
        return np.concatenate([self.centre, self.normal, [self.radius, self.thickness]], dtype=float)[None]


@dataclass(frozen=True)
class Bodies:
    """What of a machine with legs takes up room.

    base, platform  (n, 3) joint centres in the frames of base and platform, m
    legs            (n,) names
    leg_radius      m, of every leg
    leg_ends        m from either joint centre to where the segment begins; None: leg_radius, so that the capsule's
                    round tips end in the joint centres
    base_disc, platform_disc  the plates, in the frames of base and platform; None: not looked at

    Moving the platform without turning it by v changes no distance by more than ‖v‖: a point of a leg, or of a disc,
    moves by A v with a symmetric A between 0 and 1, so any two of them by (A − A') v, and ‖A − A'‖ ≤ 1. Turning it
    moves the joint at r from its origin by no more than ‖r‖ times the angle: see `change`.

    A distance is the least of those of all pairs of points that stay where they are in their bodies. Where D joins
    such a pair, ‖D‖¨ ≤ ‖Ḋ‖²/‖D‖ + ‖D̈‖: with K no less than that for any pair, d − K τ²/2 is the least of concave
    functions, so concave, and d lies above its chord less K τ (2 − τ)/2 over a cell of τ from 0 to 2: see `bend`.
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
        discs = [name for name, disc in (("base", self.base_disc), ("platform", self.platform_disc)) if disc]
        pairs = [f"{a}–{b}" for a, b in combinations(self.legs, 2)]
        return (*pairs, *(f"{leg}–{disc}" for disc in discs for leg in self.legs))

    @property
    def content(self) -> Hashable:
        """What decides its distances."""
        discs = tuple(disc and disc.numbers.tobytes() for disc in (self.base_disc, self.platform_disc))
        return self.legs, self.ends, self.leg_radius, self.base.tobytes(), self.platform.tobytes(), discs

    @cached_property
    def contact(self) -> Array:
        """(k,) m: the distance of axes, or of axis and disc, at which the bodies touch."""
        pairs = len(self.legs) * (len(self.legs) - 1) // 2
        return freeze_array(self.leg_radius * np.array([2.0] * pairs + [1.0] * (len(self.names) - pairs)))

    def distances(self, x: Array) -> Array:
        """(N, k) m between the axes of any two legs, then between legs and discs, at the poses of numbers x (N, 12)."""
        found = np.empty((len(x), len(self.names)))
        discs = [np.zeros((0, 8)) if disc is None else disc.numbers for disc in (self.base_disc, self.platform_disc)]
        # copies: one kind of array, for which the loop is compiled once
        x, base, platform = (np.array(each, float, order="C") for each in (x, self.base, self.platform))
        given = x, base, platform, float(self.ends), *discs, found
        if len(x) > FEW_POSES:
            measure_distances(*given)
        else:
            call_light(measure_distances, *given)
        return found

    def change(self, x: Array, way: Array, turn: Array) -> Array:
        """(N, k) m by which no distance changes on any path of the platform from x (N, 12), with its origin's way (N,)
        m and its turn (N,) rad at most.

        Legs i and j: way + turn (‖rᵢ‖ + ‖rⱼ‖);  leg and base: way + turn ‖r‖;  leg and platform, as seen from there,
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
        self, x: Array, way: Array, turn: Array, least: Array, first: tuple[Array, Array], second: tuple[Array, Array]
    ) -> Array:
        """(N, k) that no second derivative of a distance along any path from x (N, 12) is above; ∞ where it has none.

        way, turn (N,)  of the platform at most, as in `change`
        least (N, k)    no distance is below that
        first, second   ((N,), (N,)) of its origin and its turn, the largest of the first derivatives: those of ‖ṗ‖ and
                        of the angle, and of the second: ‖p̈‖ and Frobenius' norm of R̈

        A leg ℓ of length L at whose ends e is left out has points (1−σ) b + σ j + e (1−2σ) ℓ/L, with
        ‖(ℓ/L)¨ − P ℓ̈/L‖ ≤ 2 ‖ℓ̇‖²/L², P across the leg: their second derivative is A ℓ̈ with A between 0 and 1, and no
        more than 2 e ‖ℓ̇‖²/L². The base as seen from the platform: Rᵀ(b − p).
        """
        way, turn, pace, spin, push, swing = (each[:, None] for each in (way, turn, *first, *second))
        arm = _length(self.platform)
        joints = x[:, None, :3] + self.platform @ x[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2)
        length = _length(joints - self.base) - (way + turn * arm)
        i, j = np.array(list(combinations(range(len(self.legs)), 2))).T

        def turned(speed: Array) -> Array:
            """What the shortening of legs adds, at speeds ‖ℓ̇‖ (N, n)."""
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.where(length > 2 * self.ends, 2 * self.ends * speed**2 / length**2, np.inf)

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
            found = np.concatenate(moves, 1) ** 2 / np.maximum(least, 0.0) + np.concatenate(bends, 1)
        return np.where(np.isnan(found), np.inf, found) * (1 + 64 * EPS)


@kernel
def measure_distances(
    x: Floats2, base: Floats2, platform: Floats2, ends: float, base_disc: Floats2, platform_disc: Floats2, out: Floats2
) -> None:
    """Fill out (N, k) as `Bodies.distances`; of each disc (1, 8) centre, normal, radius and thickness, or (0, 8)."""
    legs = len(base)
    low, high, start, end = np.zeros((legs, 3)), np.zeros((legs, 3)), np.zeros(3), np.zeros(3)
    leg = np.zeros(3)
    for n in range(len(x)):
        for k in range(legs):
            for i in range(3):
                row = 3 + 3 * i
                turned = x[n, row] * platform[k, 0] + x[n, row + 1] * platform[k, 1] + x[n, row + 2] * platform[k, 2]
                high[k, i] = x[n, i] + turned
                leg[i] = high[k, i] - base[k, i]
            length = np.sqrt(leg[0] * leg[0] + leg[1] * leg[1] + leg[2] * leg[2])
            share = min(ends / length, 0.5) if length > 0 else 0.5
            for i in range(3):
                low[k, i] = base[k, i] + share * leg[i]
                high[k, i] -= share * leg[i]
        place = 0
        for k in range(legs):
            for other in range(k + 1, legs):
                out[n, place] = segment_distance(low[k], high[k], low[other], high[other])
                place += 1
        for disc in base_disc:
            for k in range(legs):
                out[n, place] = segment_disc_distance(low[k], high[k], disc)
                place += 1
        for disc in platform_disc:  # seen from the platform
            for k in range(legs):
                for i in range(3):
                    start[i] = end[i] = 0.0
                    for row in range(3):
                        start[i] += (low[k, row] - x[n, row]) * x[n, 3 + 3 * row + i]
                        end[i] += (high[k, row] - x[n, row]) * x[n, 3 + 3 * row + i]
                out[n, place] = segment_disc_distance(start, end, disc)
                place += 1


@kernel
def segment_distance(p0: Floats1, p1: Floats1, q0: Floats1, q1: Floats1) -> float:
    """Distance of the segments p0 p1 and q0 q1 (3,), exact for parallel, crossing and zero-length ones.

    The nearest points are an end of one of them and a point of the other, or lie inside both, where the common
    perpendicular of the two lines meets them: n = u × v, s = (w × v)·n/‖n‖², t = (w × u)·n/‖n‖² with w = q0 − p0. Every
    candidate is a pair of points of the two segments, so none can be too small. Cross products keep what a determinant
    of dot products would lose for nearly parallel lines.
    """
    least: float = min(
        min(point_segment_distance(p0, q0, q1), point_segment_distance(p1, q0, q1)),
        min(point_segment_distance(q0, p0, p1), point_segment_distance(q1, p0, p1)),
    )
    u0, u1, u2 = p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]
    v0, v1, v2 = q1[0] - q0[0], q1[1] - q0[1], q1[2] - q0[2]
    w0, w1, w2 = q0[0] - p0[0], q0[1] - p0[1], q0[2] - p0[2]
    n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    square = n0 * n0 + n1 * n1 + n2 * n2
    if not square > 0:
        return least
    s = ((w1 * v2 - w2 * v1) * n0 + (w2 * v0 - w0 * v2) * n1 + (w0 * v1 - w1 * v0) * n2) / square
    t = ((w1 * u2 - w2 * u1) * n0 + (w2 * u0 - w0 * u2) * n1 + (w0 * u1 - w1 * u0) * n2) / square
    s, t = min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0)
    d0, d1, d2 = w0 + t * v0 - s * u0, w1 + t * v1 - s * u1, w2 + t * v2 - s * u2
    return float(min(least, np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)))


@kernel
def point_segment_distance(point: Floats1, start: Floats1, end: Floats1) -> float:
    """Distance of a point from a segment (3,)."""
    a0, a1, a2 = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    t0, t1, t2 = point[0] - start[0], point[1] - start[1], point[2] - start[2]
    square = a0 * a0 + a1 * a1 + a2 * a2
    share = min(max((t0 * a0 + t1 * a1 + t2 * a2) / square, 0.0), 1.0) if square > 0 else 0.0
    d0, d1, d2 = t0 - share * a0, t1 - share * a1, t2 - share * a2
    return float(np.sqrt(d0 * d0 + d1 * d1 + d2 * d2))


@kernel
def segment_disc_distance(start: Floats1, end: Floats1, disc: Strided1) -> float:
    """Distance of a segment (3,) from a disc in the disc's frame, as in `measure_distances`; 0 where they meet.

    At radius ρ and height h from the centre, a point is √(max(ρ − R, 0)² + max(|h| − T/2, 0)²) away. Along a segment
    the square of it is convex with a continuous slope: the nearest point is an end unless the slope changes its sign
    between them; then it is found by halving.
    """
    low, high = 0.0, 1.0
    first, falling = _point_disc(start, end, low, disc)
    last, rising = _point_disc(start, end, high, disc)
    if not (falling < 0 and rising > 0):
        return float(min(first, last))
    for _ in range(BISECTIONS_OF_ROOT):
        middle = (low + high) / 2
        if _point_disc(start, end, middle, disc)[1] < 0:
            low = middle
        else:
            high = middle
    return float(min(_point_disc(start, end, low, disc)[0], _point_disc(start, end, high, disc)[0]))


@kernel
def _point_disc(start: Floats1, end: Floats1, s: float, disc: Strided1) -> tuple[float, float]:
    """Distance of start + s (end − start) from a disc, and half the slope of its square."""
    height = rate = 0.0
    for i in range(3):
        along = end[i] - start[i]
        height += (start[i] - disc[i] + s * along) * disc[3 + i]
        rate += along * disc[3 + i]
    square = outwards = 0.0
    for i in range(3):
        along = end[i] - start[i]
        flat = start[i] - disc[i] + s * along - height * disc[3 + i]
        square += flat * flat
        outwards += flat * along
    radius = np.sqrt(square)
    over, aside = max(abs(height) - disc[7] / 2, 0.0), max(radius - disc[6], 0.0)
    slope = over * np.sign(height) * rate + (aside * outwards / radius if radius > 0 else 0.0)
    return np.hypot(over, aside), slope


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def clearance_use(clearance: Array, contact: Array) -> Array:
    """(N, k) contact / distance of axes: 1 where bodies touch."""
    with np.errstate(divide="ignore"):
        return np.asarray(contact / np.maximum(clearance + contact, 0.0))
