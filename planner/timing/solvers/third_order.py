"""Time-optimal motion under limits on speed, acceleration and jerk.

Each interval of the fixed grid has the state (ṡ, s̈) at its start and the controls (s⃛, h): constant jerk over the
duration h.

    minimise Σ h (and a trace of jerk)
    such that Δs = ṡ h + s̈ h²/2 + s⃛ h³/6, the next state follows, and every row is kept

Rows with s⃛ are kept at both ends of every interval (the jerk jumps there), the others at starts and middles. Time is a
variable and ṡ², the usual choice, is not: nothing is singular at rest, derivatives of q are constants, s(t) is exact in
closed form. Solved by planner.timing.solvers.interior_point.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.timing.problem import Problem
from planner.timing.profile import RunSolution, close_profile
from planner.timing.solvers.interior_point import Start, minimise
from planner.timing.solvers.stage_problem import PosedStages, pose_stages

# How often a problem is solved whose rows depend on the motion, unless a round gains less than this share.
MAX_ROW_ROUNDS, MIN_ROUND_GAIN = 4, 1e-4
# What a speed at an end is worth that is to be as large as can be, beside the duration.
END_SPEED_WEIGHT = 100.0


def solve_jerk_limited(problem: Problem, guess: Array, *, near: bool = False) -> RunSolution:
    """The fastest motion. guess (4, N): ṡ, s̈, s⃛, h to start from; near: it answers almost the same problem.

    Rows that speak only near some motions are taken near the guess, and then near each answer in turn.
    """
    for _ in range(1 if problem.settled else MAX_ROW_ROUNDS):
        posed = settle_rows(problem, guess)
        found = third_order(posed, guess, near=near)
        if not found.solved:
            return found
        gained, guess = 1 - found.duration / guess[3].sum(), found.profile.columns()
        if abs(gained) < MIN_ROUND_GAIN:
            break
        near = True
    return replace(found, problem=problem)


def settle_rows(problem: Problem, columns: Array) -> Problem:
    """With the rows that speak near a motion (4, N), where not all speak near every one."""
    if problem.settled:
        return problem
    v, a, j, h = columns
    speed = v + h / 2 * (a + h * j / 4)  # in the middle, for both sides
    return problem.around(speed, speed)


def third_order(problem: Problem, guess: Array, *, fast_end: int | None = None, near: bool = False) -> RunSolution:
    """The fastest motion, s̈ zero at both ends but those where it is free. guess (4, N): ṡ, s̈, s⃛, h to start from.

    near: the guess is about the answer.
    fast_end: 0 for the start, 1 for the end: the motion with the largest speed there instead, up to the problem's.
    """
    if fast_end == 1:
        columns = _solve_stages(problem.reversed(), _reverse_columns(guess), END_SPEED_WEIGHT)
        columns = columns if isinstance(columns, MotionError) else _reverse_columns(columns)
    else:
        columns = _solve_stages(problem, guess, 0.0 if fast_end is None else END_SPEED_WEIGHT, near)
    if isinstance(columns, MotionError):
        return RunSolution.refused(columns)
    if fast_end is not None:
        v, a, j, h = columns[:, -1]
        reached = (columns[0, 0], v + h * (a + h * j / 2))[fast_end]
        speeds = list(problem.speeds)
        speeds[fast_end] = float(np.clip(reached, 0.0, speeds[fast_end]))
        problem = replace(problem, speeds=(speeds[0], speeds[1]))
    profile = close_profile(problem, columns)
    if isinstance(profile, MotionError):
        return RunSolution.refused(profile)
    return RunSolution("solved", profile, maker="riccati", problem=problem)


def _solve_stages(problem: Problem, guess: Array, prize: float, near: bool = False) -> Array | MotionError:
    """Columns (4, N) of ṡ, s̈, s⃛, h, or why there are none."""
    attempts: tuple[Start, ...] = ("near", "far", "farther") if near else ("far", "farther")
    return minimise_posed(pose_stages(problem, guess, prize), attempts)


def minimise_posed(posed: PosedStages, attempts: Sequence[Start]) -> Array | MotionError:
    """Columns (4, N) of ṡ, s̈, s⃛, h by the first attempt with an answer, or why there is none."""
    stages, rows, states, controls, unit = posed
    numbers = (states, controls, stages.jerks, rows.first, rows.second)
    if not (all(np.isfinite(each).all() for each in numbers) and (stages.step > 0).all()):
        return MotionError("the jerk-limited problem holds what is no number, or an interval of no length")
    for start in attempts:
        answer = minimise(stages, rows, states, controls, start)
        if answer.status in ("solved", "loose"):
            break
    else:
        return MotionError(
            f"the jerk-limited solver stopped without an answer ({answer.status}, {answer.iterations} iterations)"
        )
    return np.concatenate([answer.states[:-1].T, answer.controls.T]) * unit[:, None]


def _reverse_columns(columns: Array) -> Array:
    """(4, N) of ṡ, s̈, s⃛, h of the same motion from its end to its start."""
    v, a, j, h = columns[:, ::-1]
    return np.stack([v + h * (a + h * j / 2), -(a + h * j), j, h])
