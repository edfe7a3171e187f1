"""The goal "fastest": the shortest motion that respects every limit."""

from collections.abc import Mapping
from dataclasses import dataclass

from kinematics.foundation.arrays import Array
from planner.timing.attempts import solve_run
from planner.timing.grid import Task
from planner.timing.solution import RunSolution
from planner.timing.tighten import tighten_run


@dataclass(frozen=True, slots=True)
class Fastest:
    """The fastest motion at order 2 or 3."""

    uniform: bool = True

    def solve(self, task: Task) -> RunSolution:
        """Try the ways to time a run in order."""
        return solve_run(task)

    def tighten(self, task: Task, solution: RunSolution, use: Mapping[str, Array]) -> RunSolution:
        """Solve again with less room where a limit was exceeded."""
        return tighten_run(task, solution, use)
