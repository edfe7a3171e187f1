"""copp-py's TOPP2-RA and TOPP3-SOCP: Wang et al., github.com/TOPP-THU/copp.

Its unknowns are x = ṡ² and u = s̈ on a grid. At order 2, u is constant on each interval; at order 3
du/ds is, so that s⃛ = (du/ds) √x. On the first and the last few intervals s⃛ is constant instead,
from rest and to rest.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.evidence.peers.problems import SHARES, Motion, PathProblem
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, NotInstalled

# Relative change of the duration that ends the linearisations of jerk.
TOLERANCE = 1e-5
REST = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Grid:
    """Intervals along the path, closer together towards both ends by `graded` of 0 to 1.

    resting  number of intervals with constant jerk at each end
    """

    intervals: int = 1000
    graded: float = 0.0
    resting: int = 1


def solve(
    problem: PathProblem,
    order: int,
    grid: Grid,
    linearisations: int = 6,
) -> Callable[[], Motion]:
    """Find the fastest motion. Raises MotionError with copp-py's message where it has no answer."""
    try:
        import copp_py
    except ImportError as error:
        raise NotInstalled("the comparison", "copp-py", "peers") from error

    even = np.linspace(0.0, 1.0, grid.intervals + 1)
    share = even - grid.graded * np.sin(2 * np.pi * even) / (2 * np.pi)
    try:
        robot = _pose(problem, order, share)
        ra = copp_py.solver.topp2_ra
        posed = ra.Problem(
            robot.constraints,
            idx_s_interval=(0, grid.intervals),
            a_boundary=REST,
        )
        x = ra.solve(posed, ra.Options())
        if order == 2:
            duration = float(copp_py.interpolation.s_to_t_topp2(share, x, 0.0)[0])
            pieces = _order2_pieces(share, np.asarray(x))
            return partial(_sample, problem, duration, share, pieces)
        duration, profile = _linearise(robot, share, x, grid.resting, linearisations)
    except copp_py.CoppError as error:
        raise MotionError(f"copp-py: {error}") from error
    return partial(_sample, problem, duration, share, _order3_pieces(share, profile))


def _pose(problem: PathProblem, order: int, share: Array) -> Any:
    """Return copp-py's robot, whose parameter is the share of the path."""
    import copp_py

    count, length = len(share), problem.length
    q, q1, q2, q3 = problem.derivatives(problem.path.breaks[0] + length * share)
    robot = copp_py.Robot(len(problem.axes), capacity=count)
    robot.append_s(share)
    robot.set_q(q, q1 * length, q2 * length**2, 0, dddq=q3 * length**3)
    speed, acceleration, jerk = ((above, -below) for below, above in problem.bounds)
    robot.add_velocity_limits(*speed, start_idx_s=0, length=count)
    robot.add_acceleration_limits(*acceleration, start_idx_s=0, length=count)
    if order == 3:
        robot.add_jerk_limits(*jerk, start_idx_s=0, length=count)
    return robot


def _linearise(robot: Any, share: Array, x: Any, resting: int, times: int) -> tuple[float, Any]:
    """Return duration and profile of the conic programme; jerk is linearised anew up to `times`.

    The solver may end early, as in copp-py's own tests.
    """
    import copp_py
    from copp_py.clarabel import ClarabelOptions

    socp = copp_py.solver.topp3_socp
    options = ClarabelOptions(
        allow_max_iterations=True,
        allow_max_time=True,
        allow_insufficient_progress=True,
    )
    u, before = None, np.inf
    for _ in range(times):
        posed = socp.Problem(
            robot.constraints,
            x,
            a_boundary=REST,
            b_boundary=REST,
            num_stationary_max=resting,
            b_linearization=u,
        )
        profile = socp.solve(posed, options)
        x, u = profile.a, profile.b
        duration = float(copp_py.interpolation.s_to_t_topp3(share, profile)[0])
        if abs(before - duration) < TOLERANCE * duration:
            break
        before = duration
    return duration, profile


Pieces = Callable[[np.ndarray, Array], tuple[Array, Array, Array]]
"""x, s̈ and s⃛ at ways (N,) from the start of intervals (N,)."""


def _sample(problem: PathProblem, duration: float, share: Array, pieces: Pieces) -> Motion:
    """Return the motion at many instants of each interval."""
    step = np.diff(share)
    k = np.repeat(np.arange(len(step)), len(SHARES))
    way = np.outer(step, SHARES).ravel()
    x, u, jerk = pieces(k, way)
    length = problem.length
    s = problem.path.breaks[0] + length * (share[k] + way)
    speed = np.sqrt(np.maximum(x, 0.0))
    return problem.motion(duration, s, (speed * length, u * length, jerk * length))


def _order2_pieces(share: Array, x: Array) -> Pieces:
    u = np.diff(x) / (2 * np.diff(share))
    return lambda k, way: (x[k] + 2 * u[k] * way, u[k], np.full(len(k), np.inf))


def _order3_pieces(share: Array, profile: Any) -> Pieces:
    x, u = np.asarray(profile.a), np.asarray(profile.b)
    slope = np.diff(u) / np.diff(share)
    first, last = profile.num_stationary

    def pieces(k: np.ndarray, way: Array) -> tuple[Array, Array, Array]:
        square = np.maximum(x[k] + way * (2 * u[k] + slope[k] * way), 0.0)
        push = u[k] + slope[k] * way
        jerk = slope[k] * np.sqrt(square)
        place = share[k] + way
        until = len(share) - 1 - last
        ends = (
            (k < first, place, share[first], x[first], 1.0),
            (k >= until, 1 - place, 1 - share[until], x[until], -1.0),
        )
        # s = j t³/6, ṡ = j t²/2 and s̈ = j t from rest
        for near, travelled, whole, square_there, sign in ends:
            constant = 2 / 9 * square_there**1.5 / whole**2 if near.any() else 0.0
            t = np.cbrt(6 * travelled[near] / constant)
            square[near] = (constant * t**2 / 2) ** 2
            push[near] = sign * constant * t
            jerk[near] = constant
        return square, push, jerk

    return pieces
