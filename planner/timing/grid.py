"""Grids of a run, and the problems posed on them.

At order 2 a grid is even, since its solution is cheap, or denser where rows mix ṡ with other terms
and where s̈ steps. At order 3 its points lie where the averaged
order-2 motion (planner.timing.initial_guess) spends time or changes s̈.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from planner.limits.limit import Limit, Term
from planner.path.actuation import ActuatorPath
from planner.path.polynomial import PolynomialPath
from planner.timing.initial_guess import (
    MAX_BRIEF_SHARE,
    WINDOW_GROWTH,
    average_run,
    pass_breaks,
    relax_jerk,
    slow_breaks,
    spread_points,
)
from planner.timing.order2.second_order import second_order
from planner.timing.problem import Block, Continuation, Problem, Run, fix_passed_ends
from planner.timing.profile import Profile
from planner.timing.rows import leave_out_idle, pose_problem


@dataclass(frozen=True, slots=True)
class Rule:
    """Number of intervals of a run: at least, for each piece, and for each radian that it turns."""

    least: int
    per_piece: int
    per_radian: int
    order: int = 3


SECOND_ORDER = Rule(1000, 50, 40, order=2)
THIRD_ORDER = Rule(240, 24, 15)
COARSE = Rule(400, 20, 20)
"""For the order-2 motion from which an order-3 solve starts."""
ROUGH_GRID = Rule(120, 8, 6)
"""For a solution that only shows where it loses time."""
# Intervals of a piece in a sketch, and as many for each radian that it turns. Too few would miss a
# peak of a limit's use on a cruise; the proof finds such a peak, and the run is then solved as a
# whole.
SAMPLES = 8
# Largest number of intervals at each order: an interval takes 5 kB at order 2, 0.15 MB at order 3.
MAX_INTERVALS = {2: 1_000_000, 3: 50_000}
# Largest number of pieces in one run without a machine. With many pieces each has fewer intervals,
# so that all fit into MAX_INTERVALS: so dense a spline bends little from knot to knot.
MAX_DENSE_PIECES = 100_000
# Grids by weight: the share of weight that goes with time, the least number of intervals of a
# piece, and the number of parts in which each piece of the motion is integrated.
TIME_SHARE = 0.4
MIN_PER_PIECE = 4
PLACE_PARTS = 8
# Share by which rounding may raise a number of intervals.
ROUNDING = 1e-6
# At order 2 a line on which the axes' directions q′ hardly change needs fewer intervals: this many
# for a change of q′ by its own size, rounded up to one of a few numbers. Each interval at whose
# ends s̈ steps by MIN_STEP_SHARE of the largest is then cut. On lines of the hexapod, durations
# stay within 3e-4 of those on 8000 intervals.
PER_CHANGE = 2000
FEW_INTERVALS = (250, 350, 500, 700)
MIN_STEP_SHARE = 0.2
STEP_PARTS = 8
# Number of places of a piece at which q′ is compared.
DIRECTION_POINTS = 17
# Where a run continues a motion: the least share of an interval that is left after that motion's
# grid; the share of an interval up to which a point is near a knot; and the share of a run up to
# which two places are the same.
MIN_STEP_LEFT = 0.5
NEAR_STEP_SHARE = 1 / 3
SAME_PLACE = 1e-12


@dataclass(frozen=True)
class Task:
    """A run that is to be timed within limits, and the problems on it that several ways share.

    negligible  time (s) by which a closed form may be longer than the fastest motion
    """

    path: ActuatorPath
    limits: Sequence[Limit]
    run: Run
    order: int
    negligible: float = 0.0

    def with_run(self, run: Run) -> "Task":
        """Return the task for another run."""
        return replace(self, run=run)

    @cached_property
    def sketch(self) -> Problem:
        """Rows at a few places of each piece: enough to see where limits bind."""
        pieces = np.arange(self.run.first, self.run.last + 1)
        count = SAMPLES + np.ceil(SAMPLES * self.path.turns[pieces]).astype(int)
        s, owner = divide_intervals(self.run.breaks(self.path), count)
        return pose_problem(self.path, self.limits, s, pieces[owner], self.run.ends)

    @cached_property
    def coarse(self) -> Problem:
        """Rows on a coarse even grid."""
        return coarse_jerk_problem(self.path, self.limits, self.run)

    @cached_property
    def active_limits(self) -> list[Limit]:
        """Limits without those on loads that surely stay far from binding."""
        if not any(Term.ONE in limit.terms for limit in self.limits):
            return list(self.limits)
        return leave_out_idle(self.limits, self.coarse)

    @cached_property
    def resting(self) -> "Task":
        """Task with rest at the ends that a motion might pass; this one if there are none."""
        ends = fix_passed_ends(self.run.ends)
        return self if ends == self.run.ends else self.with_run(replace(self.run, ends=ends))


def make_grid(
    path: ActuatorPath,
    run: Run,
    intervals: int,
    spread: Array | None = None,
    *,
    least: Array | None = None,
) -> tuple[Array, np.ndarray]:
    """Return about `intervals` intervals (N+1,), with a point at each break, and their pieces (N,).

    spread  (K,) rising from 0 to 1: points as shares of the run; evenly if None
    least   (P,) least number of intervals of each piece: one with fewer has as many even ones
    """
    breaks = run.breaks(path)
    share = np.linspace(0, 1, intervals + 1) if spread is None else spread
    s = breaks[0] + (breaks[-1] - breaks[0]) * share
    if len(breaks) == 2:
        s[[0, -1]] = breaks
        return s, find_pieces(path, run, s)
    # a break takes the place of points that are near it
    near = np.maximum(np.gradient(s), 0) / 3
    s = np.union1d(s[_distances(s, breaks) > near], breaks)
    if least is not None:
        s = _fill_pieces(s, breaks, least)
    return s, find_pieces(path, run, s)


def find_pieces(path: ActuatorPath, run: Run, s: Array) -> np.ndarray:
    """Return the piece (N,) of each interval of a grid (N+1,) along a run."""
    inner = run.breaks(path)[1:-1]
    middle = (s[1:] + s[:-1]) / 2
    return np.asarray(run.first + np.searchsorted(inner, middle, side="right"))


def divide_intervals(s: Array, count: np.ndarray) -> tuple[Array, np.ndarray]:
    """Cut each interval of a grid into count (N,) even parts; return the grid and their owners
    (M,).
    """
    owner = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    share = (np.arange(len(owner)) - first[owner]) / count[owner]
    points = s[owner] + share * np.diff(s)[owner]
    return np.append(points, s[-1]), owner


def _fill_pieces(s: Array, breaks: Array, least: Array) -> Array:
    at = np.searchsorted(s, breaks)
    parts = [s[a:b] for a, b in pairwise(at)]
    for k in np.flatnonzero(np.diff(at) < least):
        count = int(np.ceil(least[k]))
        parts[k] = np.linspace(breaks[k], breaks[k + 1], count + 1)[:-1]
    return np.concatenate([*parts, breaks[-1:]])


def _distances(s: Array, places: Array) -> Array:
    """Return the distance (N,) from each s to the nearest of rising places; ∞ without any."""
    others = np.concatenate([[-np.inf], places, [np.inf]])
    after = np.searchsorted(others, s).clip(1)
    to_previous = s - others[after - 1]
    to_next = others[after] - s
    return np.asarray(np.minimum(to_previous, to_next))


def acceleration_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Problem:
    """Pose a run at order 2: on an even grid, or a graded one if rows have ṡ next to other
    terms.
    """
    of_speed = [limit.terms for limit in limits if Term.SD in limit.terms]
    mixed = any(len(terms) > 1 for terms in of_speed)
    has_free_end = any(end.zero_derivatives == 1 for end in run.ends)
    few = None if mixed or has_free_end or run.fineness > 1 else _few_intervals(path, run)
    if few is not None:
        grid = make_grid(path, run, few)
    else:
        spread = _graded_shares(count_intervals(SECOND_ORDER, path, run)) if mixed else None
        grid = _grid(SECOND_ORDER, path, run, spread)
    problem = pose_problem(path, limits, *grid, run.ends)
    if run.continuation is None:
        return problem
    return continue_problem(path, limits, run, problem, run.continuation)


def continue_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    problem: Problem,
    continuation: Continuation,
) -> Problem:
    """Begin a run's problem with the grid and the room of the motion that it continues.

    On this grid that motion keeps every row. On another it need not, and then no motion may.
    """
    s = problem.s
    known = continuation.s
    least = MIN_STEP_LEFT * (s[-1] - s[-2])
    s = np.concatenate([known, s[s > known[-1] + least]])
    for _ in range(2):  # the knots of the first time change which points are near
        s = _insert_knots(s, continuation.knots, run.breaks(path))
    piece = find_pieces(path, run, s)
    posed = pose_problem(path, limits, s, piece, run.ends)
    blocks: list[Block] = []
    for block in posed.blocks:
        room = block.room.copy()
        known_room = continuation.room.get(block.name, np.empty(0))
        room[: len(known_room)] = known_room
        blocks.append(replace(block, room=room))
    return replace(posed, blocks=tuple(blocks))


def _insert_knots(s: Array, knots: Array, breaks: Array) -> Array:
    """Return a grid (N+1,) with knots in place of the points near them, except ends and breaks."""
    last = s[-1] - NEAR_STEP_SHARE * (s[-1] - s[-2])
    knots = knots[(knots > s[0]) & (knots < last)]
    same = SAME_PLACE * (s[-1] - s[0])
    knots = knots[_distances(knots, breaks) > same]
    near = NEAR_STEP_SHARE * np.gradient(s)
    stays = np.isin(s, breaks) | (_distances(s, knots) > near)
    stays[[0, -1]] = True
    return np.union1d(s[stays], knots)


def refine_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    problem: Problem,
    motion: Profile,
) -> Problem | None:
    """Cut the intervals next to a step of s̈ in a problem of few intervals; None for the others.

    s̈ cannot step inside an interval, which costs time.
    """
    if problem.intervals not in FEW_INTERVALS:
        return None
    size = np.abs(np.diff(motion.a, prepend=0.0, append=0.0))
    steps = size > MIN_STEP_SHARE * np.abs(motion.a).max()
    count = np.where(steps[:-1] | steps[1:], STEP_PARTS, 1)
    return cut_intervals(path, limits, problem, count)


def cut_intervals(
    path: ActuatorPath,
    limits: Sequence[Limit],
    problem: Problem,
    count: np.ndarray,
) -> Problem:
    """Cut each interval of a problem into count (N,) even parts, with the room that it has."""
    s, owner = divide_intervals(problem.s, count)
    limits = leave_out_idle(limits, problem)
    finer = pose_problem(path, limits, s, problem.piece[owner], problem.ends)
    rooms = {block.name: block.room[owner] for block in problem.blocks}
    blocks: list[Block] = []
    for block in finer.blocks:
        room = rooms.get(block.name, block.room)
        blocks.append(replace(block, room=room))
    return replace(finer, blocks=tuple(blocks), ends=problem.ends)


def coarse_jerk_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Problem:
    """Pose a run on a coarse even grid, from which order-3 solves start."""
    return pose_problem(path, limits, *_grid(COARSE, path, run), run.ends)


def brief_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    coarse: Problem,
) -> tuple[Problem, float] | None:
    """Pose a run from rest to rest at order 2, with the window of its average; None unless
    brief.
    """
    if max(run.speeds) > 0 or not coarse.is_unconditional:
        return None
    gentle, window = relax_jerk(coarse)
    sharp = second_order(gentle)
    if not sharp.solved or WINDOW_GROWTH * window > MAX_BRIEF_SHARE * sharp.duration:
        return None
    spread = _graded_shares(count_intervals(SECOND_ORDER, path, run))
    s, piece = _grid(SECOND_ORDER, path, run, spread)
    return relax_jerk(pose_problem(path, limits, s, piece))


def jerk_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    coarse: Problem | None = None,
    rule: Rule = THIRD_ORDER,
) -> tuple[Problem, Profile] | MotionError:
    """Pose a run at order 3 on a grid that is graded for it, with the motion to start from.

    That is the averaged order-2 motion, or ramps from slow break to slow break. Returns an error
    without a bound of the jerk, or without an order-2 motion.
    """
    coarse = coarse or coarse_jerk_problem(path, limits, run)
    start = unbounded_error(coarse, 3) or average_run(coarse)
    if isinstance(start, MotionError):
        return start
    breaks = run.breaks(path)
    slow, speeds = slow_breaks(coarse, start, breaks)
    ramps = None
    if len(slow):
        at = np.searchsorted(coarse.s, breaks[[0, *slow, -1]])
        ramps = pass_breaks(coarse, at, speeds)
    if ramps is not None:
        start = ramps.cut(breaks, run.first)
        s, piece = _place_grid(rule, path, run, start, start.h)
    else:  # without slow breaks, or where the jerk leaves no way from speed to speed
        points = spread_points(start, count_intervals(rule, path, run, on_top=True))
        share = (points - breaks[0]) / (breaks[-1] - breaks[0])
        s, piece = _grid(rule, path, run, share.clip(0.0, 1.0))
    return pose_problem(path, limits, s, piece, run.ends), start


def place_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    motion: Profile,
    weight: Array,
) -> Problem:
    """Pose a run at order 3 on a grid whose intervals have the same mean of weight and time.

    motion  (M pieces) of the run, cut at its breaks
    weight  (M,) of each piece; inside a piece it grows with time
    """
    s, piece = _place_grid(THIRD_ORDER, path, run, motion, weight)
    return pose_problem(path, limits, s, piece, run.ends)


def divide_motion(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    motion: Profile,
    parts: int,
) -> Problem:
    """Pose a run within one piece on the time pieces of a motion, each cut into parts.

    Its steps of s⃛ are grid points, so that fewer intervals suffice.
    """
    owner = np.repeat(np.arange(len(motion.h)), parts)
    shares = np.arange(parts) / parts
    s, *_ = motion.at(owner, np.outer(motion.h, shares).ravel())
    s = np.append(s, run.breaks(path)[-1])
    return pose_problem(path, limits, s, motion.piece[owner], run.ends)


def _place_grid(
    rule: Rule,
    path: ActuatorPath,
    run: Run,
    motion: Profile,
    weight: Array,
) -> tuple[Array, np.ndarray]:
    """Return the grid of `place_problem`."""
    breaks = run.breaks(path)
    share = motion.h / motion.duration
    total = weight.sum()
    if total > 0:
        share = (1 - TIME_SHARE) * weight / total + TIME_SHARE * share
    # the share that is passed, at a few places of each piece
    owner = np.repeat(np.arange(len(motion.h)), PLACE_PARTS)
    parts = np.arange(PLACE_PARTS) / PLACE_PARTS
    tau = np.outer(motion.h, parts).ravel()
    places = np.append(motion.at(owner, tau)[0], breaks[-1])
    places = np.maximum.accumulate(places).clip(breaks[0], breaks[-1])
    passed = np.concatenate([[0.0], np.cumsum(share[owner]) / PLACE_PARTS])

    pieces = np.arange(run.first, run.last + 1)
    first = np.searchsorted(motion.piece, pieces)
    at_breaks = passed[[*PLACE_PARTS * first, -1]]
    per_piece = min(MIN_PER_PIECE, _per_piece(rule, path, run))
    least = np.maximum(per_piece, rule.per_radian * path.turns[pieces] / 2)
    intervals = np.diff(at_breaks) * count_intervals(rule, path, run, on_top=True)
    count = np.ceil(np.maximum(least, intervals) - ROUNDING).astype(int)
    even, owner = divide_intervals(at_breaks, count)
    s = np.interp(even, passed, places)
    s[np.append(0, np.cumsum(count))] = breaks
    return s, pieces[owner]


def grade_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    shares: Callable[[int], Array],
) -> Problem:
    """Pose a run at order 3 with points at shares of the run that depend on their number."""
    spread = shares(count_intervals(THIRD_ORDER, path, run))
    ends = fix_passed_ends(run.ends)  # a passing speed is too fast for a slow motion
    return pose_problem(path, limits, *_grid(THIRD_ORDER, path, run, spread), ends)


def _grid(
    rule: Rule,
    path: ActuatorPath,
    run: Run,
    spread: Array | None = None,
) -> tuple[Array, np.ndarray]:
    """Return a run's grid by a rule, which holds for each piece by itself."""
    turns = path.turns[run.first : run.last + 1]
    least = np.maximum(_per_piece(rule, path, run), rule.per_radian * turns)
    return make_grid(path, run, count_intervals(rule, path, run), spread, least=least)


