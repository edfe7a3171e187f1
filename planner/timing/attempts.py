"""The ways to time a run, tried in order until one gives a motion that respects every limit.

No other place looks for another way to a fastest run, but for cruises whose proof fails
(planner.timing.certify_loop). A motion that exceeds a limit between
grid points is first tightened (planner.timing.tighten); one that then still has to be slowed as a
whole is remembered while the next ways are tried, and the fastest of all is returned.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.place import Infeasible
from planner.timing.end_speeds import find_excessive_end_speed
from planner.timing.feed_limited import FeedLimitedRun
from planner.timing.grid import (
    Task,
    acceleration_problem,
    brief_problem,
    divide_motion,
    jerk_problem,
    refine_problem,
    unbounded_error,
)
from planner.timing.initial_guess import add_brief_ramps
from planner.timing.loss_grid import pose_by_loss, pose_usual_problem
from planner.timing.order2.closed_form import nearly_straight_ramp, straight
from planner.timing.order2.second_order import TERMS as ORDER_2_TERMS
from planner.timing.order2.second_order import estimate_lower_bound, second_order
from planner.timing.order3.interior_point import Start
from planner.timing.order3.solve import solve_jerk_limited
from planner.timing.problem import Problem, Run
from planner.timing.profile import Profile
from planner.timing.sampling import sample_limit_use
from planner.timing.solution import (
    AVERAGED,
    BRIEF_RAMPS,
    MAX_NEGLIGIBLE_SLOWNESS,
    WITH_RESTS,
    RunSolution,
    TooFast,
)
from planner.timing.tighten import SOLVER_MARGIN, required_slowness, tighten_until_kept

# A motion that has to be slowed by more than this is not accepted while other ways are left: a rest
# in between slows it in one place only.
MAX_ACCEPTED_SLOWNESS = 1.01
# Share by which the limits of a nearly straight ramp may vary along it. Each of its pieces of
# constant jerk has an interval for each 0.1 % that they vary, in the range below: with hundreds the
# interior point may fail. The 20 files of evidence cam_files took 5.2 s to plan at order 3 on the
# usual grid; they take 4.6 s, and their motion as long.
MAX_BEND = 0.15
BEND_PER_INTERVAL = 1e-3
RAMP_INTERVALS = (20, 80)
# Ramps of s̈ shorter than this share of a motion are ramps that no solver can tell from steps.
SURELY_BRIEF = 1e-5
# Number of pieces of a run up to which rests at all of its breaks are tried.
MOST_RESTED = 12


Outcomes = Sequence[RunSolution]
"""Results of earlier attempts."""


def ends_search(solution: RunSolution) -> bool:
    """Return whether no faster motion is to be expected from the ways that are left."""
    if solution.maker in (WITH_RESTS, AVERAGED):
        return False
    if solution.maker == BRIEF_RAMPS:
        return has_surely_brief_ramps(solution)
    return solution.slowness <= MAX_ACCEPTED_SLOWNESS


def has_surely_brief_ramps(solution: RunSolution) -> bool:
    """Return whether no solver could tell a motion's ramps of s̈ from steps."""
    longest = float(solution.profile.h[solution.profile.j != 0].max(initial=0.0))
    return (
        longest <= SURELY_BRIEF * solution.duration and solution.slowness <= MAX_NEGLIGIBLE_SLOWNESS
    )


@dataclass(frozen=True, slots=True)
class Attempt:
    """One way to time a run.

    reason    why it is tried, and why at this place in the table
    solve     returns a motion or a refusal; None where this way does not apply
    refuses   a refusal ends the search
    once      tried also where a quick answer is wanted (`solve_once`)
    """

    reason: str
    solve: Callable[[Task, Outcomes], RunSolution | None]
    refuses: bool = False
    once: bool = False


def solve_once(task: Task) -> RunSolution:
    """Return the motion of the general ways, untightened: for callers with other runs to try."""
    return solve_run(task, once=True, tightened=False)


