"""A few runs from rest to rest, timed and proved by themselves: what any process can do with a part of a path."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath
from planner.certify import TOLERANCE, Known, prove
from planner.limits.limit import Limit
from planner.timing.problem import Run
from planner.timing.profile import Profile

# How often a run is timed until its proof holds.
ROUNDS = 8


class Timed(Protocol):
    """A motion along one run, and how it becomes one that holds."""

    @property
    def profile(self) -> Profile: ...
    @property
    def method(self) -> str: ...
    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Timed":
        """Another motion, where some limit was exceeded: use (M,) of each time piece, per limit.

        Slowed as a whole, `slowness` times as long, it would hold.
        """


Timing = Callable[[ActuatorPath, Sequence[Limit], Run], Timed]


@dataclass(frozen=True, slots=True)
class Proved:
    """A run's motion, what it uses of each limit for certain, the method that gave it, and in how many rounds."""

    profile: Profile
    known: Known
    method: str
    rounds: int


@dataclass(frozen=True, slots=True)
class Prover:
    """Runs -> their motions, each proved to keep every limit on time, or given up after ROUNDS."""

    path: ActuatorPath
    limits: tuple[Limit, ...]
    order: int
    timing: Timing

    def __call__(self, runs: Sequence[Run]) -> list[Proved]:
        timed = [self.timing(self.path, self.limits, run) for run in runs]
        known = self._prove(timed)
        rounds = [1] * len(runs)
        for _ in range(1, ROUNDS):
            again = [n for n, what in enumerate(known) if self._exceeds(what)]
            if not again:
                break
            for n in again:
                use = known[n].use
                slowness = max(limit.slowness(float(use[limit.name].max())) for limit in self._timed)
                timed[n] = timed[n].tightened(use, slowness)
                rounds[n] += 1
            for n, what in zip(again, self._prove([timed[n] for n in again]), strict=True):
                known[n] = what
        return [
            Proved(one.profile, what, one.method, count) for one, what, count in zip(timed, known, rounds, strict=True)
        ]

    def _prove(self, timed: Sequence[Timed]) -> list[Known]:
        """All in one go: what each uses of the limits."""
        joined = Profile.joined([one.profile for one in timed])
        use, attained = prove(joined.along(self.path), self._timed, self.order)
        ends = np.cumsum([len(one.profile.h) for one in timed])[:-1]
        parts = [{name: np.split(values, ends) for name, values in each.items()} for each in (use, attained)]
        return [
            Known(*({name: values[n] for name, values in part.items()} for part in parts)) for n in range(len(timed))
        ]

    def _exceeds(self, known: Known) -> bool:
        """Whether it exceeds a limit, by what slowing can mend."""
        return 1 + TOLERANCE < max(float(known.use[limit.name].max()) for limit in self._timed) < np.inf

    @property
    def _timed(self) -> list[Limit]:
        """The limits that timing can help; the others say the same of every timing."""
        return [limit for limit in self.limits if not limit.geometric]
