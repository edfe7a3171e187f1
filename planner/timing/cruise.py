"""Cruises: stretches of a run on which the fastest motion keeps the capped speed c of the tool.

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
from planner.timing.grid import Task, divide_intervals
from planner.timing.initial_guess import reduce_pieces
from planner.timing.order2.second_order import follow_speeds, is_of_speed
from planner.timing.problem import EXACT_AIM, SOLVER_AIM, EndCondition, Problem, Run
from planner.timing.profile import Profile, close_profile
from planner.timing.sampling import sample_limit_use
from planner.timing.solution import CRUISE, RunSolution

# Share of f up to which it counts as constant on a piece: rounding of arc lengths.
SAME_SPEED = 1e-8
# Use of the limits on axis speeds, as a share of the tool's, up to which the tool's cap surely
# binds.
MAX_OTHER_SPEED = 0.98
# Intervals of a piece on which f varies: COUNT · (variation of f)^POWER, which keeps the tool
# within some 3e-5 of its cap: a right angle that is rounded takes 2 × 90 intervals at order 3, and
# the cruise around it is 2e-5 slower for that. More would lengthen the plan's files.
INTERVAL_COUNT = {2: 300.0, 3: 120.0}
INTERVAL_POWER = {2: 1 / 2, 3: 1 / 3}
MIN_INTERVALS = 4
# Multiples of that number that are tried, until the cap is exceeded by no more than MAX_SLOWING.
FINENESSES = (1, 2, 4)
# Time pieces for each radian that a piece of constant ṡ turns: the proof encloses each by itself.
PIECES_PER_RADIAN = 16
# Share by which a cruise may be slowed to keep the cap between its grid points.
MAX_SLOWING = 5e-5
# Share of the limit on acceleration by which s̈ may step where two pieces meet at order 3.
MAX_STEP = 1e-3


@dataclass(frozen=True, slots=True)
class Caps:
    """The largest speed along each of the P pieces of a run.

    tool    (P,) the tool's speed in m/s where its cap binds everywhere; ∞ elsewhere
    along   (P,) ṡ where that is constant, by any limit on speed; ∞ elsewhere
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

    def varies(self, run: Run) -> np.ndarray:
        """Return the pieces (P,) of a run on which ṡ varies along a cruise."""
        pieces = np.arange(run.first, run.last + 1)
        return np.asarray(np.isinf(self.along[pieces - self.first]))

    def count_intervals(self, pieces: np.ndarray, order: int) -> np.ndarray:
        """Return the usual number of intervals for pieces (P,) on which ṡ varies."""
        uneven = self.uneven[pieces - self.first]
        count = np.ceil(INTERVAL_COUNT[order] * uneven ** INTERVAL_POWER[order])
        return np.asarray(np.maximum(count, MIN_INTERVALS).astype(int))

    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        """Return ṡ and s̈ (N,) of a cruise at places of capped pieces.

        ṡ = c/f and s̈ = −c² f′/f³, with f′ = p′·p″/f.
        """
        local = piece - self.first
        v = self.along[local]
        a = np.zeros(len(s))
        varies = np.flatnonzero(np.isinf(v))
        if len(varies):
            points = Points(self.path, s[varies], piece[varies], ())
            _, p1, p2 = (derivative[:, :3] for derivative in points.tool_derivatives)
            f = np.linalg.norm(p1, axis=1)
            slope = (p1 * p2).sum(1) / f
            c = EXACT_AIM * self.tool[local[varies]]
            v[varies] = c / f
            a[varies] = -(c**2) * slope / f**3
        return v, a

    def find_changes(self, breaks: Array, order: int, acceleration: Array) -> np.ndarray:
        """Return the pieces, after the first, at whose start a cruise cannot continue.

        acceleration  (P,) s̈ that the limits allow on each piece
        """
        capped = self.capped
        inner = np.flatnonzero(capped[1:] & capped[:-1]) + 1
        v_before, a_before = self.at(breaks[inner], self.first + inner - 1)
        v_after, a_after = self.at(breaks[inner], self.first + inner)
        joined = np.isclose(v_before, v_after, rtol=SAME_SPEED, atol=0.0)
        if order == 3:
            least = np.minimum(acceleration[inner], acceleration[inner - 1])
            joined &= np.abs(a_before - a_after) <= MAX_STEP * least
        pieces = np.arange(1, len(breaks) - 1)
        return np.setdiff1d(pieces, inner[joined])


