"""Where a motion and its derivatives lie over cells of time, from series of the path: cheap, and near enough for most.

q(σ), a Taylor series with guaranteed error over a stretch of path, serves all cells of time in that stretch: with the
cubic σ(τ) put into it, q is a polynomial in τ ∈ [−1, 1]. Every product of these sums is carried twice more, with the
sizes of its factors, and with those enlarged by their errors: the one bounds rounding, and the difference of the two
what errors can change, since |∏(x + e) − ∏x| ≤ ∏(|x| + |e|) − ∏|x|; higher powers than are kept are part of it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError
from kinematics.foundation.kernels import kernel
from kinematics.foundation.taylor_model import EPS, Series
from planner.certificate.enclosure import Cells, expand_motion
from planner.path.actuation import ActuatorPath, MachinePath, check_rate
from planner.trajectory import MIN_PARTS, PER_RADIAN, Trajectory

# Order of the series along the path, and how many stretches of it there are to one of `unit_speed_trajectory`.
PATH_ORDER, STRETCHES = 8, 2
# What a group of cells takes of its stretch at least; powers of τ that are kept beyond the highest derivative.
LEAST_EXTENT, MORE_POWERS = 2.0**-29, 4
# Cells that are bounded together: their numbers stay in the processor's cache.
CELLS = 64
# Share of a polynomial's lower coefficients up to which its cubic one is little beside what bounds may be off.
SMALL_CUBIC = 2.0**-26
# Roundings of any one product in the sums below: fewer.
ROUNDINGS = 64 * EPS


@dataclass(frozen=True)
class Ranges:
    """The motion over N cells, each quantity a ball (1, N, m) about the middle of where it lies.

    piece (N,) of path
    axes  (4, highest + 1, N, n) of q and its derivatives: middles, radii, and what is met for certain (`bound_motion`)
    find_pose  balls of the pose's numbers and their derivatives up to an order, 2 or 3
    """

    stretches: "_Stretches"
    piece: np.ndarray
    axes: Array
    find_pose: Callable[[int], Array]

    @cached_property
    def _pose(self) -> Array:
        return self.find_pose(2)

    @cached_property
    def _pose_to_jerk(self) -> Array:
        """Balls of the pose up to the third derivative, which few limits need."""
        return self.find_pose(3)

    def __getitem__(self, rows: np.ndarray) -> "Ranges":
        """Of some cells."""
        some = self.stretches[rows]
        return Ranges(some, self.piece[rows], self.axes[:, :, rows], some.bound_pose)

    def range_over(self, trajectory: Trajectory, parts: Cells, rows: np.ndarray) -> "Ranges":
        """Over parts of cells, of which each is the cell of: as there, from the same series."""
        return self.stretches.range_over(self.stretches.stretch[rows], expand_motion(trajectory, parts))

    def merge(self, first: np.ndarray) -> "Ranges":
        """Of groups of cells of one stretch, one after the other, from the `first` of each."""
        return Ranges(
            self.stretches,
            self.piece[first],
            _merge_balls(self.axes[0], self.axes[1], first),
            lambda highest: self.stretches.bound_pose_of_groups(first, highest),
        )

    @property
    def met(self) -> "tuple[Ranges, Ranges]":
        """The least and the most that each axis' value and derivatives surely are, each at an instant of its own."""
        found = [
            Ranges(self.stretches, self.piece, np.stack([each, 0 * each]), self.find_pose) for each in self.axes[2:]
        ]
        return found[0], found[1]

    @property
    def q(self) -> Series:
        return _make_ball(self.axes, 0)

    @property
    def qd(self) -> Series:
        return _make_ball(self.axes, 1)

    @property
    def qdd(self) -> Series:
        return _make_ball(self.axes, 2)

    @property
    def qddd(self) -> Series:
        return _make_ball(self.axes, 3)

    def pose_rate(self, times: int) -> Series:
        return _make_ball(self._pose if check_rate(times) < 3 else self._pose_to_jerk, times)

    def tool_rate(self, times: int) -> Series:
        rate, tool = self.pose_rate(times), self.stretches.path.tool
        return rate if tool is None else self.evaluate(tool, rate)

    def evaluate(self, expression: Expression, *inputs: Series) -> Series:
        return expression.enclose_columns(*inputs)

    def distances(self, bodies: Bodies) -> Series:
        raise MotionError("distances are bounded along the path, not over time")


def _make_ball(found: Array, n: int) -> Series:
    return Series(found[0, n : n + 1], found[1, n : n + 1], 0)


