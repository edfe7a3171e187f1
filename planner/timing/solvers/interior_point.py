"""The fastest motion under limits on speed, acceleration and jerk, by an interior-point method of our own.

    minimise Σ h + a trace of s⃛²    such that the stages follow each other and every row is kept

Primal-dual: each row has a slack and a force, whose product is μ; Newton's method on the optimality conditions by a
Riccati recursion over the stages (planner.timing.solvers.riccati), steps by a filter line search, μ lowered whenever
the conditions hold well enough for it: A. Wächter and L. T. Biegler, Mathematical Programming 106 (2006) 25–57. The
cost of an iteration grows as the number of intervals.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinematics.foundation.arrays import Array
from planner.timing.solvers.optimality import follow_step, linearize, push_forces, try_share
from planner.timing.solvers.riccati import NewtonStep, Recursion, solve_step
from planner.timing.solvers.stages import TERM_COUNT, Iterate, Misses, Slopes, StageRows, Stages, evaluate

Status = Literal["solved", "loose", "slow", "not convex"]
Start = Literal["farther", "far", "finer", "near", "nearer"]
# The cost is counted in thousandths of the guess' duration, of more than a thousand intervals in so many parts: of that
# size, the constants below are usual ones, and μ weighs as much beside an interval's time however long the run is.
WEIGHT = 1000.0
TOLERANCE = 1e-7
MAX_ITERATIONS, MAX_HALVINGS = 200, 14
# The first μ, and the least slack of rows and of bounds on ṡ and h: from anywhere, where that jams, from the answer on
# a coarser grid, and from near the answer of almost the same problem.
STARTS: dict[Start, tuple[float, float, float]] = {
    "far": (1e-2, 1e-2, 1e-3),
    "farther": (1.0, 1e-2, 1e-3),
    "finer": (1e-3, 1e-2, 1e-3),
    "near": (1e-5, 1e-3, 1e-4),
    "nearer": (1e-6, 1e-4, 1e-5),
}
# Where the cost is not convex: the first that is added, by how much it is lowered from one iteration to the next and
# raised until it does, first and later, and the largest.
FIRST_CONVEXITY, LOWER, RAISE_FIRST, RAISE, MOST_CONVEXITY = 1e-4, 1 / 3, 100.0, 8.0, 1e20
LEAST_CONVEXITY = 1e-14
# The filter: shares by which misses or cost must fall, and what counts as few misses and far too many.
FILTER_SHARE, FEW, MANY = 1e-5, 1e-4, 2.0
# Of a step along which the cost changes by less than its own rounding, as a share of it, only the misses are weighed.
ARMIJO, ROUNDING, FLAT = 1e-8, 1e-13, 1e-11
# The last iterations go on from where it creeps with so much curvature added, in units of the cost per squared scale,
# that misses vanish: a motion that keeps every row so well is an answer, though not quite the best.
LAST_ITERATIONS, DAMPING = 20, 1.0
LOOSE_ROWS = 1e-6
# Bounds are revised when μ, at that or below, is about to be lowered for the first time, and then with every answer; so
# often in all.
FIRST_REVISION, MOST_REVISIONS = 1e-4, 5
# Flat steps in a row after which nothing more is to be gained.
MAX_FLAT_STEPS = 8

Revise = Callable[[Array, Array, Array], tuple[Array, Array] | None]
"""States, controls and the rows' values -> what bounds the rows from now on, `low` and `high`; None: what does now."""


@dataclass(frozen=True, slots=True)
class Minimum:
    """States (N + 1, 2) and controls (N, 2), scaled as they were given; multipliers of rows, next states,
    steps and the duration.

    The multipliers say what a unit of each bound is worth, in thousandths of the guess' duration.
    """

    status: Status
    iterations: int
    states: Array
    controls: Array
    low_forces: Array
    high_forces: Array
    next_forces: Array
    step_forces: Array
    time_force: float


