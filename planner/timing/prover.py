"""A few runs between stops, timed and proved by themselves: what any process can do with a part of a path."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.actuation import ActuatorPath
from planner.certificate.certify import ProvedUse, prove, use_at_knots
from planner.certificate.resonance_dwell import find_stays
from planner.limits.limit import Limit
from planner.limits.resonance import BAND_MARGIN, Resonance, SpeedCap
from planner.timing.problem import Run
from planner.timing.profile import Profile, sample_limit_use
from planner.timing.run import Attempt, required_slowness

# How often a run is timed until its proof holds, before it is slowed as a whole; and how often it is slowed.
ROUNDS, LAST = 8, 3
# How often axes are held below resonance bands: so often where they stay in them too long, then over their whole run,
# at last all of them; each time more of the same by so much farther below, as a grid lets a motion peak beside it.
HOLDINGS, STRETCH_ROUNDS, ALL, FARTHER = 8, 2, 6, 4.0
# What is slowed is slowed a little more: rounding.
MARGIN = 1e-6


class RunTiming(Protocol):
    """A motion along one run, and how it becomes one that holds."""

    @property
    def profile(self) -> Profile: ...
    @property
    def method(self) -> str: ...
    @property
    def floor(self) -> float:
        """An estimate of the least time (s) that the run can take; 0 from who has none."""

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "RunTiming":
        """Another motion, where some limit was exceeded: use (M,) of each time piece, per limit.

        Slowed as a whole, `slowness` times as long, it would hold.
        """


Timing = Callable[[ActuatorPath, Sequence[Limit], Run], RunTiming]


@dataclass(frozen=True, slots=True)
class ProvedRun:
    """A run's motion, what it uses of each limit for certain, the method that gave it, and in how many rounds.

    floor: an estimate of the least time that it can take (s); held: where axes are held below resonance bands
    """

    profile: Profile
    known: ProvedUse
    method: str
    rounds: int
    floor: float
    held: tuple[SpeedCap, ...]


@dataclass(frozen=True, slots=True)
class Tries:
    """How often a run was tightened, timed anew with axes held back, and slowed as a whole."""

    tightened: int = 0
    held: int = 0
    slowed: int = 0

    @property
    def rounds(self) -> int:
        """How often it was timed."""
        return 1 + self.tightened + self.held + self.slowed


@dataclass(frozen=True, slots=True)
class Prover:
    """Runs -> their motions, each proved to keep every limit on time; what does not within ROUNDS is slowed until then.

    Given up is only what cannot be slowed: between stated speeds, or in a stated duration.
    """

    path: ActuatorPath
    limits: tuple[Limit, ...]
    order: int
    timing: Timing

    def __call__(self, runs: Sequence[Run]) -> list[ProvedRun]:
        timed = [self.timing(self.path, self.limits, run) for run in runs]
        known = self._prove(timed)
        held: list[tuple[SpeedCap, ...]] = [()] * len(runs)
        tries = [Tries()] * len(runs)
        again = list(range(len(runs)))
        while again:
            changed = []
            for n in again:
                staying = self._staying(timed[n].profile)
                if staying:
                    holding = self._holding(staying, runs[n], held[n], tries[n].held)
                    found, held[n], tries[n] = self._held_back(timed[n], runs[n], held[n], holding, tries[n])
                elif self._exceeds(known[n]):
                    found, tries[n] = self._tightened(timed[n], known[n], tries[n])
                else:
                    continue
                if found is not None:
                    timed[n] = found
                    changed.append(n)
            again = changed
            for n, what in zip(again, self._prove([timed[n] for n in again]) if again else (), strict=True):
                known[n] = what
        return [
            ProvedRun(one.profile, what, one.method, count.rounds, one.floor, bands)
            for one, what, count, bands in zip(timed, known, tries, held, strict=True)
        ]

    def _held_back(
        self, timed: RunTiming, run: Run, held: tuple[SpeedCap, ...], more: Sequence[SpeedCap], tries: "Tries"
    ) -> tuple[RunTiming | None, tuple[SpeedCap, ...], "Tries"]:
        """A run timed anew with axes held in more places; where that is of no use, slowed below all bands."""
        if tries.held < HOLDINGS:
            try:
                found = self.timing(self.path, hold_axes(self.limits, (*held, *more)), run)
                return found, (*held, *more), replace(tries, held=tries.held + 1)
            except MotionError:
                if tries.held + 1 < ALL:  # all that is held may leave a solver more room than a part of it
                    everywhere = self._holding((), run, held, ALL)
                    return self._held_back(timed, run, held, everywhere, replace(tries, held=ALL))
                if not isinstance(timed, Attempt):
                    raise
        if tries.slowed >= LAST or not isinstance(timed, Attempt):
            return None, held, tries
        bands = [limit for limit in self.limits if isinstance(limit, Resonance)]
        slowness = required_slowness(
            bands, sample_limit_use(self.path, [limit.kept_below() for limit in bands], timed.profile)
        )
        return timed.slowed(slowness * (1 + BAND_MARGIN)), held, replace(tries, slowed=tries.slowed + 1)

    def _tightened(self, timed: RunTiming, known: ProvedUse, tries: "Tries") -> tuple[RunTiming | None, "Tries"]:
        slowness = required_slowness(self._timed, known.use)
        if tries.tightened + 1 < ROUNDS:
            return timed.tightened(known.use, slowness), replace(tries, tightened=tries.tightened + 1)
        if tries.slowed >= LAST or not isinstance(timed, Attempt):
            return None, tries
        return timed.slowed(slowness * (1 + MARGIN)), replace(tries, slowed=tries.slowed + 1)

    def _prove(self, timed: Sequence[RunTiming]) -> list[ProvedUse]:
        """All in one go: what each uses of the limits."""
        profiles = [one.profile for one in timed]
        motion = Profile.joined(profiles).along(self.path)
        use, attained = prove(motion, self._timed, self.order)
        attained |= use_at_knots(motion, [limit for limit in self.limits if limit.geometric])
        ends = np.cumsum([len(profile.h) for profile in profiles])[:-1]
        parts = [{name: np.split(values, ends) for name, values in each.items()} for each in (use, attained)]
        return [
            ProvedUse(*({name: values[n] for name, values in part.items()} for part in parts))
            for n in range(len(timed))
        ]

    def _exceeds(self, known: ProvedUse) -> bool:
        """Whether it exceeds a limit, by what slowing can mend."""
        return 1 < max(float(known.use[limit.name].max()) for limit in self._timed) < np.inf

    def _staying(self, profile: Profile) -> list[SpeedCap]:
        """Where an axis stays in a resonance band too long."""
        motion, found = profile.along(self.path), []
        for limit in self.limits:
            for stay in find_stays(motion, limit) if isinstance(limit, Resonance) else ():
                if stay.use > 1:
                    first, last = motion.at(np.array([stay.start, stay.end])).along.tolist()
                    found.append(SpeedCap(stay.band, first, last))
        return found

    def _holding(self, staying: Sequence[SpeedCap], run: Run, held: Sequence[SpeedCap], times: int) -> list[SpeedCap]:
        """Where to hold axes: where they stay, or over the whole run; at last all of them."""
        if times < STRETCH_ROUNDS:
            return list(staying)
        first, last = run.breaks(self.path)[[0, -1]].tolist()
        bands = dict.fromkeys(each.band for each in staying)
        if times >= ALL:
            bands = dict.fromkeys(band for limit in self.limits if isinstance(limit, Resonance) for band in limit.bands)
        found = []
        for band in bands:
            before = sum(each.band == band and (each.first, each.last) == (first, last) for each in held)
            found.append(SpeedCap(band, first, last, BAND_MARGIN * FARTHER**before))
        return found

    @property
    def _timed(self) -> list[Limit]:
        """The limits that depend on timing; the others have one value for every timing."""
        return [limit for limit in self.limits if not limit.geometric]


def hold_axes(limits: Sequence[Limit], held: Sequence[SpeedCap]) -> tuple[Limit, ...]:
    """The limits, with axes held below resonance bands in more places."""
    return tuple(limit.holding(held) if held and isinstance(limit, Resonance) else limit for limit in limits)
