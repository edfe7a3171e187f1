"""One stretch at constant tool speed: the shortest ramp up, exactly that speed, and a ramp down.

The path's parameter is the tool's way here (planner.path.arc_length), so a constant ṡ is the tool's
speed, to 1e-10 of it.

The fastest motion under the speed as a cap shows where the ramps can end. At order 2 no motion is
faster anywhere [Pham and Pham 2018], so none reaches the speed earlier or leaves it later. At order
3 that is taken over as a rule, and ramps are some 1 % longer than the shortest found (exact where
the path is straight in the actuators). Between these two places the speed is kept, or the plan is
infeasible there.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from planner.place import ConstantRefused
from planner.timing.attempts import solve_once, solve_run
from planner.timing.cruise import keep_speed
from planner.timing.goals.constant_speed_errors import (
    Places,
    resonance_error,
    speed_error,
    too_short_error,
)
from planner.timing.grid import Task
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
# A ramp is solved on the length that the capped motion takes for it, whose grid may be far too
# coarse, and again on the length that it takes itself. More solves gain less than 1e-7 of the run.
RAMP_SOLVES = 2
# Points of a time piece at which limits are sampled.
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
    ramps: dict[int, RunSolution] = {}
    slower = [end for end in (0, 1) if run.speeds[end] < speed]
    if slower:
        capped = solve_run(task, tightened=False)
        if not capped.solved:
            return (capped,)
        for end in slower:
            ramp = _RampSearch(task, speed, end).find_shortest(capped)
            if ramp is None:
                break
            ramps[end], places[end] = ramp
        if len(ramps) < len(slower) or places[0] >= places[1]:
            motion = capped.profile
            refusal = speed_error(task, (motion.s, motion.piece), speed)
            refusal = refusal or too_short_error(task, motion, speed)
            return (RunSolution.refused(refusal),)
    profile = _keep_speed(task, (places[0], places[1]), speed)
    refusal = speed_error(task, _list_places(profile), speed)
    if refusal is not None:
        return (RunSolution.refused(refusal),)
    constant = RunSolution("solved", profile, profile.duration, MADE_CONSTANT_SPEED)
    parts = (ramps.get(0), constant, ramps.get(1))
    return tuple(part for part in parts if part is not None)


def refuse_excess(task: Task, solution: RunSolution, use: Mapping[str, Array]) -> RunSolution:
    """Return the refusal where a constant speed is proved to exceed a limit: it cannot change."""
    exceeds = np.repeat(np.max([*use.values()], axis=0) > 1, CHECK_POINTS)
    s, piece = _list_places(solution.profile)
    speed = float(solution.profile.v[0])
    refusal = speed_error(task, (s[exceeds], piece[exceeds]), speed)
    return solution if refusal is None else RunSolution.refused(refusal)


def joined_speed_error(task: Task, speed: float) -> ConstantRefused | None:
    """Return why the speed is not possible next to an end of the run that already has it.

    That is up to the run's middle, if a ramp fits in the other half; all of it without a ramp.
    """
    run = task.run
    if max(run.speeds) != speed:
        return None
    ends = run.breaks(task.path)[[0, -1]].tolist()
    middle = (ends[0] + ends[1]) / 2
    needs_ramp = min(run.speeds) < speed
    slower = int(np.argmin(run.speeds))
    if needs_ramp:
        ends[slower] = middle
    profile = _keep_speed(task, (ends[0], ends[1]), speed)
    refusal = speed_error(task, _list_places(profile), speed)
    if refusal is None or not needs_ramp:
        return refusal
    ramp = _RampSearch(task, speed, slower).solve_to(middle)
    return refusal if ramp.solved else None


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
        ends = self.task.run.breaks(self.task.path)[[0, -1]].tolist()
        end = ends[self.end]
        nearest = -1 if self.end else 0
        best: tuple[RunSolution, float] | None = None
        motion = capped
        for _ in range(RAMP_SOLVES):
            profile = motion.profile
            kind = STRAIGHT if motion.method == STRAIGHT else self.task.order
            at_speed = profile.s[profile.v >= self.speed * (1 - REACHED_SHARE[kind])]
            if not len(at_speed):
                break
            length = float(at_speed[nearest]) - end
            places = (end + length * longer for longer in RAMP_LENGTHENING[kind])
            inside = (place for place in places if ends[0] < place < ends[1])
            ramps = ((self.solve_to(place), place) for place in inside)
            ramp = next((each for each in ramps if each[0].solved), None)
            if ramp is None:
                break
            best = ramp
            motion = ramp[0]
        return best

    def solve_to(self, place: float) -> RunSolution:
        """Return the ramp between the end of the run and a place at which it has the speed."""
        run = self.task.run
        ends = run.breaks(self.task.path)[[0, -1]].tolist()
        conditions = list(run.ends)
        ends[1 - self.end] = place
        conditions[1 - self.end] = EndCondition(self.speed)
        part = run.cut(self.task.path, *ends)
        return solve_once(self.task.with_run(replace(part, ends=(conditions[0], conditions[1]))))


def _keep_speed(task: Task, ends: tuple[float, float], speed: float) -> Profile:
    """Return the constant speed between two path lengths."""
    part = task.run.cut(task.path, *ends)
    pieces = np.arange(part.first, part.last + 1)
    return keep_speed(task.path, part.breaks(task.path), pieces, np.full(len(pieces), speed))


def _list_places(profile: Profile) -> Places:
    """Return some places of each time piece of constant speed."""
    share = np.linspace(0, 1, CHECK_POINTS)
    s = profile.s[:, None] + (profile.v * profile.h)[:, None] * share
    return s.ravel(), np.repeat(profile.piece, CHECK_POINTS)
