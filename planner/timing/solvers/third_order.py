"""Time-optimal motion under limits on speed, acceleration and jerk.

Each interval of the fixed grid has the state (ṡ, s̈) at its start and the controls (s⃛, h): constant jerk over the
duration h.

    minimise Σ h (and a trace of jerk)
    such that Δs = ṡ h + s̈ h²/2 + s⃛ h³/6, the next state follows, and every row is kept

Rows with s⃛ are kept at both ends of every interval (the jerk jumps there), the others at starts and middles. Time is a
variable and ṡ², the usual choice, is not: nothing is singular at rest, derivatives of q are constants, s(t) is exact in
closed form. Solved by planner.timing.solvers.interior_point.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Term
from planner.timing.problem import SOLVER_AIM, EndCondition, Problem
from planner.timing.profile import Profile, close_profile
from planner.timing.sampling import MIN_WATCHED_USE
from planner.timing.solution import RunSolution
from planner.timing.solvers.interior_point import FAR_STARTS, TOLERANCE, WEIGHT, Minimum, Revise, Start, minimise
from planner.timing.solvers.stage_problem import PosedStages, pose_bounds, pose_stages
from planner.timing.solvers.stages import evaluate

# How often a problem is solved whose rows depend on the motion, unless a round gains less than this share.
MAX_ROW_ROUNDS, MIN_ROUND_GAIN = 4, 1e-4
# What a speed at an end is worth that is to be as large as can be, beside the duration.
END_SPEED_WEIGHT = 100.0
# How well a problem is solved that only says where time goes.
ROUGH = 1e-3
# Use of a limit from which its peaks between grid points count; by how much more room is left for them than they take,
# as they move a little with the motion that heeds them; the largest; and the least that a room is lowered by.
NEAR_USE, PEAK_FACTOR, MOST_PEAK, LEAST_LOWERED = 0.98, 1.05, 0.3, 1e-7
# Intervals from which a run is mended in windows, in a shorter one their ends would be felt; those beside one that is
# mended with it; the largest share of a run for which it is not all solved again; and how often.
LONG_RUN, MENDED_REACH, MOST_MENDED, MOST_MENDINGS = 2500, 60, 0.5, 4
# Excess that slowing a motion as a whole takes off at next to no cost.
SMALL_EXCESS = 4e-6
Look = Callable[[Profile, Collection[str]], Mapping[str, Array]]
"""A motion on a grid -> the largest share (N,) of each of some limits that it meets in each interval."""
# Share of an interval's time up to which that can be lost.
MOST_LOST = 0.1


def solve_jerk_limited(problem: Problem, guess: Array, start: Start = "far", look: Look | None = None) -> RunSolution:
    """The fastest motion. guess (4, N): ṡ, s̈, s⃛, h to start from; start: how far that is from the answer.

    Rows that speak only near some motions are taken near the guess, and then near each answer in turn.
    look: what is seen of a motion between grid points too; the answer is given the room to keep the limits there.
    """
    for _ in range(1 if problem.is_unconditional else MAX_ROW_ROUNDS):
        posed = settle_rows(problem, guess)
        found = third_order(posed, guess, start=start, look=look)
        if not found.solved:
            return found
        gained, guess = 1 - found.duration / guess[3].sum(), found.profile.columns()
        if abs(gained) < MIN_ROUND_GAIN:
            break
        start = "nearer"
    rooms = [block.room for block in found.problem.blocks] if found.problem is not None else []
    blocks = tuple(replace(block, room=room) for block, room in zip(problem.blocks, rooms, strict=True))
    return replace(found, problem=replace(problem, blocks=blocks))


def settle_rows(problem: Problem, columns: Array) -> Problem:
    """With the rows that speak near a motion (4, N), where not all speak near every one."""
    if problem.is_unconditional:
        return problem
    v, a, j, h = columns
    speed = v + h / 2 * (a + h * j / 4)  # in the middle, for both sides
    return problem.around(speed, speed)


def third_order(
    problem: Problem,
    guess: Array,
    *,
    fast_end: int | None = None,
    start: Start = "far",
    look: Look | None = None,
) -> RunSolution:
    """The fastest motion, s̈ zero at both ends but those where it is free. guess (4, N): ṡ, s̈, s⃛, h to start from.

    start: how far that is from the answer.
    fast_end: 0 for the start, 1 for the end: the motion with the largest speed there instead, up to the problem's.
    """
    seen: Mapping[str, Array] | None = None
    if fast_end == 1:
        columns = _solve_stages(problem.reversed(), _reverse_columns(guess), END_SPEED_WEIGHT)
        columns = columns if isinstance(columns, MotionError) else _reverse_columns(columns)
    elif look is None or fast_end == 0:
        columns = _solve_stages(problem, guess, 0.0 if fast_end is None else END_SPEED_WEIGHT, start)
    else:
        posed = pose_stages(problem, guess)
        peaks = _Peaks(problem, posed, look)
        answer = _try_starts(posed, (start,), revise=peaks)
        if isinstance(answer, MotionError):  # from there it is tried; anew, once some bounds were revised
            columns = minimise_posed(posed, [each for each in FAR_STARTS if each != start])
        else:
            columns, problem = _columns(posed, answer), peaks.problem
            if answer.status == "solved":
                columns, problem = _mend(peaks, answer, columns)
                seen = peaks.seen
    if isinstance(columns, MotionError):
        return RunSolution.refused(columns)
    if fast_end is not None:
        v, a, j, h = columns[:, -1]
        reached = (columns[0, 0], v + h * (a + h * j / 2))[fast_end]
        ends = list(problem.ends)
        speed = float(np.clip(reached, 0.0, ends[fast_end].speed))
        ends[fast_end] = replace(ends[fast_end], speed=speed)
        problem = replace(problem, ends=(ends[0], ends[1]))
    profile = close_profile(problem, columns)
    if isinstance(profile, MotionError):
        return RunSolution.refused(profile)
    return RunSolution("solved", profile, maker="riccati", problem=problem, use=seen)


class _Peaks:
    """Room for what a motion uses of the limits between grid points more than on them.

    That goes with the squares of the intervals and hardly changes with the motion: one that is given the room for what
    is seen of another uses the limits up. What a room has been lowered to, it is not raised from.
    """

    def __init__(self, problem: Problem, posed: PosedStages, look: Look) -> None:
        self.problem = self.given = problem
        self.posed, self.look = posed, look
        self.seen: Mapping[str, Array] | None = None
        """What the motion was seen to use that answers the problem."""
        self.windows: list[tuple[int, int]] = []
        """First intervals, and those behind the last ones, in which that motion is to be mended."""
        self._watched: Collection[str] = {block.name for block in problem.blocks}

    def __call__(self, states: Array, controls: Array, values: Array) -> tuple[Array, Array] | None:
        rows, unit = self.posed[1], self.posed[-1]
        v, a, j, h = np.concatenate([states[:-1].T, controls.T]) * unit[:, None]
        use = self.look(Profile(self.problem.s[:-1], v, a, j, h, self.problem.piece), self._watched)
        self._watched = {name for name, each in use.items() if each.max() > MIN_WATCHED_USE}
        count, last = int(rows.size.sum()), 0
        lowered, blocks = np.zeros(self.problem.intervals, bool), []
        for block in self.problem.blocks:
            own = slice(last, last + block.middle.size)
            last = own.stop
            first, second = (block.share(half[:, own]).max(1) for half in (values[:, :count], values[:, count:]))
            there = np.maximum(first, second)
            if Term.SDDD not in block.start:  # kept in the middle, and where the next one starts
                there[:-1] = np.maximum(there[:-1], first[1:])
            used = use.get(block.name, there)
            room = np.where(used > NEAR_USE, SOLVER_AIM - (used - there).clip(0.0, MOST_PEAK), 1.0)
            short = room < block.room - LEAST_LOWERED
            room = np.where(short, SOLVER_AIM - PEAK_FACTOR * (SOLVER_AIM - room), block.room)
            lowered |= short
            blocks.append(replace(block, room=room))
        # nothing is looked at any more where the motion uses less than half of every limit
        largest = max((float(each.max()) for each in use.values()), default=0.0)
        exceeds = largest > 1 + SMALL_EXCESS
        first = self.problem is self.given
        self.seen, self.windows = None, []
        if not lowered.any() or not (exceeds or first):
            self.seen = use
            return None
        self.problem = replace(self.problem, blocks=tuple(blocks))
        windows = _join_windows(np.flatnonzero(lowered), len(lowered))
        if (
            first
            or len(lowered) < LONG_RUN
            or sum(last - start for start, last in windows) > MOST_MENDED * len(lowered)
        ):
            return pose_bounds(self.problem)
        self.windows = windows
        return None


def _join_windows(lowered: np.ndarray, count: int) -> list[tuple[int, int]]:
    """About each of some intervals, of so many, MENDED_REACH more on either side; those that overlap are one."""
    apart = np.flatnonzero(np.diff(lowered) > 2 * MENDED_REACH)
    starts, lasts = lowered[np.append(0, apart + 1)], lowered[np.append(apart, len(lowered) - 1)]
    return [
        (max(0, int(a) - MENDED_REACH), min(count, int(b) + 1 + MENDED_REACH))
        for a, b in zip(starts, lasts, strict=True)
    ]


def _mend(peaks: _Peaks, answer: Minimum, columns: Array) -> tuple[Array, Problem]:
    """An answer solved again in the windows only in which it exceeds limits between grid points, and its problem.

    A long run takes the more iterations, the longer it is, as its worst stage shortens the steps of all.
    """
    stages, rows, *_, unit = peaks.posed
    values = np.empty(rows.low.shape)
    for _ in range(MOST_MENDINGS):
        mended = columns.copy()
        for first, last in peaks.windows:
            found = _solve_window(peaks.problem, columns, first, last)
            if isinstance(found, MotionError):  # whoever solves it all again may do it
                return columns, peaks.problem
            mended[:, first:last] = found
        if not peaks.windows:
            break
        columns = mended
        states, controls = answer.states.copy(), np.ascontiguousarray((columns[2:] / unit[2:, None]).T)
        states[:-1] = (columns[:2] / unit[:2, None]).T
        evaluate(stages, rows, states, controls, values)
        peaks(states, controls, values)
    return columns, peaks.problem


def _solve_window(problem: Problem, columns: Array, first: int, last: int) -> Array | MotionError:
    """Columns (4, last − first) of some intervals, between the states that the run has there."""
    start, end = first == 0, last == problem.intervals
    there = columns[:2, -1] if end else columns[:2, last]
    part = replace(
        problem.part(slice(first, last)),
        ends=(
            problem.ends[0] if start else EndCondition(*columns[:2, first].tolist()),
            problem.ends[1] if end else EndCondition(*there.tolist()),
        ),
    )
    posed = pose_stages(part, columns[:, first:last])
    answer = _try_starts(posed, ("near",))
    return answer if isinstance(answer, MotionError) else _columns(posed, answer)


def estimate_motion(problem: Problem, guess: Array) -> tuple[Profile, Array] | MotionError:
    """About the fastest motion, and (N,) s, how much of its time each interval takes for want of a finer grid.

    s⃛ is constant over an interval, so that of a row with s⃛ what changes from one end to the other is left unused at
    one of them: by the row's multiplier, that is worth so much time. It falls with the square of the interval.
    """
    fixed = settle_rows(problem, guess)
    posed = pose_stages(fixed, guess)
    answer = _try_starts(posed, ("rough",), ROUGH)
    if isinstance(answer, MotionError):
        return answer
    profile = close_profile(fixed, _columns(posed, answer))
    if isinstance(profile, MotionError):
        return profile
    stages, rows, *_, unit = posed
    values = np.empty(rows.low.shape)
    evaluate(stages, rows, answer.states, answer.controls, values)
    count = int(rows.size.sum())
    jerk = np.flatnonzero(np.repeat(rows.at_end, rows.size))
    forces = np.where(rows.low > -np.inf, answer.low_forces, 0.0) + np.where(
        rows.high < np.inf, answer.high_forces, 0.0
    )
    change = np.abs(values[:, count + jerk] - values[:, jerk])
    unused = ((forces[:, jerk] + forces[:, count + jerk]) * change).sum(1) / 2
    return profile, np.minimum(unused / WEIGHT * unit[3], MOST_LOST * profile.h)


def _solve_stages(problem: Problem, guess: Array, prize: float, start: Start = "far") -> Array | MotionError:
    """Columns (4, N) of ṡ, s̈, s⃛, h, or why there are none."""
    return minimise_posed(pose_stages(problem, guess, prize), tuple(dict.fromkeys((start, *FAR_STARTS))))


def minimise_posed(posed: PosedStages, attempts: Sequence[Start]) -> Array | MotionError:
    """Columns (4, N) of ṡ, s̈, s⃛, h by the first attempt with an answer, or why there is none."""
    answer = _try_starts(posed, attempts)
    if isinstance(answer, MotionError):
        return answer
    return _columns(posed, answer)


def _columns(posed: PosedStages, answer: Minimum) -> Array:
    return np.asarray(np.concatenate([answer.states[:-1].T, answer.controls.T]) * posed[-1][:, None])


def _try_starts(
    posed: PosedStages, attempts: Sequence[Start], tolerance: float = TOLERANCE, revise: Revise | None = None
) -> Minimum | MotionError:
    stages, rows, states, controls, _ = posed
    numbers = (states, controls, stages.jerks, stages.pushes, rows.first, rows.second)
    if not (all(np.isfinite(each).all() for each in numbers) and (stages.step > 0).all()):
        return MotionError("the jerk-limited problem holds what is no number, or an interval of no length")
    for start in attempts:
        answer = minimise(stages, rows, states, controls, start, tolerance, revise)
        if answer.status in ("solved", "loose"):
            return answer
    return MotionError(
        f"the jerk-limited solver stopped without an answer ({answer.status}, {answer.iterations} iterations)"
    )


def _reverse_columns(columns: Array) -> Array:
    """(4, N) of ṡ, s̈, s⃛, h of the same motion from its end to its start."""
    v, a, j, h = columns[:, ::-1]
    return np.stack([v + h * (a + h * j / 2), -(a + h * j), j, h])
