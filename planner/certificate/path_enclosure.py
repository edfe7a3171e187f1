"""The coarse enclosure of a motion: intervals of its quantities over cells of time.

q(σ), a Taylor series with guaranteed error over an interval of the path, serves all cells of time
in that interval (`planner.certificate.ranges`). Groups of cells are bounded by the chain rule, from
intervals of x′, x″, x‴ over their part of the path and intervals of ṡ, s̈, s⃛.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array, largest_in_rows
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError
from kinematics.foundation.taylor_model import EPS, Series
from planner.certificate.cells import Cells, Values
from planner.certificate.enclosure import (
    MotionEnclosure,
    cover_places,
    expand_motion,
    make_ball,
    split_series,
    widen,
)
from planner.certificate.ranges import bound_motion
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath, MachinePath, check_rate
from planner.trajectory import MIN_PARTS, PER_RADIAN, State, Trajectory

# Order of the series along the path, and intervals of the path per part of `unit_speed_trajectory`.
PATH_ORDER = 8
INTERVALS = 2
# Cells bounded together: their numbers stay in the processor's cache.
COARSE_BATCH = 1 << 13
# Parts into which a loose cell of a limit on single axes is split.
PARTS = 8
# Cells in a group, and the number of cells from which on groups pay.
GROUP_CELLS = 16
MIN_GROUPED = 512
# Least extent of a group of cells as a share of its interval: a motion at rest has none.
LEAST_EXTENT = 2.0**-29


class IntervalEnclosure(MotionEnclosure):
    """Intervals of a motion over N cells, each quantity a ball (1, N, m)."""

    @property
    @abstractmethod
    def axes(self) -> Array:
        """Middles and radii (2 or more, highest+1, N, n) of q and its derivatives by time."""

    @abstractmethod
    def bound_pose(self, highest: int) -> Array:
        """Return middles and radii (2, highest+1, N, 12) of the pose and its derivatives by
        time.
        """

    @cached_property
    def _pose(self) -> Array:
        return self.bound_pose(2)

    @cached_property
    def _pose_to_jerk(self) -> Array:
        """The pose with its third derivative, which few limits need."""
        return self.bound_pose(3)

    def axis_rate(self, times: int) -> Series:
        return _take_ball(self.axes, times)

    def pose_rate(self, times: int) -> Series:
        return _take_ball(
            self._pose if check_rate(times) < 3 else self._pose_to_jerk,
            times,
        )

    def distances(self, bodies: Bodies) -> Series:
        raise MotionError("distances are bounded along the path, not over time")

    def bound(self, values: Series) -> tuple[Array, Array]:
        mid = values.mid[0]
        rad = values.rad[0]
        finite = np.isfinite(mid) & np.isfinite(rad)
        rad = rad * (1 + 4 * EPS) + 4 * EPS * np.abs(mid)
        rad[~finite] = np.inf
        return mid - rad, mid + rad


def _take_ball(balls: Array, times: int) -> Series:
    return Series(balls[0, times : times + 1], balls[1, times : times + 1], 0)


@dataclass(frozen=True)
class PathEnclosure(IntervalEnclosure):
    """The coarse enclosure: series along the path, with the motion of each cell put into them.

    interval  (N,) of the path in which each cell lies
    motion    (9, N) coefficients of σ in τ, their errors and dτ/dt, as `bound_motion` takes them
    highest   derivative of q
    """

    path: ActuatorPath
    piece: np.ndarray
    series: "_PathSeries"
    interval: np.ndarray
    motion: Array
    highest: int

    @cached_property
    def axes(self) -> Array:
        """Balls of q and its derivatives, and two values between which each attains all (4, …)."""
        return self._bound(self.series.axes, self.highest, 4)

    def bound_pose(self, highest: int) -> Array:
        return self._bound(self.series.pose, highest, 2)

    def _bound(self, series: Array, highest: int, kinds: int) -> Array:
        out = np.empty((kinds, highest + 1, len(self.interval), series.shape[3]))
        # one layout in memory, so that the kernel is compiled once
        bound_motion(
            np.ascontiguousarray(series),
            self.interval,
            np.ascontiguousarray(self.motion),
            out,
        )
        return out

    def __getitem__(self, rows: np.ndarray) -> "PathEnclosure":
        return replace(
            self,
            piece=self.piece[rows],
            interval=self.interval[rows],
            motion=self.motion[:, rows],
        )

    def find_attained_use(self, limit: Limit) -> Array:
        """Return a use (N,) of a limit on single axes that is surely attained in each cell."""
        attained = [AttainedValues(self.path, self.piece, values) for values in self.axes[2:]]
        least, most = (limit.value(each).mid[0] for each in attained)
        return largest_in_rows(limit.use(least, most, self.piece))


@dataclass(frozen=True)
class GroupEnclosure(IntervalEnclosure):
    """Groups of consecutive cells, from `first` (G,) on, each bounded as one."""

    path: ActuatorPath
    piece: np.ndarray
    cells: PathEnclosure
    first: np.ndarray

    @cached_property
    def axes(self) -> Array:
        return _merge_balls(self.cells.axes[0], self.cells.axes[1], self.first)

    def bound_pose(self, highest: int) -> Array:
        """ẋ = x′ σ̇,  ẍ = x′ σ̈ + x″ σ̇²,  x⃛ = x′ σ⃛ + 3 x″ σ̇ σ̈ + x‴ σ̇³."""
        motion = self.cells.motion
        rate = motion[8]
        # the n-th derivative by τ is n! times the n-th coefficient, about any centre in the cell
        factors = np.stack([np.ones_like(rate), rate, 2 * rate**2, 6 * rate**3])
        mid = motion[:4] * factors
        rad = widen(motion[:4], motion[4:8]) * factors
        rad = rad * (1 + 16 * EPS) + 16 * EPS * np.abs(mid)
        sigma = _merge_balls(mid[..., None], rad[..., None], self.first)
        pose = self._bound_pose_along(sigma[:, 0, :, 0], highest)
        x1 = _take_ball(pose, 1)
        x2 = _take_ball(pose, 2)
        speed, growth, jerk = (_take_ball(sigma, n) for n in (1, 2, 3))
        rates = [x1 * speed, x1 * growth + x2 * (speed * speed)]
        if highest == 3:
            x3 = _take_ball(pose, 3)
            cube = speed * speed * speed
            rates.append(x1 * jerk + x2 * (speed * growth) * 3.0 + x3 * cube)
        for n, rate in enumerate(rates, 1):
            pose[:, n] = rate.mid[0], rate.rad[0]
        return pose

    def _bound_pose_along(self, sigma: Array, highest: int) -> Array:
        """Return the pose and its derivatives by σ over balls (2, G) of σ."""
        low = np.minimum(sigma[0] - sigma[1], 1 - LEAST_EXTENT)
        half = (np.maximum(sigma[0] + sigma[1], low + LEAST_EXTENT) - low) / 2
        motion = np.zeros((9, len(half)))
        motion[0] = low + half
        motion[1] = half
        motion[4] = 8 * EPS * (np.abs(low) + half)
        motion[8] = 1 / half
        return replace(self.cells[self.first], motion=motion).bound_pose(highest)


@dataclass(frozen=True)
class AttainedValues(IntervalEnclosure):
    """Single values (highest+1, N, n) of q and its derivatives, each at an instant of its own."""

    path: ActuatorPath
    piece: np.ndarray
    values: Array

    @property
    def axes(self) -> Array:
        return np.stack([self.values, np.zeros_like(self.values)])

    def bound_pose(self, highest: int) -> Array:
        raise MotionError("values of single axes have no pose")


def _merge_balls(mid: Array, rad: Array, first: np.ndarray) -> Array:
    """Return balls (2, k, G, m) that contain those (k, N, m) of each group, from `first` on."""
    low = np.minimum.reduceat(mid - rad, first, axis=1)
    high = np.maximum.reduceat(mid + rad, first, axis=1)
    middle, radius = make_ball(low, high)
    unbounded = ~(np.isfinite(low) & np.isfinite(high))
    middle[unbounded] = 0.0
    radius[unbounded] = np.inf
    return np.stack([middle, radius])


@dataclass(frozen=True)
class _PathSeries:
    """Taylor series of axes and pose over G intervals of the path.

    They are in σ = (s − centre)/half ∈ [−1, 1].

    centre, half (G,) m; piece (G,) of the path
    s  series in σ: about the centre of each interval, then about any place in it
    """

    path: ActuatorPath
    centre: Array
    half: Array
    piece: np.ndarray
    s: Series

    def enclose(
        self,
        interval: np.ndarray,
        expansion: tuple[Array, Array, Array],
        highest: int,
    ) -> PathEnclosure:
        """Return the enclosure of cells in intervals (N,), from the result of `expand_motion`."""
        s, error, half = expansion
        centre = self.centre[interval]
        width = self.half[interval]
        motion = np.concatenate([s, error, 1 / half[None]])
        motion[0] -= centre
        motion[4] += 32 * EPS * np.abs(centre)
        motion[:8] /= width
        return PathEnclosure(self.path, self.piece[interval], self, interval, motion, highest)

    @cached_property
    def axes(self) -> Array:
        """Coefficients (2, D+1, G, n) of q and their errors; the last is the remainder."""
        return self._join(self.path.enclose(self.s, np.tile(self.piece, 2)))

    @cached_property
    def pose(self) -> Array:
        """Coefficients (2, D+1, G, 12) of the pose's numbers likewise."""
        pose = self.path.enclose_pose(self.s, np.tile(self.piece, 2))
        assert pose is not None  # only machines have limits on their pose
        return self._join(pose)

    def _join(self, series: Series) -> Array:
        """Return the coefficients about the centres, and as the last one the remainder."""
        polynomial, errors = split_series(series, len(self.half))
        joined = np.stack([np.zeros_like(errors), errors])
        joined[0, :-1] = polynomial
        # a polynomial has fewer coefficients, and no remainder
        used = np.flatnonzero(joined.any((0, 2, 3)))
        return joined[:, : used.max(initial=0) + 2]


