"""Time-optimal motion under limits on speed, acceleration and jerk.

On a fixed grid, with the states (ṡ, s̈) at the grid points, and a constant jerk s⃛ over a duration
h on each interval:

    minimise Σ h (and a small weight of jerk)
    such that Δs = ṡ h + s̈ h²/2 + s⃛ h³/6, the next state follows, and all rows hold

Rows with s⃛ hold at both ends of each interval, where the jerk steps, the others at starts and
middles. Time is a variable instead of the usual ṡ²: so nothing is singular at rest, derivatives of
q are constants, and s(t) is exact.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.timing.order3.interior_point import FAR_STARTS, Start, try_starts
from planner.timing.order3.peaks import Look, Peaks
from planner.timing.order3.pose import OBJECTIVE_SCALE, PosedStages, pose_stages
from planner.timing.order3.stages import evaluate
from planner.timing.problem import Problem
from planner.timing.profile import Profile, close_profile
from planner.timing.solution import RunSolution

# Rounds of a problem whose rows depend on the motion, and the gain, as a share, below which no
# other follows.
MAX_ROW_ROUNDS = 4
MIN_ROUND_GAIN = 1e-4
# Value of a maximal speed at an end, relative to the duration.
END_SPEED_REWARD = 100.0
# Tolerance of a motion for whose peaks bounds are revised. With a smaller one each revision begins
# with slacks so small that they hinder it, for next to no time: COPP's first ten splines (evidence
# random_splines) take 44, 41 and 37 iterations with 3e-6, 1e-5 and 3e-5. They last 2e-6 longer
# with the second than with the first, bundled programs up to 7e-6, and 2e-5 with the third.
REVISED_TOLERANCE = 1e-5
# Tolerance of a solution that only shows where time is lost.
ROUGH_TOLERANCE = 1e-3
# Share of an interval's time up to which that can be lost.
MAX_LOSS_SHARE = 0.1


def solve_jerk_limited(
    problem: Problem,
    guess: Array,
    start: Start = "far",
    look: Look | None = None,
) -> RunSolution:
    """Return the fastest motion.

    guess  (4, N) of ṡ, s̈, s⃛, h
    start  distance of the guess from the solution
    look   samples a motion between grid points: the solution satisfies the limits there too

    Rows that apply only near some motions are those near the guess at first, and then those near
    each solution.
    """
    for _ in range(1 if problem.is_unconditional else MAX_ROW_ROUNDS):
        solution = third_order(settle_rows(problem, guess), guess, start=start, look=look)
        if not solution.solved:
            return solution
        gain = 1 - solution.duration / guess[3].sum()
        guess = solution.profile.columns()
        if abs(gain) < MIN_ROUND_GAIN:
            break
        start = "nearer"
    assert solution.problem is not None
    pairs = zip(problem.blocks, solution.problem.blocks, strict=True)
    blocks = tuple(replace(block, room=settled.room) for block, settled in pairs)
    return replace(solution, problem=replace(problem, blocks=blocks))


def settle_rows(problem: Problem, columns: Array) -> Problem:
    """Return the problem with the rows that apply near a motion (4, N)."""
    if problem.is_unconditional:
        return problem
    v, a, j, h = columns
    middle = v + h / 2 * (a + h * j / 4)
    return problem.around(middle, middle)


def third_order(
    problem: Problem,
    guess: Array,
    *,
    fast_end: int | None = None,
    start: Start = "far",
    look: Look | None = None,
) -> RunSolution:
    """Return the fastest motion between the end conditions of a problem.

    guess     (4, N) of ṡ, s̈, s⃛, h
    start     distance of the guess from the solution
    fast_end  0 for the start, 1 for the end: return the motion with the largest speed there
    """
    if fast_end is not None:
        return _maximise_speed(problem, guess, fast_end)
    posed = pose_stages(problem, guess)
    if look is None:
        starts = tuple(dict.fromkeys((start, *FAR_STARTS)))
        return _close(problem, minimise_posed(posed, starts))
    peaks = Peaks(problem, posed, look)
    solution = try_starts(posed, (start,), REVISED_TOLERANCE, peaks)
    if isinstance(solution, MotionError):
        others = [each for each in FAR_STARTS if each != start]
        return _close(problem, minimise_posed(posed, others))
    use = peaks.use if solution.status == "solved" else None
    columns = posed.columns(solution.states, solution.controls)
    return replace(_close(peaks.problem, columns), use=use)


def _close(problem: Problem, columns: Array | MotionError) -> RunSolution:
    """Return a solution's motion, made continuous."""
    profile = columns if isinstance(columns, MotionError) else close_profile(problem, columns)
    if isinstance(profile, MotionError):
        return RunSolution.refused(profile)
    return RunSolution("solved", profile, maker="riccati", problem=problem)


def _maximise_speed(problem: Problem, guess: Array, end: int) -> RunSolution:
    """Return the motion with the largest speed at its start (end 0) or its end (1)."""
    oriented = _reverse_columns(guess) if end else guess
    posed = pose_stages(problem.reversed() if end else problem, oriented, END_SPEED_REWARD)
    columns = minimise_posed(posed, FAR_STARTS)
    if isinstance(columns, MotionError):
        return RunSolution.refused(columns)
    speed = float(np.clip(columns[0, 0], 0.0, problem.ends[end].speed))
    ends = list(problem.ends)
    ends[end] = replace(ends[end], speed=speed)
    columns = _reverse_columns(columns) if end else columns
    return _close(replace(problem, ends=(ends[0], ends[1])), columns)


def _reverse_columns(columns: Array) -> Array:
    """Return (4, N) of ṡ, s̈, s⃛, h of the same motion from its end to its start."""
    v, a, j, h = columns[:, ::-1]
    return np.stack([v + h * (a + h * j / 2), -(a + h * j), j, h])


def estimate_motion(problem: Problem, guess: Array) -> tuple[Profile, Array] | MotionError:
    """Return about the fastest motion, and the time (N,) that intervals lose because of their size.

    s⃛ is constant over an interval, so a row with s⃛ that is active at one end has slack at the
    other, equal to the change of its value. By the row's multiplier that is worth the lost time,
    which falls with the square of the interval.
    """
    settled = settle_rows(problem, guess)
    posed = pose_stages(settled, guess)
    solution = try_starts(posed, ("rough",), ROUGH_TOLERANCE)
    if isinstance(solution, MotionError):
        return solution
    profile = close_profile(settled, posed.columns(solution.states, solution.controls))
    if isinstance(profile, MotionError):
        return profile
    rows = posed.rows
    values = np.empty(rows.low.shape)
    evaluate(posed.stages, rows, solution.states, solution.controls, values)
    jerk_rows = np.flatnonzero(np.repeat(rows.at_end, rows.size))
    end_rows = int(rows.size.sum()) + jerk_rows
    multipliers = solution.low_multipliers + solution.high_multipliers
    slack = np.abs(values[:, end_rows] - values[:, jerk_rows])
    lost = ((multipliers[:, jerk_rows] + multipliers[:, end_rows]) * slack).sum(1) / 2
    return profile, np.minimum(lost / OBJECTIVE_SCALE * posed.unit[3], MAX_LOSS_SHARE * profile.h)


def minimise_posed(posed: PosedStages, starts: Sequence[Start]) -> Array | MotionError:
    """Return (4, N) of ṡ, s̈, s⃛, h from the first start that leads to a solution, or the error."""
    solution = try_starts(posed, starts)
    if isinstance(solution, MotionError):
        return solution
    return posed.columns(solution.states, solution.controls)
