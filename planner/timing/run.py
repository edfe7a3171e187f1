"""One run, on its way to a motion that holds: posed, solved, tightened, solved again; with rests if need be.

A leg: a part of a run between two places where it rests, or all of it, on its way to a motion that holds.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit
from planner.place import Infeasible
from planner.timing.brief import ramped
from planner.timing.discretization import (
    START_GRID,
    acceleration_problem,
    brief_problem,
    coarse_jerk_problem,
    jerk_problem,
    refine_problem,
)
from planner.timing.ends import TooFast, largest_end_speed
from planner.timing.lower_bound import floor
from planner.timing.problem import EXACT_AIM, SOLVER_AIM, Block, Problem, Run
from planner.timing.profile import Profile, sample_limit_use
from planner.timing.solvers.closed_form import straight
from planner.timing.solvers.second_order import TERMS as SECOND
from planner.timing.solvers.second_order import second_order
from planner.timing.solvers.third_order import third_order

# Room taken off: this share of the excess, more with every try, and a little for the solver's own tolerance.
EXCESS_FACTOR, SOLVER_MARGIN = 1.1, 2e-7
# How often a leg is solved before it is slowed instead.
MAX_TRIES = 5
# A motion that only so much slowness keeps from holding is slowed: solving again would cost more than it gains.
MAX_CHEAP_SLOWNESS = 1 + 3e-5
# Up to here slowness is told as what it is: the last touch of a motion, not its maker.
MAX_UNTOLD_SLOWNESS = 1 + 1e-4
AVERAGED, STRAIGHT = "averaged", "straight"
# How often an order-3 leg is solved where rows depend on the motion, unless a round gains less than this share.
MAX_ROUNDS, MIN_ROUND_GAIN = 4, 1e-4
# Intervals up to which IPOPT is asked where FATROP gives no answer: its time grows faster than theirs.
MAX_IPOPT_INTERVALS = 600


@dataclass(frozen=True, slots=True)
class Candidate:
    """A problem, the profile that answers it, and who gave it.

    floor: an estimate of the least time that the leg can take (s)
    tries: how often it was solved. The peaks between grid points heed the room only in part: each try takes off more
    slowness: how many times as long as the answer the profile is, where it was slowed as a whole
    """

    run: Run
    problem: Problem
    profile: Profile
    by: str
    order: int
    floor: float
    tries: int = 1
    slowness: float = 1.0

    @property
    def method(self) -> str:
        if self.slowness == 1:
            return self.by
        return f"{self.by}, slowed" if self.slowness > MAX_UNTOLD_SLOWNESS else f"{self.by}, slowed by less than 0.01 %"

    @property
    def aim(self) -> float:
        """The share of every limit that it aims at."""
        return EXACT_AIM if self.by == STRAIGHT else SOLVER_AIM

    def aimed(self, use: Mapping[str, Array]) -> dict[str, Array]:
        """Shares of the limits as shares of what it aims at."""
        return {name: values / self.aim for name, values in use.items()}

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Candidate":
        """Solved again with less room wherever a limit was found exceeded: use per limit and interval, as `aimed`.

        Where that does not help, or would cost more than it gains, the same motion slowed as a whole: what holds
        wherever anything does. Only a leg from rest to rest can be slowed: another is tried on.
        """
        moving, solved = max(self.problem.speeds) > 0, self.by not in (AVERAGED, STRAIGHT) and self.slowness == 1
        if solved and (moving or (slowness > MAX_CHEAP_SLOWNESS and self.tries < MAX_TRIES)):
            blocks = tuple(
                tightened(block, use[block.name], self.tries) if block.name in use else block  # START is no limit
                for block in self.problem.blocks
            )
            problem = replace(self.problem, blocks=blocks)
            try:
                profile, by = self._solved(problem)
                return replace(self, problem=problem, profile=profile, by=by, tries=self.tries + 1)
            except MotionError:
                if moving:
                    raise
        if moving:
            raise MotionError(
                f"no motion from {self.problem.speeds[0]:.6g} to {self.problem.speeds[1]:.6g} along the path was found "
                "that keeps every limit; ask for slower ends"
            )
        return replace(self, profile=self.profile.slowed(slowness), slowness=self.slowness * slowness)

    def _solved(self, problem: Problem) -> tuple[Profile, str]:
        if self.order == 2:
            return second_order(problem, solver=self.run.solver), self.run.solver
        return solve_jerk_limited(problem, self.profile.columns())


def required_slowness(limits: Sequence[Limit], use: Mapping[str, Array]) -> float:
    """How many times slower a motion that uses so much of the limits must be, to keep them all."""
    return max(limit.slowness(float(use[limit.name].max())) for limit in limits if limit.name in use)


def tightened(block: Block, excess: Array, tries: int) -> Block:
    """With less room where there was an excess (N,): of the part of it that holding still does not use."""
    less = block.aimed((1 - SOLVER_MARGIN) / (1 + EXCESS_FACTOR * tries * (excess - 1) / (1 - block.still)))
    return replace(block, room=np.where(excess > 1 + SOLVER_MARGIN, less.room, block.room))


def solve_jerk_limited(
    problem: Problem, guess: Array, *, patient: bool | None = None, **options: Any
) -> tuple[Profile, str]:
    """By FATROP, or by IPOPT where that gives no answer to a problem of few intervals; which of them is told.

    patient: whether IPOPT is asked. If not told, from rest to rest only: between given speeds there may be no answer,
    which takes it up to a minute to find out.
    Rows that speak only near some motions are taken near the guess, and then near each answer in turn.
    """
    if not problem.settled:
        for _ in range(MAX_ROUNDS):
            v, a, j, h = guess
            speed = v + h / 2 * (a + h * j / 4)  # in the middle, for both sides
            profile, method = solve_jerk_limited(problem.around(speed, speed), guess, patient=patient, **options)
            gained, guess = 1 - profile.duration / h.sum(), profile.columns()
            if abs(gained) < MIN_ROUND_GAIN:
                break
        return profile, method
    try:
        return third_order(problem, guess, **options), "fatrop"
    except MotionError:
        asked = max(problem.speeds) == 0 if patient is None else patient
        if not asked or problem.intervals > MAX_IPOPT_INTERVALS:
            raise
        return third_order(problem, guess, solver="ipopt", **options), "ipopt"


# A leg that has to be this much slower as a whole is tried in two, with a rest between: what is slow there stays there.
MIN_SPLIT_SLOWNESS = 1.01
# Shares of the largest speed at an end without a jerk limit, from which the largest with one is sought.
END_SPEED_SHARES = (0.9, 0.5, 0.2)
# From its answer a solver finds a larger one still, as the grid is made for the motion to start from: until it changes
# by no more than this share, and so often at most.
SETTLED_CHANGE, MAX_RESOLVES = 1e-4, 3
# Shares of the largest speed that a solver finds for an end, tried in turn until one leads to a motion that holds; then
# halvings between that and the one before it.
NEAR_SHARES, HALVINGS = (0.9995, 0.998, 0.99, 0.95, 0.8, 0.5), 3


@dataclass(frozen=True, slots=True)
class Attempt:
    """A motion along a run: one leg, or several with a rest between each two."""

    legs: tuple[Candidate, ...]
    limits: tuple[Limit, ...] = field(repr=False)

    @property
    def profile(self) -> Profile:
        return Profile.joined([leg.profile for leg in self.legs])

    @property
    def method(self) -> str:
        """What gave the motion, whether it was slowed, and whether it rests where the path does not ask for it."""
        told = list(dict.fromkeys(leg.method for leg in self.legs))
        return ", ".join(told if len(self.legs) == 1 else [*told, "with rests"])

    @property
    def floor(self) -> float:
        """An estimate of the least time that the run can take (s): of a motion without the rests between legs."""
        return sum(leg.floor for leg in self.legs)

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Attempt":
        """Every leg that exceeds a limit made to exceed it less: use per limit and time piece."""
        legs, first = [], 0
        for leg in self.legs:
            last = first + len(leg.profile.h)
            own = leg.aimed({name: values[first:last] for name, values in use.items()})
            slower, first = required_slowness(self.limits, own), last
            legs.append(leg.tightened(own, slower) if slower > 1 + SOLVER_MARGIN or len(self.legs) == 1 else leg)
        return replace(self, legs=tuple(legs))

    def slowed(self, slowness: float) -> "Attempt | None":
        """The same motion, so many times as long; None for one that does not begin and end at rest."""
        if any(max(leg.problem.speeds) > 0 for leg in self.legs):
            return None
        legs = (
            replace(leg, profile=leg.profile.slowed(slowness), slowness=leg.slowness * slowness) for leg in self.legs
        )
        return replace(self, legs=tuple(legs))


def solve_run(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, *, probing: bool = False) -> Attempt:
    """The first solve of a run. Raises Infeasible for end speeds that cannot be, MotionError if nothing bounds it.

    probing: just that one solve, for whoever has other runs to try if it gives no answer or none that holds.
    """
    try:
        legs = [_solved(path, limits, run, order)] if probing else [*_solve_legs(path, limits, run, order)]
        return Attempt(tuple(legs), tuple(limits))
    except TooFast as no:
        end = (run.first, run.last)[no.end]
        place = path.place(float(run.breaks(path)[-no.end]), end)
        unit, scale = ("mm/s", 1e3) if place.segment is not None else ("/s", 1.0)
        remedy = f"{no.largest * scale:.6g} {unit} is the largest that the limits leave room for"
        remedy += ", from rest or to rest at the other end: both are too high" if no.both else ""
        raise Infeasible(no.name, "path", place, no.speed * scale, no.largest * scale, unit, remedy) from None


def _solve_legs(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int) -> Iterator[Candidate]:
    """The run in one leg; in two, and so on, where a solver has no answer for it or none that holds unslowed."""
    try:
        leg = _settle_leg(path, limits, _solved(path, limits, run, order))
    except TooFast:
        if order == 3:
            straight(coarse_jerk_problem(path, limits, run))  # what that refuses, it refuses exactly
            _refuse_ends(path, limits, run)
        raise
    except MotionError:
        if order == 2:
            raise
        _refuse_ends(path, limits, run)
        yield from (
            _solve_patiently(path, limits, run) or _solve_halves(path, limits, run) or [_average_leg(path, limits, run)]
        )
        return
    if order == 3 and leg.slowness > MIN_SPLIT_SLOWNESS:
        others = [_solve_halves(path, limits, run)]
        if max(run.speeds) == 0:  # what the solver started from may be faster than its answer, slowed
            others.append([_average_leg(path, limits, run)])
        yield from min([[leg], *filter(None, others)], key=lambda legs: sum(part.profile.duration for part in legs))
        return
    yield leg


def _solve_patiently(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> list[Candidate]:
    """Between speeds that are not refused: by whatever solver finds a motion. Empty where none does."""
    if max(run.speeds) == 0:
        return []
    try:
        return [_settle_leg(path, limits, _solved(path, limits, run, 3, patient=True))]
    except MotionError:
        return []


def _solved(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, *, patient: bool | None = None
) -> Candidate:
    """The run in one leg, solved once; patient: as `solve_jerk_limited` has it."""
    if order == 2:
        problem = acceleration_problem(path, limits, run)
        profile = straight(problem) if run.solver == "passes" else None
        if profile is not None:
            return Candidate(run, problem, profile, STRAIGHT, order, EXACT_AIM * profile.duration)
        profile = second_order(problem, solver=run.solver)
        finer = refine_problem(path, limits, problem, profile)
        if finer is not None:
            problem, profile = finer, second_order(finer, solver=run.solver)
        least = floor(problem, profile if run.solver == "passes" else None)
        return Candidate(run, problem, profile, run.solver, order, least)
    coarse = coarse_jerk_problem(path, limits, run)
    profile = straight(coarse)
    if profile is not None:
        return Candidate(run, coarse, profile, STRAIGHT, order, EXACT_AIM * profile.duration)
    leg = _ramped(path, limits, run, coarse)
    if (
        leg is not None
        and required_slowness(limits, leg.aimed(sample_limit_use(path, limits, leg.profile))) <= MAX_UNTOLD_SLOWNESS
    ):
        return leg
    problem, start = jerk_problem(path, limits, run, coarse)
    profile, by = solve_jerk_limited(problem, start.on(problem.s), patient=patient)
    return Candidate(run, problem, profile, by, order, floor(coarse))


def _ramped(path: ActuatorPath, limits: Sequence[Limit], run: Run, coarse: Problem) -> Candidate | None:
    """The order-2 motion with ramps of s̈ that are brief beside it, where they are: no longer than it by more."""
    brief = brief_problem(path, limits, run, coarse)
    if brief is None:
        return None
    problem, window = brief
    sharp = Candidate(run, problem, second_order(problem), run.solver, 2, 0.0)
    sharp = _settle_leg(path, [limit for limit in limits if limit.terms <= SECOND], sharp)
    profile = ramped(sharp.profile, window, run.breaks(path), run.first)
    if profile is None:
        return None
    stated = replace(problem, blocks=tuple(block for block in problem.blocks if block.name != START_GRID))
    return Candidate(run, problem, profile, AVERAGED, 3, floor(stated))


def _settle_leg(path: ActuatorPath, limits: Sequence[Limit], leg: Candidate) -> Candidate:
    """Solved again, or slowed where that costs next to nothing, until no limit is seen to be exceeded.

    A proof takes far longer than a look: most runs need one only.
    """
    while leg.tries < MAX_TRIES:
        use = leg.aimed(sample_limit_use(path, limits, leg.profile))
        slowness = required_slowness(limits, use)
        if slowness <= 1 + SOLVER_MARGIN:
            break
        before, leg = leg, leg.tightened(use, slowness)
        if leg.problem is before.problem:  # slowed as a whole: that holds
            break
    return leg


def _average_leg(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Candidate:
    """What an order-3 solve starts from: a motion whatever solvers do, though it has to be slowed."""
    coarse = coarse_jerk_problem(path, limits, run)
    leg = _ramped(path, limits, run, coarse)
    if leg is None:
        problem, start = jerk_problem(path, limits, run, coarse)
        leg = Candidate(run, problem, start.profile(problem), AVERAGED, 3, floor(coarse))
    return _settle_leg(path, limits, leg)


def _solve_halves(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> list[Candidate]:
    """The run with a rest about its middle, at the break where it is slowest anyway. Empty where that is no way."""
    if run.first == run.last:
        return []
    try:
        problem, start = jerk_problem(path, limits, run)
        pieces = run.last - run.first + 1
        inner = run.breaks(path)[1:-1][(pieces - 1) // 4 : pieces - 1 - (pieces - 1) // 4]
        speed = start.on(problem.s)[0, np.searchsorted(problem.s, inner)]
        rest = run.first + 1 + (pieces - 1) // 4 + int(np.argmin(speed))
        parts = (
            replace(run, last=rest - 1, end_speed=0.0, until=None, stands=(run.stands[0], False)),
            replace(run, first=rest, start_speed=0.0, since=None, stands=(False, run.stands[1])),
        )
        return [leg for part in parts for leg in _solve_legs(path, limits, part, 3)]
    except MotionError:  # no room for a rest beside a speed at an end
        return []


def _refuse_ends(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> None:
    """Raise TooFast where the jerk leaves no room for a speed at an end: beside the other's, else beside a rest."""
    for beside in (run, None):
        for end in (0, 1):
            asked = run.speeds[end]
            largest = (
                _largest_end_speed(path, limits, beside or _with_end(run, 1 - end, 0.0), end) if asked > 0 else 0.0
            )
            if 0 < largest < asked:
                raise TooFast(end, asked, largest, beside is None)
        if min(run.speeds) == 0:  # beside a rest already
            return


