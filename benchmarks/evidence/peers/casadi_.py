"""The order-3 problem by FATROP and IPOPT through CasADi: a second opinion on our own solver.

Unknown are ṡ and s̈ at the start of each interval, its constant s⃛ and its duration h, and ṡ and s̈
at the end:

    ṡ⁺ = ṡ + h (s̈ + h s⃛/2),   s̈⁺ = s̈ + h s⃛,   Δs = h (ṡ + h (s̈/2 + h s⃛/6)).

Rows with s⃛ are bounded at both ends of an interval, as the jerk jumps there, and other rows at its
start and in its middle. Lengths are counted in the run's, times in the guess' duration, and each
variable in its largest guess: so 35 iterations suffice where the plain problem takes 400.

FATROP: L. Vanroye et al., IROS 2023. IPOPT: A. Wächter and L. T. Biegler, Mathematical Programming
106 (2006) 25–57.
"""

from collections.abc import Mapping
from typing import Any, Literal

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Term
from planner.timing import Block, Problem, RunSolution, close_profile
from planner.timing.order3.pose import (
    JERK_WEIGHT,
    POWERS,
    SHORTEST,
    interpolate_middles,
    jerk_share,
)

Solver = Literal["fatrop", "ipopt"]
Motion = tuple[ca.MX, ca.MX, ca.MX]
"""ṡ, s̈ and s⃛ (1, N) at one place of each interval."""

# The cost of the guess is about 1000, which suits the solvers' tolerances.
WEIGHT = 1000.0
# Share by which a given speed may exceed a limit: rounding.
SPEED_ROUNDING = 1e-9
OPTIONS: dict[str, dict[str, Any]] = {
    "ipopt": {"ipopt": {"print_level": 0, "sb": "yes", "max_iter": 300, "tol": 1e-9}},
    # No step is too short: FATROP's restoration, which would begin there, may never end.
    "fatrop": {
        "structure_detection": "auto",
        "fatrop": {
            "print_level": 0,
            "max_iter": 300,
            "tol": 1e-7,
            "mu_init": 1e-2,
            "alpha_min_frac": 0.0,
        },
    },
}
QUIET = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}


def solve_by_casadi(problem: Problem, guess: Array, solver: Solver = "fatrop") -> RunSolution:
    """Find the fastest motion, as `third_order` does, from a guess (4, N): ṡ, s̈, s⃛, h."""
    return CasadiProblem(problem, guess, solver).solve()


