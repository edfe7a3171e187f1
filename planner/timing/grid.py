"""A run's problem, posed: on which grid, and from which motion an order-3 solve starts."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from planner.limits.limit import Limit, Term
from planner.path.actuation import ActuatorPath
from planner.path.polynomial import PolynomialPath
from planner.timing.initial_guess import MAX_BRIEF_SHARE, WINDOW_GROWTH, Smoothed, pass_breaks, slow_breaks
from planner.timing.order2.second_order import TERMS as SECOND
from planner.timing.order2.second_order import second_order
from planner.timing.problem import (
    Block,
    Continuation,
    Problem,
    Run,
    fix_passed_ends,
    leave_out_idle,
    pose_problem,
)
from planner.timing.profile import Profile

Rule = tuple[int, int, int]
"""Intervals of a run at least, for each piece in it, and for each radian that it turns."""
# COARSE is for the order-2 motion that starts an order-3 solve, and on ROUGH_GRID that only tells where it loses time.
SECOND_ORDER, THIRD_ORDER, COARSE, ROUGH_GRID = (1000, 50, 40), (240, 24, 15), (400, 20, 20), (120, 8, 6)
# Intervals of a run at most, at order 2 and 3: these hold some 5 kB each, and 0.15 MB.
MAX_INTERVALS = (1_000_000, 50_000)
# Pieces of a path without a machine in one run at most. The more it has, the fewer intervals has each, so that all are
# within MAX_INTERVALS: so dense a spline bends little from knot to knot.
MAX_DENSE_PIECES = 100_000
# Of a grid whose intervals have the same weight each: the share of the weight that goes with time, the least number of
# intervals of a piece, and in how many parts a motion's pieces are taken.
TIME_SHARE, MIN_PER_PIECE, PLACE_PARTS = 0.4, 4, 8
# Of numbers of intervals.
ROUNDING = 1e-6
# At order 2 fewer do where the axes' directions q′ hardly change along a piece: so many for each change by the whole of
# themselves, rounded up to one of a few sizes. Measured on lines of the hexapod: durations stay within 3e-4 of those on
# 8000 intervals, since each interval at whose ends s̈ steps by a share of the largest is cut in so many.
PER_CHANGE, FEW_INTERVALS = 2000, (250, 350, 500, 700)
MIN_STEP_SHARE, STEP_PARTS = 0.2, 8
# Points of a piece at which its directions are looked at.
DIRECTION_POINTS = 17
# Share of an interval that is left of one behind a grid that is gone on from.
MIN_STEP_LEFT = 0.5
# Share of an interval up to which a point of it is near a knot; of a run up to which two places are the same.
NEAR_STEP_SHARE, SAME_PLACE = 1 / 3, 1e-12
START_GRID = "start"
"""Name of the rows that bound s̈ by what the jerk lets a motion reach: no limit's."""
# Window of the average, as a share of what the run allows, where a gentle start finds no way between two speeds.
START_WINDOW_SHARE = 1e-2


def make_grid(
    path: ActuatorPath, run: Run, intervals: int, spread: Array | None = None, *, least: Array | None = None
) -> tuple[Array, np.ndarray]:
    """Grid of about `intervals` intervals that holds every break of the run, and the piece of each interval.

    spread (K,) in [0, 1], rising from 0 to 1: where points should lie, as a share of the run (evenly if None).
    least (P,): a piece of the run in which fewer intervals would lie, as in a blend, has so many even ones instead.
    """
    breaks = run.breaks(path)
    share = np.linspace(0, 1, intervals + 1) if spread is None else spread
    s = breaks[0] + (breaks[-1] - breaks[0]) * share
    if len(breaks) > 2:
        # a point too near a break would make a sliver: the break takes its place
        after = np.searchsorted(breaks, s).clip(1, len(breaks) - 1)
        gap = np.minimum(np.abs(s - breaks[after - 1]), np.abs(breaks[after] - s))
        near = np.maximum(np.gradient(s), 0) / 3
        s = np.union1d(s[gap > near], breaks)
        s = s if least is None else _fill_pieces(s, breaks, least)
    else:
        s[0], s[-1] = breaks
    return s, find_pieces(path, run, s)


