"""A path with axis limits, a peer's answer on it, and what that uses of each limit, densely sampled.

Our own solvers, toppra on our rows, and IPOPT on our order-3 problem.
"""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from importlib.util import find_spec
from statistics import median
from time import perf_counter

import numpy as np

from benchmarks.evidence.timing import time_calls
from kinematics import load_machine
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, require
from kinematics.machine.axis import Axis
from planner import load_program
from planner.actuation import ActuatorPath, actuate
from planner.limits import limits_of
from planner.limits.limit import Limit
from planner.path.polynomial import PolynomialPath
from planner.timing import discretization as posing
from planner.timing.certified_solve import certified_solve
from planner.timing.discretization import jerk_problem
from planner.timing.problem import Run, Solver, make_grid, pose_problem
from planner.timing.profile import Profile
from planner.timing.solvers import third_order as solver
from planner.timing.solvers.second_order import second_order
from planner.timing.solvers.third_order import third_order

# How often a solve is timed, at most: no more once it has taken so long (s), but twice.
REPEATS, MAX_TIMING_DURATION = 5, 10.0
# Instants per interval at which a motion is looked at, both ends among them.
SAMPLE_SHARES = np.linspace(0.0, 1.0, 41)


@dataclass(frozen=True, slots=True)
class Case:
    """A path along which no stop is needed, and its axes with speed, acceleration and jerk limits (n,)."""

    name: str
    path: ActuatorPath
    axes: tuple[Axis, ...]

    @property
    def bounds(self) -> tuple[Array, Array, Array]:
        speed, acceleration, jerk = (
            np.array([getattr(axis, field) for axis in self.axes])
            for field in ("max_speed", "max_acceleration", "max_jerk")
        )
        return speed, acceleration, jerk

    @property
    def length(self) -> float:
        return float(self.path.breaks[-1] - self.path.breaks[0])

    def piece(self, s: Array) -> np.ndarray:
        return np.clip(np.searchsorted(self.path.breaks, s, side="right") - 1, 0, len(self.path.breaks) - 2)


@dataclass(frozen=True, slots=True)
class MotionSamples:
    """A motion at many instants: s, ṡ, s̈, s⃛ and the path's piece, each (N,)."""

    s: Array
    v: Array
    a: Array
    j: Array
    piece: np.ndarray


@dataclass(frozen=True, slots=True)
class PeerAnswer:
    """One line of the table: wall time of the first call and the median of those after it (s), duration (s), ratios.

    worst: value/limit of speed, acceleration and jerk, the largest of the samples; jerk is ∞ where acceleration steps.
    """

    case: str
    order: int
    method: str
    intervals: int | None
    first: float
    again: float
    duration: float
    worst: tuple[float, float, float]
    note: str = ""

    @property
    def feasible(self) -> float:
        """The duration, slowed until the samples keep every limit of its order (s)."""
        powers = [1.0, 0.5, 1 / 3][: self.order]
        slowness = [use**power for use, power in zip(self.worst, powers, strict=False)]
        slowed: float = self.duration * max(1.0, *slowness)
        return slowed


PeerMotion = tuple[float, MotionSamples]


def answer(
    case: Case, order: int, method: str, intervals: int | None, solve: Callable[[], PeerMotion], note: str = ""
) -> PeerAnswer:
    """Solve a few times, and look at the motion."""
    (duration, samples), times = time_calls(solve, REPEATS, perf_counter, MAX_TIMING_DURATION)
    return PeerAnswer(
        case.name, order, method, intervals, times[0], median(times[1:]), duration, worst(case, samples), note
    )


def failed_answer(case: Case, order: int, method: str, intervals: int | None, why: str) -> PeerAnswer:
    nan = float("nan")
    return PeerAnswer(case.name, order, method, intervals, nan, nan, nan, (nan, nan, nan), why)


def worst(case: Case, samples: MotionSamples) -> tuple[float, float, float]:
    _, q1, q2, q3 = case.path.derivatives(samples.s, samples.piece)
    v, a, j = samples.v[:, None], samples.a[:, None], samples.j[:, None]
    values = q1 * v, q1 * a + q2 * v**2, q1 * j + 3 * q2 * v * a + q3 * v**3
    speed, acceleration, jerk = (
        float((np.abs(value) / bound).max()) for value, bound in zip(values, case.bounds, strict=True)
    )
    return speed, acceleration, jerk


def sample_profile(profile: Profile, order: int) -> MotionSamples:
    """Our own pieces of constant s⃛; at order 2 s̈ steps, and jerk knows no bound."""
    k, tau = np.repeat(np.arange(len(profile.h)), len(SAMPLE_SHARES)), (profile.h[:, None] * SAMPLE_SHARES).ravel()
    v, a, j = profile.v[k], profile.a[k], profile.j[k]
    s = profile.s[k] + tau * (v + tau * (a / 2 + tau * j / 6))
    jerk = np.full(len(k), np.inf) if order == 2 else j
    return MotionSamples(s, v + tau * (a + tau * j / 2), a + tau * j, jerk, profile.piece[k])