def enclose_along_path(
    trajectory: Trajectory,
    cells: Cells,
    highest: int,
) -> PathEnclosure:
    """Return the coarse enclosure of a motion over cells, with derivatives of q up to `highest`."""
    path = trajectory.path
    piece = trajectory.piece[cells.k]
    s, error, half = expand_motion(trajectory, cells)
    reach = np.abs(s[1:]).sum(0) + error.sum(0)
    # a polynomial is known exactly over a whole piece
    exact = not isinstance(path, MachinePath) or is_affine(path.machine.inverse_map)
    least = 1 if exact else MIN_PARTS
    parts = INTERVALS * np.maximum(least, np.ceil(PER_RADIAN * path.turns))
    width = np.diff(path.breaks) / parts
    share = (s[0] - path.breaks[piece]) / width[piece]
    share = np.clip(share, 0, parts[piece] - 1)
    firsts = np.append(0, np.cumsum(parts))
    place = firsts[piece] + np.floor(np.nan_to_num(share))
    # an interval that the motion comes back to is listed again
    entered = np.diff(place, prepend=-1) != 0
    first = np.flatnonzero(entered)
    interval = np.cumsum(entered) - 1
    low = np.minimum.reduceat(s[0] - reach, first)
    high = np.maximum.reduceat(s[0] + reach, first)
    centre, width = make_ball(low, high)
    places = cover_places(centre, width, PATH_ORDER)
    series = _PathSeries(path, centre, width, piece[first], places)
    return series.enclose(interval, (s, error, half), highest)


