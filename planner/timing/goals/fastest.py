"""The goal "fastest": the shortest motion that respects every limit."""

from dataclasses import dataclass

from planner.timing.attempts import solve_run
from planner.timing.tighten import tighten_run


@dataclass(frozen=True, slots=True)
class Fastest:
    """The fastest motion at order 2 or 3: the ways to time a run, tried in order."""

    uniform: bool = True

    solve = staticmethod(solve_run)
    tighten = staticmethod(tighten_run)
