"""A few runs between stops, timed and proved by themselves: what any process can do with a part of a path."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath
from planner.certify import Known, at_knots, prove
from planner.limits.limit import Limit
from planner.limits.resonance import Held, Resonance
from planner.stays import stays
from planner.timing.problem import Run
from planner.timing.profile import Profile

# How often a run is timed until its proof holds.
ROUNDS = 8
# Rounds after which an axis that still stays in a resonance band too long is held below it over its whole run.
STRETCHES = 3


class Timed(Protocol):
    """A motion along one run, and how it becomes one that holds."""

    @property
    def profile(self) -> Profile: ...
    @property
    def method(self) -> str: ...
    @property
    def floor(self) -> float:
        """An estimate of the least time (s) that the run can take; 0 from who has none."""

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Timed":
        """Another motion, where some limit was exceeded: use (M,) of each time piece, per limit.

        Slowed as a whole, `slowness` times as long, it would hold.
        """


Timing = Callable[[ActuatorPath, Sequence[Limit], Run], Timed]


@dataclass(frozen=True, slots=True)
class Proved:
    """A run's motion, what it uses of each limit for certain, the method that gave it, and in how many rounds.

    floor: an estimate of the least time that it can take (s); held: where axes are held below resonance bands
    """

    profile: Profile
    known: Known
    method: str
    rounds: int
    floor: float
    held: tuple[Held, ...]


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
        held: list[tuple[Held, ...]] = [()] * len(runs)
        rounds = [1] * len(runs)
        again = list(range(len(runs)))
        for tried in range(1, ROUNDS):
            staying = {n: self._staying(timed[n].profile, runs[n], tried >= STRETCHES) for n in again}
            again = [n for n in again if staying[n] or self._exceeds(known[n])]
            if not again:
                break
            for n in again:
                if staying[n]:
                    held[n] = (*held[n], *staying[n])
                    timed[n] = self.timing(self.path, holding(self.limits, held[n]), runs[n])
                else:
                    use = known[n].use
                    slowness = max(limit.slowness(float(use[limit.name].max())) for limit in self._timed)
                    timed[n] = timed[n].tightened(use, slowness)
                rounds[n] += 1
            for n, what in zip(again, self._prove([timed[n] for n in again]), strict=True):
                known[n] = what
        return [
            Proved(one.profile, what, one.method, count, one.floor, bands)
            for one, what, count, bands in zip(timed, known, rounds, held, strict=True)
        ]

    def _prove(self, timed: Sequence[Timed]) -> list[Known]:
        """All in one go: what each uses of the limits."""
        profiles = [one.profile for one in timed]
        motion = Profile.joined(profiles).along(self.path)
        use, attained = prove(motion, self._timed, self.order)
        attained |= at_knots(motion, [limit for limit in self.limits if limit.geometric])
        ends = np.cumsum([len(profile.h) for profile in profiles])[:-1]
        parts = [{name: np.split(values, ends) for name, values in each.items()} for each in (use, attained)]
        return [
            Known(*({name: values[n] for name, values in part.items()} for part in parts)) for n in range(len(timed))
        ]

    def _exceeds(self, known: Known) -> bool:
        """Whether it exceeds a limit, by what slowing can mend."""
        return 1 < max(float(known.use[limit.name].max()) for limit in self._timed) < np.inf

    def _staying(self, profile: Profile, run: Run, whole: bool) -> list[Held]:
        """Where an axis stays in a resonance band too long: there, or over the whole run."""
        motion, found = profile.along(self.path), []
        for limit in self.limits:
            for stay in stays(motion, limit) if isinstance(limit, Resonance) else ():
                if stay.use > 1:
                    ends = (
                        run.breaks(self.path)[[0, -1]] if whole else motion.at(np.array([stay.start, stay.end])).along
                    )
                    found.append(Held(stay.band, float(ends[0]), float(ends[1])))
        return found

    @property
    def _timed(self) -> list[Limit]:
        """The limits that timing can help; the others say the same of every timing."""
        return [limit for limit in self.limits if not limit.geometric]


def holding(limits: Sequence[Limit], held: Sequence[Held]) -> tuple[Limit, ...]:
    """The limits, with axes held below resonance bands in more places."""
    return tuple(limit.holding(held) if held and isinstance(limit, Resonance) else limit for limit in limits)