@lru_cache(maxsize=32)
def is_affine(inverse_map: Expression) -> bool:
    """Return whether the actuator coordinates are affine in the pose's numbers.

    Then pieces of the path that are polynomials in space are polynomials in the axes.
    """
    x = ca.SX.sym("x", inverse_map.size[0])
    return bool(ca.is_linear(inverse_map.function(x), x))


def bound_coarsely(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    order: int,
    cells: Cells,
) -> Values:
    """Return bounds of each limit's use over N cells, and the use attained at some instants.

    Each (limits, N). Limits on single axes are bounded over every cell, and over parts of loose
    cells; other limits over groups of cells, and over the cells of groups that may use the most.
    """
    motion = enclose_along_path(trajectory, cells, order)
    groups = None
    if len(cells.k) >= MIN_GROUPED and not all(limit.by_axis for limit in limits):
        groups = _Groups.of(trajectory, cells, motion)
    bounds, attained = np.zeros((2, len(limits), len(cells.k)))
    centres: State | None = None
    for n, limit in enumerate(limits):
        if limit.by_axis:
            bounds[n], attained[n] = _bound_by_axis(limit, trajectory, cells, motion)
        elif groups is not None:
            bounds[n], attained[n] = groups.bound(limit, motion)
        else:
            centres = centres or state_at(trajectory, cells, 0.5, order)
            bounds[n] = motion.bound_use(limit)
            attained[n] = use_in(limit, centres)
    return bounds, attained


