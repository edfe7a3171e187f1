"""A path with axis limits, a peer's answer on it, and what that uses of each limit, densely sampled.

The answers of our own solvers, of toppra on our rows, and of IPOPT on our order-3 problem. The peers are imported here
alone: copp-py's TOPP2-RA and its TOPP3-SOCP at its best, and ruckig's straight moves.

copp-py: Wang et al., github.com/TOPP-THU/copp. Its order-3 state is a = ṡ², b = s̈ on a grid, with db/ds constant on
every interval (so that s⃛ = (db/ds) √a) but for the first and last few, which have constant s⃛ from rest.
ruckig: jerk-limited moves; Berscheid and Kröger, RSS 2021.
"""

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from importlib.util import find_spec
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.evidence.measuring import time_calls
from benchmarks.evidence.peers.casadi_ import solve_by_casadi
from kinematics import load_machine
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, require
from kinematics.machine.axis import Axis, directional_bounds
from planner import load_program
from planner.limits import limits_of
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath, actuate
from planner.path.polynomial import PolynomialPath
from planner.timing import discretization
from planner.timing.certified_solve import certified_solve
from planner.timing.discretization import jerk_problem
from planner.timing.problem import Run, Solver, make_grid, pose_problem
from planner.timing.profile import Profile
from planner.timing.solvers.second_order import second_order
from planner.timing.solvers.third_order import third_order

# How often a solve is timed, at most: no more once it has taken so long (s), but twice.
REPEATS, MAX_TIMING_DURATION = 5, 10.0
# Instants per interval at which a motion is looked at, both ends among them.
SAMPLE_SHARES = np.linspace(0.0, 1.0, 41)


@dataclass(frozen=True, slots=True)
class Case:
    """A path along which no stop is needed, and its axes with speed, acceleration and jerk limits."""

    name: str
    path: ActuatorPath
    axes: tuple[Axis, ...]

    @property
    def bounds(self) -> Array:
        """(3, 2, n) of speed, acceleration and jerk: the magnitudes towards smaller and towards greater values."""
        fields = "max_speed", "max_acceleration", "max_jerk"
        sides = [[directional_bounds(getattr(axis, field)) for axis in self.axes] for field in fields]
        return np.array(sides).transpose(0, 2, 1)

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
    third = q1 * j + 3 * q2 * v * a + q3 * v**3 if np.isfinite(j).all() else np.full_like(q1, np.inf)
    return largest_uses((q1 * v, q1 * a + q2 * v**2, third), case.bounds)