def _largest_end_speed(path: ActuatorPath, limits: Sequence[Limit], run: Run, end: int) -> float:
    """The largest speed up to the run's that is found for an end of it and leads to a motion; 0 if none does."""
    bound, most = largest_end_speed(coarse_jerk_problem(path, limits, run), end), 0.0
    for share in END_SPEED_SHARES:
        if share * bound > most:
            most = max(most, _fastest_end_speed(path, limits, _with_end(run, end, share * bound), end, bound))
    for _ in range(MAX_RESOLVES if most > 0 else 0):
        before, again = most, _fastest_end_speed(path, limits, _with_end(run, end, NEAR_SHARES[1] * most), end, bound)
        most = again or before
        if abs(most / before - 1) < SETTLED_CHANGE:
            break
    high = 1.0
    for low in NEAR_SHARES if most > 0 else ():
        if _is_feasible(path, limits, _with_end(run, end, low * most)):
            break
        high = low
    else:
        return 0.0
    for _ in range(HALVINGS if high < 1 else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if _is_feasible(path, limits, _with_end(run, end, middle * most)) else (low, middle)
    return low * most


def _is_feasible(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> bool:
    """Whether a motion is found along a run, between its speeds, that is seen to keep every limit."""
    try:
        leg = _settle_leg(path, limits, _solved(path, limits, run, 3))
    except MotionError:
        return False
    return required_slowness(limits, leg.aimed(sample_limit_use(path, limits, leg.profile))) <= 1 + SOLVER_MARGIN


def _with_end(run: Run, end: int, speed: float) -> Run:
    return replace(run, start_speed=speed) if end == 0 else replace(run, end_speed=speed)


def _fastest_end_speed(path: ActuatorPath, limits: Sequence[Limit], run: Run, end: int, bound: float) -> float:
    """The largest speed at an end, up to the bound, that a solver finds from a motion with the run's; 0 if none."""
    try:
        problem, start = jerk_problem(path, limits, run)
        guess = start.on(problem.s)
        if not problem.settled:
            v, a, j, h = guess
            speed = v + h / 2 * (a + h * j / 4)
            problem = problem.around(speed, speed)
        speeds = (bound, run.end_speed) if end == 0 else (run.start_speed, bound)
        profile = third_order(replace(problem, speeds=speeds), guess, fast_end=end)
    except MotionError:
        return 0.0
    v, a, j, h = (values[-end] for values in (profile.v, profile.a, profile.j, profile.h))
    return float(v if end == 0 else v + h * (a + h * j / 2))
