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
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.place import ConstantRefused
from planner.timing.attempts import solve_once, solve_run
from planner.timing.goals.constant_speed_errors import (
    is_allowed,
    resonance_error,
    speed_error,
    too_short_error,
)
from planner.timing.grid import make_grid
from planner.timing.problem import EndCondition, Run
from planner.timing.profile import Profile
from planner.timing.solution import MADE_CONSTANT_SPEED, STRAIGHT, RunSolution

# A speed counts as reached from this share of it on, since motions aim at a little less. For ramps
# from closed forms, and from solvers at order 2 and 3.
REACHED_SHARE = {STRAIGHT: 2e-9, 2: 2e-6, 3: 1e-5}
# Lengths of a ramp that are tried in turn, as multiples of the shortest that was found: where the
# speed is just reached a solver has no room left. Under jerk limits the speed is approached as a
# parabola: its last 1e-5 take 0.5 % of a ramp.
RAMP_LENGTHENING = {STRAIGHT: (1 + 1e-8, 1.002, 1.02), 2: (1.00001, 1.002, 1.02), 3: (1.01, 1.03, 1.1)}
# A ramp is solved again on its own finer grid while it gets shorter by this share, so often at most.
MIN_RAMP_GAIN, MAX_SOLVES = {STRAIGHT: 1e-3, 2: 1e-3, 3: 1.5e-2}, 4
# Time pieces at constant speed: at least, and for each radian that the path turns.
MIN_PIECES, PIECES_PER_RADIAN = 200, 100
# Points of a time piece at which limits are sampled, before the proof and where that finds one
# exceeded.
FIRST_POINTS, CHECK_POINTS = 3, 17


def solve_constant_stretch(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    order: int,
    speed: float,
) -> tuple[RunSolution, ...]:
    """Solve a run at constant speed. An end at that speed has no ramp.

    Where a limit does not allow the speed, or the run is too short, the refusal is all there is.
    """
    refusal = resonance_error(path, limits, run, speed)
    if refusal is not None:
        return (RunSolution.refused(refusal),)
    breaks = run.breaks(path)
    places = [float(breaks[0]), float(breaks[-1])]
    ramps: list[list[RunSolution]] = [[], []]
    if min(run.speeds) < speed:
        capped = _solve_capped(path, limits, run, order, speed)
        if not capped.solved:
            return (capped,)
        for end in (0, 1):
            if run.speeds[end] < speed:
                search = _RampSearch(path, limits, run, order, speed, end)
                ramp = search.find_shortest(capped)
                if ramp is None:
                    return _refuse_short(path, limits, capped, speed)
                ramps[end].append(ramp[0])
                places[end] = ramp[1]
        if places[0] >= places[1]:
            return _refuse_short(path, limits, capped, speed)
    profile = _keep_speed(path, run, (places[0], places[1]), speed)
    samples = _list_places(profile, np.arange(len(profile.h)), FIRST_POINTS)
    refusal = speed_error(path, limits, *samples, speed)
    if refusal is not None:
        return (RunSolution.refused(refusal),)
    constant = RunSolution("solved", profile, profile.duration, MADE_CONSTANT_SPEED)
    return (*ramps[0], constant, *ramps[1])


def _refuse_short(
    path: ActuatorPath,
    limits: Sequence[Limit],
    capped: RunSolution,
    speed: float,
) -> tuple[RunSolution]:
    return (RunSolution.refused(too_short_error(path, limits, capped.profile, speed)),)


def refuse_excess(
    path: ActuatorPath,
    limits: Sequence[Limit],
    solution: RunSolution,
    use: Mapping[str, Array],
) -> RunSolution:
    """Return the refusal where a constant speed is proved to exceed a limit: it cannot change."""
    profile = solution.profile
    exceeding = np.flatnonzero(np.max([*use.values()], axis=0) > 1)
    samples = _list_places(profile, exceeding, CHECK_POINTS)
    refusal = speed_error(path, limits, *samples, float(profile.v[0]))
    return solution if refusal is None else RunSolution.refused(refusal)


