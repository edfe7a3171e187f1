"""A run under jerk limits: solved as a whole, or where a solver has no answer, by what still leads to a motion.

In that order: the closed form, where it is straight; the averaged order-2 motion, where its ramps are brief; the solver
(planner.timing.order3.solve); two legs with a rest between, and so on; the averaged motion, slowed.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit, Term
from planner.path.actuation import ActuatorPath
from planner.timing.certified_run import SOLVER_MARGIN, required_slowness, tighten_until_kept
from planner.timing.discretization import (
    MAX_INTERVALS,
    ROUGH_GRID,
    START_GRID,
    THIRD_ORDER,
    Rule,
    brief_problem,
    coarse_jerk_problem,
    continue_problem,
    count_intervals,
    jerk_problem,
    place_problem,
    unbounded_error,
)
from planner.timing.initial_guess import Smoothed, ramped
from planner.timing.order3.peaks import Look
from planner.timing.order3.solve import estimate_motion, settle_rows, solve_jerk_limited, third_order
from planner.timing.problem import POWERS, Problem, Run, fix_passed_ends, leave_out_idle
from planner.timing.profile import (
    AVERAGED,
    BRIEF_RAMPS,
    MAX_UNTOLD_SLOWNESS,
    WITH_RESTS,
    Profile,
    RunSolution,
    TooFast,
    sample_limit_use,
)
from planner.timing.solvers.closed_form import straight
from planner.timing.solvers.second_order import TERMS as SECOND
from planner.timing.solvers.second_order import estimate_lower_bound, second_order

# A leg that has to be this much slower as a whole is tried in two, with a rest between: what is slow there stays there.
MIN_SPLIT_SLOWNESS = 1.01
# Of a motion, ramps of s̈ that no solver tells from steps; longer ones are for where a solver's answer takes longer.
SURELY_BRIEF, LITTLE_LONGER = 1e-5, 1 + 1e-4
# Pieces of a run, at most, between all of which rests are tried where a solver has no answer.
MOST_RESTED = 12
# A rough answer that takes so many times as long as what it started from says little of where time goes.
MAX_ROUGHNESS = 1.1
# Share of a motion that a grid may lose, as a rough answer predicts it, and how many times as many
# intervals as usual it may have for that. 26 blended triangles on the five-axis machine take
# 13.3036 s with the usual grid, 13.2680 s with this one, and 13.2570 s with half of this share and
# twice as many intervals.
MAX_LOSS, MAX_FINENESS = 4e-4, 4
# Shares of the largest speed at an end without a jerk limit, from which the largest with one is sought.
END_SPEED_SHARES = (0.9, 0.5, 0.2)
# From its answer a solver finds a larger one still, as the grid is made for the motion to start from: until it changes
# by no more than this share, and so often at most.
SETTLED_CHANGE, MAX_RESOLVES = 1e-4, 3
# Shares of the largest speed that a solver finds for an end, tried in turn until one leads to a motion that holds; then
# halvings between that and the one before it.
NEAR_SHARES, HALVINGS = (0.9995, 0.998, 0.99, 0.95, 0.8, 0.5), 3
# Halvings that find the largest speed that the rows leave room for: to rounding.
ROW_HALVINGS = 50
# Of the largest speed that a start allows at the beginning of a run that goes on with a motion.
CONTINUED_START_SHARE = 0.99


def solve_legs(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution:
    """The run in one leg; in two, and so on, where a solver has no answer for it or none that holds unslowed."""
    whole = tighten_until_kept(path, limits, solve_leg(path, limits, run))
    if run.continuation is not None:  # whoever goes on with a motion may do so elsewhere
        return whole
    if whole.status == "too fast":
        exact = straight(coarse_jerk_problem(path, limits, run))  # what that refuses, it refuses exactly
        return exact if exact is not None and not exact.solved else _refuse_ends(path, limits, run) or whole
    if not whole.solved:
        refused = _refuse_ends(path, limits, run)
        if refused is not None:
            return refused
        rested = [_solve_halves(path, limits, run), _rest_everywhere(path, limits, run)]
        return _pick_fastest(rested) or _average_leg(path, limits, run)
    if whole.slowness <= MIN_SPLIT_SLOWNESS:
        return whole
    tried = [whole, _solve_halves(path, limits, run), _rest_everywhere(path, limits, run)]
    if max(run.speeds) == 0:  # what the solver started from may be faster than its answer, slowed
        tried.append(_average_leg(path, limits, run))
    return _pick_fastest(tried) or whole


def _pick_fastest(tried: Sequence[RunSolution | None]) -> RunSolution | None:
    """Return the fastest of the solutions that there are."""
    solved = [one for one in tried if one is not None and one.solved]
    return min(solved, key=lambda one: one.duration, default=None)


def solve_leg(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution:
    """The run in one leg, solved once."""
    coarse = coarse_jerk_problem(path, limits, run)
    unbounded = unbounded_error(coarse, 3)
    if unbounded is not None:
        return RunSolution.refused(unbounded)
    exact = straight(coarse) if run.continuation is None else None
    if exact is not None:
        return exact
    limits = leave_out_idle(limits, coarse)
    ramps = _ramp_leg(path, limits, run, coarse)
    keeps = ramps is not None and (
        not ramps.solved
        or required_slowness(limits, ramps.aimed(sample_limit_use(path, limits, ramps.profile))) <= MAX_UNTOLD_SLOWNESS
    )
    brief = ramps is None or not (ramps.solved and _longest_ramp(ramps) > SURELY_BRIEF * ramps.duration)
    if ramps is not None and keeps and brief:
        return ramps
    found = _solve_in_two(path, limits, run, coarse)
    # where a constant speed is reached, a solver tells
    asked = any(path.constant(piece) is not None for piece in range(run.first, run.last + 1))
    if (
        ramps is not None
        and keeps
        and not asked
        and not (found.solved and found.duration < LITTLE_LONGER * ramps.duration)
    ):
        return ramps
    return _bounded(found, coarse) if run.continuation is None else found


def _longest_ramp(leg: RunSolution) -> float:
    """s, of a motion with brief ramps of s̈."""
    return float(leg.profile.h[leg.profile.j != 0].max(initial=0.0))


def _pose(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, coarse: Problem, rule: Rule
) -> tuple[Problem, Smoothed | Profile] | MotionError:
    """As `jerk_problem`; a run that goes on with a motion may start from a little slower: it goes on all the same."""
    posed = jerk_problem(path, limits, run, coarse, rule)
    if isinstance(posed, TooFast) and run.continuation is not None:
        slower = _with_end(run, 0, CONTINUED_START_SHARE * posed.largest)
        posed = jerk_problem(path, limits, slower, replace(coarse, ends=slower.ends), rule)
    return posed


def _begin(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, problem: Problem, start: Smoothed | Profile
) -> tuple[Problem, Array]:
    """A problem and the guess (4, N) on its grid; those of a run that goes on with a motion begin as that does."""
    if run.continuation is None:
        return problem, start.on(problem.s)
    problem = continue_problem(path, limits, run, problem, run.continuation)
    guess, known = start.on(problem.s), run.continuation.columns
    guess[:, : known.shape[1]] = known
    return problem, guess


def _solve_in_two(path: ActuatorPath, limits: Sequence[Limit], run: Run, coarse: Problem) -> RunSolution:
    """Roughly on a few intervals, then on a grid that is fine where that loses time; at once where it says little."""
    placed = place_by_loss(path, limits, run, coarse)
    if isinstance(placed, MotionError):
        return RunSolution.refused(placed)
    if placed is not None:
        leg = solve_jerk_limited(*_begin(path, limits, run, *placed), "finer", look_along(path, limits))
        if leg.solved:
            return leg
    ends = fix_passed_ends(run.ends)
    if ends != run.ends:  # a solver that does not come away from such an end may do so from rest
        resting = replace(run, ends=ends)
        return _solve_in_two(path, limits, resting, coarse_jerk_problem(path, limits, resting))
    posed = _pose(path, limits, run, coarse, THIRD_ORDER)
    if isinstance(posed, MotionError):
        return RunSolution.refused(posed)
    return solve_jerk_limited(*_begin(path, limits, run, *posed), look=look_along(path, limits))


def place_by_loss(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    coarse: Problem,
    rough: Rule = ROUGH_GRID,
    rule: Rule = THIRD_ORDER,
) -> tuple[Problem, Profile] | MotionError | None:
    """A run's problem on a grid that is fine where a rough answer loses time, and that; None where that says little.

    An interval that is cut in m parts loses an m-th of what it did: Σ lossₖ/mₖ is least, for a number Σ mₖ of
    intervals, where mₖ goes with √lossₖ. It is (Σ √lossₖ)² / Σ mₖ then, which tells how many intervals are needed.
    """
    posed = _pose(path, limits, run, coarse, rough)
    if isinstance(posed, MotionError):
        return posed
    problem, guess = _begin(path, limits, run, *posed)
    answer = estimate_motion(problem, guess)
    if isinstance(answer, MotionError):
        return None
    motion, lost = answer
    if run.continuation is None and not _tells_loss(motion, lost, guess):
        return None
    weight = np.sqrt(lost)
    needed = float(weight.sum()) ** 2 / (MAX_LOSS * motion.duration)
    usual = count_intervals(rule, path, run, on_top=True)
    finer = min(int(np.ceil(needed / usual)), MAX_FINENESS, MAX_INTERVALS[1] // usual)
    run = replace(run, fineness=run.fineness * max(finer, 1))
    beside = np.maximum(np.append(weight[1:], 0.0), np.append(0.0, weight[:-1]))  # what binds may move a little
    return place_problem(path, limits, run, motion, np.maximum(weight, beside / 2), rule), motion


def look_along(path: ActuatorPath, limits: Sequence[Limit]) -> Look:
    """How solvers look at motions along a path between grid points."""
    return lambda motion, names: sample_limit_use(path, [limit for limit in limits if limit.name in names], motion)


def _tells_loss(motion: Profile, lost: Array, guess: Array) -> bool:
    """Whether a rough answer says where time goes."""
    return motion.duration < MAX_ROUGHNESS * float(guess[3].sum()) and float(lost.sum()) > 0


def _bounded(leg: RunSolution, problem: Problem) -> RunSolution:
    """With the estimate of the least time that a problem tells, if there is one."""
    bound = estimate_lower_bound(problem) if leg.solved else 0.0
    return RunSolution.refused(bound) if isinstance(bound, MotionError) else replace(leg, bound=bound)


def _ramp_leg(path: ActuatorPath, limits: Sequence[Limit], run: Run, coarse: Problem) -> RunSolution | None:
    """The order-2 motion with ramps of s̈ that are brief beside it, where they are: no longer than it by more."""
    brief = brief_problem(path, limits, run, coarse)
    if brief is None:
        return None
    problem, window = brief
    sharp = second_order(problem, solver=run.solver)
    sharp = tighten_until_kept(path, [limit for limit in limits if limit.terms <= SECOND], sharp)
    if not sharp.solved:
        return sharp
    profile = ramped(sharp.profile, window, run.breaks(path), run.first)
    if profile is None:
        return None
    stated = replace(problem, blocks=tuple(block for block in problem.blocks if block.name != START_GRID))
    return _bounded(RunSolution("solved", profile, maker=BRIEF_RAMPS, problem=problem), stated)


def _average_leg(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution:
    """What an order-3 solve starts from: a motion whatever solvers do, though it has to be slowed."""
    coarse = coarse_jerk_problem(path, limits, run)
    unbounded = unbounded_error(coarse, 3)
    leg = _ramp_leg(path, limits, run, coarse) if unbounded is None else RunSolution.refused(unbounded)
    if leg is None:
        posed = jerk_problem(path, limits, run, coarse)
        if isinstance(posed, MotionError):
            return RunSolution.refused(posed)
        problem, start = posed
        profile = start.profile(problem) if isinstance(start, Smoothed) else start.cut(run.breaks(path), run.first)
        leg = _bounded(RunSolution("solved", profile, maker=AVERAGED, problem=problem), coarse)
    return tighten_until_kept(path, limits, leg)


def _solve_halves(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution | None:
    """The run with a rest about its middle, at the break where it is slowest anyway. None where that is no way."""
    posed = None if run.first == run.last else jerk_problem(path, limits, run)
    if posed is None or isinstance(posed, MotionError):
        return None
    problem, start = posed
    pieces = run.last - run.first + 1
    inner = run.breaks(path)[1:-1][(pieces - 1) // 4 : pieces - 1 - (pieces - 1) // 4]
    speed = start.on(problem.s)[0, np.searchsorted(problem.s, inner)]
    rest = run.first + 1 + (pieces - 1) // 4 + int(np.argmin(speed))
    return _rest_at(path, limits, run, [rest])


def _rest_everywhere(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution | None:
    """Solve a run of few pieces with a rest at each break, as the classical timings do."""
    if not 2 < run.last - run.first + 1 <= MOST_RESTED:
        return None
    return _rest_at(path, limits, run, range(run.first + 1, run.last + 1))


def _rest_at(path: ActuatorPath, limits: Sequence[Limit], run: Run, rests: Sequence[int]) -> RunSolution | None:
    """Solve a run with rests at the starts of some of its pieces; None where there is no room."""
    breaks = run.breaks(path).tolist()
    legs: list[RunSolution] = []
    for first, after in pairwise([run.first, *rests, run.last + 1]):
        leg = solve_legs(path, limits, run.cut(path, breaks[first - run.first], breaks[after - run.first]))
        if not leg.solved:  # no room for a rest and a speed at an end
            return None
        legs += leg.parts or (leg,)
    return RunSolution.joined(legs, WITH_RESTS)


def _refuse_ends(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution | None:
    """Too fast, where the jerk leaves no room for a speed at an end: beside the other's, else beside a rest."""
    for beside in (run, None):
        for end in (0, 1):
            asked = run.speeds[end]
            largest = (
                _largest_end_speed(path, limits, beside or _with_end(run, 1 - end, 0.0), end) if asked > 0 else 0.0
            )
            if 0 < largest < asked:
                return RunSolution.refused(TooFast(end, asked, largest, beside is None))
        if min(run.speeds) == 0:  # beside a rest already
            break
    return None


