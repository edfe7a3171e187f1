"""The outcome of solving a run: a motion that is not yet proved, or the refusal."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.place import Infeasible
from planner.timing.problem import EXACT_AIM, SOLVER_AIM, Problem, Solver
from planner.timing.profile import Profile

Status = Literal["solved", "too fast", "infeasible", "stopped"]
"""Solved; a speed at an end is not possible; a limit cannot be respected; no answer was found."""

# Makers of motions. Closed forms and averages:
STRAIGHT = "straight"
AVERAGED = "averaged"
BRIEF_RAMPS = "brief ramps"
# motions at constant speed, by the program or at the capped speed of the tool;
MADE_CONSTANT_SPEED = "constant speed"
CRUISE = "cruise"
# motions joined of several: with rests between, of constant speeds and ramps, of cruises and ramps.
WITH_RESTS = "with rests"
IN_PARTS = "in parts"
FEED_LIMITED = "feed-limited"

# A motion slowed by less than this still counts as its maker's.
MAX_NEGLIGIBLE_SLOWNESS = 1 + 1e-4
SLOWNESS_NOTES = {
    MAX_NEGLIGIBLE_SLOWNESS: " by less than 0.01 %",
    1 + 1e-3: " by less than 0.1 %",
}
_NOTHING = np.zeros(0)
NO_MOTION = Profile(_NOTHING, _NOTHING, _NOTHING, _NOTHING, _NOTHING, np.zeros(0, int))


class TooFast(MotionError):
    """A speed ṡ at an end for which the limits leave no room.

    Solvers return it; `planner.timing.attempts`, which knows the path, says where that is.

    end      0 for the start, 1 for the end
    largest  largest possible speed
    both     it is possible only with rest at the other end, whose speed is too high as well
    """

    def __init__(self, end: int, speed: float, largest: float, both: bool = False) -> None:
        self.end = end
        self.speed = speed
        self.largest = largest
        self.both = both
        super().__init__(
            f"the {self.name} {speed:.6g} is beyond {largest:.6g}, the largest from which the run can be made"
        )

    @property
    def name(self) -> str:
        """Name of the end's speed."""
        return ("start speed", "end speed")[self.end]


@dataclass(frozen=True, slots=True)
class RunSolution:
    """The outcome of solving a run or a part of it.

    lower_estimate  estimate (s) of the least time that the run can take; 0 without an estimate
    maker           solver or other source of the motion
    problem         problem that it answers; None for joined motions and cruises
    use             sampled use of limits on each time piece, if the solver sampled it
    tries           number of times that it was solved
    slowness        duration as a multiple of the solver's answer, where it was slowed as a whole
    parts           solutions of which it is joined
    fallback        motion that respects every limit, for goals that have one
    refusal         the reason why there is no motion
    """

    status: Status
    profile: Profile
    lower_estimate: float = 0.0
    maker: str = ""
    problem: Problem | None = field(default=None, repr=False)
    use: Mapping[str, Array] | None = field(default=None, repr=False)
    tries: int = 1
    slowness: float = 1.0
    parts: "tuple[RunSolution, ...]" = ()
    fallback: Profile | None = None
    refusal: MotionError | None = None

    @classmethod
    def refused(cls, refusal: MotionError) -> "RunSolution":
        """Return no motion, and the reason."""
        status: Status = "stopped"
        if isinstance(refusal, Infeasible):
            status = "infeasible"
        if isinstance(refusal, TooFast):
            status = "too fast"
        return cls(status, NO_MOTION, refusal=refusal)

    @classmethod
    def joined(cls, parts: "Sequence[RunSolution]", maker: str) -> "RunSolution":
        """Return several solutions one after the other, or the first refusal among them."""
        for part in parts:
            if not part.solved:
                return part
        if len(parts) == 1:
            return parts[0]
        profile = Profile.joined([part.profile for part in parts])
        estimate = sum(part.lower_estimate for part in parts)
        return cls("solved", profile, estimate, maker, parts=tuple(parts))

    @property
    def solved(self) -> bool:
        """True if there is a motion."""
        return self.status == "solved"

    @property
    def duration(self) -> float:
        """Duration in s."""
        return self.profile.duration

    def require_profile(self) -> Profile:
        """Return the motion. Raises the refusal instead, if it is refused."""
        if self.refusal is not None:
            raise self.refusal
        return self.profile

    @property
    def method(self) -> str:
        """Maker, with a note where the motion was slowed or rests where the path asks for none."""
        if self.maker == IN_PARTS:
            solved = (part.method for part in self.parts if part.maker != MADE_CONSTANT_SPEED)
            return next(solved, MADE_CONSTANT_SPEED)
        if self.parts:
            methods = dict.fromkeys(part.method for part in self.parts)
            return ", ".join([*methods, self.maker])
        if self.slowness == 1:
            return self.maker
        notes = (words for most, words in SLOWNESS_NOTES.items() if self.slowness <= most)
        return f"{self.maker}, slowed{next(notes, '')}"

    @property
    def fastest(self) -> bool:
        """True if it was solved for as the fastest motion of its run."""
        if self.parts:
            return self.maker in (WITH_RESTS, FEED_LIMITED)
        return self.problem is not None and self.fallback is None

    @property
    def is_closed_form(self) -> bool:
        """True if it is a closed form, which aims nearer at the limits than solvers."""
        return self.maker in (STRAIGHT, CRUISE)

    @property
    def order_2_solver(self) -> Solver | None:
        """Solver of order 2 that found it, if one did."""
        return next((solver for solver in get_args(Solver) if solver == self.maker), None)

    @property
    def can_be_solved_again(self) -> bool:
        """True if it is a solver's answer, which less room changes."""
        is_answer = self.maker not in (STRAIGHT, AVERAGED, BRIEF_RAMPS)
        return is_answer and self.problem is not None and self.slowness == 1

    @property
    def has_end_speed(self) -> bool:
        """True if it begins or ends in motion: such a motion cannot be slowed."""
        if any(part.has_end_speed for part in self.parts):
            return True
        return self.problem is not None and max(self.problem.speeds) > 0

    def slowed(self, slowness: float) -> "RunSolution":
        """Return the motion from rest to rest slowed as a whole."""
        return replace(
            self,
            profile=self.profile.slowed(slowness),
            use=None,
            slowness=self.slowness * slowness,
            parts=tuple(part.slowed(slowness) for part in self.parts),
        )

    def bare(self) -> "RunSolution":
        """Return the motion and its method, without the data for solving it again."""
        return replace(
            self,
            maker=self.method,
            slowness=1.0,
            problem=None,
            use=None,
            parts=(),
            fallback=None,
        )

    def relate_use(self, use: Mapping[str, Array]) -> dict[str, Array]:
        """Return the use of limits as shares of the maker's aim.

        Where the motion begins or ends at a speed, the first and the last piece may use all of
        the limits: such a speed is given, and may be that of a motion in closed form.
        """
        aims = np.full(len(self.profile.h), SOLVER_AIM)
        if self.is_closed_form:
            aims[:] = EXACT_AIM
        if self.has_end_speed:
            aims[[0, -1]] = EXACT_AIM
        return {name: values / aims for name, values in use.items()}
