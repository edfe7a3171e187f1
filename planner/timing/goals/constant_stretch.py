"""One stretch at constant tool speed: the shortest ramp up, exactly that speed, and a ramp down.

The path's parameter is the tool's way here (planner.path.arc_length), so a constant ṡ is the tool's
speed, to 1e-10 of it.

The fastest motion under the speed as a cap shows where the ramps can end. At order 2 no motion is
faster anywhere [Pham and Pham 2018], so none reaches the speed earlier or leaves it later. At order
3 that is taken over as a rule, and ramps are some 1 % longer than the shortest found (exact where
the path is straight in the actuators). Between these two places the speed is kept, or the plan is
infeasible there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from planner.place import ConstantRefused
from planner.timing.attempts import solve_once, solve_run
from planner.timing.goals.constant_speed_errors import (
    Places,
    resonance_error,
    speed_error,
    too_short_error,
)
from planner.timing.grid import Task, make_grid
from planner.timing.problem import EndCondition
from planner.timing.profile import Profile
from planner.timing.solution import MADE_CONSTANT_SPEED, STRAIGHT, RunSolution

# A speed counts as reached from this share of it on, since motions aim at a little less. For ramps
# from closed forms, and from solvers at order 2 and 3.
REACHED_SHARE = {STRAIGHT: 2e-9, 2: 2e-6, 3: 1e-5}
# Lengths of a ramp that are tried in turn, as multiples of the shortest that was found: where the
# speed is just reached a solver has no room left. Under jerk limits the speed is approached as a
# parabola: its last 1e-5 take 0.5 % of a ramp.
RAMP_LENGTHENING = {
    STRAIGHT: (1 + 1e-8, 1.002, 1.02),
    2: (1.00001, 1.002, 1.02),
    3: (1.01, 1.03, 1.1),
}
# A ramp is solved again on its own finer grid while it gets shorter by this share, so often at most.
MIN_RAMP_GAIN = {STRAIGHT: 1e-3, 2: 1e-3, 3: 1.5e-2}
MAX_SOLVES = 4
# Time pieces at constant speed: at least, and for each radian that the path turns.
MIN_PIECES = 200
PIECES_PER_RADIAN = 100
# Points of a time piece at which limits are sampled, before the proof and where that finds one
# exceeded.
FIRST_POINTS = 3
CHECK_POINTS = 17


def solve_constant_stretch(task: Task, speed: float) -> tuple[RunSolution, ...]:
    """Solve a run at constant speed. An end at that speed has no ramp.

    Where a limit does not allow the speed, or the run is too short, the refusal is all there is.
    """
    refusal = resonance_error(task, speed)
    if refusal is not None:
        return (RunSolution.refused(refusal),)
    run = task.run
    places = run.breaks(task.path)[[0, -1]].tolist()
    ramps: list[list[RunSolution]] = [[], []]
    if min(run.speeds) < speed:
        capped = _solve_capped(task, speed)
        if not capped.solved:
            return (capped,)
        slower = [end for end in (0, 1) if run.speeds[end] < speed]
        shortest = [_RampSearch(task, speed, end).find_shortest(capped) for end in slower]
        for end, ramp in zip(slower, shortest, strict=True):
            if ramp is not None:
                ramps[end].append(ramp[0])
                places[end] = ramp[1]
        if None in shortest or places[0] >= places[1]:
            return (RunSolution.refused(too_short_error(task, capped.profile, speed)),)
    profile = _keep_speed(task, (places[0], places[1]), speed)
    samples = _list_places(profile, np.arange(len(profile.h)), FIRST_POINTS)
    refusal = speed_error(task, samples, speed)
    if refusal is not None:
        return (RunSolution.refused(refusal),)
    constant = RunSolution("solved", profile, profile.duration, MADE_CONSTANT_SPEED)
    return (*ramps[0], constant, *ramps[1])


def refuse_excess(task: Task, solution: RunSolution, use: Mapping[str, Array]) -> RunSolution:
    """Return the refusal where a constant speed is proved to exceed a limit: it cannot change."""
    profile = solution.profile
    exceeding = np.flatnonzero(np.max([*use.values()], axis=0) > 1)
    samples = _list_places(profile, exceeding, CHECK_POINTS)
    refusal = speed_error(task, samples, float(profile.v[0]))
    return solution if refusal is None else RunSolution.refused(refusal)


def joined_speed_error(task: Task, speed: float) -> ConstantRefused | None:
    """Return why the speed is not possible next to an end of the run that already has it.

    That is up to the run's middle, if a ramp fits in the other half; all of it without a ramp.
    """
    run = task.run
    if max(run.speeds) != speed:
        return None
    first, last = run.breaks(task.path)[[0, -1]].tolist()
    middle = (first + last) / 2
    needs_ramp = min(run.speeds) < speed
    slows_down = run.speeds[0] == speed
    if needs_ramp and slows_down:
        last = middle
    elif needs_ramp:
        first = middle
    profile = _keep_speed(task, (first, last), speed)
    samples = _list_places(profile, np.arange(len(profile.h)), CHECK_POINTS)
    refusal = speed_error(task, samples, speed)
    if refusal is None or not needs_ramp:
        return refusal
    ramp = _RampSearch(task, speed, end=1 if slows_down else 0).solve_to([middle])
    return None if ramp is None else refusal


def _solve_capped(task: Task, speed: float) -> RunSolution:
    """Solve for the fastest motion under the speed. Infeasible where no longer ramp would help."""
    solution = solve_run(task, tightened=False)
    if not solution.solved:
        return solution
    motion = solution.profile
    fastest = [int(np.argmax(motion.v))]
    if speed_error(task, (motion.s[fastest], motion.piece[fastest]), speed) is None:
        return solution
    refusal = speed_error(task, (motion.s, motion.piece), speed)
    return solution if refusal is None else RunSolution.refused(refusal)


@dataclass(frozen=True, slots=True)
class _RampSearch:
    """The search for the shortest ramp between an end of a run (0 or 1) and the speed."""

    task: Task
    speed: float
    end: int

    def find_shortest(self, capped: RunSolution) -> tuple[RunSolution, float] | None:
        """Return the shortest ramp and the place where it meets the speed; None without one.

        capped  the fastest motion under the speed
        """
        end = float(self.task.run.breaks(self.task.path)[-self.end])
        nearest = -1 if self.end else 0
        best: tuple[RunSolution, float] | None = None
        motion = capped
        for _ in range(MAX_SOLVES):
            profile = motion.profile
            kind = STRAIGHT if motion.method == STRAIGHT else self.task.order
            at_speed = np.flatnonzero(profile.v >= self.speed * (1 - REACHED_SHARE[kind]))
            if not len(at_speed):
                break
            length = float(profile.s[at_speed[nearest]]) - end
            if best is not None and abs(length) > abs(best[1] - end) * (1 - MIN_RAMP_GAIN[kind]):
                break
            ramp = self.solve_to([end + length * longer for longer in RAMP_LENGTHENING[kind]])
            if ramp is None:
                break
            best = ramp
            motion = ramp[0]
        return best

    def solve_to(self, places: Sequence[float]) -> tuple[RunSolution, float] | None:
        """Return the ramp to the first of some places that one leads to."""
        path = self.task.path
        run = self.task.run
        first, last = run.breaks(path)[[0, -1]].tolist()
        start, end = run.ends
        at_speed = EndCondition(self.speed)
        for place in places:
            if not first < place < last:
                break
            if self.end:
                part = replace(run.cut(path, place, last), ends=(at_speed, end))
            else:
                part = replace(run.cut(path, first, place), ends=(start, at_speed))
            ramp = solve_once(self.task.with_run(part))
            if ramp.solved:
                return ramp, place
        return None


def _keep_speed(task: Task, ends: tuple[float, float], speed: float) -> Profile:
    """Return the constant speed between two path lengths, in pieces short enough to prove."""
    path = task.path
    part = task.run.cut(path, *ends)
    turn = path.turns[part.first : part.last + 1].sum()
    count = max(MIN_PIECES, int(PIECES_PER_RADIAN * turn))
    s, piece = make_grid(path, part, count)
    zero = np.zeros(len(piece))
    return Profile(s[:-1], zero + speed, zero, zero, np.diff(s) / speed, piece)


def _list_places(profile: Profile, k: np.ndarray, points: int) -> Places:
    """Return some places of each time piece k of constant speed."""
    share = np.linspace(0, 1, points)
    s = profile.s[k, None] + (profile.v * profile.h)[k, None] * share
    return s.ravel(), np.repeat(profile.piece[k], points)