class CasadiProblem:
    """The problem as CasADi's solvers take it: built once, solved as often as wanted."""

    shortest = SHORTEST
    """Least duration of an interval, as a share of its guess."""

    def __init__(self, problem: Problem, guess: Array, solver: Solver) -> None:
        self.problem, self.solver = problem, solver
        self.length = float(problem.s[-1] - problem.s[0])
        self.time = float(guess[3].sum())
        per_time = self.length / self.time ** np.arange(1, 4)
        self.unit = np.append(per_time, self.time)[:, None]
        self.start = guess / self.unit
        # A motion of constant speed has no s̈ and s⃛; from rest to rest they are 4 and 32 at least.
        largest = np.maximum(np.abs(self.start).max(1), [0.0, 1.0, 1.0, 0.0])
        self.scale = np.tile(largest[:, None], problem.intervals)
        self.scale[3] = self.start[3]

        columns = ca.MX.sym("columns", *self.start.shape)
        last = ca.MX.sym("last", 2)
        v, a, j, h = ca.vertsplit(columns * self.scale)
        middle = v + h / 2 * (a + h * j / 4), a + h * j / 2, j
        end = v + h * (a + h * j / 2), a + h * j, j
        gaps = ca.horzcat(columns[:2, 1:], last) - ca.vertcat(*end[:2]) / self.scale[:2]
        step = np.diff(problem.s)[None] / self.length
        way = h * (v + h * (a / 2 + h * j / 6)) / step
        rows, low, high = self._pose_rows((v, a, j), middle, end)
        values = ca.vec(ca.vertcat(gaps, way, rows))
        cost, sums = self.weigh((v, a, j), end, h)
        values = ca.vertcat(values, *sums)
        low, high = (np.append(side, np.zeros(len(sums))) for side in (low, high))

        least, most = self._bound_columns()
        guessed = np.append((self.start / self.scale).T, [least[-2], 0.0])
        self.given = {"x0": guessed, "lbx": least, "ubx": most, "lbg": low, "ubg": high}
        options = QUIET | OPTIONS[solver]
        if solver == "fatrop":
            options["equality"] = (low == high).tolist()
        programme = {"x": ca.vertcat(ca.vec(columns), last), "f": WEIGHT * cost, "g": values}
        self.method = ca.nlpsol("order3", solver, programme, options)

    def weigh(self, start: Motion, end: Motion, h: ca.MX) -> tuple[ca.MX, list[ca.MX]]:
        """Return the cost, about 1 for the guess, and further sums that are to be 0."""
        trace = jerk_share(self.problem, float(self.unit[2, 0])) * np.sqrt(self.start[3])
        return ca.sum2(h) + JERK_WEIGHT * ca.sumsqr(trace[None] * start[2]), []

    def _pose_rows(self, start: Motion, middle: Motion, end: Motion) -> tuple[ca.MX, Array, Array]:
        """Return the limits' rows (R, N), and the bounds of all constraints, stage by stage."""
        rows = []
        low = [np.array([[0.0], [0.0], [1.0]]).repeat(self.problem.intervals, 1)]
        high = low.copy()
        for block in self.problem.blocks:
            jumps = Term.SDDD in block.start
            terms = block.start.items()
            between = {t: interpolate_middles(self.problem, c, block.end[t]) for t, c in terms}
            second, motion = (block.end, end) if jumps else (between, middle)
            rows += [self._sum_terms(block.start, start), self._sum_terms(second, motion)]
            for room in (block.room if jumps else _start_room(block), block.room):
                low.append((block.middle - 1)[:, None] * room)
                high.append((block.middle + 1)[:, None] * room)
        return ca.vertcat(*rows), np.concatenate(low).T.ravel(), np.concatenate(high).T.ravel()

    def _sum_terms(self, side: Mapping[Term, Array], motion: Motion) -> ca.MX:
        """Return the rows (m, N) of a block at one place of each interval."""
        v, a, j = motion
        values = {
            Term.SD: v,
            Term.SD2: v**2,
            Term.SD3: v**3,
            Term.SDD: a,
            Term.SDSDD: v * a,
            Term.SDDD: j,
        }
        total = ca.MX(0)
        for term, coefficients in side.items():
            lengths, times = POWERS[term]
            scaled = coefficients.T * (self.length**lengths / self.time**times)
            total += scaled * ca.repmat(values.get(term, v**0), len(scaled), 1)
        return total

    def _bound_columns(self) -> tuple[Array, Array]:
        """Return the least and the largest values of all variables.

        ṡ is given at both ends, and s̈ is 0 but at a free end.
        """
        least = np.tile([[0.0], [-np.inf], [-np.inf], [self.shortest]], self.problem.intervals)
        most = np.full(least.shape, np.inf)
        first, last = np.array(self.problem.speeds) / self.unit[0] / self.scale[0, 0]
        free_start, free_end = np.where(self.problem.free, np.inf, 0.0)
        least[:2, 0] = first, -free_start
        most[:2, 0] = first, free_start
        # s̈ is constant next to a free end: q⃛ is 0 at the end and might peak before the next point
        for end in np.flatnonzero(self.problem.free):
            least[2, -end] = most[2, -end] = 0.0
        return np.append(least.T, [last, -free_end]), np.append(most.T, [last, free_end])

    def solve(self) -> RunSolution:
        """Solve it, and close the motion; refused where the solver does not converge."""
        try:
            answer = np.asarray(self.method(**self.given)["x"]).ravel()[:-2]
        except RuntimeError as error:  # an evaluation overflows
            return RunSolution.refused(MotionError(f"{self.solver} failed: {error}"))
        stats = self.method.stats()
        if not stats["success"] or not np.isfinite(answer).all():
            message = f"{self.solver} stopped: {stats['return_status']}"
            return RunSolution.refused(MotionError(message))
        profile = close_profile(self.problem, answer.reshape(-1, 4).T * self.scale * self.unit)
        if isinstance(profile, MotionError):
            return RunSolution.refused(profile)
        return RunSolution("solved", profile, maker=self.solver, problem=self.problem)


def _start_room(block: Block) -> Array:
    """Return the room at an interval's start, where rows without s⃛ bound the interval before too.

    The first has some to spare, as a given speed may be at its limit.
    """
    return np.append(1 + SPEED_ROUNDING, np.minimum(block.room[1:], block.room[:-1]))
