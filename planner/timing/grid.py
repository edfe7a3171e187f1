"""Grids of a run, and the problems posed on them.

At order 2 a grid is even, since its solution is cheap. At order 3 its points lie where the averaged
order-2 motion (planner.timing.initial_guess) spends time or changes s̈.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
from planner.timing.problem import Continuation, Problem, Run, fix_passed_ends
from planner.timing.profile import Profile
from planner.timing.rows import leave_out_idle, pose_problem


@dataclass(frozen=True, slots=True)
class Rule:
    """How many intervals a run has: at least, for each piece, and for each radian that it turns."""

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
# Largest number of intervals at each order: an interval takes 5 kB at order 2, 0.15 MB at order 3.
MAX_INTERVALS = {2: 1_000_000, 3: 50_000}
# Largest number of pieces in one run without a machine. With many pieces each has fewer intervals,
# so that all fit into MAX_INTERVALS: so dense a spline bends little from knot to knot.
MAX_DENSE_PIECES = 100_000
# Grids by weight: the share of weight that goes with time, the least number of intervals of a piece,
# and the number of parts in which each piece of the motion is integrated.
TIME_SHARE = 0.4
MIN_PER_PIECE = 4
PLACE_PARTS = 8
# Share by which rounding may raise a number of intervals.
ROUNDING = 1e-6
# At order 2 a line on which the axes' directions q′ hardly change needs fewer intervals: this many
# for a change of q′ by its own size, rounded up to one of a few numbers. Each interval at whose ends
# s̈ steps by MIN_STEP_SHARE of the largest is then cut. On lines of the hexapod, durations stay within
# 3e-4 of those on 8000 intervals.
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
    return np.asarray(run.first + np.searchsorted(inner, (s[1:] + s[:-1]) / 2, side="right"))


def divide_intervals(s: Array, count: np.ndarray) -> tuple[Array, np.ndarray]:
    """Return the grid (M+1,) whose intervals are cut into count (N,) even parts, and their owners (M,)."""
    owner = np.repeat(np.arange(len(count)), count)
    part = np.arange(len(owner)) - (np.cumsum(count) - count)[owner]
    inner = s[owner] + part / count[owner] * np.diff(s)[owner]
    return np.append(inner, s[-1]), owner


def _fill_pieces(s: Array, breaks: Array, least: Array) -> Array:
    at = np.searchsorted(s, breaks)
    parts = [s[a:b] for a, b in pairwise(at)]
    for k in np.flatnonzero(np.diff(at) < least):
        parts[k] = np.linspace(breaks[k], breaks[k + 1], int(np.ceil(least[k])) + 1)[:-1]
    return np.concatenate([*parts, breaks[-1:]])


def _distances(s: Array, places: Array) -> Array:
    """Return the distance (N,) from each s to the nearest of rising places; ∞ without any."""
    others = np.concatenate([[-np.inf], places, [np.inf]])
    after = np.searchsorted(others, s).clip(1)
    return np.asarray(np.minimum(s - others[after - 1], others[after] - s))


def acceleration_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Problem:
    """Pose a run at order 2, on an even grid, or on one that is graded where rows have ṡ next to others."""
    mixed = any(Term.SD in limit.terms and len(limit.terms) > 1 for limit in limits)
    stands = any(end.zero_derivatives == 1 for end in run.ends)
    few = None if mixed or stands or run.fineness > 1 else _few_intervals(path, run)
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
    posed = pose_problem(path, limits, s, find_pieces(path, run, s), run.ends)
    blocks = []
    for block in posed.blocks:
        room = continuation.room.get(block.name, np.empty(0))
        blocks.append(replace(block, room=np.append(room, block.room[len(room) :])))
    return replace(posed, blocks=tuple(blocks))


def _insert_knots(s: Array, knots: Array, breaks: Array) -> Array:
    """Return a grid (N+1,) with knots in place of the points near them, except ends and breaks."""
    last = s[-1] - NEAR_STEP_SHARE * (s[-1] - s[-2])
    knots = knots[(knots > s[0]) & (knots < last)]
    knots = knots[_distances(knots, breaks) > SAME_PLACE * (s[-1] - s[0])]
    stays = np.isin(s, breaks) | (_distances(s, knots) > NEAR_STEP_SHARE * np.gradient(s))
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
    jump = np.abs(np.diff(motion.a, prepend=0.0, append=0.0))
    step = jump > MIN_STEP_SHARE * np.abs(motion.a).max()
    return cut_intervals(path, limits, problem, np.where(step[:-1] | step[1:], STEP_PARTS, 1))


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
    room = {block.name: block.room[owner] for block in problem.blocks}
    blocks = tuple(replace(block, room=room.get(block.name, block.room)) for block in finer.blocks)
    return replace(finer, blocks=blocks, ends=problem.ends)


def coarse_jerk_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Problem:
    """Pose a run on a coarse even grid, from which order-3 solves start."""
    return pose_problem(path, limits, *_grid(COARSE, path, run), run.ends)


def brief_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    coarse: Problem,
) -> tuple[Problem, float] | None:
    """Pose a run from rest to rest at order 2, with the window of its average; None unless brief."""
    if max(run.speeds) > 0 or not coarse.is_unconditional:
        return None
    gentle, window = relax_jerk(coarse)
    sharp = second_order(gentle)
    if not sharp.solved or WINDOW_GROWTH * window > MAX_BRIEF_SHARE * sharp.duration:
        return None
    spread = _graded_shares(count_intervals(SECOND_ORDER, path, run))
    return relax_jerk(pose_problem(path, limits, *_grid(SECOND_ORDER, path, run, spread)))


def jerk_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    coarse: Problem | None = None,
    rule: Rule = THIRD_ORDER,
) -> tuple[Problem, Profile] | MotionError:
    """Pose a run at order 3 on a grid that is graded for it, with the motion to start from.

    That is the averaged order-2 motion, or ramps from slow break to slow break. Returns an error
    where nothing bounds the jerk, or without an order-2 motion.
    """
    coarse = coarse or coarse_jerk_problem(path, limits, run)
    start = unbounded_error(coarse, 3) or average_run(coarse)
    if isinstance(start, MotionError):
        return start
    breaks = run.breaks(path)
    slow, speeds = slow_breaks(coarse, start, breaks)
    if len(slow):
        at = np.searchsorted(coarse.s, breaks[[0, *slow, -1]])
        ramps = pass_breaks(coarse, at, np.array([run.speeds[0], *speeds, run.speeds[1]]))
        if ramps is not None:  # else the jerk leaves no way from speed to speed
            ramps = ramps.cut(breaks, run.first)
            grid = _place_grid(rule, path, run, ramps, ramps.h)
            return pose_problem(path, limits, *grid, run.ends), ramps

    points = spread_points(start, count_intervals(rule, path, run, on_top=True))
    spread = np.clip((points - coarse.s[0]) / (coarse.s[-1] - coarse.s[0]), 0.0, 1.0)
    return pose_problem(path, limits, *_grid(rule, path, run, spread), run.ends), start


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
    return pose_problem(path, limits, *_place_grid(THIRD_ORDER, path, run, motion, weight), run.ends)


def _place_grid(
    rule: Rule,
    path: ActuatorPath,
    run: Run,
    motion: Profile,
    weight: Array,
) -> tuple[Array, np.ndarray]:
    """Return the grid of `place_problem`."""
    breaks = run.breaks(path)
    total = weight.sum()
    even = motion.h / motion.duration
    share = (1 - TIME_SHARE) * weight / total + TIME_SHARE * even if total > 0 else even
    # s over the weight that is passed, at a few places of each piece
    owner = np.repeat(np.arange(len(motion.h)), PLACE_PARTS)
    tau = np.outer(motion.h, np.arange(PLACE_PARTS) / PLACE_PARTS).ravel()
    s = np.append(motion.at(owner, tau)[0], breaks[-1])
    s = np.clip(np.maximum.accumulate(s), breaks[0], breaks[-1])
    passed = np.concatenate([[0.0], np.cumsum(share[owner]) / PLACE_PARTS])

    pieces = np.arange(run.first, run.last + 1)
    first = np.append(np.searchsorted(motion.piece, pieces), len(motion.h))
    at_breaks = passed[PLACE_PARTS * first]
    per_piece = min(MIN_PER_PIECE, _per_piece(rule, path, run))
    least = np.maximum(per_piece, rule.per_radian * path.turns[pieces] / 2)
    intervals = count_intervals(rule, path, run, on_top=True)
    count = np.ceil(np.maximum(least, np.diff(at_breaks) * intervals) - ROUNDING).astype(int)
    wanted, owner = divide_intervals(at_breaks, count)
    grid = np.interp(wanted, passed, s)
    grid[np.append(np.cumsum(count) - count, len(owner))] = breaks
    return grid, pieces[owner]


def grade_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    shares: Callable[[int], Array],
) -> Problem:
    """Pose a run at order 3 with points at shares of it, which depend on their number."""
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
    """Return shares of a run that are ever denser towards its ends: ṡ ~ √x changes fastest there."""
    even = np.linspace(0.0, 1.0, intervals + 1)
    return np.asarray(even**2 * (3 - 2 * even))


def _per_piece(rule: Rule, path: ActuatorPath, run: Run) -> int:
    """Return the number of intervals for each piece; fewer on a dense path without a machine."""
    if not isinstance(path, PolynomialPath):
        return rule.per_piece
    pieces = run.last - run.first + 1
    return min(rule.per_piece, max(1, MAX_INTERVALS[rule.order] // pieces))


def count_intervals(rule: Rule, path: ActuatorPath, run: Run, on_top: bool = False) -> int:
    """Return the number of intervals of a run. Raises MotionError if it is too large.

    on_top  pieces after the first add to the least number
    """
    pieces = run.last - run.first + 1
    turn = float(path.turns[run.first : run.last + 1].sum())
    per_piece = _per_piece(rule, path, run)
    least = rule.least + per_piece * (pieces - 1) if on_top else rule.least
    size = run.fineness * max(least, per_piece * pieces, int(rule.per_radian * turn))
    if isinstance(path, PolynomialPath):
        _refuse_dense(pieces)
    elif size > MAX_INTERVALS[rule.order]:
        raise _size_error(rule, path, run, size)
    return size


def _size_error(rule: Rule, path: ActuatorPath, run: Run, size: int) -> MotionError:
    since = path.place(float(path.breaks[run.first]), run.first)
    until = path.place(float(path.breaks[run.last + 1]), run.last)
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
    change = float(np.abs(np.diff(slope, axis=0)).max(1).sum() / np.abs(slope).max())
    return min([size for size in FEW_INTERVALS if size >= PER_CHANGE * change], default=None)


def unbounded_error(problem: Problem, order: int) -> MotionError | None:
    """Return the error of a run on which nothing bounds s̈, or at order 3 s⃛; None where it is bounded."""
    term, name = (Term.SDD, "acceleration") if order == 2 else (Term.SDDD, "jerk")
    if any(np.any(block.start.get(term, 0.0)) for block in problem.blocks):
        return None
    return MotionError(
        f"the motion is unbounded: no moving axis states a limit of {name}; state one, or plan at another order"
    )