def _graded_shares(intervals: int) -> Array:
    """Return shares of a run that are ever denser towards its ends: ṡ ~ √x changes fastest
    there.
    """
    even = np.linspace(0.0, 1.0, intervals + 1)
    return np.asarray(even**2 * (3 - 2 * even))


def _per_piece(rule: Rule, path: ActuatorPath, run: Run) -> int:
    """Return the number of intervals for each piece; fewer on a dense path without a machine."""
    if not isinstance(path, PolynomialPath):
        return rule.per_piece
    pieces = run.last - run.first + 1
    return min(rule.per_piece, max(1, MAX_INTERVALS[rule.order] // pieces))


def count_intervals(
    rule: Rule,
    path: ActuatorPath,
    run: Run,
    on_top: bool = False,
) -> int:
    """Return the number of intervals of a run. Raises MotionError if it is too large.

    on_top  pieces after the first add to the least number
    """
    pieces = run.last - run.first + 1
    per_piece = _per_piece(rule, path, run)
    least = rule.least
    if on_top:
        least += per_piece * (pieces - 1)
    turn = float(path.turns[run.first : run.last + 1].sum())
    size = max(least, per_piece * pieces, int(rule.per_radian * turn))
    size = int(size * run.fineness)
    if isinstance(path, PolynomialPath):
        _refuse_dense(pieces)
    elif size > MAX_INTERVALS[rule.order]:
        raise _size_error(rule, path, run, size)
    return size


def _size_error(rule: Rule, path: ActuatorPath, run: Run, size: int) -> MotionError:
    since = path.place(path.breaks[run.first], run.first)
    until = path.place(path.breaks[run.last + 1], run.last)
    order = ", or plan at order 2" if rule.order == 3 else ""
    return MotionError(
        f"from {since} to {until} the motion does not stop, and takes {count_noun(size, 'interval')} "
        f'to time, at most {MAX_INTERVALS[rule.order]}: write join = "stop" on the way, or split a '
        f"segment that turns many times{order}"
    ).in_segment(since.segment)


def _refuse_dense(pieces: int) -> None:
    if pieces > MAX_DENSE_PIECES:
        raise MotionError(
            f"the path has {pieces} pieces without a stop, at most {MAX_DENSE_PIECES} are timed at "
            "once: give a spline of fewer knots, or parts of it one by one with start_speed and "
            "end_speed"
        )


def _few_intervals(path: ActuatorPath, run: Run) -> int | None:
    """Return how few intervals suffice for a piece on which q′ hardly changes; None: the rule's."""
    if run.first != run.last:
        return None
    start, end = run.breaks(path)
    s = np.linspace(start, end, DIRECTION_POINTS)
    slope = path.derivatives(s, np.full(DIRECTION_POINTS, run.first), 2)[1]
    change = np.abs(np.diff(slope, axis=0)).max(1).sum()
    needed = PER_CHANGE * change / np.abs(slope).max()
    return min([size for size in FEW_INTERVALS if size >= needed], default=None)


def unbounded_error(problem: Problem, order: int) -> MotionError | None:
    """Return the error of a run without a bound of s̈, or of s⃛ at order 3; None where there is
    one.
    """
    term = Term.SDD if order == 2 else Term.SDDD
    if any(np.any(block.start.get(term)) for block in problem.blocks):
        return None
    name = "acceleration" if order == 2 else "jerk"
    return MotionError(
        f"the motion is unbounded: no moving axis states a limit of {name}; state one, or plan at another order"
    )