@dataclass(frozen=True, slots=True)
class _Stretches:
    """Which of G stretches of path N cells lie in, and how they run through it.

    stretch (N,); middle and half (G,) of stretches, of path pieces on_piece (G,)
    motion (4, N) σ's coefficients in τ, and error (4, N) of them; rate (N,) 1/s, by which τ runs
    highest  derivative of the axes; along: s over the stretches; known: the series of axes and pose that were made
    """

    path: ActuatorPath
    middle: Array
    half: Array
    on_piece: np.ndarray
    highest: int
    along: Series
    stretch: np.ndarray
    motion: Array
    error: Array
    rate: Array
    known: dict[bool, tuple[Array, Array]] = field(default_factory=dict)

    def range_over(self, stretch: np.ndarray, motion: tuple[Array, Array, Array]) -> Ranges:
        """Over cells of time that lie in its stretches, stretch (N,): what `expand_motion` finds of them."""
        way, error, half = motion
        centre, wide = self.middle[stretch], self.half[stretch]
        way = np.concatenate([way[:1] - centre, way[1:]]) / wide
        error = np.concatenate([error[:1] + 32 * EPS * np.abs(centre), error[1:]]) / wide
        cells = replace(self, stretch=stretch, motion=way, error=error, rate=1 / half)
        return Ranges(cells, self.on_piece[stretch], cells.bound_axes(), cells.bound_pose)

    def __getitem__(self, rows: np.ndarray) -> "_Stretches":
        """Of some cells."""
        motion, error = self.motion[:, rows], self.error[:, rows]
        return replace(self, stretch=self.stretch[rows], motion=motion, error=error, rate=self.rate[rows])

    def bound_axes(self) -> Array:
        """Of the axes and their derivatives by time: what `bound_motion` finds, (4, highest + 1, N, n)."""
        return self._bound(False, self.highest, 4)

    def bound_pose(self, highest: int) -> Array:
        """Bound the pose's numbers and their derivatives: balls, (2, highest + 1, N, 12)."""
        return self._bound(True, highest, 2)

    def bound_pose_of_groups(self, first: np.ndarray, highest: int) -> Array:
        """Bound the same over groups of cells of one stretch, from the `first` of each.

        ẋ = x′ σ̇,  ẍ = x′ σ̈ + x″ σ̇²,  x⃛ = x′ σ⃛ + 3 x″ σ̇ σ̈ + x‴ σ̇³.
        """
        (s0, s1, s2, s3), (e0, e1, e2, e3) = self.motion, self.error
        reach = np.abs(s1) + np.abs(s2) + np.abs(s3) + e0 + e1 + e2 + e3
        speed, push, jerk = s1 * self.rate, 2 * s2 * self.rate**2, 6 * s3 * self.rate**3
        faster = (2 * np.abs(s2) + 3 * np.abs(s3) + e1 + 2 * e2 + 3 * e3) * self.rate
        harder = (6 * np.abs(s3) + 2 * e2 + 6 * e3) * self.rate**2
        jerkier = 6 * e3 * self.rate**3
        size = np.stack([np.abs(s0), np.abs(speed), np.abs(push), np.abs(jerk)])
        spread = np.stack([reach, faster, harder, jerkier])
        balls = np.stack([s0, speed, push, jerk]), spread * (1 + 16 * EPS) + 16 * EPS * size
        merged = _merge_balls(balls[0][..., None], balls[1][..., None], first)
        (place, speed, push, jerk), (far, faster, harder, jerkier) = merged
        # a place where the motion rests is one of no extent
        low = np.minimum(place - far, 1 - LEAST_EXTENT)
        half = (np.maximum(place + far, low + LEAST_EXTENT) - low) / 2
        none = np.zeros_like(half[:, 0])
        way, error = np.stack([(low + half)[:, 0], half[:, 0], none, none]), np.zeros((4, len(none)))
        error[0] = 8 * EPS * (np.abs(low) + half)[:, 0]
        along = replace(self, stretch=self.stretch[first], motion=way, error=error, rate=1 / half[:, 0])
        pose = along.bound_pose(highest)
        x1, x2 = _make_ball(pose, 1), _make_ball(pose, 2)
        rate, growth = Series(speed[None], faster[None], 0), Series(push[None], harder[None], 0)
        rates = [x1 * rate, x1 * growth + x2 * (rate * rate)]
        if highest == 3:
            third = Series(jerk[None], jerkier[None], 0)
            rates.append(x1 * third + x2 * (rate * growth) * 3.0 + _make_ball(pose, 3) * (rate * rate * rate))
        for n, each in enumerate(rates, 1):
            pose[0, n], pose[1, n] = each.mid[0], each.rad[0]
        return pose

    def _bound(self, pose: bool, highest: int, kinds: int) -> Array:
        mid, rad = self._enclose(pose)
        found = np.empty((kinds, highest + 1, len(self.stretch), mid.shape[2]))
        met = found[2:] if kinds == 4 else np.empty((2, 0, 0, 0))
        # one layout in memory, so that the kernel is compiled once
        mid, rad, motion, error = map(np.ascontiguousarray, (mid, rad, self.motion, self.error))
        bound_motion(mid, rad, self.stretch, motion, error, self.rate, *found[:2], *met)
        return found

    def _enclose(self, pose: bool) -> tuple[Array, Array]:
        """Coefficients (PATH_ORDER + 1, G, m) over the stretches; the last is what remains."""
        if pose in self.known:
            return self.known[pose]
        enclose, count = self.path.enclose_pose if pose else self.path.enclose, len(self.middle)
        found = enclose(self.along, np.tile(self.on_piece, 2))
        assert found is not None  # only machines have limits on their pose
        full = found.pad(PATH_ORDER)
        mid, rad = np.array(full.mid[:, :count]), np.array(full.rad[:, :count])
        mid[-1], rad[-1] = 0.0, np.abs(full.mid[-1, count:]) + full.rad[-1, count:]
        self.known[pose] = mid, rad
        return mid, rad