def solve_run(task: Task, *, once: bool = False, tightened: bool = True) -> RunSolution:
    """Return the fastest motion along a run, or its refusal.

    once       true: only the general ways
    tightened  false: the motion may exceed limits between grid points

    Infeasible for a speed at an end that is not possible; stopped where nothing bounds the motion.
    """
    unbounded = unbounded_error(task.sketch, task.order)
    if unbounded is not None:
        return RunSolution.refused(unbounded)
    outcomes: list[RunSolution] = []
    for attempt in ATTEMPTS[task.order]:
        solution = None if once and not attempt.once else attempt.solve(task, outcomes)
        if solution is None:
            continue
        if tightened and solution.problem is not None and not solution.is_closed_form:
            solution = tighten_until_kept(task, solution)
        outcomes.append(solution)
        if not solution.solved and attempt.refuses:
            return _place_refusal(task, solution)
        if solution.solved and ends_search(solution):
            break
    solved = [solution for solution in outcomes if solution.solved]
    if not solved:
        return _place_refusal(task, outcomes[-1] if outcomes else NOT_TRIED)
    return _add_estimate(task, min(solved, key=lambda solution: solution.duration))


NOT_TRIED = RunSolution.refused(MotionError("no way to time the run applies"))


def _add_estimate(task: Task, solution: RunSolution) -> RunSolution:
    """Add the estimate of the least time that the run can take, where the maker has none."""
    # of parts with rests between, the sum is no estimate for the run
    has_estimate = solution.lower_estimate > 0 and solution.maker != WITH_RESTS
    if has_estimate or task.run.continuation is not None:
        return solution
    return replace(solution, lower_estimate=estimate_lower_bound(task.coarse))


def _place_refusal(task: Task, solution: RunSolution) -> RunSolution:
    """Say where along the path a speed at an end is too fast: solvers do not know that."""
    error = solution.refusal
    if not isinstance(error, TooFast):
        return solution
    run = task.run
    s = run.breaks(task.path)[-error.end]
    place = task.path.place(s, run.last if error.end else run.first)
    unit, scale = ("/s", 1.0) if place.segment is None else ("mm/s", 1e3)
    largest = error.largest * scale
    remedy = f"{largest:.6g} {unit} is the largest that the limits allow"
    if error.both:
        remedy += ", from rest or to rest at the other end: both are too high"
    speed = error.speed * scale
    refusal = Infeasible(error.name, "path", place, speed, largest, unit, remedy)
    return RunSolution.refused(refusal)


def _has_motion(outcomes: Outcomes) -> bool:
    """Return whether an earlier attempt found a motion, other than brief ramps."""
    return any(solution.solved and solution.maker != BRIEF_RAMPS for solution in outcomes)


