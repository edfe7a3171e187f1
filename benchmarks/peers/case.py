"""A path with axis limits, a peer's answer on it, and what that uses of each limit, densely sampled."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from statistics import median
from time import perf_counter

import numpy as np

from kinematics import load_machine
from kinematics.array import Array
from kinematics.axis import Axis
from planner import load_program
from planner.actuation import ActuatorPath, actuate
from planner.polynomial import PolynomialPath
from planner.timing.profile import Profile

# How often a solve is timed, at most: no more once it has taken so long (s), but twice.
REPEATS, ENOUGH = 5, 10.0
# Instants per interval at which a motion is looked at, both ends among them.
LOOKED = np.linspace(0.0, 1.0, 41)


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
class Samples:
    """A motion at many instants: s, ṡ, s̈, s⃛ and the path's piece, each (N,)."""

    s: Array
    v: Array
    a: Array
    j: Array
    piece: np.ndarray


@dataclass(frozen=True, slots=True)
class Answer:
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


Solved = tuple[float, Samples]


def answer(
    case: Case, order: int, method: str, intervals: int | None, solve: Callable[[], Solved], note: str = ""
) -> Answer:
    """Solve a few times, and look at the motion."""
    times = []
    for _ in range(REPEATS):
        begin = perf_counter()
        duration, samples = solve()
        times.append(perf_counter() - begin)
        if len(times) > 1 and sum(times) > ENOUGH:
            break
    return Answer(
        case.name, order, method, intervals, times[0], median(times[1:]), duration, worst(case, samples), note
    )


def failed(case: Case, order: int, method: str, intervals: int | None, why: str) -> Answer:
    nan = float("nan")
    return Answer(case.name, order, method, intervals, nan, nan, nan, (nan, nan, nan), why)


def worst(case: Case, samples: Samples) -> tuple[float, float, float]:
    _, q1, q2, q3 = case.path.derivatives(samples.s, samples.piece)
    v, a, j = samples.v[:, None], samples.a[:, None], samples.j[:, None]
    values = q1 * v, q1 * a + q2 * v**2, q1 * j + 3 * q2 * v * a + q3 * v**3
    speed, acceleration, jerk = (
        float((np.abs(value) / bound).max()) for value, bound in zip(values, case.bounds, strict=True)
    )
    return speed, acceleration, jerk


def sampled(profile: Profile, order: int) -> Samples:
    """Our own pieces of constant s⃛; at order 2 s̈ steps, and jerk knows no bound."""
    k, tau = np.repeat(np.arange(len(profile.h)), len(LOOKED)), (profile.h[:, None] * LOOKED).ravel()
    v, a, j = profile.v[k], profile.a[k], profile.j[k]
    s = profile.s[k] + tau * (v + tau * (a / 2 + tau * j / 6))
    jerk = np.full(len(k), np.inf) if order == 2 else j
    return Samples(s, v + tau * (a + tau * j / 2), a + tau * j, jerk, profile.piece[k])


def present(module: str) -> bool:
    return find_spec(module) is not None


def circle() -> Case:
    machine = load_machine("hexapod")
    path = actuate(load_program("bare-circle"), machine)
    return Case("hexapod, circle", path, machine.axes)


def spline(seed: int = 0, count: int = 50, axes: int = 6) -> Case:
    """Random waypoints, a quintic through them (it bends smoothly enough for jerk), limits about one."""
    from scipy.interpolate import make_interp_spline

    from planner.bare import _pieces

    rng = np.random.default_rng(seed)
    curve = make_interp_spline(np.arange(float(count)), rng.uniform(-1, 1, (count, axes)), k=5)
    breaks, coefficients = _pieces(curve)
    names = tuple(f"axis{k + 1}" for k in range(axes))
    limited = tuple(Axis(name, max_speed=1.0, max_acceleration=2.0, max_jerk=20.0) for name in names)
    return Case(f"spline, {count} waypoints", PolynomialPath(breaks, coefficients, names), limited)


def straight(length: float = 0.0508) -> Case:
    """One axis over the hexapod's stroke."""
    axis = replace(load_machine("hexapod").axes[0], name="x")
    path = PolynomialPath(np.array([0.0, length]), np.array([[[1.0]], [[0.0]]]), ["x"])
    return Case("straight, one axis", path, (axis,))
