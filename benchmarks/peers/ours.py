"""Our own solvers, toppra on our rows, and IPOPT on our order-3 problem."""

from collections.abc import Iterator
from copy import copy

from benchmarks.peers.case import Answer, Case, Solved, answer, failed, present, sampled
from kinematics.errors import MotionError
from planner.limits import limits_of
from planner.limits.limit import Limit
from planner.solve import fastest
from planner.timing import posing
from planner.timing import third_order as solver
from planner.timing.posing import jerk_problem
from planner.timing.problem import Run, Solver, grid, pose_problem
from planner.timing.profile import Profile
from planner.timing.second_order import second_order
from planner.timing.third_order import third_order

# Intervals of the alone-standing order-2 solves, and of the references.
INTERVALS, REFERENCE_2, REFERENCE_3 = 1000, 10_000, 2000


def limits_on(case: Case, order: int) -> tuple[Limit, ...]:
    """Of the axes alone: no travel, no tilt, which no peer knows."""
    return tuple(limit for limit in limits_of(case.path, case.axes, order) if not limit.geometric)


def _run(case: Case) -> Run:
    return Run(0, len(case.path.breaks) - 2)


def certified(case: Case, order: int) -> Answer:
    """Solve and certificate, as `plan` does it."""
    limits = limits_on(case, order)
    solver._forget()

    def solve() -> Solved:
        # what geometry uses is proved once for a path: each call gets a path of its own
        found = fastest(copy(case.path), limits, order).trajectory
        h = found.knots[1:] - found.knots[:-1]
        return found.duration, sampled(Profile(found.s, found.v, found.a, found.j, h, found.piece), order)

    return answer(case, order, "ours, certified", None, solve, "first call builds the problem" if order == 3 else "")


def general(case: Case) -> Answer:
    """The order-3 solver where the closed form would serve."""
    limits = limits_on(case, 3)

    def solve() -> Solved:
        problem, start = jerk_problem(case.path, limits, _run(case))
        profile = third_order(problem, start.on(problem.s))
        return profile.duration, sampled(profile, 3)

    return answer(case, 3, "ours, general solver, uncertified", None, solve)


def second(case: Case) -> Iterator[Answer]:
    limits = limits_on(case, 2)

    def by(which: Solver, intervals: int) -> Solved:
        profile = second_order(pose_problem(case.path, limits, *grid(case.path, _run(case), intervals)), solver=which)
        return profile.duration, sampled(profile, 2)

    yield answer(case, 2, "ours, uncertified", INTERVALS, lambda: by("passes", INTERVALS))
    yield answer(case, 2, "ours, uncertified (reference)", REFERENCE_2, lambda: by("passes", REFERENCE_2))
    if not present("toppra"):
        yield failed(case, 2, "toppra", None, "absent")
        return
    try:
        yield answer(case, 2, "toppra", INTERVALS, lambda: by("toppra", INTERVALS))
    except MotionError as no:
        yield failed(case, 2, "toppra", INTERVALS, str(no))


def ipopt(case: Case) -> Answer:
    """The reference: IPOPT on many intervals, from where FATROP ends on as many."""
    usual, posing.THIRD_ORDER = posing.THIRD_ORDER, (REFERENCE_3, 0, 0)
    try:
        problem, start = jerk_problem(case.path, limits_on(case, 3), _run(case))
    finally:
        posing.THIRD_ORDER = usual
    guess = start.on(problem.s)

    def solve() -> Solved:
        profile = third_order(problem, guess, solver="ipopt")
        return profile.duration, sampled(profile, 3)

    try:
        return answer(case, 3, "IPOPT (reference)", problem.intervals, solve)
    except MotionError as no:
        return failed(case, 3, "IPOPT (reference)", problem.intervals, str(no))
