"""A leg: a part of a run between two places where it rests, or all of it, on its way to a motion that holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.limits.limit import Limit
from planner.timing.problem import AIM, EXACTLY, Block, Problem, Run
from planner.timing.profile import Profile
from planner.timing.second_order import second_order
from planner.timing.third_order import third_order

# Room taken off: this share of the excess, more with every try, and a little for the solver's own tolerance.
MORE, MARGIN = 1.1, 2e-7
# How often a leg is solved before it is slowed instead.
TRIES = 5
# A motion that only so much slowness keeps from holding is slowed: solving again would cost more than it gains.
CHEAP = 1 + 3e-5
# Up to here slowness is told as what it is: the last touch of a motion, not its maker.
HARDLY = 1 + 1e-4
AVERAGED, STRAIGHT = "averaged", "straight"
# How often an order-3 leg is solved where rows depend on the motion, unless a round gains less than this share.
ROUNDS, GAIN = 4, 1e-4
# Intervals up to which IPOPT is asked where FATROP gives no answer: its time grows faster than theirs.
FEW = 600


@dataclass(frozen=True, slots=True)
class Leg:
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
        return f"{self.by}, slowed" if self.slowness > HARDLY else f"{self.by}, slowed by less than 0.01 %"

    @property
    def aim(self) -> float:
        """The share of every limit that it aims at."""
        return EXACTLY if self.by == STRAIGHT else AIM

    def aimed(self, use: Mapping[str, Array]) -> dict[str, Array]:
        """Shares of the limits as shares of what it aims at."""
        return {name: values / self.aim for name, values in use.items()}

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Leg":
        """Solved again with less room wherever a limit was found exceeded: use per limit and interval, as `aimed`.

        Where that does not help, or would cost more than it gains, the same motion slowed as a whole: what holds
        wherever anything does. Only a leg from rest to rest can be slowed: another is tried on.
        """
        moving, solved = max(self.problem.speeds) > 0, self.by not in (AVERAGED, STRAIGHT) and self.slowness == 1
        if solved and (moving or (slowness > CHEAP and self.tries < TRIES)):
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
        return jerk_limited(problem, self.profile.columns())


def slowest(limits: Sequence[Limit], use: Mapping[str, Array]) -> float:
    """How many times slower a motion that uses so much of the limits must be, to keep them all."""
    return max(limit.slowness(float(use[limit.name].max())) for limit in limits if limit.name in use)


def tightened(block: Block, excess: Array, tries: int) -> Block:
    """With less room where there was an excess (N,): of the part of it that holding still does not use."""
    less = block.aimed((1 - MARGIN) / (1 + MORE * tries * (excess - 1) / (1 - block.still)))
    return replace(block, room=np.where(excess > 1 + MARGIN, less.room, block.room))


def jerk_limited(problem: Problem, guess: Array, *, patient: bool | None = None, **options: Any) -> tuple[Profile, str]:
    """By FATROP, or by IPOPT where that gives no answer to a problem of few intervals; which of them is told.

    patient: whether IPOPT is asked. If not told, from rest to rest only: between given speeds there may be no answer,
    which takes it up to a minute to find out.
    Rows that speak only near some motions are taken near the guess, and then near each answer in turn.
    """
    if not problem.settled:
        for _ in range(ROUNDS):
            v, a, j, h = guess
            speed = v + h / 2 * (a + h * j / 4)  # in the middle, for both sides
            profile, method = jerk_limited(problem.around(speed, speed), guess, patient=patient, **options)
            gained, guess = 1 - profile.duration / h.sum(), profile.columns()
            if abs(gained) < GAIN:
                break
        return profile, method
    try:
        return third_order(problem, guess, **options), "fatrop"
    except MotionError:
        asked = max(problem.speeds) == 0 if patient is None else patient
        if not asked or problem.intervals > FEW:
            raise
        return third_order(problem, guess, solver="ipopt", **options), "ipopt"
