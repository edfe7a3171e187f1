"""Primal-dual interior-point method for the order-3 problem.

Algorithm A of A. Wächter and L. T. Biegler, Mathematical Programming 106 (2006) 25–57; comments
give its steps. Newton steps come from a Riccati recursion, so that an iteration costs time in
proportion to the number of intervals. Beyond the paper, inactive constraints are left out
(planner.timing.order3.active_set), and bounds may be revised.

| symbol | here | |
|---|---|---|
| x | `states`, `controls` | (v, a) = (ṡ, s̈) at grid points, (j, h) = (s⃛, duration) of intervals |
| s | `Iterate.s` | slacks of the active constraints g(x) + s = b |
| c(x) = 0 | `Iterate.next`, `Iterate.step` | equality constraints: next states and path steps |
| λ | `EqualityMultipliers` | their multipliers |
| z | `Iterate.z` | multipliers of s ≥ 0, which equal those of g(x) + s = b |
| f | `sum_costs`, `Merit.objective` | objective |
| μ | `mu` | barrier parameter |
| φ | `Merit.phi` | barrier function f − μ Σ ln s |
| θ | `Merit.theta` | constraint violation, ‖c(x)‖₁ + ‖g(x) + s − b‖₁ |
| E_μ | `OptimalityError.at` | optimality error (equation 5) |
| τ | `tau` in `limit_step` | fraction to the boundary |
| α, α_z | `Limits`, `search` | step lengths of x, s, λ and of z |
| Δx, Δs, Δz | `Direction` | Newton step |
| W + Σ | `Derivatives.hessian` | Hessian with the slacks eliminated |
| δ_w | `delta_w` | regularization of the Hessian |
| F | `Filter` | filter |

Other than in the paper,

- λ is 0 at first, and s_d (after equation 5) counts z alone;
- step A-2 asks for E_μ ≤ κ_ε μ at the last μ, of `tolerance`, in place of E_0 ≤ ε_tol;
- step A-3 is repeated in every iteration, not in the first one alone;
- there are no second-order corrections, no δ_c and no restoration phase: after MAX_HALVINGS the
  shortest step is taken, and multipliers that diverge end the method;
- the filter is emptied where the active constraints or their bounds change.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.timing.order3.active_set import activate_near, collect_active, find_common, set_bounds
from planner.timing.order3.kkt import (
    Derivatives,
    EqualityMultipliers,
    Iterate,
    OptimalityError,
    Program,
    linearize,
)
from planner.timing.order3.line_search import (
    Filter,
    Ray,
    limit_step,
    measure,
    search,
    step_multipliers,
)
from planner.timing.order3.pose import OBJECTIVE_SCALE, PosedStages
from planner.timing.order3.riccati import Direction, NewtonSystem, Recursion, solve_newton
from planner.timing.order3.stages import evaluate

Status = Literal["solved", "loose", "slow", "diverged", "not convex"]
Start = Literal["farther", "far", "rough", "finer", "near", "nearer"]
TOLERANCE = 1e-7
MAX_ITERATIONS = 200


@dataclass(frozen=True, slots=True)
class Warmth:
    """First μ, and least first slacks of rows and of the bounds of v and h."""

    mu: float
    row_slack: float
    bound_slack: float


STARTS: dict[Start, Warmth] = {
    "far": Warmth(1e-2, 1e-2, 1e-3),
    "farther": Warmth(1.0, 1e-2, 1e-3),  # where "far" stops without a solution
    "rough": Warmth(1e-2, 1e-1, 1e-2),  # for a solution that need not be exact
    "finer": Warmth(1e-3, 1e-2, 1e-3),  # from the solution on a coarser grid
    "near": Warmth(1e-5, 1e-3, 1e-4),  # from the solution with slightly wider bounds
    "nearer": Warmth(1e-6, 1e-4, 1e-5),  # from the solution with hardly wider bounds
}
FAR_STARTS: tuple[Start, ...] = ("far", "farther")
"""Starts that need no solution nearby."""
NEAR_STARTS: tuple[Start, ...] = ("finer", "near", "nearer")
# A barrier problem is solved where E_μ ≤ κ_ε μ; the next μ is max(tolerance, min(κ_μ μ, μ^θ_μ))
# (equations 6 and 7).
KAPPA_EPSILON = 10.0
KAPPA_MU = 0.2
THETA_MU = 1.5
# The equality constraints of a solution hold more exactly than E_μ asks, by this share of the
# tolerance: a motion is made continuous afterwards, which must not change its use of the limits.
RESIDUAL_SHARE = 1e-2
# Regularization (algorithm IC): the first δ_w, factors of the next, and its range.
FIRST_DELTA = 1e-4
MIN_DELTA = 1e-14
MAX_DELTA = 1e20
DECREASE = 1 / 3
INCREASE = 8.0
FIRST_INCREASE = 100.0
# The last iterations continue with so much regularization that residuals vanish where the method
# creeps: a motion that satisfies all rows up to MAX_VIOLATION is a solution, though not the best.
LAST_ITERATIONS = 20
LAST_DELTA = 1.0
MAX_VIOLATION = 1e-6
# Flat steps in a row after which rounding leaves nothing to gain.
MAX_FLAT_STEPS = 8
# Where constraints exclude each other, steps become ever shorter and multipliers diverge. The method
# ends after MAX_SHORT_STEPS in a row below SHORT_STEP if a multiplier, in thousandths of the guess'
# duration, says that a unit of a bound is worth a million durations. In solves that succeed, after
# such steps, it was 8e4 at most, counted by hand in evidence robustness --third 400 and --kind
# ratios in November 2026. Nine stops of the circle on the hexapod (`Plan.hold`) take a third of the
# time that they take with MAX_MULTIPLIER = np.inf.
MAX_SHORT_STEPS = 5
SHORT_STEP = 1e-4
MAX_MULTIPLIER = 1e9
# Bounds are revised at the first solution for a μ up to EARLY_MU, from where that takes few
# iterations (not from near starts, whose first μ is the last), and then with each solution for the
# last μ. Two early revisions take fewer iterations in long splines, but lower rooms too much at
# ends that are passed.
EARLY_MU = 1e-4
MAX_REVISIONS = 5
# Average number of constraints per stage up to which all are active: leaving out some of few saves
# nothing.
FEW_CONSTRAINTS = 32
# Room of inactive constraints below which they are activated: examined in every fourth iteration,
# at the first solution for a μ up to EARLY_MU, and at the last. An activation extends to stages
# around, 5 from near starts and 16 from far ones, and to twice as many each time: with a constant
# number more solves fail.
SHORT = 0.1
EXAMINE_EACH = 4
REACH = 5
FAR_REACH = 16

Revise = Callable[[Array, Array, Array, bool], tuple[Array, Array] | None]
"""States, controls, values of the rows, whether these are a solution -> new bounds, or None."""


@dataclass(frozen=True, slots=True)
class Minimum:
    """Scaled states (N + 1, 2) and controls (N, 2), and multipliers of rows and of the duration.

    The multipliers say what a unit of each bound is worth, in thousandths of the guess' duration.
    """

    status: Status
    iterations: int
    states: Array
    controls: Array
    low_multipliers: Array
    high_multipliers: Array
    time_multiplier: float


def minimise(
    posed: PosedStages,
    start: Start = "far",
    tolerance: float = TOLERANCE,
    revise: Revise | None = None,
) -> Minimum:
    """Return a local minimum of the objective under all rows.

    start: distance of the posed states and controls from it. revise: called with solutions, for
    other bounds.
    """
    method = _Method(posed, start, tolerance)
    while True:
        error = method.linearize()
        solved = method.is_solved(error)
        if method.update_constraints(error, revise):
            continue
        if solved:
            return method.result("solved")
        reason = method.find_failure()
        if reason is not None:
            return method.result("loose" if method.violation(error) <= MAX_VIOLATION else reason)
        method.iterations += 1
        method.lower_barrier(error)
        if not method.find_direction():
            return method.result("not convex")
        method.step()


def try_starts(
    posed: PosedStages,
    starts: Sequence[Start],
    tolerance: float = TOLERANCE,
    revise: Revise | None = None,
) -> Minimum | MotionError:
    """Return the minimum from the first start that leads to one, or the error."""
    stages = posed.stages
    rows = posed.rows
    numbers = (posed.states, posed.controls, stages.squares, rows.first, rows.second)
    if not (all(np.isfinite(each).all() for each in numbers) and (stages.step > 0).all()):
        fault = "a coefficient that is not finite, or an interval of length 0"
        return MotionError(f"the jerk-limited problem has {fault}")
    for start in starts:
        minimum = minimise(posed, start, tolerance, revise)
        if minimum.status in ("solved", "loose"):
            return minimum
    reason = f"{minimum.status}, {minimum.iterations} iterations"
    return MotionError(f"the jerk-limited solver stopped without a solution ({reason})")


class _Method:
    """State of the method between two steps of the algorithm.

    mask (2, N, 2M + 2)   active constraints
    room (2, N, 2M + 2)   distances of all rows from their bounds, when last examined
    values (N, 2M + 2)    values of all rows then
    unit                  unit of multipliers, in thousandths of the guess' duration
    last_delta            the last positive δ_w
    """

    def __init__(self, posed: PosedStages, start: Start, tolerance: float) -> None:
        rows = posed.rows
        count, width = rows.low.shape
        warmth = STARTS[start]
        self.posed = posed
        self.tolerance = tolerance
        self.unit = OBJECTIVE_SCALE / posed.stages.objective_scale
        self.mu = warmth.mu
        self.least_slack = np.full(width, warmth.row_slack)
        self.least_slack[-2:] = warmth.bound_slack
        self.values = np.empty((count, width))
        self.room = np.empty((2, count, width))
        self.recursion = Recursion.allocate(count)
        self.derivatives = Derivatives.allocate(count)
        self.multipliers = EqualityMultipliers.allocate(count)
        self.filter = Filter()
        self.last_delta = self.delta = 0.0
        self.revisions = self.iterations = 0
        self.reach = REACH if start in NEAR_STARTS else FAR_REACH
        self._examine(posed.states, posed.controls)
        self.mask = self.room < np.inf
        self.constraints = int(np.count_nonzero(self.mask))
        if start != FAR_STARTS[-1] and self.constraints > FEW_CONSTRAINTS * count:
            self.mask[:, :, :-2] = False  # the bounds of v and h stay
            activate_near(self.mask, self.room, self.reach)
        self._activate(posed.states, posed.controls)
        self._restart()

    def _examine(self, states: Array, controls: Array) -> None:
        """Evaluate all rows, active or not."""
        rows = self.posed.rows
        evaluate(self.posed.stages, rows, states, controls, self.values)
        np.subtract(self.values, rows.low, out=self.room[0])
        np.subtract(rows.high, self.values, out=self.room[1])

    def _activate(self, states: Array, controls: Array) -> None:
        """Begin at states and controls with the constraints of the mask."""
        active = collect_active(self.posed.rows, self.mask)
        count = len(controls)
        size = len(active.bound)
        least = self.least_slack[active.flat % len(self.least_slack)]
        s = np.maximum(self.room.ravel()[active.flat], least)
        z = self.mu / s
        self.program = Program(self.posed.stages, active)
        self.point, self.trial = (
            Iterate(
                states.copy(),
                controls.copy(),
                s.copy(),
                z,
                np.empty(size),
                np.empty((count, 2)),
                np.empty(count),
            )
            for _ in range(2)
        )
        self.direction = Direction(
            states=np.zeros((count + 1, 2)),
            stages=np.zeros((count, 4)),
            s=np.zeros(size),
            z=np.zeros(size),
            next=np.zeros((count + 1, 2)),
            step=np.zeros(count),
            time=np.zeros(1),
        )

    def _restart(self) -> None:
        """Evaluate the residuals, and empty the filter, after a change of constraints."""
        self.direction.s[:] = 0.0
        self.merit = measure(self.program, self.point, self.direction, self.trial)
        self.point, self.trial = self.trial, self.point
        self.filter.widen(self.merit.theta)
        self.flat_steps = self.short_steps = 0

    def linearize(self) -> OptimalityError:
        error: OptimalityError = linearize(
            self.program,
            self.point,
            self.multipliers,
            self.derivatives,
        )
        if self.posed.stages.fixed_time:
            error = error._replace(primal=max(error.primal, abs(self._time_residual())))
        return error

    def _time_residual(self) -> float:
        return self.merit.time - 1 if self.posed.stages.fixed_time else 0.0

    def _converged(self, error: OptimalityError) -> bool:
        """Return whether the barrier problem is solved (step A-3)."""
        return error.at(self.mu, self.constraints) <= KAPPA_EPSILON * self.mu

    def is_solved(self, error: OptimalityError) -> bool:
        """Return whether the problem is solved (step A-2), by the error at the last μ."""
        is_exact = error.primal <= RESIDUAL_SHARE * self.tolerance
        return self.mu <= self.tolerance and is_exact and self._converged(error)

    def find_failure(self) -> Status | None:
        """Return why the method ends without a solution; None if it continues."""
        if self.iterations == MAX_ITERATIONS or self.flat_steps >= MAX_FLAT_STEPS:
            return "slow"
        # the constraints seem to exclude each other
        has_stalled = self.short_steps >= MAX_SHORT_STEPS
        has_diverged = has_stalled and self.unit * self.point.z.max() > MAX_MULTIPLIER
        return "diverged" if has_diverged else None

    def violation(self, error: OptimalityError) -> float:
        """Return the largest residual, of all rows too."""
        self._examine(self.point.states, self.point.controls)
        return max(error.primal, -float(self.room.min()))

    def update_constraints(self, error: OptimalityError, revise: Revise | None) -> bool:
        """Activate constraints near the point, or revise bounds. Return True if any changed."""
        solved = self.is_solved(error)
        can_be_early = self.revisions == 0 and self.tolerance < self.mu <= EARLY_MU
        early = can_be_early and self._converged(error)
        if not (solved or early) and self.iterations % EXAMINE_EACH != EXAMINE_EACH - 1:
            return False
        self._examine(self.point.states, self.point.controls)
        if ((self.room < (0.0 if solved else SHORT)) & ~self.mask).any():
            self._activate_more()
            return True
        late = solved and self.revisions < MAX_REVISIONS
        if revise is None or not (early or late):
            return False
        self.revisions += 1
        bounds = revise(self.point.states, self.point.controls, self.values, solved)
        if bounds is None:
            return False
        rows = self.posed.rows._replace(low=bounds[0], high=bounds[1])
        self.posed = self.posed._replace(rows=rows)
        set_bounds(self.program.active, rows)
        self._restart()
        return True

    def _activate_more(self) -> None:
        """Activate constraints with little room; the others retain their slacks and multipliers."""
        active = self.program.active
        point = self.point
        self.reach *= 2
        activate_near(self.mask, self.room, self.reach)
        self._activate(point.states, point.controls)
        common = find_common(active, self.program.active, self.room.size)
        self.point.s[common] = point.s
        self.point.z[common] = point.z
        self._restart()

    def lower_barrier(self, error: OptimalityError) -> None:
        """Lower μ until its barrier problem is not solved yet."""
        before = self.mu
        while self._converged(error) and self.mu > self.tolerance:
            self.mu = max(self.tolerance, min(KAPPA_MU * self.mu, self.mu**THETA_MU))
        if self.mu < before:
            self.flat_steps = 0
            self.filter.entries.clear()

    def find_direction(self) -> bool:
        """Fill the direction with the Newton step, regularized where necessary (algorithm IC)."""
        delta = LAST_DELTA if self.iterations > MAX_ITERATIONS - LAST_ITERATIONS else 0.0
        self.last_delta = self.delta or self.last_delta
        gradient = self.derivatives.constant + self.mu * self.derivatives.barrier
        gradient[:, 3] += self.multipliers.time[0]
        system = NewtonSystem(
            stages=self.posed.stages,
            point=self.point,
            hessian=self.derivatives.hessian,
            gradient=gradient,
            last=self.multipliers.next[-1],
            time_residual=self._time_residual(),
            delta_w=delta,
        )
        while not solve_newton(system, self.recursion, self.direction):
            if delta == 0:
                last = self.last_delta
                delta = max(MIN_DELTA, DECREASE * last) if last > 0 else FIRST_DELTA
            else:
                delta *= INCREASE if self.last_delta > 0 else FIRST_INCREASE
            if not delta < MAX_DELTA:
                return False
            system = system._replace(delta_w=delta)
        self.delta = delta
        return True

    def step(self) -> None:
        limits = limit_step(self.program, self.point, self.derivatives, self.mu, self.direction)
        ray = Ray(self.program, self.point, self.merit, self.direction, limits, self.mu)
        self.flat_steps = self.flat_steps + 1 if ray.is_flat else 0
        alpha, self.merit = search(ray, self.filter, self.trial)
        self.short_steps = self.short_steps + 1 if alpha < SHORT_STEP else 0
        # accept the trial point; z is shared by both
        self.point, self.trial = self.trial, self.point
        step_multipliers(self.point, self.direction, limits.alpha_z, self.mu)
        self.multipliers.next[:] += alpha * (self.direction.next - self.multipliers.next)
        self.multipliers.step[:] += alpha * (self.direction.step - self.multipliers.step)
        self.multipliers.time[:] += alpha * self.direction.time

    def result(self, status: Status) -> Minimum:
        self._examine(self.point.states, self.point.controls)
        # those of inactive constraints, which were left out, are about μ/s
        multipliers = self.unit * self.mu / np.maximum(self.room, self.least_slack)
        multipliers.flat[self.program.active.flat] = self.unit * self.point.z
        return Minimum(
            status=status,
            iterations=self.iterations,
            states=self.point.states,
            controls=self.point.controls,
            low_multipliers=multipliers[0],
            high_multipliers=multipliers[1],
            time_multiplier=self.unit * float(self.multipliers.time[0]),
        )
