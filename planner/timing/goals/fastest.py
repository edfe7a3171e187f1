"""The goal "fastest": the shortest motion that respects every limit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from kinematics.foundation.arrays import Array
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.timing.attempts import solve_run
from planner.timing.problem import Run
from planner.timing.solution import RunSolution
from planner.timing.tighten import tighten_run


@dataclass(frozen=True, slots=True)
class Fastest:
    """The fastest motion at order 2 or 3."""

    order: int
    uniform: bool = True

    def solve(self, path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution:
        """Try the ways to time a run in order."""
        return solve_run(path, limits, run, self.order)

    def tighten(
        self,
        path: ActuatorPath,
        limits: Sequence[Limit],
        solution: RunSolution,
        use: Mapping[str, Array],
    ) -> RunSolution:
        """Solve again with less room where a limit was exceeded."""
        return tighten_run(path, limits, solution, use)