def _merge_balls(mid: Array, rad: Array, first: np.ndarray) -> Array:
    """Balls (2, k, G, m) that hold those (k, N, m) of each group, from its `first`."""
    low = np.minimum.reduceat(mid - rad, first, axis=1)
    high = np.maximum.reduceat(mid + rad, first, axis=1)
    middle, good = (low + high) / 2, np.isfinite(low) & np.isfinite(high)
    wide = (high - low) / 2 * (1 + 4 * EPS) + 8 * EPS * np.maximum(np.abs(low), np.abs(high))
    return np.stack([np.where(good, middle, 0.0), np.where(good, wide, np.inf)])


def bound_balls(values: Series) -> tuple[Array, Array]:
    """Bounds low and high (N, m) of what is computed from ranges."""
    mid, rad = values.mid[0], values.rad[0]
    rad = np.where(np.isfinite(mid) & np.isfinite(rad), rad * (1 + 4 * EPS) + 4 * EPS * np.abs(mid), np.inf)
    return mid - rad, mid + rad


def bound_ranges(trajectory: Trajectory, cells: Cells, highest: int) -> Ranges:
    """The motion and its derivatives up to the `highest` over cells of time."""
    path, piece = trajectory.path, trajectory.piece[cells.k]
    way, error, half = expand_motion(trajectory, cells)
    reach = np.abs(way[1:]).sum(0) + error.sum(0)
    # polynomials are known exactly over a whole piece
    least = MIN_PARTS if isinstance(path, MachinePath) else 1
    parts = STRETCHES * np.maximum(least, np.ceil(PER_RADIAN * path.turns))
    width = np.diff(path.breaks) / parts
    share = np.clip((way[0] - path.breaks[piece]) / width[piece], 0, parts[piece] - 1)
    key = np.concatenate([[0], np.cumsum(parts)[:-1]])[piece] + np.floor(np.nan_to_num(share))
    entered = np.diff(key, prepend=-1) != 0  # one after the other: one that is come to again is another
    first, stretch = np.flatnonzero(entered), np.cumsum(entered) - 1
    low, high = np.minimum.reduceat(way[0] - reach, first), np.maximum.reduceat(way[0] + reach, first)
    centre = (low + high) / 2
    wide = (high - low) / 2 * (1 + 64 * EPS) + 64 * EPS * np.maximum(np.abs(low), np.abs(high))
    # s over the stretches: about their middles, then anywhere
    none = np.zeros_like(wide)
    about, around = np.tile([centre, wide], 2), np.stack([np.append(none, wide), np.append(none, none)])
    stretches = _Stretches(
        path, centre, wide, piece[first], highest, Series(about, around, PATH_ORDER), stretch, way, error, half
    )
    return stretches.range_over(stretch, (way, error, half))


