"""Goals that have a motion to fall back on: the fastest motion, slowed."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.path.actuation import ActuatorPath
from planner.timing.grid import Task
from planner.timing.order3.interior_point import Start
from planner.timing.order3.pose import PosedStages
from planner.timing.order3.solve import minimise_posed
from planner.timing.problem import Problem
from planner.timing.profile import Profile, close_profile
from planner.timing.solution import RunSolution
from planner.timing.tighten import MAX_TRIES, lower_rooms
from planner.trajectory import State, Trajectory

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
    def minimise(self, path: ActuatorPath, problem: Problem, guess: Array) -> RunSolution:
        """Return a motion of little cost, from a guess (4, N) of ṡ, s̈, s⃛, h; or a refusal."""

    @abstractmethod
    def find_cost(self, path: ActuatorPath, profile: Profile) -> float:
        """Return the cost of a motion."""

    def improve_or_fall_back(
        self,
        path: ActuatorPath,
        problem: Problem,
        slowed: Profile,
        tries: int = 0,
    ) -> RunSolution:
        """Return a motion of less cost, or else the fastest motion slowed."""
        better = self.minimise(path, problem, slowed.on(problem.s))
        most = self.find_cost(path, slowed)
        if better.solved and self.find_cost(path, better.profile) <= most:
            return replace(better, problem=problem, fallback=slowed, tries=tries + 1)
        return RunSolution(
            "solved",
            slowed,
            maker=SLOWED,
            problem=problem,
            tries=MAX_TRIES,
            fallback=slowed,
        )

    def tighten(self, task: Task, solution: RunSolution, use: Mapping[str, Array]) -> RunSolution:
        """Solve again with less room where a limit was exceeded; after MAX_TRIES fall back."""
        problem = solution.problem
        slowed = solution.fallback
        assert problem is not None
        assert slowed is not None
        if solution.profile is slowed:
            return solution
        if solution.tries >= MAX_TRIES:
            return replace(solution, profile=slowed, maker=SLOWED)
        tighter = lower_rooms(problem, solution.relate_use(use), solution.tries)
        return self.improve_or_fall_back(task.path, tighter, slowed, solution.tries)


def solve_posed(
    problem: Problem,
    posed: PosedStages,
    starts: Sequence[Start],
    maker: str,
) -> RunSolution:
    """Return the motion of least cost from the first start that leads to one, or the refusal."""
    columns = minimise_posed(posed, starts)
    profile = columns if isinstance(columns, MotionError) else close_profile(problem, columns)
    if isinstance(profile, MotionError):
        return RunSolution.refused(profile)
    return RunSolution("solved", profile, maker=maker, problem=problem)


def integrate_squares(trajectory: Trajectory, derivative: int, weights: Array) -> float:
    """Return ∫ Σ (q⁽ᵏ⁾/w)² dt of the k-th derivative, 2 or 3, by Simpson's rule on each time
    piece.
    """
    h = np.diff(trajectory.knots)
    pieces = np.arange(len(h))
    start, middle, end = (trajectory.within(pieces, share * h) for share in (0.0, 0.5, 1.0))

    def sum_squares(state: State) -> Array:
        rates = state.qdd if derivative == 2 else state.qddd
        return np.asarray(((rates / weights) ** 2).sum(1))

    squares = sum_squares(start) + 4 * sum_squares(middle) + sum_squares(end)
    return float((h / 6 * squares).sum())


def weigh_slopes(path: ActuatorPath, problem: Problem, derivative: int, weights: Array) -> Array:
    """Return (N, 2, n, k) of q′, … to the k-th derivative over w, at both ends of each interval."""
    sides = []
    for s in (problem.s[:-1], problem.s[1:]):
        slopes = path.derivatives(s, problem.piece, derivative)[1:]
        sides.append(np.stack(slopes, axis=-1))
    return np.stack(sides, axis=1) / weights[:, None]