def minimise(
    stages: Stages,
    rows: StageRows,
    states: Array,
    controls: Array,
    start: Start = "far",
    tolerance: float = TOLERANCE,
    revise: Revise | None = None,
) -> Minimum:
    """From states (N + 1, 2), of which the first and the last are kept but for what is to be found there, and controls
    (N, 2), which may be about the answer: "near", as that of a problem of almost the same rows is.
    """
    count, width = rows.low.shape
    motion, trial = (_empty_iterate(rows, states, controls) for _ in range(2))
    trial = trial._replace(force_low=motion.force_low, force_high=motion.force_high)
    misses, tried = (Misses(np.empty((count, width)), np.empty((count, 2)), np.empty(count)) for _ in range(2))
    mu, least, least_bound = STARTS[start]
    weight = max(WEIGHT, float(count))
    slopes = Slopes(np.zeros((count, 4)), np.zeros((count, 4)), np.zeros((count, 4)), np.zeros((count, 4, 4)))
    recursion = Recursion(
        np.zeros((count + 1, 3)),
        np.zeros((count + 1, 2)),
        np.zeros(count, int),
        np.zeros((count, 4)),
        np.zeros((count, 4)),
        np.zeros((3, count + 1, 2)),
        np.zeros((3, count)),
        np.zeros(3),
        np.zeros(3),
    )
    next_force, step_force, time_force = np.zeros((count + 1, 2)), np.zeros(count), 0.0
    step = NewtonStep(np.zeros((count + 1, 2)), np.zeros((count, 4)), np.zeros((count + 1, 2)), np.zeros(count))
    terms, gains, pushes = np.zeros((count, 3, TERM_COUNT)), np.zeros((count, width)), np.zeros((2, count, width))
    evaluate(stages, rows, states, controls, terms, misses.values)
    _start_slacks(rows, motion, misses, mu, least, least_bound)
    bounds = np.isfinite(rows.low).sum() + np.isfinite(rows.high).sum()
    # where it stands, as if a step of nothing had led there
    missed, cost, logarithms, time = try_share(
        stages, rows, motion, misses, step.states, step.stages, terms, gains, 0.0, weight, trial, tried
    )
    motion, trial, misses, tried = trial, motion, tried, misses
    few, many = FEW * max(1.0, missed), MANY * max(1.0, missed)
    filtered: list[tuple[float, float]] = []
    last = convexity = 0.0
    flat = revisions = 0
    status: Status = "slow"
    iterations = 0
    while True:
        row_error, slope_error, smallest, largest, forces = linearize(
            stages, rows, motion, misses, next_force, step_force, time_force, weight, slopes
        )
        excess = time - 1 if stages.stated else 0.0
        row_error = max(row_error, abs(excess))
        size = max(100.0, forces / bounds) / 100.0
        error = max(row_error, slope_error / size, max(largest - mu, mu - smallest) / size)
        solved = mu <= tolerance and error <= 10 * tolerance
        first = revisions == 0 and tolerance < mu <= FIRST_REVISION and error <= 10 * mu
        if revise is not None and (first or (solved and revisions < MOST_REVISIONS)):
            revised = revise(motion.states, motion.controls, misses.values)
            revisions += 1
            if revised is not None:
                rows = rows._replace(low=revised[0], high=revised[1])
                missed, cost, logarithms, time = try_share(
                    stages, rows, motion, misses, step.states, step.stages, terms, gains, 0.0, weight, trial, tried
                )
                motion, trial, misses, tried = trial, motion, tried, misses
                flat = 0
                filtered.clear()
                continue
        if solved:
            status = "solved"
            break
        if iterations == MAX_ITERATIONS or flat >= MAX_FLAT_STEPS:  # after the errors: they are this motion's
            status = "loose" if row_error <= LOOSE_ROWS else "slow"
            break
        iterations += 1
        before = mu
        while error <= 10 * mu and mu > tolerance:
            mu = max(tolerance, min(mu / 5, mu**1.5))
            error = max(row_error, slope_error / size, max(largest - mu, mu - smallest) / size)
        if mu < before:
            flat = 0
            filtered.clear()
        pulls = slopes.pull + mu * slopes.centre
        pulls[:, 3] += time_force
        damping = DAMPING if iterations > MAX_ITERATIONS - LAST_ITERATIONS else 0.0
        last, convexity = convexity or last, damping
        while True:
            more = solve_step(
                stages, motion, misses, slopes.bend, pulls, next_force[-1], excess, convexity, recursion, step
            )
            if more is not None:
                break
            if convexity == 0:
                convexity = max(LEAST_CONVEXITY, last * LOWER) if last > 0 else FIRST_CONVEXITY
            else:
                convexity *= RAISE if last > 0 else RAISE_FIRST
            if not convexity < MOST_CONVEXITY:
                break
        if more is None:
            status = "not convex"
            break
        most, most_force, slope = follow_step(
            stages, rows, motion, misses, slopes, step.stages, mu, terms, gains, pushes
        )
        barrier = cost - mu * logarithms
        share, flat = most, flat + 1 if abs(slope) <= FLAT * abs(barrier) else 0
        for _ in range(MAX_HALVINGS):
            new_missed, new_cost, new_logarithms, time = try_share(
                stages, rows, motion, misses, step.states, step.stages, terms, gains, share, weight, trial, tried
            )
            new_barrier = new_cost - mu * new_logarithms
            held = all(new_missed < (1 - FILTER_SHARE) * m or new_barrier < c - FILTER_SHARE * m for m, c in filtered)
            if held and new_missed < many:
                if flat:
                    if new_missed <= max(missed, FEW * TOLERANCE):
                        break
                elif missed <= few and slope < 0 and share * (-slope) ** 2.3 > missed**1.1:
                    if new_barrier <= barrier + ARMIJO * share * slope + ROUNDING * abs(barrier):
                        break
                elif new_missed <= (1 - FILTER_SHARE) * missed or new_barrier <= barrier - FILTER_SHARE * missed:
                    filtered.append((missed, barrier))
                    break
            share /= 2
        else:  # no share is better: the least one is taken all the same, from where it may lead elsewhere
            filtered.clear()
        motion, trial, misses, tried = trial, motion, tried, misses
        push_forces(rows, motion, pushes, most_force, mu)
        next_force += share * (step.next_force - next_force)
        step_force += share * (step.step_force - step_force)
        time_force += share * more
        missed, cost, logarithms = new_missed, new_cost, new_logarithms
    unit = WEIGHT / weight
    return Minimum(
        status,
        iterations,
        motion.states,
        motion.controls,
        unit * motion.force_low,
        unit * motion.force_high,
        unit * next_force,
        unit * step_force,
        unit * time_force,
    )


def _empty_iterate(rows: StageRows, states: Array, controls: Array) -> Iterate:
    ones = (np.ones(rows.low.shape) for _ in range(4))
    return Iterate(states.copy(), controls.copy(), next(ones), next(ones), next(ones), next(ones))


def _start_slacks(
    rows: StageRows, motion: Iterate, misses: Misses, mu: float, least_row: float, least_bound: float
) -> None:
    least = np.full(rows.low.shape[1], least_row)
    least[-2:] = least_bound
    for slack, force, room in (
        (motion.slack_low, motion.force_low, misses.values - rows.low),
        (motion.slack_high, motion.force_high, rows.high - misses.values),
    ):
        bound = np.isfinite(room)
        slack[bound] = np.maximum(room, least)[bound]
        force[:] = np.where(bound, mu / slack, 0.0)
