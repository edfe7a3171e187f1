"""Goals that have a motion to fall back on: the fastest motion, slowed."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from kinematics.foundation.arrays import Array
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.timing.problem import Problem
from planner.timing.profile import Profile
from planner.timing.solution import RunSolution
from planner.timing.tighten import MAX_TRIES, lower_rooms

SLOWED = "slowed"
"""Maker of the fastest motion slowed."""


@dataclass(frozen=True, slots=True)
class FallbackGoal:
    """A goal whose cost a solver lowers from a motion that respects every limit.

    fastest  fastest motion of each run, by the run's first piece
    """

    fastest: Mapping[int, Profile]
    uniform: bool = False

    @abstractmethod
    def improve(self, path: ActuatorPath, problem: Problem, slowed: Profile) -> RunSolution | None:
        """Return a motion that costs less than the fastest motion slowed, or None."""

    def improve_or_fall_back(
        self,
        path: ActuatorPath,
        problem: Problem,
        slowed: Profile,
        tries: int = 0,
    ) -> RunSolution:
        """Return a motion of less cost, or else the fastest motion slowed."""
        better = self.improve(path, problem, slowed)
        if better is not None:
            return replace(better, problem=problem, fallback=slowed, tries=tries + 1)
        return RunSolution(
            "solved",
            slowed,
            maker=SLOWED,
            problem=problem,
            tries=MAX_TRIES,
            fallback=slowed,
        )

    def tighten(
        self,
        path: ActuatorPath,
        limits: Sequence[Limit],
        solution: RunSolution,
        use: Mapping[str, Array],
    ) -> RunSolution:
        """Solve again with less room where a limit was exceeded; after MAX_TRIES fall back."""
        problem = solution.problem
        slowed = solution.fallback
        if problem is None or slowed is None:
            return solution
        if solution.tries >= MAX_TRIES:
            return replace(solution, profile=slowed, maker=SLOWED)
        tighter = lower_rooms(problem, solution.relate_use(use), solution.tries)
        return self.improve_or_fall_back(path, tighter, slowed, solution.tries)


def integrate(values: Sequence[Array], h: Array) -> float:
    """Return the integral over pieces of durations h by Simpson's rule.

    values  at the start, the middle and the end of each piece
    """
    start, middle, end = values
    return float((h / 6 * (start + 4 * middle + end)).sum())
