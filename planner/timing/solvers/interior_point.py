"""The fastest motion under limits on speed, acceleration and jerk, by an interior-point method of our own.

    minimise Σ h + a trace of s⃛²    such that the stages follow each other and every row is kept

Primal-dual: each side of a row that is held has a slack and a force, whose product is μ; Newton's method on the
optimality conditions by a Riccati recursion over the stages (planner.timing.solvers.riccati), steps by a filter line
search, μ lowered whenever the conditions hold well enough for it: A. Wächter and L. T. Biegler, Mathematical
Programming 106 (2006) 25–57. Sides that the motion is not near are left out (planner.timing.solvers.sides). The cost of
an iteration grows as the number of intervals.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinematics.foundation.arrays import Array
from planner.timing.solvers.optimality import follow_step, linearize, push_forces, try_share
from planner.timing.solvers.riccati import NewtonStep, Recursion, solve_step
from planner.timing.solvers.sides import Sides, find_same, hold_near, hold_sides, list_bounds
from planner.timing.solvers.stages import Iterate, Misses, Slopes, StageRows, Stages, evaluate

Status = Literal["solved", "loose", "slow", "not convex"]
Start = Literal["farther", "far", "rough", "finer", "near", "nearer"]
# The cost is counted in thousandths of the guess' duration, of more than a thousand intervals in so many parts: of that
# size, the constants below are usual ones, and μ weighs as much beside an interval's time however long the run is.
WEIGHT = 1000.0
TOLERANCE = 1e-7
MAX_ITERATIONS, MAX_HALVINGS = 200, 14
# The first μ, and the least slack of rows and of bounds on ṡ and h: from anywhere, where that jams, for an answer that
# need not be exact, from the answer on a coarser grid, and from near the answer of almost the same problem.
STARTS: dict[Start, tuple[float, float, float]] = {
    "far": (1e-2, 1e-2, 1e-3),
    "farther": (1.0, 1e-2, 1e-3),
    "rough": (1e-2, 1e-1, 1e-2),
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
# Starts of which an answer need not be known nearby, and the last of them, which holds all sides of rows; sides of a
# stage, on average, up to which any does: leaving out some of few saves nothing, and what is left bounds a stage too
# seldom from all sides.
FAR_STARTS: tuple[Start, ...] = ("far", "farther")
LAST_START: Start = "farther"
FEW_SIDES = 32
NEAR_STARTS: tuple[Start, ...] = ("finer", "near", "nearer")
# Room from which a side that is left out is held, less than near: looked at wherever the conditions hold, and in
# each of so many iterations. About where a motion is near a side, stages at which it is held too: twice as many each
# time.
SHORT, LOOK_EACH = 0.1, 4
REACH, FAR_REACH = 5, 16
# Flat steps in a row after which nothing more is to be gained.
MAX_FLAT_STEPS = 8

Revise = Callable[[Array, Array, Array], tuple[Array, Array] | None]
"""States, controls and the rows' values -> what bounds the rows from now on, `low` and `high`; None: what does now."""


