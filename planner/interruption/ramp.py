"""The soonest motion from the midst of one to what another does ahead: to a rest, or to the plan slowed.

From the state (s, ṡ, s̈) at an instant the engine's own problem is solved again, to a state at an end that is sought:
the nearest to which a motion is found that keeps every limit. A motion to a nearer end takes less time, but for what
limits change along the path: docs/theory/hold.md.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, attempt
from planner.certificate.certify import Certificate, certify
from planner.interruption.instant import (
    Instant,
    cut_motion,
    find_piece,
    join_motions,
    look,
    next_rest,
    shift_motion,
)
from planner.interruption.section import Whole
from planner.limits import Limit
from planner.path.actuation import MachinePath
from planner.shaping.shaped_proof import ShapedProof
from planner.timing.certified_solve import certified_solve
from planner.timing.discretization import coarse_jerk_problem
from planner.timing.jerk_limited import place_by_loss
from planner.timing.problem import Continuation, Run
from planner.timing.run import solve_run
from planner.trajectory import Trajectory

# Share of its way by which a ramp may be longer than the nearest that is found; and how often it is halved at most.
NEAR_SHARE, HALVINGS = 0.01, 24
# By how much farther it is tried to end in turn, where what a solve was promised is not proved.
FARTHER = (1.0, 1.02, 1.1, 1.3)
# The nearest end is sought from a share of the way ahead on: along short ways grids are fine, and a grid that is not
# may show no motion where there is one. Times so much farther in turn.
TRIED_SHARE, DOUBLING = 1e-4, 2.0
# Share of the largest s⃛ by which it steps where a motion may be left; at so many places at most.
STEP_SHARE, MAX_LEAVES = 0.1, 6
NO_KNOTS = np.empty(0)
# One with jerk limits is sought from so many times the way of the nearest without them on, which begins with this share
# of the speed, as that may be the largest; and so many times farther in turn.
TRIED_FROM, TRIED_SPEED, GROWTH = 1.05, 0.99, 1.3
# Share of a path's length: a way that is shorter is no ramp, as rounding of places is too much of it.
LEAST_WAY = 1e-10
# Of the way that is found, nearer ends that are tried once more.
NEARER = (0.8, 0.9, 0.96)

Target = Callable[[float], tuple[float, float]]
"""A place (m) of the plan's path -> ṡ and s̈ to be reached there."""


class Proved(NamedTuple):
    """The path of a motion, its limits, the motion, its proof, where it begins (m), and the proof behind shapers."""

    path: MachinePath
    limits: tuple[Limit, ...]
    trajectory: Trajectory
    certificate: Certificate
    since: float
    shaped: ShapedProof | None = None

    @property
    def duration(self) -> float:
        """s, behind the shapers if there are any."""
        return self.trajectory.duration if self.shaped is None else self.shaped.duration


def rest_anywhere(place: float) -> tuple[float, float]:
    """A target: to stand still."""
    return 0.0, 0.0


def find_ramps(
    whole: Whole,
    motion: Trajectory | None,
    now: Instant,
    end: float,
    target: Target,
    knots: Array = NO_KNOTS,
) -> Iterator[Iterator[Proved]]:
    """Find ways from an instant of a motion, or from rest (None), to what a target has before `end`.

    They come by the instant at which the motion is left, the earliest first; the ways from each
    instant, the soonest first.

    end    m
    knots  places (m) where s⃛ of the plan may step. On a grid that has them, and those of
           the motion that is left, following either for a while is among the motions of the problem.
    """
    if motion is not None:
        knots = np.union1d(motion.s, knots)
    least = LEAST_WAY * float(whole.path.breaks[-1])

    def find_ways(leave: Instant) -> Iterator[Proved]:
        ahead = knots[knots > leave.s] - leave.s
        left = Continuation(np.zeros(1), np.zeros((4, 0)), {}, leave.a, ahead)
        way = _find_way(whole, leave, end, target, left, least)
        for farther in FARTHER:
            until = leave.s + farther * way
            if until >= end:
                break
            ends = target(until)
            path = whole.draw(leave.s, until, leave.v, leave.a, leave.t, leave.q, ends)
            limits = whole.limits(path)
            solve = partial(certified_solve, path, limits, whole.order, continuation=left)
            solution = attempt(solve)
            if isinstance(solution, MotionError):
                continue
            if motion is None or leave is now:
                yield Proved(path, limits, solution.trajectory, solution.certificate, now.s)
            else:
                yield _follow_first(whole, motion, now, leave, solution.trajectory, ends)

    for leave in _find_leaves(whole, motion, now):
        if end - leave.s > least:
            yield find_ways(leave)


