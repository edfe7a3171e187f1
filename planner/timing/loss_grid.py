"""The grid of a jerk-limited run: fine where a rough solution loses time, coarse elsewhere."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.timing.grid import (
    MAX_INTERVALS,
    ROUGH_GRID,
    THIRD_ORDER,
    Rule,
    continue_problem,
    count_intervals,
    jerk_problem,
    place_problem,
)
from planner.timing.order3.solve import estimate_motion
from planner.timing.problem import Problem, Run
from planner.timing.profile import Profile
from planner.timing.solution import TooFast

# A rough solution that takes this many times as long as its guess does not show where time goes.
MAX_ROUGHNESS = 1.1
# Share of the duration that a grid may lose, as the rough solution predicts it, and how many times
# the usual number of intervals it may have for that. COPP's first 20 random splines (evidence
# random_splines) take 41.167, 41.162 and 41.157 s with shares of 4e-4, 3.5e-4 and 3e-4, and 73, 78
# and 87 ms to plan.
MAX_LOSS, MAX_FINENESS = 3.5e-4, 4
# Start speed of a run that continues a motion, as a share of the largest that its guess allows.
CONTINUED_START_SHARE = 0.99


def pose_usual_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    coarse: Problem,
    rule: Rule = THIRD_ORDER,
) -> tuple[Problem, Array] | MotionError:
    """Pose a run on the usual grid, with a guess (4, N) of ṡ, s̈, s⃛, h. Returns the refusal."""
    posed = jerk_problem(path, limits, run, coarse, rule)
    if isinstance(posed, TooFast) and run.continuation is not None:
        # the guess may be slower than the motion that is continued
        start = replace(run.ends[0], speed=CONTINUED_START_SHARE * posed.largest)
        slower = replace(run, ends=(start, run.ends[1]))
        posed = jerk_problem(path, limits, slower, replace(coarse, ends=slower.ends), rule)
    if isinstance(posed, MotionError):
        return posed
    return _begin(path, limits, run, *posed)


def _begin(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    problem: Problem,
    guess: Profile,
) -> tuple[Problem, Array]:
    """Put the guess on the grid. A run that continues a motion begins with that motion's grid."""
    if run.continuation is None:
        return problem, guess.on(problem.s)
    problem = continue_problem(path, limits, run, problem, run.continuation)
    columns = guess.on(problem.s)
    known = run.continuation.columns
    columns[:, : known.shape[1]] = known
    return problem, columns


def pose_by_loss(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    coarse: Problem,
) -> tuple[Problem, Array] | MotionError | None:
    """Pose a run on a grid that is fine where a rough solution loses time, with that as guess.

    An interval that is cut in m parts loses a share 1/m of its loss. For a total of M = Σ mₖ parts
    the loss Σ lossₖ/mₖ is least where mₖ ~ √lossₖ, and is then (Σ √lossₖ)²/M: that gives M.

    Returns None where the rough solution shows too little.
    """
    posed = pose_usual_problem(path, limits, run, coarse, ROUGH_GRID)
    if isinstance(posed, MotionError):
        return posed
    problem, guess = posed
    answer = estimate_motion(problem, guess)
    if isinstance(answer, MotionError):
        return None
    motion, loss = answer
    rough = motion.duration >= MAX_ROUGHNESS * float(guess[3].sum())
    if run.continuation is None and (rough or loss.sum() <= 0):
        return None
    weight = np.sqrt(loss)
    needed = float(weight.sum()) ** 2 / (MAX_LOSS * motion.duration)
    usual = count_intervals(THIRD_ORDER, path, run, on_top=True)
    finer = min(needed / usual, MAX_FINENESS, MAX_INTERVALS[3] / usual)
    run = replace(run, fineness=run.fineness * max(finer, 1.0))
    # the place where a limit binds may move a little
    neighbours = np.maximum(np.append(weight[1:], 0.0), np.append(0.0, weight[:-1]))
    weight = np.maximum(weight, neighbours / 2)
    return _begin(path, limits, run, place_problem(path, limits, run, motion, weight), motion)
