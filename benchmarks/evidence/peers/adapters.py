"""The peers, each imported here alone: copp-py's TOPP2-RA and its TOPP3-SOCP at its best, and ruckig's straight moves.

copp-py: Wang et al., github.com/TOPP-THU/copp. Its order-3 state is a = ṡ², b = s̈ on a grid, with db/ds constant on
every interval (so that s⃛ = (db/ds) √a) but for the first and last few, which have constant s⃛ from rest.
ruckig: jerk-limited moves; Berscheid and Kröger, RSS 2021.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.evidence.peers.case import (
    SAMPLE_SHARES,
    Case,
    MotionSamples,
    PeerAnswer,
    PeerMotion,
    answer,
    failed_answer,
    is_installed,
)
from kinematics.foundation.arrays import Array

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
        return answer(case, order, method, intervals, lambda: _solve(case, order, intervals, graded, stationary))
    except CoppError as no:
        return failed_answer(case, order, method, intervals, str(no).splitlines()[0])


def _solve(case: Case, order: int, intervals: int, graded: float, stationary: int) -> PeerMotion:
    import copp_py

    even = np.linspace(0.0, 1.0, intervals + 1)
    share = even - graded * np.sin(2 * np.pi * even) / (2 * np.pi)
    s = case.path.breaks[0] + case.length * share
    q, q1, q2, q3 = case.path.derivatives(s, case.piece(s))
    speed, acceleration, jerk = case.bounds
    length = case.length
    robot = copp_py.Robot(len(case.axes), capacity=len(s))
    robot.append_s(share)
    robot.set_q(q, q1 * length, q2 * length**2, 0, dddq=q3 * length**3)
    robot.add_velocity_limits(speed, -speed, start_idx_s=0, length=len(s))
    robot.add_acceleration_limits(acceleration, -acceleration, start_idx_s=0, length=len(s))
    if order == 3:
        robot.add_jerk_limits(jerk, -jerk, start_idx_s=0, length=len(s))
    ra = copp_py.solver.topp2_ra
    a = ra.solve(ra.Problem(robot.constraints, idx_s_interval=(0, intervals), a_boundary=(0.0, 0.0)), ra.Options())
    if order == 2:
        return float(copp_py.interpolation.s_to_t_topp2(share, a, 0.0)[0]), _sample_order2(case, share, np.asarray(a))
    socp, b, before = copp_py.solver.topp3_socp, None, np.inf
    for _ in range(LINEARISATIONS):
        problem = socp.Problem(
            robot.constraints,
            a,
            a_boundary=(0.0, 0.0),
            b_boundary=(0.0, 0.0),
            num_stationary_max=stationary,
            b_linearization=b,
        )
        profile = socp.solve(problem)
        a, b = profile.a, profile.b
        duration = float(copp_py.interpolation.s_to_t_topp3(share, profile)[0])
        if abs(before - duration) < DURATION_TOLERANCE * duration:
            break
        before = duration
    return duration, _sample_order3(case, share, profile)


def _sample_order2(case: Case, share: Array, x: Array) -> MotionSamples:
    """s̈ is constant on each interval."""
    u = np.diff(x) / (2 * np.diff(share))
    return _samples(case, share, lambda k, way: (x[k] + 2 * u[k] * way, u[k], np.full(len(k), np.inf)))


def _sample_order3(case: Case, share: Array, profile: Any) -> MotionSamples:
    x, b = np.asarray(profile.a), np.asarray(profile.b)
    first, last = profile.num_stationary
    slope = np.diff(b) / np.diff(share)

    def usual(k: np.ndarray, way: Array) -> tuple[Array, Array, Array]:
        now = np.maximum(x[k] + way * (2 * b[k] + slope[k] * way), 0.0)
        return now, b[k] + slope[k] * way, slope[k] * np.sqrt(now)

    def resting(k: np.ndarray, way: Array) -> tuple[Array, Array, Array]:
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

    return _samples(case, share, resting)


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
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = (bound.tolist() for bound in case.bounds)
    trajectory = Trajectory(1)
    Ruckig(1).calculate(asked, trajectory)
    profile = trajectory.profiles[0][0]
    h, j = np.array(profile.t), np.array(profile.j)
    starts = np.append(0.0, np.cumsum(h))[:-1]
    s, v, a = np.array([trajectory.at_time(t) for t in (starts[:, None] + h[:, None] * SAMPLE_SHARES).ravel()])[
        :, :, 0
    ].T
    return float(trajectory.duration), MotionSamples(s, v, a, np.repeat(j, len(SAMPLE_SHARES)), np.zeros(len(s), int))
