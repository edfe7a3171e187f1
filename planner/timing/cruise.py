"""Cruises: stretches of a run on which the fastest motion keeps the capped speed of the tool.

The tool's speed is f ṡ with f = |dp/ds|. Where f = 1, as on lines, arcs and whatever is drawn by
its own length, a cruise has constant ṡ = c. On splines and blends f varies, and the cruise follows
ṡ = c/f(s), in pieces of constant s̈ at order 2 and of constant s⃛ at order 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit, Term
from planner.limits.tool import ToolSpeed
from planner.path.actuation import ActuatorPath, Points
from planner.timing.problem import EXACT_AIM, SOLVER_AIM, Block, EndCondition, Problem, Run
from planner.timing.profile import Profile, close_profile
from planner.timing.rows import pose_problem
from planner.timing.sampling import sample_limit_use
from planner.timing.solution import CRUISE, RunSolution

# Share of f up to which it counts as constant on a piece: rounding of arc lengths.
SAME_SPEED = 1e-8
# Use of the limits on axis speeds, as a share of the tool's, up to which the tool's cap surely binds.
MAX_OTHER_SPEED = 0.98
# Intervals of a piece on which f varies: COUNT · (variation of f)^POWER, which keeps the tool
# within some 3e-5 of its cap: a right angle that is rounded takes 2 × 90 intervals at order 3, and
# the cruise around it is 2e-5 slower for that. More would lengthen the plan's files.
INTERVAL_COUNT, INTERVAL_POWER = {2: 300.0, 3: 120.0}, {2: 1 / 2, 3: 1 / 3}
MIN_INTERVALS = 4
# Share by which a cruise may be slowed to keep the cap between its grid points.
MAX_SLOWING = 5e-5
# Share of the limit on acceleration by which s̈ may step where two pieces meet at order 3.
MAX_STEP = 1e-3
# Time pieces for each radian that the path turns: the proof encloses each by itself.
PIECES_PER_RADIAN = 16


@dataclass(frozen=True, slots=True)
class Caps:
    """The largest speed along each of the P pieces of a run.

    tool    (P,) the tool's speed in m/s where its cap binds everywhere; ∞ elsewhere
    along   (P,) ṡ where that is constant, by whichever limit on speed; ∞ elsewhere
    fastest (P,) the largest ṡ by the limits on speed
    uneven  (P,) how much f varies on each piece, as a share
    """

    path: ActuatorPath
    first: int
    tool: Array
    along: Array
    fastest: Array
    uneven: Array

    @property
    def capped(self) -> np.ndarray:
        """Pieces (P,) on which a cruise may lie."""
        return np.isfinite(self.tool) | np.isfinite(self.along)

    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        """Return ṡ and s̈ (N,) of a cruise at places of capped pieces.

        ṡ = c/f and s̈ = −c² f′/f³, with f′ = p′·p″/f.
        """
        local = piece - self.first
        speed = self.along[local]
        acceleration = np.zeros(len(s))
        curved = np.flatnonzero(np.isinf(speed))
        if len(curved):
            points = Points(self.path, s[curved], piece[curved], ())
            _, p1, p2 = (derivative[:, :3] for derivative in points.tool_derivatives)
            f = np.linalg.norm(p1, axis=1)
            cap = EXACT_AIM * self.tool[local[curved]]
            speed[curved] = cap / f
            acceleration[curved] = -(cap**2) * (p1 * p2).sum(1) / f**4
        return speed, acceleration

    def find_changes(self, breaks: Array, order: int, acceleration: Array) -> np.ndarray:
        """Return the pieces, after the first, at whose start a cruise cannot go on from the last.

        acceleration  (P,) s̈ that the limits allow on each piece
        """
        count = len(breaks) - 1
        capped = self.capped
        inner = np.flatnonzero(capped[1:] & capped[:-1]) + 1
        before, after = (self.at(breaks[inner], self.first + inner - k) for k in (1, 0))
        joined = np.isclose(before[0], after[0], rtol=SAME_SPEED, atol=0.0)
        if order == 3:
            least = np.minimum(acceleration[inner], acceleration[inner - 1])
            joined &= np.abs(before[1] - after[1]) <= MAX_STEP * least
        changes = np.ones(count, bool)
        changes[inner[joined]] = False
        return np.flatnonzero(changes)[1:]


def find_caps(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    sketch: Problem,
) -> Caps | None:
    """Find the caps of a run's pieces from its rows at a few places.

    None where rows depend on the motion itself, or where nothing is capped.
    """
    if not sketch.is_unconditional:
        return None
    pieces = sketch.piece - run.first
    tool, other = np.zeros((2, sketch.intervals)), np.zeros((2, sketch.intervals))
    for block in sketch.blocks:
        if is_of_speed(block):
            slopes = tool if block.name == ToolSpeed.name else other
            for k, side in enumerate((block.start, block.end)):
                slopes[k] = np.maximum(slopes[k], block.share(side[Term.SD]).max(1, initial=0.0))
    slope = np.maximum(tool, other)
    most, least = _extremes(slope, pieces)
    most_f, least_f = _extremes(tool, pieces)
    with np.errstate(divide="ignore", invalid="ignore"):
        even = (most > 0) & (most - least <= SAME_SPEED * most)
        along = _level(np.where(even, EXACT_AIM / most, np.inf))
        binds = _extremes(other - MAX_OTHER_SPEED * tool, pieces)[0] < 0
        uneven = np.where(least_f > 0, most_f / least_f - 1, 0.0)
        tool_caps = np.where(binds & (least_f > 0), _tool_caps(limits, run), np.inf)
        lowered = _find_lowered(path, limits, run)
        tool_caps[lowered] = along[lowered] = np.inf
        caps = Caps(path, run.first, tool_caps, along, 1 / least, uneven)
    return caps if caps.capped.any() else None


def is_of_speed(block: Block) -> bool:
    """Return whether a limit bounds ṡ by itself."""
    return set(block.start) == {Term.SD}


def _extremes(values: Array, pieces: np.ndarray) -> tuple[Array, Array]:
    """Return the largest and the least of values (2, N) on each of the pieces that are given (N,)."""
    most = np.full(pieces[-1] + 1, -np.inf)
    least = np.full(pieces[-1] + 1, np.inf)
    np.maximum.at(most, pieces, values.max(0))
    np.minimum.at(least, pieces, values.min(0))
    return most, least


def _tool_caps(limits: Sequence[Limit], run: Run) -> Array:
    """Return the cap on the tool's speed (P,) on each piece of a run."""
    for limit in limits:
        if isinstance(limit, ToolSpeed):
            return np.asarray(limit.caps[run.first : run.last + 1])
    return np.full(run.last + 1 - run.first, np.inf)