def follow_closed_form(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Time a run that is straight in the actuators by seven pieces of constant jerk."""
    if task.order == 3 and task.run.continuation is not None:
        return None
    return straight(task.sketch)


def cruise_at_caps(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Time a feed-limited run: cruises at the capped speed of the tool, and ramps between them."""
    if task.run.whole:
        return None
    return FeedLimitedRun(task.with_run(replace(task.run, continuation=None))).solve(solve_run)


def solve_two_passes(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Solve an order-2 run on its grid, on a finer one where s̈ steps."""
    problem = acceleration_problem(task.path, task.limits, task.run)
    solver = task.run.solver
    solution = second_order(problem, solver=solver)
    if solution.solved:
        finer = refine_problem(task.path, task.limits, problem, solution.profile)
        if finer is not None:
            solution = second_order(finer, solver=solver)
    if not solution.solved or solution.problem is None or task.run.continuation is not None:
        return solution
    fastest = solution.profile if solver == "passes" else None
    estimate = estimate_lower_bound(solution.problem, fastest)
    return replace(solution, lower_estimate=estimate)


def ramp_brief_steps(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Return the order-2 motion whose steps of s̈ become ramps; None where these are not brief."""
    brief = brief_problem(task.path, task.active_limits, task.run, task.coarse)
    if brief is None:
        return None
    problem, window = brief
    sharp = second_order(problem, solver=task.run.solver)
    gentle = [limit for limit in task.active_limits if limit.terms <= ORDER_2_TERMS]
    sharp = tighten_until_kept(replace(task, limits=gentle), sharp)
    if not sharp.solved:
        return sharp
    breaks = task.run.breaks(task.path)
    profile = add_brief_ramps(sharp.profile, window, breaks, task.run.first)
    if profile is None:
        return None
    ramps = RunSolution("solved", profile, maker=BRIEF_RAMPS, problem=problem)
    pieces = range(task.run.first, task.run.last + 1)
    is_stated = any(task.path.constant(piece) is not None for piece in pieces)
    # only a solver tells where a stated constant speed is reached
    return ramps if has_surely_brief_ramps(ramps) or not is_stated else None


def solve_from_closed_form(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Solve a nearly straight ramp from its closed form, unless that loses next to nothing.

    The faster of both motions is returned, or a refusal where the solver fails.
    """
    if task.run.continuation is not None:
        return None
    near = nearly_straight_ramp(task.sketch, MAX_BEND)
    if near is None:
        return None
    if near.duration - near.lower_estimate <= task.negligible:
        return near
    if task.order == 2:  # two passes take no guess
        return None
    motion = near.profile
    bend = 1 - near.lower_estimate / near.duration
    parts = int(np.clip(np.ceil(bend / BEND_PER_INTERVAL), *RAMP_INTERVALS))
    problem = divide_motion(task.path, task.active_limits, task.run, motion, parts)
    solution = _solve_posed(task, (problem, motion.on(problem.s)), "finer")
    if solution.solved and near.duration < solution.duration:
        return replace(near, lower_estimate=0.0)  # too rough an estimate
    return solution


def solve_by_loss(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Solve roughly, then on a grid that is fine where the rough solution loses time."""
    posed = pose_by_loss(task.path, task.active_limits, task.run, task.coarse)
    if posed is None:
        return None
    return _solve_posed(task, posed, "finer")


def solve_on_usual_grid(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Solve on the usual grid, with rest at the ends that a motion might pass."""
    if _has_motion(outcomes):
        return None
    task = task.resting
    posed = pose_usual_problem(task.path, task.active_limits, task.run, task.coarse)
    return _solve_posed(task, posed, "far")


def _solve_posed(
    task: Task,
    posed: tuple[Problem, Array] | MotionError,
    start: Start,
) -> RunSolution:
    if isinstance(posed, MotionError):
        return RunSolution.refused(posed)

    def look(motion: Profile, names: Collection[str]) -> Mapping[str, Array]:
        watched = [limit for limit in task.active_limits if limit.name in names]
        return sample_limit_use(task.path, watched, motion)

    return solve_jerk_limited(*posed, start, look)


def refuse_end_speed(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Refuse a run whose start or end speed is too high."""
    if task.run.continuation is not None or _has_motion(outcomes):
        return None

    def is_feasible(run: Run) -> bool:
        solution = tighten_until_kept(task, solve_once(task.with_run(run)))
        if not solution.solved:
            return False
        use = sample_limit_use(task.path, task.limits, solution.profile)
        slowness = required_slowness(task.limits, solution.relate_use(use))
        return slowness <= 1 + SOLVER_MARGIN

    error = find_excessive_end_speed(task, is_feasible)
    if error is not None:
        return RunSolution.refused(error)
    too_fast = (solution for solution in outcomes if solution.status == "too fast")
    return next(too_fast, None)


def rest_in_middle(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Rest at the break about the middle at which the motion is slowest anyway."""
    run = task.run
    count = run.last - run.first + 1
    if count == 1 or run.continuation is not None:
        return None
    posed = jerk_problem(task.path, task.limits, run, task.coarse)
    if isinstance(posed, MotionError):
        return None
    problem, guess = posed
    first = (count - 1) // 4
    inner = run.breaks(task.path)[1:-1][first : count - 1 - first]
    speed = guess.on(problem.s)[0, np.searchsorted(problem.s, inner)]
    return _rest_at(task, [1 + first + int(np.argmin(speed))])


def rest_at_all_breaks(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Rest at each break of a run of few pieces, as the classical timings do."""
    count = task.run.last - task.run.first + 1
    if not 2 < count <= MOST_RESTED or task.run.continuation is not None:
        return None
    return _rest_at(task, range(1, count))


def _rest_at(task: Task, inner: Sequence[int]) -> RunSolution | None:
    """Rest at some inner breaks, by their numbers in the run. None where there is no room."""
    run = replace(task.run, whole=True)
    breaks = run.breaks(task.path)
    places = breaks[[0, *inner, len(breaks) - 1]].tolist()
    parts: list[RunSolution] = []
    for since, until in pairwise(places):
        part = solve_run(task.with_run(run.cut(task.path, since, until)))
        if not part.solved:
            return None
        parts += part.parts or (part,)
    return RunSolution.joined(parts, WITH_RESTS)


def average_acceleration(task: Task, outcomes: Outcomes) -> RunSolution | None:
    """Return the averaged order-2 motion from which solvers start, which only has to be slowed."""
    if task.run.continuation is not None:
        return None
    if any(end.acceleration != 0 for end in task.run.ends):
        return None  # its s̈ is 0 at both ends
    if _has_motion(outcomes) and max(task.run.speeds) > 0:
        return None  # it could not be slowed
    if any(solution.maker == BRIEF_RAMPS for solution in outcomes):
        return None  # they are that motion
    posed = jerk_problem(task.path, task.limits, task.run, task.coarse)
    if isinstance(posed, MotionError):
        return RunSolution.refused(posed)
    problem, guess = posed
    profile = guess.cut(task.run.breaks(task.path), task.run.first)
    return RunSolution("solved", profile, maker=AVERAGED, problem=problem)


CLOSED_FORM = Attempt(
    "A straight run has an exact solution, and an exact refusal.",
    follow_closed_form,
    refuses=True,
    once=True,
)
CRUISES = Attempt(
    "Most runs of a mill reach the feed at once and keep it: one grid over ramps of microseconds "
    "and cruises of minutes would resolve neither.",
    cruise_at_caps,
)
NEARLY_STRAIGHT = Attempt(
    "Ramps along an arc are nearly straight: their closed form is as good as the fastest motion, "
    "or shows as much as a rough solution.",
    solve_from_closed_form,
    once=True,
)
ATTEMPTS = {
    2: (
        CLOSED_FORM,
        CRUISES,
        NEARLY_STRAIGHT,
        Attempt("The general method.", solve_two_passes, refuses=True, once=True),
    ),
    3: (
        CLOSED_FORM,
        CRUISES,
        NEARLY_STRAIGHT,
        Attempt(
            "Ramps of s̈ may take a billionth of the motion: a solver cannot tell them from steps. "
            "Where they are brief but not that brief, it may be a little faster, or fail.",
            ramp_brief_steps,
            once=True,
        ),
        Attempt(
            "The general method: interior point on a grid made for the run.",
            solve_by_loss,
            once=True,
        ),
        Attempt(
            "A rough solution that takes far longer than its guess makes no good grid. Nor may the "
            "solver come away from an end that a motion passes, but from rest.",
            solve_on_usual_grid,
            once=True,
        ),
        Attempt(
            "Without a motion so far, a speed at an end may be too high: say which is possible.",
            refuse_end_speed,
            refuses=True,
        ),
        Attempt(
            "A limit that the solver cannot keep in one place slows all of a run: a rest between slows one half only.",
            rest_in_middle,
        ),
        Attempt(
            "The classical timings rest at every break: short runs are never slower than these.",
            rest_at_all_breaks,
        ),
        Attempt(
            "The solver's guess is a motion whatever the solver does, and may need less slowing.",
            average_acceleration,
        ),
    ),
}
"""The attempts of each order, in the order in which they are tried."""