def _largest_end_speed(path: ActuatorPath, limits: Sequence[Limit], run: Run, end: int) -> float:
    """The largest speed up to the run's that is found for an end of it and leads to a motion; 0 if none does."""
    bound, most = largest_end_speed(coarse_jerk_problem(path, limits, run), end), 0.0
    for share in END_SPEED_SHARES:
        if share * bound > most:
            most = max(most, _fastest_end_speed(path, limits, _with_end(run, end, share * bound), end, bound))
    for _ in range(MAX_RESOLVES if most > 0 else 0):
        before, again = most, _fastest_end_speed(path, limits, _with_end(run, end, NEAR_SHARES[1] * most), end, bound)
        most = again or before
        if abs(most / before - 1) < SETTLED_CHANGE:
            break
    high = 1.0
    for low in NEAR_SHARES if most > 0 else ():
        if _is_feasible(path, limits, _with_end(run, end, low * most)):
            break
        high = low
    else:
        return 0.0
    for _ in range(HALVINGS if high < 1 else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if _is_feasible(path, limits, _with_end(run, end, middle * most)) else (low, middle)
    return low * most


def _is_feasible(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> bool:
    """Whether a motion is found along a run, between its speeds, that is seen to keep every limit."""
    leg = tighten_until_kept(path, limits, solve_leg(path, limits, run))
    if not leg.solved:
        return False
    return required_slowness(limits, leg.aimed(sample_limit_use(path, limits, leg.profile))) <= 1 + SOLVER_MARGIN


def _with_end(run: Run, end: int, speed: float) -> Run:
    ends = list(run.ends)
    ends[end] = replace(ends[end], speed=speed)
    return replace(run, ends=(ends[0], ends[1]))


def _fastest_end_speed(path: ActuatorPath, limits: Sequence[Limit], run: Run, end: int, bound: float) -> float:
    """The largest speed at an end, up to the bound, that a solver finds from a motion with the run's; 0 if none."""
    posed = jerk_problem(path, limits, run)
    if isinstance(posed, MotionError):
        return 0.0
    problem, start = posed
    guess = start.on(problem.s)
    problem = settle_rows(problem, guess)
    found = third_order(replace(problem, ends=_with_end(run, end, bound).ends), guess, fast_end=end)
    if not found.solved:
        return 0.0
    return found.profile.last_speed if end else float(found.profile.v[0])


def largest_end_speed(problem: Problem, end: int) -> float:
    """The largest speed at an end, up to the problem's, at which the rows without s⃛ leave room there, s̈ being 0.

    A solver keeps such rows inside a run only: at its ends there is nothing to choose between given speeds.
    """
    last = problem.intervals - 1
    there = problem.part(slice(last, last + 1) if end else slice(0, 1))
    low, high = 0.0, problem.speeds[end]
    if _has_room(there, end, high):
        return high
    for _ in range(ROW_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _has_room(there, end, middle) else (low, middle)
    return low


def _has_room(there: Problem, end: int, speed: float) -> bool:
    """Whether the rows at the start or the end of one interval leave room for a speed."""
    for block in there.around(np.array([speed]), np.array([speed])).blocks:
        side = block.end if end else block.start
        if Term.SDDD in side:
            continue
        used = sum(values[0] * speed ** POWERS[term] for term, values in side.items() if term in POWERS)
        if np.max(block.share(used)) > 1:
            return False
    return True