@kernel
def bound_motion(
    mid: Array,
    rad: Array,
    stretch: np.ndarray,
    motion: Array,
    error: Array,
    rate: Array,
    out_mid: Array,
    out_rad: Array,
    least: Array,
    most: Array,
) -> None:
    """Balls out (highest + 1, N, m) of a function and its derivatives by time, and what is met for certain.

    least, most (highest + 1, N, m)  no less and no more than the value at some instant each, 0 where unknown; or empty
    mid, rad (D + 1, G, m)   its coefficients over G stretches of path; the last, times σ^D, is what remains
    stretch (N,), motion, error (4, N), rate (N,)  as in `_Stretches`
    """
    degree, highest = len(mid) - 1, len(out_mid) - 1
    powers = min(highest + MORE_POWERS, degree - 1)
    # cells innermost: they are what the processor's vectors hold
    p, size = np.zeros((degree, CELLS)), np.zeros((degree, CELLS))
    a, large = np.zeros((powers + 1, CELLS)), np.zeros((powers + 1, CELLS))
    e, whole, slack, scale = np.zeros((powers + 6, CELLS)), np.zeros((4, CELLS)), np.zeros(CELLS), np.zeros(CELLS)
    s0, s1, s2, s3, t0, t1, t2, t3, reach, z1, z2, z3 = np.zeros((12, CELLS))
    a0, a1, a2, a3, one, other = np.zeros((6, CELLS))
    sure, start, end, first, second = np.zeros((5, CELLS))
    for begin in range(0, len(stretch), CELLS):
        count = min(CELLS, len(stretch) - begin)
        for n in range(count):
            s0[n], s1[n], s2[n], s3[n] = (
                motion[0, begin + n],
                motion[1, begin + n],
                motion[2, begin + n],
                motion[3, begin + n],
            )
            t0[n], t1[n], t2[n], t3[n] = abs(s0[n]), abs(s1[n]), abs(s2[n]), abs(s3[n])
            w1, w2, w3 = t1[n] + error[1, begin + n], t2[n] + error[2, begin + n], t3[n] + error[3, begin + n]
            # how far σ reaches, and its derivatives by τ at the most
            reach[n] = (t0[n] + error[0, begin + n] + w1 + w2 + w3) * (1 + ROUNDINGS)
            z1[n], z2[n], z3[n] = w1 + 2 * w2 + 3 * w3, 2 * w2 + 6 * w3, 6 * w3
        for c in range(mid.shape[2]):
            for i in range(degree):
                for n in range(count):
                    p[i, n] = mid[i, stretch[begin + n], c]
                    size[i, n] = abs(p[i, n])
            # of sizes and errors together, with its derivatives by σ, at the end
            for n in range(count):
                whole[0, n] = abs(mid[degree, stretch[begin + n], c]) + rad[degree, stretch[begin + n], c]
                whole[1, n] = whole[2, n] = whole[3, n] = 0.0
            for i in range(degree - 1, -1, -1):
                for n in range(count):
                    whole[3, n] = whole[3, n] * reach[n] + 3 * whole[2, n]
                    whole[2, n] = whole[2, n] * reach[n] + 2 * whole[1, n]
                    whole[1, n] = whole[1, n] * reach[n] + whole[0, n]
                    whole[0, n] = whole[0, n] * reach[n] + (size[i, n] + rad[i, stretch[begin + n], c])
            # about where the cell's middle lies
            for i in range(powers + 1):
                for k in range(degree - 2, i - 1, -1):
                    for n in range(count):
                        p[k, n] += s0[n] * p[k + 1, n]
                        size[k, n] += t0[n] * size[k + 1, n]
            # p(s1 τ + s2 τ² + s3 τ³), Horner's scheme from the highest coefficient of τ down, in place
            for n in range(count):
                a[0, n], large[0, n] = p[powers, n], size[powers, n]
            for k in range(1, powers + 1):
                for n in range(count):
                    a[k, n] = large[k, n] = 0.0
            for i in range(powers - 1, -1, -1):
                for k in range(min(powers, 3 * (powers - i)), 2, -1):
                    for n in range(count):
                        a[k, n] = s1[n] * a[k - 1, n] + s2[n] * a[k - 2, n] + s3[n] * a[k - 3, n]
                        large[k, n] = t1[n] * large[k - 1, n] + t2[n] * large[k - 2, n] + t3[n] * large[k - 3, n]
                for n in range(count):
                    a[2, n] = s1[n] * a[1, n] + s2[n] * a[0, n]
                    large[2, n] = t1[n] * large[1, n] + t2[n] * large[0, n]
                    a[1, n] = s1[n] * a[0, n]
                    large[1, n] = t1[n] * large[0, n]
                    a[0, n] = p[i, n]
                    large[0, n] = size[i, n]
            for n in range(count):
                scale[n] = 1.0
            for m in range(highest + 1):
                for n in range(count):
                    if m == 0:
                        slack[n] = whole[0, n]
                    elif m == 1:
                        slack[n] = whole[1, n] * z1[n]
                    elif m == 2:
                        slack[n] = whole[2, n] * z1[n] * z1[n] + whole[1, n] * z2[n]
                    else:
                        slack[n] = whole[3, n] * z1[n] * z1[n] * z1[n]
                        slack[n] += 3 * whole[2, n] * z1[n] * z2[n] + whole[1, n] * z3[n]
                    slack[n] *= 1 + ROUNDINGS
                for k in range(m, powers + 1):
                    factor = 1.0
                    for i in range(m):
                        factor *= k - i
                    for n in range(count):
                        e[k - m, n] = factor * a[k, n]
                        slack[n] -= factor * large[k, n] * (1 - 2 * ROUNDINGS)
                for k in range(powers - m + 1, powers + 6):
                    for n in range(count):
                        e[k, n] = 0.0
                # but for a little of what comes after it, a cubic: Chebyshev's; it peaks where its slope is nothing
                for n in range(count):
                    sure[n] = slack[n]
                    slack[n] += abs(e[4, n]) / 8 + abs(e[5, n]) / 16
                    a0[n], a1[n] = e[0, n] - e[4, n] / 8, e[1, n] - 0.3125 * e[5, n]
                    a2[n], a3[n] = e[2, n] + e[4, n], e[3, n] + 1.25 * e[5, n]
                for n in range(count):
                    one[n] = other[n] = 0.0
                    if abs(a3[n]) <= SMALL_CUBIC * (abs(a0[n]) + abs(a1[n]) + abs(a2[n])):
                        slack[n] += abs(a3[n]) / 4
                        a1[n] += 0.75 * a3[n]
                        a3[n] = 0.0
                        if abs(a1[n]) < 2 * abs(a2[n]):
                            one[n] = -a1[n] / (2 * a2[n])
                    else:
                        unit = abs(a1[n]) + abs(a2[n]) + abs(a3[n])  # else squares vanish, or are beyond all numbers
                        b1, b2, b3 = a1[n] / unit, a2[n] / unit, a3[n] / unit
                        square = b2 * b2 - 3 * b1 * b3
                        if square > 0:
                            root = -b2 - np.sqrt(square) if b2 > 0 else -b2 + np.sqrt(square)
                            one[n] = root / (3 * b3) if abs(root) < 3 * abs(b3) else 0.0
                            other[n] = b1 / root if abs(b1) < abs(root) else 0.0
                for k in range(6, powers - m + 1):
                    for n in range(count):
                        slack[n] += abs(e[k, n])
                if len(least):  # what the polynomial itself is there, and at both ends
                    for n in range(count):
                        start[n] = end[n] = first[n] = second[n] = 0.0
                    for k in range(powers - m, -1, -1):
                        for n in range(count):
                            sure[n] += ROUNDINGS * abs(e[k, n])
                            start[n], end[n] = e[k, n] - start[n], e[k, n] + end[n]
                            first[n], second[n] = e[k, n] + one[n] * first[n], e[k, n] + other[n] * second[n]
                for n in range(count):
                    even, odd = a0[n] + a2[n], abs(a1[n] + a3[n])
                    up = a0[n] + one[n] * (a1[n] + one[n] * (a2[n] + one[n] * a3[n]))
                    down = a0[n] + other[n] * (a1[n] + other[n] * (a2[n] + other[n] * a3[n]))
                    low, high = min(even - odd, up, down) * scale[n], max(even + odd, up, down) * scale[n]
                    beyond = slack[n] * scale[n] * (1 + ROUNDINGS)
                    own = (high - low) / 2 * (1 + 4 * EPS) + 16 * EPS * max(abs(low), abs(high)) + beyond
                    good = reach[n] <= 1 and np.isfinite(own) and np.isfinite(low) and np.isfinite(high)
                    out_mid[m, begin + n, c] = (low + high) / 2 if good else 0.0
                    out_rad[m, begin + n, c] = own if good else np.inf
                    if len(least):
                        beside, bottom = sure[n] * (1 + ROUNDINGS), min(start[n], end[n], first[n], second[n])
                        top = max(start[n], end[n], first[n], second[n])
                        least[m, begin + n, c] = (bottom + beside) * scale[n] if good else 0.0
                        most[m, begin + n, c] = (top - beside) * scale[n] if good else 0.0
                    scale[n] *= rate[begin + n]
