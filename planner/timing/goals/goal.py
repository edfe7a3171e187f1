"""A goal: what the motion along a run is to be."""

from collections.abc import Mapping
from typing import Protocol

from kinematics.foundation.arrays import Array
from planner.timing.grid import Task
from planner.timing.solution import RunSolution


class Goal(Protocol):
    """A way to time runs, which `planner.timing.certify_loop` proves and tightens."""

    @property
    def uniform(self) -> bool:
        """True if equal runs have equal motions."""

    def solve(self, task: Task) -> RunSolution:
        """Return a motion along a run, or its refusal."""

    def tighten(self, task: Task, solution: RunSolution, use: Mapping[str, Array]) -> RunSolution:
        """Return a motion that exceeds the limits less, or the same solution if nothing can change.

        use  (M,) proved use of each limit on each time piece of the solution
        """