def find_pieces(path: ActuatorPath, run: Run, s: Array) -> np.ndarray:
    """The piece (N,) of each interval of a grid (N+1,) along a run."""
    inner = run.breaks(path)[1:-1]
    return np.asarray(run.first + np.searchsorted(inner, (s[1:] + s[:-1]) / 2, side="right"))


def _fill_pieces(s: Array, breaks: Array, least: Array) -> Array:
    at = np.searchsorted(s, breaks)
    parts = [s[a:b] for a, b in pairwise(at)]
    for k in np.flatnonzero(np.diff(at) < least):
        parts[k] = np.linspace(breaks[k], breaks[k + 1], int(np.ceil(least[k])) + 1)[:-1]
    return np.concatenate([*parts, breaks[-1:]])


def acceleration_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Problem:
    """A run's rows on an even grid, or a graded one."""
    mixed = any(Term.SD in limit.terms and len(limit.terms) > 1 for limit in limits)
    few = (
        None
        if mixed or any(end.zero_derivatives == 1 for end in run.ends) or run.fineness > 1
        else _few_intervals(path, run)
    )
    spread = _graded_shares(count_intervals(SECOND_ORDER, path, run)) if mixed else None
    s, piece = _grid(SECOND_ORDER, path, run, spread) if few is None else make_grid(path, run, few)
    problem = pose_problem(path, limits, s, piece, run.ends)
    return problem if run.continuation is None else continue_problem(path, limits, run, problem, run.continuation)


def continue_problem(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, problem: Problem, continuation: Continuation
) -> Problem:
    """A run's problem, begun on the grid and with the room of the motion that it goes on with.

    That motion keeps every row there; on another grid it need not, and none may.
    """
    s = problem.s
    known = continuation.s
    s = np.concatenate([known, s[s > known[-1] + MIN_STEP_LEFT * (s[-1] - s[-2])]])
    s = _hold_knots(s, continuation.knots, run.breaks(path))
    s = _hold_knots(s, continuation.knots, run.breaks(path))
    posed = pose_problem(path, limits, s, find_pieces(path, run, s), run.ends)
    blocks = []
    for block in posed.blocks:
        room = continuation.room.get(block.name, np.empty(0))
        blocks.append(replace(block, room=np.append(room, block.room[len(room) :])))
    return replace(posed, blocks=tuple(blocks))


def _hold_knots(s: Array, knots: Array, breaks: Array) -> Array:
    """A grid (N+1,) with knots in it, in place of points near them: but for its ends, and breaks of the path."""
    knots = knots[(knots > s[0]) & (knots < s[-1] - NEAR_STEP_SHARE * (s[-1] - s[-2]))]
    knots = knots[_distances(knots, breaks) > SAME_PLACE * (s[-1] - s[0])]
    kept = np.isin(s, breaks) | (_distances(s, knots) > NEAR_STEP_SHARE * np.gradient(s))
    kept[[0, -1]] = True
    return np.union1d(s[kept], knots)


def _distances(s: Array, places: Array) -> Array:
    """(N,) from each of some places (N,) to the nearest of others, in order; ∞ where there are none."""
    others = np.concatenate([[-np.inf], places, [np.inf]])
    after = np.searchsorted(others, s)
    return np.asarray(np.minimum(s - others[after - 1], others[after] - s))


def refine_problem(path: ActuatorPath, limits: Sequence[Limit], problem: Problem, motion: Profile) -> Problem | None:
    """A problem of few intervals, with those beside which s̈ steps cut in STEP_PARTS; None for the others.

    s̈ cannot step inside an interval, and that takes time.
    """
    if problem.intervals not in FEW_INTERVALS:
        return None
    step = np.abs(np.diff(motion.a, prepend=0.0, append=0.0)) > MIN_STEP_SHARE * np.abs(motion.a).max()
    return cut_intervals(path, limits, problem, np.where(step[:-1] | step[1:], STEP_PARTS, 1))