def is_installed(module: str) -> bool:
    return find_spec(module) is not None


def circle() -> Case:
    machine = load_machine("hexapod")
    path = actuate(load_program("bare-circle"), machine)
    return Case("hexapod, circle", path, machine.axes)


def spline(seed: int = 0, count: int = 50, axes: int = 6) -> Case:
    """Random waypoints, a quintic through them (it bends smoothly enough for jerk), limits about one."""
    from scipy.interpolate import make_interp_spline

    from planner.time_optimal import _pieces

    rng = np.random.default_rng(seed)
    curve = make_interp_spline(np.arange(float(count)), rng.uniform(-1, 1, (count, axes)), k=5)
    breaks, coefficients = _pieces(curve)
    names = tuple(f"axis{k + 1}" for k in range(axes))
    limited = tuple(Axis(name, max_speed=1.0, max_acceleration=2.0, max_jerk=20.0) for name in names)
    return Case(f"spline, {count} waypoints", PolynomialPath(breaks, coefficients, names), limited)


def straight_case(length: float = 0.0508) -> Case:
    """One axis over the hexapod's stroke."""
    axis = replace(load_machine("hexapod").axes[0], name="x")
    path = PolynomialPath(np.array([0.0, length]), np.array([[[1.0]], [[0.0]]]), ["x"])
    return Case("straight, one axis", path, (axis,))


# Intervals of the alone-standing order-2 solves, and of the references.
INTERVALS, REFERENCE_2, REFERENCE_3 = 1000, 10_000, 2000


def axis_limits(case: Case, order: int) -> tuple[Limit, ...]:
    """Of the axes alone: no travel, no tilt, which no peer knows."""
    return tuple(limit for limit in limits_of(case.path, case.axes, order) if not limit.geometric)


def _run(case: Case) -> Run:
    return Run(0, len(case.path.breaks) - 2)


def solve_certified(case: Case, order: int) -> PeerAnswer:
    """Solve and certificate, as `plan` does it."""
    limits = axis_limits(case, order)
    solver._forget()

    def solve() -> PeerMotion:
        # what geometry uses is proved once for a path: each call gets a path of its own
        found = certified_solve(copy(case.path), limits, order).trajectory
        h = found.knots[1:] - found.knots[:-1]
        return found.duration, sample_profile(Profile(found.s, found.v, found.a, found.j, h, found.piece), order)

    return answer(case, order, "ours, certified", None, solve, "first call builds the problem" if order == 3 else "")


def solve_general(case: Case) -> PeerAnswer:
    """The order-3 solver where the closed form would serve."""
    limits = axis_limits(case, 3)

    def solve() -> PeerMotion:
        problem, start = require(jerk_problem(case.path, limits, _run(case)))
        profile = third_order(problem, start.on(problem.s)).require_profile()
        return profile.duration, sample_profile(profile, 3)

    return answer(case, 3, "ours, general solver, uncertified", None, solve)


def solve_order2(case: Case) -> Iterator[PeerAnswer]:
    limits = axis_limits(case, 2)

    def by(which: Solver, intervals: int) -> PeerMotion:
        problem = pose_problem(case.path, limits, *make_grid(case.path, _run(case), intervals))
        profile = second_order(problem, solver=which).require_profile()
        return profile.duration, sample_profile(profile, 2)

    yield answer(case, 2, "ours, uncertified", INTERVALS, lambda: by("passes", INTERVALS))
    yield answer(case, 2, "ours, uncertified (reference)", REFERENCE_2, lambda: by("passes", REFERENCE_2))
    if not is_installed("toppra"):
        yield failed_answer(case, 2, "toppra", None, "absent")
        return
    try:
        yield answer(case, 2, "toppra", INTERVALS, lambda: by("toppra", INTERVALS))
    except MotionError as no:
        yield failed_answer(case, 2, "toppra", INTERVALS, str(no))


def solve_by_ipopt(case: Case) -> PeerAnswer:
    """The reference: IPOPT on many intervals, from where FATROP ends on as many."""
    usual, posing.THIRD_ORDER = posing.THIRD_ORDER, (REFERENCE_3, 0, 0)
    try:
        problem, start = require(jerk_problem(case.path, axis_limits(case, 3), _run(case)))
    finally:
        posing.THIRD_ORDER = usual
    guess = start.on(problem.s)

    def solve() -> PeerMotion:
        profile = third_order(problem, guess, solver="ipopt").require_profile()
        return profile.duration, sample_profile(profile, 3)

    try:
        return answer(case, 3, "IPOPT (reference)", problem.intervals, solve)
    except MotionError as no:
        return failed_answer(case, 3, "IPOPT (reference)", problem.intervals, str(no))