def state_at(
    trajectory: Trajectory,
    cells: Cells,
    share: Array | float,
    order: int,
) -> State:
    """Return the motion at these shares of the cells."""
    return trajectory.within(cells.k, cells.lo + share * cells.lengths, jerk=order == 3)


def use_in(limit: Limit, state: State) -> Array:
    """Return the largest use (N,) of a limit at N instants; ∞ if it is undefined."""
    use = largest_in_rows(limit.use_at(state))
    return np.where(np.isnan(use), np.inf, use)


def _bound_by_axis(
    limit: Limit,
    trajectory: Trajectory,
    cells: Cells,
    motion: PathEnclosure,
) -> tuple[Array, Array]:
    """Bound a limit on single axes: the values that each axis surely reaches need no state."""
    bound = motion.bound_use(limit)
    attained = motion.find_attained_use(limit)
    most = np.maximum(attained, min(attained.max(), 1.0))
    is_loose = (bound > most + limit.tight(most)) & (bound < np.inf)
    loose = np.flatnonzero(is_loose)
    if len(loose):
        interval = np.tile(motion.interval[loose], PARTS)
        expansion = expand_motion(trajectory, cells[loose].parts(PARTS))
        parts = motion.series.enclose(interval, expansion, motion.highest)
        bound[loose] = parts.bound_use(limit).reshape(PARTS, -1).max(0)
        attained[loose] = parts.find_attained_use(limit).reshape(PARTS, -1).max(0)
    return bound, attained


@dataclass(frozen=True, slots=True)
class _Groups:
    """Groups of consecutive cells on one interval of the path.

    motion, centres  enclosure of each group, and the state at the centre of its middle cell
    middle   (G,) the middle cell of each group
    number   (N,) group of each cell
    """

    trajectory: Trajectory
    cells: Cells
    motion: GroupEnclosure
    centres: State
    middle: np.ndarray
    number: np.ndarray

    @staticmethod
    def of(
        trajectory: Trajectory,
        cells: Cells,
        motion: PathEnclosure,
    ) -> "_Groups":
        count = len(motion.interval)
        runs = np.flatnonzero(np.diff(motion.interval, prepend=-1))
        place_in_run = np.arange(count) - np.repeat(runs, np.diff(np.append(runs, count)))
        starts = place_in_run % GROUP_CELLS == 0
        first = np.flatnonzero(starts)
        middle = (first + np.append(first[1:], count)) // 2
        centres = state_at(trajectory, cells[middle], 0.5, motion.highest)
        group = GroupEnclosure(motion.path, motion.piece[first], motion, first)
        return _Groups(trajectory, cells, group, centres, middle, np.cumsum(starts) - 1)

    def bound(
        self,
        limit: Limit,
        motion: PathEnclosure,
    ) -> tuple[Array, Array]:
        """Return the bound (N,) of a limit's use, and the use attained in some cells."""
        attained = np.zeros(len(self.number))
        attained[self.middle] = use_in(limit, self.centres)
        most = attained.max()
        bound = self.motion.bound_use(limit)[self.number]
        loose = np.flatnonzero(~(bound < min(most, 1.0) + limit.tight(most)))
        if len(loose):
            bound[loose] = motion[loose].bound_use(limit)
            centres = state_at(self.trajectory, self.cells[loose], 0.5, motion.highest)
            attained[loose] = use_in(limit, centres)
        return bound, attained