def joined_speed_error(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    order: int,
    speed: float,
) -> ConstantRefused | None:
    """Return why the speed is not possible next to an end of the run that already has it.

    That is up to the run's middle, if a ramp fits in the other half; all of it without a ramp.
    """
    breaks = run.breaks(path)
    first = float(breaks[0])
    last = float(breaks[-1])
    if max(run.speeds) != speed:
        return None
    if min(run.speeds) == speed:
        return speed_error(path, limits, *_sample(path, run, (first, last), speed), speed)
    middle = (first + last) / 2
    down = run.speeds[0] == speed
    half = (first, middle) if down else (middle, last)
    samples = _sample(path, run, half, speed)
    if is_allowed(path, limits, *samples, speed):
        return None
    search = _RampSearch(path, limits, run, order, speed, end=1 if down else 0)
    if search.solve_to([middle]) is None:
        return None
    return speed_error(path, limits, *samples, speed)


def _sample(
    path: ActuatorPath,
    run: Run,
    ends: tuple[float, float],
    speed: float,
) -> tuple[Array, np.ndarray]:
    """Return dense places between two path lengths, and their path pieces."""
    profile = _keep_speed(path, run, ends, speed)
    return _list_places(profile, np.arange(len(profile.h)), CHECK_POINTS)


def _solve_capped(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    order: int,
    speed: float,
) -> RunSolution:
    """Solve for the fastest motion under the speed. Infeasible where no longer ramp would help."""
    solution = solve_once(path, limits, run, order)
    if not solution.solved:
        solution = solve_run(path, limits, run, order)
    if not solution.solved:
        return solution
    motion = solution.profile
    fastest = [int(np.argmax(motion.v))]
    if is_allowed(path, limits, motion.s[fastest], motion.piece[fastest], speed):
        return solution
    refusal = speed_error(path, limits, motion.s, motion.piece, speed)
    return solution if refusal is None else RunSolution.refused(refusal)


@dataclass(frozen=True, slots=True)
class _RampSearch:
    """The search for the shortest ramp between an end of a run (0 or 1) and the speed."""

    path: ActuatorPath
    limits: Sequence[Limit]
    run: Run
    order: int
    speed: float
    end: int

    def find_shortest(self, capped: RunSolution) -> tuple[RunSolution, float] | None:
        """Return the shortest ramp and the place where it meets the speed; None without one.

        capped  the fastest motion under the speed
        """
        end = float(self.run.breaks(self.path)[-self.end])
        nearest = -1 if self.end else 0
        best: tuple[RunSolution, float] | None = None
        motion = capped
        for _ in range(MAX_SOLVES):
            profile = motion.profile
            kind = STRAIGHT if motion.method == STRAIGHT else self.order
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
        run = self.run
        breaks = run.breaks(self.path)
        start, last = run.ends
        at_speed = EndCondition(self.speed)
        for place in places:
            if not breaks[0] < place < breaks[-1]:
                break
            piece = run.first + int(np.searchsorted(breaks, place)) - 1
            if self.end:
                part = replace(run, first=piece, since=place, ends=(at_speed, last))
            else:
                part = replace(run, last=piece, until=place, ends=(start, at_speed))
            ramp = solve_once(self.path, self.limits, part, self.order)
            if ramp.solved:
                return ramp, place
        return None


def _keep_speed(
    path: ActuatorPath,
    run: Run,
    ends: tuple[float, float],
    speed: float,
) -> Profile:
    """Return the constant speed between two path lengths, in pieces short enough to prove."""
    since, until = ends
    breaks = run.breaks(path)
    first = run.first + int(np.searchsorted(breaks, since, side="right")) - 1
    last = run.first + int(np.searchsorted(breaks, until)) - 1
    turn = path.turns[first : last + 1].sum()
    count = max(MIN_PIECES, int(PIECES_PER_RADIAN * turn))
    s, piece = make_grid(path, Run(first, last, since=since, until=until), count)
    zero = np.zeros(len(piece))
    return Profile(s[:-1], zero + speed, zero, zero, np.diff(s) / speed, piece)


def _list_places(profile: Profile, k: np.ndarray, points: int) -> tuple[Array, np.ndarray]:
    """Return some places of each time piece k of constant speed, and their path pieces."""
    share = np.linspace(0, 1, points)
    s = profile.s[k, None] + (profile.v * profile.h)[k, None] * share
    return s.ravel(), np.repeat(profile.piece[k], points)