def cut_intervals(path: ActuatorPath, limits: Sequence[Limit], problem: Problem, count: np.ndarray) -> Problem:
    """A problem each of whose intervals is cut in so many (N,) even ones, with the room that it had."""
    first = np.repeat(np.cumsum(count) - count, count)
    share = (np.arange(count.sum()) - first) / np.repeat(count, count)
    s = np.repeat(problem.s[:-1], count) + share * np.repeat(np.diff(problem.s), count)
    placed = np.append(s, problem.s[-1]), np.repeat(problem.piece, count)
    finer = pose_problem(path, leave_out_idle(limits, problem), *placed, problem.ends)
    room = {block.name: np.repeat(block.room, count) for block in problem.blocks}
    blocks = tuple(replace(block, room=room.get(block.name, block.room)) for block in finer.blocks)
    return replace(finer, blocks=blocks, ends=problem.ends)


def coarse_jerk_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Problem:
    """A run's rows on an even grid, to start from."""
    return pose_problem(path, limits, *_grid(COARSE, path, run), run.ends)


def brief_problem(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, coarse: Problem
) -> tuple[Problem, float] | None:
    """The order-2 problem of a run from rest to rest, and the window of its average; None where that is not brief."""
    if max(run.speeds) > 0 or not coarse.is_unconditional:
        return None
    gentle, window = _second_order_start(coarse.with_fixed_ends())
    sharp = second_order(gentle)
    if not sharp.solved or WINDOW_GROWTH * window > MAX_BRIEF_SHARE * sharp.duration:
        return None
    placed = _grid(SECOND_ORDER, path, run, _graded_shares(count_intervals(SECOND_ORDER, path, run)))
    return _second_order_start(pose_problem(path, limits, *placed))


def jerk_problem(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, coarse: Problem | None = None, rule: Rule | None = None
) -> tuple[Problem, Smoothed | Profile] | MotionError:
    """The order-3 problem of a run, on a grid graded for it, and the averaged order-2 motion to start from.

    Where that passes breaks faster than the jerk lets, ramps from one of them to the next. Where nothing bounds the
    jerk, or there is no order-2 motion, why not.
    """
    coarse, rule = coarse_jerk_problem(path, limits, run) if coarse is None else coarse, rule or THIRD_ORDER
    start = _smooth_motion(coarse)
    if isinstance(start, MotionError):
        return start
    breaks = run.breaks(path)
    slow, speeds = slow_breaks(coarse, start, breaks)
    if len(slow):
        at = np.searchsorted(coarse.s, breaks[np.concatenate([[0], slow, [len(breaks) - 1]])])
        passing = pass_breaks(coarse, at, np.concatenate([run.speeds[:1], speeds, run.speeds[1:]]))
        if passing is not None:  # else a speed leads nowhere: on as if there were none
            motion = passing.cut(breaks, run.first)
            return place_problem(path, limits, run, motion, motion.h, rule), passing

    points = start.spread(count_intervals(rule, path, run, on_top=True))
    spread = np.clip((points - coarse.s[0]) / (coarse.s[-1] - coarse.s[0]), 0.0, 1.0)
    return pose_problem(path, limits, *_grid(rule, path, run, spread), run.ends), start


def place_problem(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, motion: Profile, weight: Array, rule: Rule = THIRD_ORDER
) -> Problem:
    """The order-3 problem of a run on a grid whose intervals have about the same mean of weight and time.

    weight (M,): of the pieces of a motion that is cut at the run's breaks; over each piece it grows with time.
    """
    breaks = run.breaks(path)
    even, total = motion.h / motion.duration, weight.sum()
    share = (1 - TIME_SHARE) * weight / total + TIME_SHARE * even if total > 0 else even
    owner, part = np.repeat(np.arange(len(motion.h)), PLACE_PARTS), np.arange(PLACE_PARTS) / PLACE_PARTS
    s = np.append(motion.at(owner, np.outer(motion.h, part).ravel())[0], breaks[-1])
    s = np.clip(np.maximum.accumulate(s), breaks[0], breaks[-1])
    passed = np.concatenate([[0.0], np.cumsum(share[owner]) / PLACE_PARTS])
    at = PLACE_PARTS * np.append(np.searchsorted(motion.piece, np.arange(run.first, run.last + 1)), len(motion.h))
    fewest = min(MIN_PER_PIECE, _per_piece(rule, path, run))
    least = np.maximum(fewest, rule[2] * path.turns[run.first : run.last + 1] / 2)
    intervals = count_intervals(rule, path, run, on_top=True)
    count = np.ceil(np.maximum(least, np.diff(passed[at]) * intervals) - ROUNDING).astype(int)
    first = np.repeat(np.cumsum(count) - count, count)
    inside = (np.arange(count.sum()) - first) / np.repeat(count, count)
    wanted = np.repeat(passed[at[:-1]], count) + inside * np.repeat(np.diff(passed[at]), count)
    grid = np.append(np.interp(wanted, passed, s), breaks[-1])
    grid[np.cumsum(count) - count] = breaks[:-1]
    piece = np.repeat(np.arange(run.first, run.last + 1), count)
    return pose_problem(path, limits, grid, piece, run.ends)