def _find_leaves(whole: Whole, motion: Trajectory | None, now: Instant) -> Iterator[Instant]:
    """When the motion may be left: at once; else where its s⃛ steps next.

    As it comes to its largest speed its jerk is all that the limits allow, to the last digit where it was found in
    closed form: no solver finds the only motion that there is from its midst.
    """
    yield now
    if motion is None or whole.order == 2:
        return
    steps = np.abs(np.diff(motion.j)) > STEP_SHARE * np.abs(motion.j).max()
    later = 1 + np.flatnonzero(steps & (motion.knots[1:-1] > now.t) & (motion.v[1:] > 0))
    rest = next_rest(motion, now)
    for k in later[later < rest][:MAX_LEAVES].tolist():
        yield look(motion, float(motion.knots[k]))


def _follow_first(
    whole: Whole, motion: Trajectory, now: Instant, leave: Instant, ramp: Trajectory, ends: tuple[float, float]
) -> Proved:
    """The motion up to where it is left, and a ramp from there, proved together."""
    until = leave.s + float(ramp.path.breaks[-1])
    path = whole.draw(now.s, until, now.v, now.a, now.t, now.q, ends)
    first, here = find_piece(whole.path, now.s), find_piece(whole.path, leave.s)
    before = shift_motion(cut_motion(motion, now, leave), 0.0, -first)
    joined = join_motions(path, before, shift_motion(ramp, leave.s - now.s, here - first))
    limits = whole.limits(path)
    return Proved(path, limits, joined, certify(joined, limits), now.s)


def _find_way(whole: Whole, now: Instant, end: float, target: Target, left: Continuation, least: float) -> float:
    """m to the nearest place at which the target can be reached, no nearer than `least`; all there is ahead where none
    is nearer."""
    ahead = whole.draw(now.s, end, now.v, now.a, now.t, now.q)
    limits, whole_way = whole.limits(ahead), float(ahead.breaks[-1])

    def reaches(order: int, way: float) -> bool:
        last = int(np.clip(np.searchsorted(ahead.breaks, way, "left") - 1, 0, len(ahead.pieces) - 1))
        speed, push = target(now.s + way)
        if order == 2:
            begun = now.v if whole.order == 2 else TRIED_SPEED * now.v
            run = Run(0, last, start_speed=begun, end_speed=speed, until=way)
            return solve_run(ahead, limits, run, order, probing=True).solved
        run = Run(0, last, now.v, speed, until=way, continuation=left, end_acceleration=push)
        found = place_by_loss(ahead, limits, run, coarse_jerk_problem(ahead, limits, run))
        return found is not None and not isinstance(found, MotionError)

    def narrow(order: int, low: float, high: float) -> float:
        for _ in range(HALVINGS):
            if high - low <= NEAR_SHARE * high or high <= least:
                break
            middle = max(float(np.sqrt(low * high)) if low > 0.1 * high else (low + high) / 2, least)
            low, high = (low, middle) if reaches(order, middle) else (middle, high)
        return high

    def seek(order: int, high: float, growth: float) -> float:
        low = 0.0
        while high < whole_way and not reaches(order, high):
            low, high = high, growth * high
        return narrow(order, low, min(high, whole_way))

    sharp = seek(2, max(TRIED_SHARE * whole_way, least), DOUBLING)
    if whole.order == 2:
        return sharp
    way = seek(3, TRIED_FROM * sharp, GROWTH)
    for nearer in NEARER:  # a rough solve may stop without an answer though there is one
        if nearer * way > sharp and reaches(3, nearer * way):
            return narrow(3, sharp, nearer * way)
    return way