def largest_uses(values: Iterable[Array], bounds: Array) -> tuple[float, float, float]:
    """The largest value/limit of speed, acceleration and jerk, (N, n) each, held against bounds (3, 2, n)."""
    speed, acceleration, jerk = (
        float(np.maximum(value / above, -value / below).max())
        for value, (below, above) in zip(values, bounds, strict=True)
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

    def solve() -> PeerMotion:
        # a fresh path: of these limits, none is geometric, so that nothing proved before helps
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

    def solve_by(which: Solver, intervals: int) -> PeerMotion:
        problem = pose_problem(case.path, limits, *make_grid(case.path, _run(case), intervals))
        profile = second_order(problem, solver=which).require_profile()
        return profile.duration, sample_profile(profile, 2)

    yield answer(case, 2, "ours, uncertified", INTERVALS, lambda: solve_by("passes", INTERVALS))
    yield answer(case, 2, "ours, uncertified (reference)", REFERENCE_2, lambda: solve_by("passes", REFERENCE_2))
    if not is_installed("toppra"):
        yield failed_answer(case, 2, "toppra", None, "absent")
        return
    try:
        yield answer(case, 2, "toppra", INTERVALS, lambda: solve_by("toppra", INTERVALS))
    except MotionError as no:
        yield failed_answer(case, 2, "toppra", INTERVALS, str(no))


def solve_by_ipopt(case: Case) -> PeerAnswer:
    """The reference: IPOPT on many intervals, from where FATROP ends on as many."""
    usual, discretization.THIRD_ORDER = discretization.THIRD_ORDER, (REFERENCE_3, 0, 0)
    try:
        problem, start = require(jerk_problem(case.path, axis_limits(case, 3), _run(case)))
    finally:
        discretization.THIRD_ORDER = usual
    guess = start.on(problem.s)

    def solve() -> PeerMotion:
        profile = solve_by_casadi(problem, guess, "ipopt").require_profile()
        return profile.duration, sample_profile(profile, 3)

    try:
        return answer(case, 3, "IPOPT (reference)", problem.intervals, solve)
    except MotionError as no:
        return failed_answer(case, 3, "IPOPT (reference)", problem.intervals, str(no))


# Intervals, how far the grid is graded towards both ends (0: even), intervals of constant jerk at each end. It
# linearises jerk about the last answer: so often, at most, and until the duration changes by this share.
ORDER2_INTERVALS = (1000,)
EVEN_GRIDS = tuple((intervals, 0.0, 1) for intervals in (100, 200, 400, 1000))
GRADED_GRIDS = ((100, 0.9, 1), (200, 0.9, 3), (400, 0.9, 3), (700, 0.9, 3), (1000, 0.9, 3))
ORDER3_GRIDS = EVEN_GRIDS + GRADED_GRIDS
LINEARISATIONS, DURATION_TOLERANCE = 6, 1e-5


def solve_by_copp(case: Case, order: int) -> Iterator[PeerAnswer]:
    if not is_installed("copp_py"):
        yield failed_answer(case, order, "copp-py", None, "absent")
        return
    if order == 2:
        for intervals in ORDER2_INTERVALS:
            yield _try_grid(case, order, "copp-py TOPP2-RA", intervals, 0.0, 1)
        return
    for intervals, graded, stationary in ORDER3_GRIDS:
        grid = f"graded grid, {stationary} at rest" if graded else "even grid"
        yield _try_grid(case, order, f"copp-py TOPP3-SOCP, {grid}", intervals, graded, stationary)


def _try_grid(case: Case, order: int, method: str, intervals: int, graded: float, stationary: int) -> PeerAnswer:
    from copp_py import CoppError

    try:
        return answer(case, order, method, intervals, lambda: solve_grid(case, order, intervals, graded, stationary))
    except CoppError as no:
        return failed_answer(case, order, method, intervals, str(no).splitlines()[0])


def solve_grid(
    case: Case, order: int, intervals: int, graded: float, stationary: int, linearisations: int = LINEARISATIONS
) -> PeerMotion:
    """By copp-py, with its own tests' patience with the conic solver."""
    import copp_py
    from copp_py.clarabel import ClarabelOptions

    even = np.linspace(0.0, 1.0, intervals + 1)
    share = even - graded * np.sin(2 * np.pi * even) / (2 * np.pi)
    s = case.path.breaks[0] + case.length * share
    q, q1, q2, q3 = case.path.derivatives(s, case.piece(s))
    speed, acceleration, jerk = ((above, -below) for below, above in case.bounds)
    length = case.length
    robot = copp_py.Robot(len(case.axes), capacity=len(s))
    robot.append_s(share)
    robot.set_q(q, q1 * length, q2 * length**2, 0, dddq=q3 * length**3)
    robot.add_velocity_limits(*speed, start_idx_s=0, length=len(s))
    robot.add_acceleration_limits(*acceleration, start_idx_s=0, length=len(s))
    if order == 3:
        robot.add_jerk_limits(*jerk, start_idx_s=0, length=len(s))
    ra = copp_py.solver.topp2_ra
    a = ra.solve(ra.Problem(robot.constraints, idx_s_interval=(0, intervals), a_boundary=(0.0, 0.0)), ra.Options())
    if order == 2:
        return float(copp_py.interpolation.s_to_t_topp2(share, a, 0.0)[0]), _sample_order2(case, share, np.asarray(a))
    socp, b, before = copp_py.solver.topp3_socp, None, np.inf
    options = ClarabelOptions(allow_max_iterations=True, allow_max_time=True, allow_insufficient_progress=True)
    for _ in range(linearisations):
        problem = socp.Problem(
            robot.constraints,
            a,
            a_boundary=(0.0, 0.0),
            b_boundary=(0.0, 0.0),
            num_stationary_max=stationary,
            b_linearization=b,
        )
        profile = socp.solve(problem, options)
        a, b = profile.a, profile.b
        duration = float(copp_py.interpolation.s_to_t_topp3(share, profile)[0])
        if abs(before - duration) < DURATION_TOLERANCE * duration:
            break
        before = duration
    return duration, sample_order3(case, share, profile)


def _sample_order2(case: Case, share: Array, x: Array) -> MotionSamples:
    """s̈ is constant on each interval."""
    u = np.diff(x) / (2 * np.diff(share))
    return _samples(case, share, lambda k, way: (x[k] + 2 * u[k] * way, u[k], np.full(len(k), np.inf)))


def sample_order3(case: Case, share: Array, profile: Any) -> MotionSamples:
    x, b = np.asarray(profile.a), np.asarray(profile.b)
    first, last = profile.num_stationary
    slope = np.diff(b) / np.diff(share)

    def usual(k: np.ndarray, way: Array) -> tuple[Array, Array, Array]:
        now = np.maximum(x[k] + way * (2 * b[k] + slope[k] * way), 0.0)
        return now, b[k] + slope[k] * way, slope[k] * np.sqrt(now)

    def move_near_rest(k: np.ndarray, way: Array) -> tuple[Array, Array, Array]:
        """From or to rest with constant jerk: s = j t³/6, ṡ = 3 s/t, s̈ = 6 s/t²."""
        now, accelerating, jerk = usual(k, way)
        place = share[k] + way
        for chosen, to, travelled, sign in (
            (k < first, first, place, 1.0),
            (k >= len(share) - 1 - last, len(share) - 1 - last, 1 - place, -1.0),
        ):
            whole = share[to] if sign > 0 else 1 - share[to]
            push = 6 * whole / (3 * whole / np.sqrt(x[to])) ** 3
            t = np.cbrt(6 * travelled[chosen] / push)
            now[chosen], accelerating[chosen], jerk[chosen] = (push * t**2 / 2) ** 2, sign * push * t, push
        return now, accelerating, jerk

    return _samples(case, share, move_near_rest)


def _samples(case: Case, share: Array, at: Any) -> MotionSamples:
    step = np.diff(share)
    k, way = np.repeat(np.arange(len(step)), len(SAMPLE_SHARES)), (step[:, None] * SAMPLE_SHARES).ravel()
    x, u, jerk = at(k, way)
    s = case.path.breaks[0] + case.length * (share[k] + way)
    length = case.length
    return MotionSamples(s, np.sqrt(np.maximum(x, 0.0)) * length, u * length, jerk * length, case.piece(s))


def solve_by_ruckig(case: Case) -> Iterator[PeerAnswer]:
    """One axis: its path is the axis itself."""
    if is_installed("ruckig"):
        yield answer(case, 3, "ruckig", None, lambda: _solve_ruckig(case))
    else:
        yield failed_answer(case, 3, "ruckig", None, "absent")


def _solve_ruckig(case: Case) -> PeerMotion:
    from ruckig import InputParameter, Ruckig, Trajectory

    asked = InputParameter(1)
    asked.current_position, asked.target_position = [0.0], [case.length]
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = case.bounds[:, 1].tolist()
    trajectory = Trajectory(1)
    Ruckig(1).calculate(asked, trajectory)
    profile = trajectory.profiles[0][0]
    h, j = np.array(profile.t), np.array(profile.j)
    starts = np.append(0.0, np.cumsum(h))[:-1]
    s, v, a = np.array([trajectory.at_time(t) for t in (starts[:, None] + h[:, None] * SAMPLE_SHARES).ravel()])[
        :, :, 0
    ].T
    return float(trajectory.duration), MotionSamples(s, v, a, np.repeat(j, len(SAMPLE_SHARES)), np.zeros(len(s), int))