def find_caps(task: Task) -> Caps | None:
    """Find the caps of a run's pieces from its rows at a few places.

    None where rows depend on the motion itself, or without a cap.
    """
    sketch = task.sketch
    run = task.run
    if not sketch.is_unconditional:
        return None
    # 1/ṡ (2, N) at both ends of each interval, by the tool's cap and by other limits on speed
    tool = np.zeros((2, sketch.intervals))
    other = np.zeros((2, sketch.intervals))
    for block in filter(is_of_speed, sketch.blocks):
        slopes = tool if block.name == ToolSpeed.name else other
        for k, side in enumerate((block.start, block.end)):
            use = block.share(side[Term.SD]).max(1, initial=0.0)
            slopes[k] = np.maximum(slopes[k], use)
    pieces = sketch.piece - run.first
    slope = np.maximum(tool, other)
    most = reduce_pieces(np.maximum, slope.max(0), pieces)
    least = reduce_pieces(np.minimum, slope.min(0), pieces)
    most_f = reduce_pieces(np.maximum, tool.max(0), pieces)
    least_f = reduce_pieces(np.minimum, tool.min(0), pieces)
    excess = reduce_pieces(np.maximum, (other - MAX_OTHER_SPEED * tool).max(0), pieces)
    even = (most > 0) & (most - least <= SAME_SPEED * most)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = _level(np.where(even, EXACT_AIM / most, np.inf))
        uneven = np.where(least_f > 0, most_f / least_f - 1, 0.0)
        fastest = 1 / least
    binds = (excess < 0) & (least_f > 0)
    tool_caps = np.where(binds, _tool_caps(task.limits, run), np.inf)
    lowered = _find_lowered(task)
    tool_caps[lowered] = np.inf
    along[lowered] = np.inf
    result = Caps(task.path, run.first, tool_caps, along, fastest, uneven)
    return result if result.capped.any() else None


def _tool_caps(limits: Sequence[Limit], run: Run) -> Array:
    """Return the cap on the tool's speed (P,) on each piece of a run."""
    for limit in limits:
        if isinstance(limit, ToolSpeed):
            return np.asarray(limit.caps[run.first : run.last + 1])
    return np.full(run.last + 1 - run.first, np.inf)


def _find_lowered(task: Task) -> np.ndarray:
    """Return the pieces (P,) on which a limit is lowered in places: no one speed is right there."""
    breaks = task.run.breaks(task.path)
    lowered = np.zeros(len(breaks) - 1, bool)
    for limit in task.limits:
        if len(limit.shares.values):
            lowered |= limit.shares.least_over(breaks[:-1], breaks[1:]) < 1
    return lowered


def _level(speeds: Array) -> Array:
    """Return the speeds (P,), made equal where neighbours differ by rounding only."""
    same = np.isclose(speeds[1:], speeds[:-1], rtol=SAME_SPEED, atol=0.0)
    group = np.concatenate([[0], np.cumsum(~same)])
    return np.asarray(reduce_pieces(np.minimum, speeds, group)[group])


