"""The loop that makes a motion hold: solve, certify, tighten.

This is the only place that certifies runs and reacts to the proof. A run whose motion exceeds a
limit between grid points is corrected by the first remedy that applies:

1. An axis stays in a resonance band too long: solve with the axis held below the band there.
2. A limit is exceeded: the goal tightens the motion, MAX_CERTIFY_ROUNDS − 1 times at most.
3. A run of cruises and ramps that cannot be tightened: solve it as one problem.
4. Nothing else is left: slow the motion as a whole, if it is from rest to rest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.certificate.limit_use import ProvedUse, prove
from planner.certificate.resonance_dwell import find_stays
from planner.limits.limit import Limit, select_timed
from planner.limits.resonance import BAND_MARGIN, Resonance, SpeedCap
from planner.path.actuation import ActuatorPath
from planner.timing.goals.goal import Goal
from planner.timing.grid import Task
from planner.timing.problem import Run
from planner.timing.profile import Profile
from planner.timing.sampling import sample_limit_use
from planner.timing.solution import CRUISE, FEED_LIMITED, RunSolution
from planner.timing.tighten import required_slowness

# Number of times that a run is solved and tightened, and slowed after that.
MAX_CERTIFY_ROUNDS = 8
MAX_SLOWINGS = 3
# Number of times that axes are held below resonance bands: first where they stay in them too long,
# after STRETCH_ROUNDS over their whole run.
MAX_HOLDINGS = 6
STRETCH_ROUNDS = 2
# Each time that an axis is held below the same band again, the margin grows by this factor: a
# motion may peak between grid points.
MARGIN_GROWTH = 4.0
# A motion that is slowed is slowed by this share more: rounding.
SLOWING_MARGIN = 1e-6
NOTHING_KNOWN = ProvedUse({}, {}, np.zeros((6, 0)))


@dataclass(frozen=True, slots=True)
class CertifiedRun:
    """A run's motion with its proved use of the limits.

    caps       stretches on which axes are held below resonance bands
    tightened  number of times that it was tightened
    earlier    number of times that it was tightened before it was solved as one problem
    holdings   number of times that it was solved with axes held back
    slowed     number of times that it was slowed as a whole
    room       room (M,) of each limit on each time piece; None unless it was just solved
    """

    run: Run
    solution: RunSolution
    known: ProvedUse = NOTHING_KNOWN
    caps: tuple[SpeedCap, ...] = ()
    tightened: int = 0
    earlier: int = 0
    holdings: int = 0
    slowed: int = 0
    room: Mapping[str, Array] | None = None

    @property
    def rounds(self) -> int:
        """Number of times that it was timed."""
        return 1 + self.earlier + self.tightened + self.holdings + self.slowed


@dataclass(frozen=True, slots=True)
class RunCertifier:
    """Times runs for a goal and proves that their motions respect every limit on time."""

    path: ActuatorPath
    limits: tuple[Limit, ...]
    order: int
    goal: Goal

    def __call__(self, runs: Sequence[Run]) -> list[CertifiedRun] | MotionError:
        """Return the runs' motions, or the first refusal.

        A motion for which no remedy is left is returned as it is, with the use that exceeds 1.
        """
        certified: list[CertifiedRun] = []
        for run in runs:
            solution = self.goal.solve(self._pose(run))
            if solution.refusal is not None:
                return solution.refusal
            certified.append(CertifiedRun(run, solution))
        pending = list(range(len(runs)))
        while pending:
            proofs = self._certify([certified[n].solution for n in pending])
            changed = []
            for n, known in zip(pending, proofs, strict=True):
                certified[n] = replace(certified[n], known=known)
                better = self._correct(certified[n])
                if isinstance(better, MotionError):
                    return better
                if better is not None:
                    certified[n] = better
                    changed.append(n)
            pending = changed
        return [
            replace(
                one,
                solution=one.solution.bare(),
                room=_find_room(one.solution),
            )
            for one in certified
        ]

    def _pose(self, run: Run, caps: Sequence[SpeedCap] = ()) -> Task:
        """Return the task for a run, with axes held below resonance bands on some stretches."""
        return Task(self.path, hold_axes(self.limits, caps), run, self.order)

    def _certify(self, solutions: Sequence[RunSolution]) -> list[ProvedUse]:
        """Prove the use of all limits by several runs' motions in one batch."""
        profiles = [solution.profile for solution in solutions]
        motion = Profile.joined(profiles).along(self.path)
        use, attained = prove(motion, select_timed(self.limits), self.order)
        ends = np.cumsum([len(profile.h) for profile in profiles])
        begins = ends - [len(profile.h) for profile in profiles]
        return [
            ProvedUse(
                {name: values[begin:end] for name, values in use.items()},
                {name: values[begin:end] for name, values in attained.items()},
                profile.numbers(),
            )
            for profile, begin, end in zip(profiles, begins, ends, strict=True)
        ]

    def _correct(self, one: CertifiedRun) -> CertifiedRun | MotionError | None:
        """Apply the first remedy of the table above.

        None where the motion holds, or none is left.
        """
        stays = self._find_stays(one.solution.profile)
        if stays:
            return self._hold_axes(one, stays)
        largest = max(float(one.known.use[limit.name].max()) for limit in select_timed(self.limits))
        # a use without a bound: another motion would have none either
        if not 1 < largest < np.inf:
            return None
        cruises = one.solution.maker in (FEED_LIMITED, CRUISE)
        if one.tightened + 1 < MAX_CERTIFY_ROUNDS:
            task = self._pose(one.run, one.caps)
            solution = self.goal.tighten(task, one.solution, one.known.use)
            if solution is one.solution:
                return None
            if solution.solved:
                return replace(one, solution=solution, tightened=one.tightened + 1)
            if not cruises:
                return solution.refusal
        if cruises:
            whole = self.goal.solve(self._pose(replace(one.run, whole=True)))
            earlier = one.earlier + one.tightened
            return whole.refusal or replace(one, solution=whole, tightened=0, earlier=earlier)
        slowness = required_slowness(select_timed(self.limits), one.known.use)
        return self._slow(one, slowness * (1 + SLOWING_MARGIN))

    def _slow(self, one: CertifiedRun, slowness: float) -> CertifiedRun | None:
        """Slow the motion as a whole. Only a fastest motion from rest to rest may be slowed."""
        solution = one.solution
        if one.slowed >= MAX_SLOWINGS or not solution.fastest or solution.has_end_speed:
            return None
        return replace(one, solution=solution.slowed(slowness), slowed=one.slowed + 1)

    def _find_stays(self, profile: Profile) -> list[SpeedCap]:
        """Find the stretches on which an axis stays in a resonance band too long."""
        motion = profile.along(self.path)
        stretches = []
        for limit in self.limits:
            if not isinstance(limit, Resonance):
                continue
            for stay in find_stays(motion, limit):
                if stay.use > 1:
                    ends = motion.at(np.array([stay.start, stay.end])).along
                    stretches.append(SpeedCap(stay.band, *ends.tolist()))
        return stretches

    def _hold_axes(
        self,
        one: CertifiedRun,
        stays: Sequence[SpeedCap],
    ) -> CertifiedRun | MotionError | None:
        """Solve with axes held below bands in more places, or slow the motion below all bands."""
        if one.holdings < MAX_HOLDINGS:
            caps = (*one.caps, *self._choose_caps(one, stays))
            solution = self.goal.solve(self._pose(one.run, caps))
            if solution.solved:
                return replace(one, solution=solution, caps=caps, holdings=one.holdings + 1)
            if not one.solution.fastest:
                return solution.refusal
        resonances = [limit for limit in self.limits if isinstance(limit, Resonance)]
        below = [limit.kept_below() for limit in resonances]
        use = sample_limit_use(self.path, below, one.solution.profile)
        return self._slow(one, required_slowness(resonances, use) * (1 + BAND_MARGIN))

    def _choose_caps(self, one: CertifiedRun, stays: Sequence[SpeedCap]) -> Sequence[SpeedCap]:
        """Choose where to hold axes: where they stay, or over the whole run, farther below."""
        if one.holdings < STRETCH_ROUNDS:
            return stays
        first, last = one.run.breaks(self.path)[[0, -1]].tolist()
        caps = []
        for band in dict.fromkeys(stay.band for stay in stays):
            earlier = sum(
                (cap.band, cap.first, cap.last) == (band, first, last) for cap in one.caps
            )
            margin = BAND_MARGIN * MARGIN_GROWTH**earlier
            caps.append(SpeedCap(band, first, last, margin))
        return caps


def _find_room(solution: RunSolution) -> Mapping[str, Array] | None:
    """Return the room of each limit on each time piece, where these are a problem's intervals.

    A motion that was slowed keeps the rows as well, if all terms of a row fall alike with time.
    """
    problem = solution.problem
    if problem is None or solution.parts or len(problem.piece) != len(solution.profile.h):
        return None
    homogeneous = all(len({term.per_time for term in block.start}) == 1 for block in problem.blocks)
    if solution.slowness != 1 and not homogeneous:
        return None
    return {block.name: block.room for block in problem.blocks}


def hold_axes(limits: Sequence[Limit], caps: Sequence[SpeedCap]) -> tuple[Limit, ...]:
    """Return the limits with axes held below resonance bands on more stretches."""
    if not caps:
        return tuple(limits)
    return tuple(each.hold_more(caps) if isinstance(each, Resonance) else each for each in limits)