def _find_lowered(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> np.ndarray:
    """Return which pieces (P,) of a run have a place where a limit is lowered: no one speed is right there."""
    breaks = run.breaks(path)
    lowered = np.zeros(len(breaks) - 1, bool)
    for limit in limits:
        if len(limit.shares.values):
            lowered |= limit.shares.least_over(breaks[:-1], breaks[1:]) < 1
    return lowered


def _level(speeds: Array) -> Array:
    """Return the speeds (P,), made equal where neighbours differ by rounding only."""
    changes = ~np.isclose(speeds[1:], speeds[:-1], rtol=SAME_SPEED, atol=0.0)
    group = np.concatenate([[0], np.cumsum(changes)])
    least = np.full(group[-1] + 1, np.inf)
    np.minimum.at(least, group, speeds)
    return np.asarray(least[group])


def follow_cap(
    path: ActuatorPath,
    limits: Sequence[Limit],
    caps: Caps,
    stretch: Run,
    order: int,
) -> RunSolution | None:
    """Return the motion along a stretch at the capped speed; None where it cannot keep the cap."""
    pieces = np.arange(stretch.first, stretch.last + 1)
    curved = np.isinf(caps.along[pieces - caps.first])
    changes = np.flatnonzero(np.diff(curved)) + 1
    breaks = stretch.breaks(path)
    profiles = []
    for a, b in pairwise([0, *changes.tolist(), len(pieces)]):
        group = breaks[a : b + 1], pieces[a:b]
        if not curved[a]:
            profiles.append(_keep_speed(path, caps, group))
            continue
        before = None if a == 0 else float(caps.along[pieces[a - 1] - caps.first])
        after = None if b == len(pieces) else float(caps.along[pieces[b] - caps.first])
        grid = _place_grid(caps, group, order, (before, after))
        profile = grid.follow_exactly() if order == 2 else grid.follow_smoothly(path, limits, caps)
        if profile is None:
            return None
        profiles.append(profile)
    profile = Profile.joined(profiles)
    if curved.any():
        speeds = [limit for limit in limits if limit.terms == {Term.SD}]
        use = sample_limit_use(path, speeds, profile)
        excess = max(float(values.max()) for values in use.values()) / EXACT_AIM
        if excess > 1 + MAX_SLOWING:
            return None
        # a little more: the ramps that meet the cruise need room beneath the cap
        profile = profile.slowed(max(excess, 1.0) / SOLVER_AIM)
    return RunSolution("solved", profile, EXACT_AIM * profile.duration, CRUISE)


def _keep_speed(path: ActuatorPath, caps: Caps, pieces: tuple[Array, np.ndarray]) -> Profile:
    """Return the motion at constant ṡ: a time piece for each path piece, more where it turns."""
    breaks, numbers = pieces
    share = np.diff(breaks) / (path.breaks[numbers + 1] - path.breaks[numbers])
    count = np.ceil(PIECES_PER_RADIAN * path.turns[numbers] * share).astype(int)
    s, piece = spread_points(breaks, np.maximum(count, 1), int(numbers[0]))
    speed = caps.along[piece - caps.first]
    still = np.zeros(len(piece))
    return Profile(s[:-1], speed, still, still, np.diff(s) / speed, piece)


@dataclass(frozen=True, slots=True)
class _Grid:
    """Places s (N+1,) on pieces (N,) on which f varies, and ṡ and s̈ (N+1,) of a cruise there."""

    s: Array
    piece: np.ndarray
    v: Array
    a: Array

    def follow_exactly(self) -> Profile:
        """Return the motion of order 2 with these ṡ: ṡ² grows evenly over each interval."""
        h = 2 * np.diff(self.s) / (self.v[1:] + self.v[:-1])
        still = np.zeros(len(h))
        return Profile(self.s[:-1], self.v[:-1], np.diff(self.v) / h, still, h, self.piece)

    def follow_smoothly(
        self,
        path: ActuatorPath,
        limits: Sequence[Limit],
        caps: Caps,
    ) -> Profile | None:
        """Return a motion of order 3 near these ṡ and s̈, which it has at both ends."""
        v, a = self.v, self.a
        # a cruise's duration is ∫ f ds / c, here by Simpson's rule
        middle, _ = caps.at((self.s[1:] + self.s[:-1]) / 2, self.piece)
        h = np.diff(self.s) / 6 * (1 / v[:-1] + 4 / middle + 1 / v[1:])
        # only its grid and its ends are used here: rows are posed for nothing but speeds
        speeds = [limit for limit in limits if limit.terms == {Term.SD}]
        ends = (
            EndCondition(float(v[0]), float(a[0])),
            EndCondition(float(v[-1]), float(a[-1])),
        )
        problem = pose_problem(path, speeds, self.s, self.piece, ends)
        profile = close_profile(problem, np.stack([v[:-1], a[:-1], np.diff(a) / h, h]))
        return None if isinstance(profile, MotionError) else profile


def _place_grid(
    caps: Caps,
    pieces: tuple[Array, np.ndarray],
    order: int,
    neighbours: tuple[float | None, float | None],
) -> _Grid:
    """Place a grid on pieces on which f varies.

    neighbours  ṡ of the stretches of constant ṡ before and after, if there are any
    """
    breaks, numbers = pieces
    uneven = caps.uneven[numbers - caps.first]
    count = np.ceil(INTERVAL_COUNT[order] * uneven ** INTERVAL_POWER[order]).astype(int)
    s, piece = spread_points(breaks, np.maximum(count, MIN_INTERVALS), int(numbers[0]))
    v, a = caps.at(s, np.append(piece, piece[-1]))
    for end, speed in zip((0, -1), neighbours, strict=True):
        if speed is not None:
            v[end], a[end] = speed, 0.0
    return _Grid(s, piece, v, a)


def spread_points(breaks: Array, count: np.ndarray, first: int) -> tuple[Array, np.ndarray]:
    """Return a grid with count (P,) even intervals on each piece, and the piece of each interval."""
    begin = np.repeat(np.cumsum(count) - count, count)
    share = (np.arange(count.sum()) - begin) / np.repeat(count, count)
    s = np.repeat(breaks[:-1], count) + share * np.repeat(np.diff(breaks), count)
    piece = np.repeat(first + np.arange(len(count)), count)
    return np.append(s, breaks[-1]), piece