def follow_cap(task: Task, caps: Caps) -> RunSolution | None:
    """Return the motion along a run at the capped speed; None where it cannot keep the cap."""
    speeds = [limit for limit in task.limits if limit.terms == {Term.SD}]
    for fineness in FINENESSES:
        profile = _follow_pieces(task, caps, fineness)
        if profile is None:
            return None
        if not caps.varies(task.run).any():
            return RunSolution("solved", profile, EXACT_AIM * profile.duration, CRUISE)
        use = sample_limit_use(task.path, speeds, profile)
        excess = max(float(values.max()) for values in use.values()) / EXACT_AIM
        if excess <= 1 + MAX_SLOWING:
            # more by twice the aim: ramps that meet the cruise need room beneath the cap
            profile = profile.slowed(max(excess, 1.0) / SOLVER_AIM**2)
            return RunSolution("solved", profile, EXACT_AIM * profile.duration, CRUISE)
    return None


def _follow_pieces(task: Task, caps: Caps, fineness: int) -> Profile | None:
    """Return the motion at the capped speed, in `fineness` times the usual number of intervals."""
    stretch = task.run
    pieces = np.arange(stretch.first, stretch.last + 1)
    along = caps.along[pieces - caps.first]
    varies = caps.varies(stretch)
    changes = np.flatnonzero(np.diff(varies)) + 1
    breaks = stretch.breaks(task.path)
    profiles: list[Profile] = []
    for a, b in pairwise([0, *changes.tolist(), len(pieces)]):
        group = breaks[a : b + 1], pieces[a:b]
        if varies[a]:
            before = None if a == 0 else float(along[a - 1])
            after = None if b == len(pieces) else float(along[b])
            counts = caps.count_intervals(pieces[a:b], task.order) * fineness
            profile = _follow_varying(caps, group, counts, (before, after), task.order)
        else:
            profile = keep_speed(task.path, *group, along[a:b])
        if profile is None:
            return None
        profiles.append(profile)
    return Profile.joined(profiles)


Pieces = tuple[Array, np.ndarray]
"""Breaks (P+1,) of some pieces of a path, and their numbers (P,)."""


def keep_speed(path: ActuatorPath, breaks: Array, pieces: np.ndarray, speed: Array) -> Profile:
    """Return the motion at constant ṡ (P,) of each path piece, in more time pieces where it turns.

    breaks  (P+1,) of the pieces (P,), which need not be whole at both ends
    """
    whole = path.breaks[pieces + 1] - path.breaks[pieces]
    turns = path.turns[pieces] * np.diff(breaks) / whole
    count = np.ceil(PIECES_PER_RADIAN * turns).astype(int)
    s, owner = divide_intervals(breaks, np.maximum(count, 1))
    v = speed[owner]
    still = np.zeros(len(owner))
    return Profile(s[:-1], v, still, still, np.diff(s) / v, pieces[owner])


def _follow_varying(
    caps: Caps,
    pieces: Pieces,
    counts: np.ndarray,
    neighbours: tuple[float | None, float | None],
    order: int,
) -> Profile | None:
    """Return the motion along pieces on which f varies; None where ṡ and s̈ are too far from it.

    counts      intervals (P,) of each piece
    neighbours  ṡ of the stretches of constant ṡ before and after, if there are any
    """
    breaks, numbers = pieces
    s, owner = divide_intervals(breaks, counts)
    piece = numbers[owner]
    v, a = caps.at(s, np.append(piece, piece[-1]))
    for end, speed in zip((0, -1), neighbours, strict=True):
        if speed is not None:
            v[end] = speed
            a[end] = 0.0
    if order == 2:
        return follow_speeds(s, v, piece)
    # ∫ f ds / c over each interval by Simpson's rule
    middle, _ = caps.at((s[1:] + s[:-1]) / 2, piece)
    slowness = 1 / v[:-1] + 4 / middle + 1 / v[1:]
    h = np.diff(s) * slowness / 6
    first = EndCondition(float(v[0]), float(a[0]))
    last = EndCondition(float(v[-1]), float(a[-1]))
    problem = Problem(s, piece, (), (first, last))
    columns = np.stack([v[:-1], a[:-1], np.diff(a) / h, h])
    profile = close_profile(problem, columns)
    return None if isinstance(profile, MotionError) else profile