def grade_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run, shares: Callable[[int], Array]) -> Problem:
    """The order-3 problem of a run on a grid whose points lie at such shares of it, for a number of intervals."""
    spread = shares(count_intervals(THIRD_ORDER, path, run))
    ends = fix_passed_ends(run.ends)  # a passing speed is too fast for a slow motion
    return pose_problem(path, limits, *_grid(THIRD_ORDER, path, run, spread), ends)


def _grid(rule: Rule, path: ActuatorPath, run: Run, spread: Array | None = None) -> tuple[Array, np.ndarray]:
    """A run's grid by a rule, of which every piece by itself has its share."""
    least = np.maximum(_per_piece(rule, path, run), rule[2] * path.turns[run.first : run.last + 1])
    return make_grid(path, run, count_intervals(rule, path, run), spread, least=least)


def _graded_shares(intervals: int) -> Array:
    """Shares of a run, ever denser towards its ends: what falls with ṡ, as √x does, changes fastest there."""
    even = np.linspace(0.0, 1.0, intervals + 1)
    return np.asarray(even**2 * (3 - 2 * even))


def _per_piece(rule: Rule, path: ActuatorPath, run: Run) -> int:
    """Intervals of each piece by a rule; fewer where a path without a machine has very many of them."""
    if not isinstance(path, PolynomialPath):
        return rule[1]
    most = MAX_INTERVALS[rule != SECOND_ORDER]
    return min(rule[1], max(1, most // (run.last - run.first + 1)))


def count_intervals(rule: Rule, path: ActuatorPath, run: Run, on_top: bool = False) -> int:
    """By a rule; on_top: pieces after the first come on top of the least number."""
    least, _, per_radian = rule
    per_piece = _per_piece(rule, path, run)
    turn = float(path.turns[run.first : run.last + 1].sum())
    pieces = run.last - run.first + 1
    size = max(least + per_piece * (pieces - 1) if on_top else least, per_piece * pieces, int(per_radian * turn))
    size *= run.fineness
    most = MAX_INTERVALS[rule != SECOND_ORDER]
    if isinstance(path, PolynomialPath):
        _refuse_dense(pieces)
    elif size > most:
        since, until = (
            path.place(float(s), k)
            for s, k in zip(path.breaks[[run.first, run.last + 1]], (run.first, run.last), strict=True)
        )
        order = ", or plan at order 2" if rule != SECOND_ORDER else ""
        raise MotionError(
            f"from {since} to {until} the motion does not stop, and takes {count_noun(size, 'interval')} to time, "
            f'at most {most}: write join = "stop" on the way, or split a segment that turns many times{order}'
        ).in_segment(since.segment)
    return size


def _refuse_dense(pieces: int) -> None:
    if pieces > MAX_DENSE_PIECES:
        raise MotionError(
            f"the path has {pieces} pieces without a stop, at most {MAX_DENSE_PIECES} are timed at once: give a spline "
            "of fewer knots, or parts of it one by one with start_speed and end_speed"
        )


def _few_intervals(path: ActuatorPath, run: Run) -> int | None:
    """Intervals that do for a run of one piece along which the axes' directions hardly change; None: the rule's."""
    if run.first != run.last:
        return None
    start, end = run.breaks(path)
    slope = path.derivatives(np.linspace(start, end, DIRECTION_POINTS), np.full(DIRECTION_POINTS, run.first), 2)[1]
    change = float(np.abs(np.diff(slope, axis=0)).max(1).sum() / np.abs(slope).max())
    return min([size for size in FEW_INTERVALS if size >= PER_CHANGE * change], default=None)


def unbounded_error(problem: Problem, order: int) -> MotionError | None:
    """What to say where nothing bounds the acceleration, or at order 3 the jerk; None where something does."""
    term, name = (Term.SDD, "acceleration") if order == 2 else (Term.SDDD, "jerk")
    if any(np.any(block.start.get(term, 0.0)) for block in problem.blocks):
        return None
    return MotionError(
        f"the motion is unbounded: no moving axis states a limit of {name}; state one, or plan at another order"
    )


def _smooth_motion(coarse: Problem) -> Smoothed | MotionError:
    """The averaged order-2 motion over a run; begun and ended at a speed, of a shorter one."""
    unbounded = unbounded_error(coarse, 3)
    if unbounded is not None:
        return unbounded
    gentle, window = _second_order_start(coarse.with_fixed_ends())  # averages begin and end at rest
    onward = sum(coarse.speeds)
    if onward == 0:
        sharp = second_order(gentle)
        return Smoothed(sharp.profile, window) if sharp.refusal is None else sharp.refusal
    whole = (coarse.s[-1] - coarse.s[0]) / onward
    found = _average_motion(gentle, min(window, whole))
    if isinstance(found, MotionError):
        blocks = tuple(block for block in coarse.blocks if set(block.start) <= SECOND)
        return _average_motion(replace(gentle, blocks=blocks), START_WINDOW_SHARE * whole)
    return found


def _average_motion(problem: Problem, window: float) -> Smoothed | MotionError:
    low = problem.s[0] + problem.speeds[0] * window / 2
    high = problem.s[-1] - problem.speeds[1] * window / 2
    sliver = 1e-9 * (high - low)
    kept = np.flatnonzero((problem.s[1:] > low + sliver) & (problem.s[:-1] < high - sliver))
    chosen = slice(kept[0], kept[-1] + 1)
    s = problem.s[kept[0] : kept[-1] + 2].copy()
    s[0], s[-1] = low, high
    part = replace(problem.part(chosen), s=s)
    sharp = second_order(part)
    return Smoothed(sharp.profile, window, problem.speeds) if sharp.refusal is None else sharp.refusal


def _second_order_start(problem: Problem) -> tuple[Problem, float]:
    """The problem without its jerk rows, and the window A/J over which its motion is averaged.

    A is the least of the limit on acceleration and what the jerk lets a motion reach before full speed, √(V J), or
    halfway, (J² L/2)^⅓; speeds, accelerations and jerks are along the path, on average. It shapes the start only,
    never the answer.
    """
    jerk, speed, push = _mean_bound(problem, Term.SDDD), _mean_bound(problem, Term.SD), _mean_bound(problem, Term.SDD)
    reached = min(np.sqrt(speed * jerk), np.cbrt(jerk**2 * (problem.s[-1] - problem.s[0]) / 2))
    if not np.isfinite(reached):
        raise MotionError("the motion is unbounded: no moving axis states a limit of speed or acceleration; state one")
    blocks = [block for block in problem.blocks if set(block.start) <= SECOND]
    if reached < push:
        size = np.full((problem.intervals, 1), 1 / reached)
        blocks.append(Block(START_GRID, {Term.SDD: size}, {Term.SDD: size}, np.ones(problem.intervals), np.zeros(1)))
    return replace(problem, blocks=tuple(blocks)), min(reached, push) / jerk


def _mean_bound(problem: Problem, term: Term) -> float:
    """How large a term may be along the path by itself, on average; ∞ where no row holds it."""
    size = np.zeros(problem.intervals)
    for block in problem.blocks:
        if term in block.start:
            np.maximum(size, np.abs(block.start[term]).max(1), out=size)
    return 1 / float(size.mean()) if size.any() else float("inf")
