"""One run, on its way to a motion that holds: posed, solved, tightened, solved again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit
from planner.place import Infeasible
from planner.timing.ends import TooFast
from planner.timing.floor import floor
from planner.timing.posing import jerk_problem, order_2_problem, order_3_coarse, refined
from planner.timing.problem import Problem, Run
from planner.timing.profile import Profile
from planner.timing.second_order import second_order
from planner.timing.seen import seen
from planner.timing.straight import straight
from planner.timing.third_order import third_order

# Room taken off: this share of the excess, more with every try, and a little for the solver's own tolerance.
MORE, MARGIN = 1.1, 2e-7
# How often a run is solved before it is slowed instead.
TRIES = 5
# A motion that only so much slowness keeps from holding is slowed: solving again would cost more than it gains.
CHEAP = 1 + 3e-5
AVERAGED, STRAIGHT = "averaged", "straight"
# How near the largest speed at an end is told, and the share of a bound below which none is looked for.
NEARLY, VANISHING = 1e-3, 1e-2
# How often an order-3 run is solved where rows depend on the motion, unless a round gains less than this share.
ROUNDS, GAIN = 4, 1e-4


@dataclass(frozen=True, slots=True)
class Attempt:
    """A problem, the profile that answers it, and the method that gave it.

    floor: an estimate of the least time that the run can take (s)
    tries: how often it was solved. The peaks between grid points heed the room only in part: each try takes off more
    """

    problem: Problem
    profile: Profile
    method: str
    order: int
    floor: float
    tries: int = 1

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Attempt":
        """Solved again with less room wherever a limit was found exceeded: use per limit and interval.

        Where that does not help, or would cost more than it gains, the same motion slowed as a whole: what holds
        wherever anything does. Only a run from rest to rest can be slowed: another is tried on.
        """
        moving, solved = max(self.problem.speeds) > 0, self.method not in (AVERAGED, STRAIGHT)
        if solved and (moving or (slowness > CHEAP and self.tries < TRIES)):
            blocks = []
            for block in self.problem.blocks:
                excess = use[block.name]
                less = block.room / (1 + MORE * self.tries * (excess - 1)) * (1 - MARGIN)
                blocks.append(replace(block, room=np.where(excess > 1 + MARGIN, less, block.room)))
            problem = replace(self.problem, blocks=tuple(blocks))
            try:
                profile, method = self._solved(problem)
                return replace(self, problem=problem, profile=profile, method=method, tries=self.tries + 1)
            except MotionError:
                if moving:
                    raise
        if moving:
            raise MotionError(
                f"no motion from {self.problem.speeds[0]:.6g} to {self.problem.speeds[1]:.6g} along the path was found "
                "that keeps every limit; ask for slower ends"
            )
        return replace(self, profile=self.profile.slowed(slowness))

    def _solved(self, problem: Problem) -> tuple[Profile, str]:
        if self.order == 2:
            return second_order(problem), "passes"
        return _third(problem, self.profile.columns())


def attempt(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, *, probing: bool = False) -> Attempt:
    """The first solve of a run. Raises Infeasible for end speeds that cannot be, MotionError if nothing bounds it.

    probing: just that one solve, for whoever has other runs to try if it gives no answer or none that holds.
    """
    try:
        first = _attempt(path, limits, run, order, probing)
        return first if probing else _settled(path, limits, first)
    except TooFast as no:
        end = (run.first, run.last)[no.end]
        place = path.place(float(run.breaks(path)[-no.end]), end)
        unit, scale = ("mm/s", 1e3) if place.segment is not None else ("/s", 1.0)
        remedy = f"{no.largest * scale:.6g} {unit} is the largest that the limits leave room for"
        raise Infeasible(no.name, "path", place, no.speed * scale, no.largest * scale, unit, remedy) from None


def _settled(path: ActuatorPath, limits: Sequence[Limit], tried: Attempt) -> Attempt:
    """Solved again, or slowed where that costs next to nothing, until no limit is seen to be exceeded.

    A proof takes far longer than a look: most runs need one only.
    """
    while tried.tries < TRIES:
        use = seen(path, limits, tried.profile)
        slowness = max(limit.slowness(float(use[limit.name].max())) for limit in limits if limit.name in use)
        if slowness <= 1 + MARGIN:
            break
        before, tried = tried, tried.tightened(use, slowness)
        if tried.problem is before.problem:  # slowed as a whole: that holds
            break
    return tried


def _attempt(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, probing: bool) -> Attempt:
    if order == 2:
        problem = order_2_problem(path, limits, run)
        profile = straight(problem)
        if profile is not None:
            return Attempt(problem, profile, STRAIGHT, order, profile.duration)
        profile = second_order(problem)
        finer = refined(path, limits, problem, profile)
        if finer is not None:
            problem, profile = finer, second_order(finer)
        return Attempt(problem, profile, "passes", order, floor(problem, profile))
    coarse = order_3_coarse(path, limits, run)
    profile = straight(coarse)
    if profile is not None:
        return Attempt(coarse, profile, STRAIGHT, order, profile.duration)
    try:
        problem, start = jerk_problem(path, limits, run, coarse)
    except TooFast as no:
        if not probing:
            _refuse_ends(path, limits, run, no)
        raise
    try:
        profile, method = _third(problem, start.on(problem.s))
    except MotionError:
        if probing:
            raise
        _refuse_ends(path, limits, run)
        profile, method = start.profile(problem), AVERAGED
    return Attempt(problem, profile, method, order, floor(coarse))


def _refuse_ends(path: ActuatorPath, limits: Sequence[Limit], run: Run, known: TooFast | None = None) -> None:
    """Raise TooFast where the jerk leaves no room for a speed at an end; known: what leaves none even without jerk."""
    for end in (0, 1):
        asked = run.speeds[end]
        bound = known.largest if known is not None and known.end == end else asked
        largest = _largest_end(path, limits, run, end, bound) if asked > 0 else 0.0
        if 0 < largest < asked:
            raise TooFast(end, asked, largest)


def _largest_end(path: ActuatorPath, limits: Sequence[Limit], run: Run, end: int, bound: float) -> float:
    """The largest speed below the bound that is found for one end of a run, by halving; 0 where there is none."""
    low, high = 0.0, bound
    while high - low > NEARLY * high:
        middle = (low + high) / 2
        slower = replace(run, start_speed=middle) if end == 0 else replace(run, end_speed=middle)
        try:
            problem, start = jerk_problem(path, limits, slower)
            third_order(problem, start.on(problem.s))
            low = middle
        except MotionError:
            high = middle
        if high < VANISHING * bound:
            return 0.0
    return low


def _third(problem: Problem, guess: Array, **options: Any) -> tuple[Profile, str]:
    """By FATROP, or by IPOPT where that gives no answer; which of them is told.

    Rows that speak only near some motions are taken near the guess, and then near each answer in turn.
    """
    if not problem.settled:
        for _ in range(ROUNDS):
            v, a, j, h = guess
            speed = v + h / 2 * (a + h * j / 4)  # in the middle, for both sides
            profile, method = _third(problem.around(speed, speed), guess, **options)
            gained, guess = 1 - profile.duration / h.sum(), profile.columns()
            if abs(gained) < GAIN:
                break
        return profile, method
    try:
        return third_order(problem, guess, **options), "fatrop"
    except MotionError:
        return third_order(problem, guess, solver="ipopt", **options), "ipopt"