@dataclass(frozen=True, slots=True)
class Minimum:
    """States (N + 1, 2) and controls (N, 2), scaled as they were given; multipliers of the rows and the duration.

    The multipliers say what a unit of each bound is worth, in thousandths of the guess' duration.
    """

    status: Status
    iterations: int
    states: Array
    controls: Array
    low_forces: Array
    high_forces: Array
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
    count = len(stages.step)
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
    values, room = np.empty(rows.low.shape), np.empty((2, *rows.low.shape))
    _measure_room(stages, rows, states, controls, values, room)
    reach = REACH if start in NEAR_STARTS else FAR_REACH
    bounds = np.count_nonzero(room < np.inf)
    held = room < np.inf
    if start != LAST_START and bounds > FEW_SIDES * count:
        held[:, :, :-2] = False  # but those of ṡ and h
        hold_near(held, room, reach)
    least_slack = np.full(rows.low.shape[1], least)
    least_slack[-2:] = least_bound
    sides, motion, trial, misses, tried = _hold(rows, held, states, controls, room, least_slack, mu)
    steps, pushes = np.zeros(len(sides.bound)), np.empty(len(sides.bound))
    # where it stands, as if a step of nothing had led there
    missed, cost, logarithms, time = try_share(
        stages, sides, motion, step.states, step.stages, steps, 0.0, weight, trial, tried
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
            stages, sides, motion, misses, next_force, step_force, time_force, weight, slopes
        )
        excess = time - 1 if stages.stated else 0.0
        row_error = max(row_error, abs(excess))
        size = max(100.0, forces / bounds) / 100.0
        error = max(row_error, slope_error / size, max(largest - mu, mu - smallest) / size)
        solved = mu <= tolerance and error <= 10 * tolerance
        answers = error <= 10 * mu
        if answers or iterations % LOOK_EACH == LOOK_EACH - 1:
            _measure_room(stages, rows, motion.states, motion.controls, values, room)
            first = revisions == 0 and tolerance < mu <= FIRST_REVISION
            revised = None
            short = bool(((room < (0.0 if solved else SHORT)) & ~held).any())
            if short:
                former, earlier = sides, motion
                reach *= 2
                hold_near(held, room, reach)
                sides, motion, trial, misses, tried = _hold(
                    rows, held, earlier.states, earlier.controls, room, least_slack, mu
                )
                same = find_same(former, sides, room.size)
                motion.slack[same], motion.force[same] = earlier.slack, earlier.force
                steps, pushes = np.zeros(len(sides.bound)), np.empty(len(sides.bound))
            elif answers and revise is not None and (first or (solved and revisions < MOST_REVISIONS)):
                revised = revise(motion.states, motion.controls, values)
                revisions += 1
                if revised is not None:
                    rows = rows._replace(low=revised[0], high=revised[1])
                    sides.bound[:] = list_bounds(rows)[sides.which]
                    steps[:] = 0.0
            if short or revised is not None:
                missed, cost, logarithms, time = try_share(
                    stages, sides, motion, step.states, step.stages, steps, 0.0, weight, trial, tried
                )
                motion, trial, misses, tried = trial, motion, tried, misses
                few, many = max(few, FEW * missed), max(many, MANY * missed)
                flat = 0
                filtered.clear()
                continue
        if solved:
            status = "solved"
            break
        if iterations == MAX_ITERATIONS or flat >= MAX_FLAT_STEPS:  # after the errors: they are this motion's
            _measure_room(stages, rows, motion.states, motion.controls, values, room)
            status = "loose" if max(row_error, -float(room.min())) <= LOOSE_ROWS else "slow"
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
        most, most_force, slope = follow_step(stages, sides, motion, misses, slopes, step.stages, mu, steps, pushes)
        barrier = cost - mu * logarithms
        share, flat = most, flat + 1 if abs(slope) <= FLAT * abs(barrier) else 0
        for _ in range(MAX_HALVINGS):
            new_missed, new_cost, new_logarithms, time = try_share(
                stages, sides, motion, step.states, step.stages, steps, share, weight, trial, tried
            )
            new_barrier = new_cost - mu * new_logarithms
            passes = all(new_missed < (1 - FILTER_SHARE) * m or new_barrier < c - FILTER_SHARE * m for m, c in filtered)
            if passes and new_missed < many:
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
        push_forces(motion, pushes, most_force, mu)
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
        *_spread_forces(rows, sides, unit * motion.force),
        unit * time_force,
    )


def _measure_room(stages: Stages, rows: StageRows, states: Array, controls: Array, values: Array, room: Array) -> None:
    """Fill the rows' values (N, 2M + 2), and how far below and above they are from their bounds (2, N, 2M + 2)."""
    evaluate(stages, rows, states, controls, values)
    np.subtract(values, rows.low, out=room[0])
    np.subtract(rows.high, values, out=room[1])


def _hold(
    rows: StageRows, held: np.ndarray, states: Array, controls: Array, room: Array, least: Array, mu: float
) -> tuple[Sides, Iterate, Iterate, Misses, Misses]:
    """The sides of rows that are held; a motion with slacks and forces of these by the room of all (2, N, 2M + 2), and
    room for what else a solve goes through: another one with the same forces, and what each misses.

    least (2M + 2,): the least slack
    """
    sides = hold_sides(rows, held)
    count, size = len(controls), len(sides.bound)
    slack = np.maximum(room.ravel()[sides.which], least[sides.which % len(least)])
    motion = Iterate(states.copy(), controls.copy(), slack, mu / slack)
    trial = Iterate(states.copy(), controls.copy(), np.empty(size), motion.force)
    misses, tried = (Misses(np.empty(size), np.empty((count, 2)), np.empty(count)) for _ in range(2))
    return sides, motion, trial, misses, tried


def _spread_forces(rows: StageRows, sides: Sides, forces: Array) -> tuple[Array, Array]:
    """(N, 2M + 2) of all rows below and above: none where a side is not held."""
    spread = np.zeros((2, *rows.low.shape))
    spread.flat[sides.which] = forces
    return spread[0], spread[1]
