"""Motions of a duration that cross resonance bands in time and are slow elsewhere, where the smoothest would not."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis
from planner.certificate.resonance_dwell import Stay, find_stays
from planner.limits.axis import Acceleration, Jerk, Speed
from planner.limits.limit import AxisLimit, Limit
from planner.limits.resonance import Resonance, SpeedCap
from planner.path.actuation import ActuatorPath
from planner.timing.certified_run import hold_axes
from planner.timing.problem import Run
from planner.timing.profile import Profile
from planner.timing.run import solve_run

# Shares of the axes' accelerations and jerks that are tried in turn: the gentlest that crosses every band in time.
EASING_SHARES = (0.1, 0.3, 0.9)
# By how much a motion may be shorter than it shall be, before it is slowed to that: room for the proof, and no more
# than what a crossing has to spare.
MIN_SHORTENING, MAX_SHORTENING = 1e-4, 2e-3
BISECTIONS_OF_PACE = 40


@dataclass(frozen=True, slots=True)
class Pacer:
    """What it takes to time one run anew."""

    path: ActuatorPath
    limits: tuple[Limit, ...]
    axes: tuple[Axis, ...]
    run: Run
    order: int

    def paced(self, duration: float) -> Profile | None:
        """The fastest motion under lower speeds, and gentler, so that it takes so long (s); None if none is found.

        An axis that would stay in a band too long is held below it.
        """
        held: list[SpeedCap] = []
        for _ in range(1 + len(self._bands)):
            late: list[Stay] = []
            for eased in EASING_SHARES:
                profile = self._fit_duration(hold_axes(self.limits, held), eased, duration)
                if profile is not None:
                    late = self.late(profile)
                    if not late:
                        return profile
            if not late:
                return None
            held += self._list_caps({stay.band.axis for stay in late})
        return None

    def late(self, profile: Profile) -> list[Stay]:
        """Where it stays in a band too long."""
        motion = profile.along(self.path)
        return [stay for limit in self._bands for stay in find_stays(motion, limit) if stay.use > 1]

    def below(self) -> tuple[Limit, ...]:
        """The limits with every axis held below its bands."""
        return hold_axes(self.limits, self._list_caps(set(range(len(self.axes)))))

    def fastest(self, limits: Sequence[Limit]) -> Profile | None:
        """Return the fastest motion under other limits; None if no solver has one."""
        solution = solve_run(self.path, limits, replace(self.run, whole=True), self.order)
        return solution.profile if solution.solved else None

    @property
    def _bands(self) -> list[Resonance]:
        return [limit for limit in self.limits if isinstance(limit, Resonance) and limit.bands]

    def _list_caps(self, axes: set[int]) -> list[SpeedCap]:
        ends = self.run.breaks(self.path)[[0, -1]].tolist()
        return [SpeedCap(band, *ends) for limit in self._bands for band in limit.bands if band.axis in axes]

    def _fit_duration(self, limits: Sequence[Limit], eased: float, duration: float) -> Profile | None:
        """Under speeds that are a share of those reached without: found by secants, as the duration all but goes with
        the share's inverse, and by halving where they lead out. The first share is that of the free motion slowed.
        """
        free = self.fastest([*self._gentler(limits, eased, None)])
        if free is None or free.duration > duration * (1 - MIN_SHORTENING):
            return None
        most = np.abs(free.along(self.path).within(np.arange(len(free.h)), free.h).qd).max(0)
        low, high, found = 0.0, 1.0, free
        share, before = free.duration / duration, (1.0, free.duration)
        for _ in range(BISECTIONS_OF_PACE):
            tried = self.fastest([*self._gentler(limits, eased, share * most)])
            if tried is None:
                return None
            if tried.duration <= duration * (1 - MIN_SHORTENING):
                found, high = tried, share
            else:
                low = share
            if found.duration >= duration * (1 - MAX_SHORTENING):
                break
            now = 1 / share, tried.duration
            rise = (now[0] - before[0]) / (now[1] - before[1]) if now[1] != before[1] else 0.0
            inverse = now[0] + rise * (duration * (1 - (MIN_SHORTENING + MAX_SHORTENING) / 2) - now[1])
            share, before = 1 / inverse if inverse > 0 else low, now
            if not low < share < high:
                share = (low + high) / 2
        return found.slowed(duration / found.duration)

    def _gentler(self, limits: Sequence[Limit], eased: float, speeds: Array | None) -> Iterator[Limit]:
        """The limits with shares of the accelerations and jerks, and lower speeds."""
        if speeds is not None:  # of the axes; the limit is the motors'
            speeds = speeds * np.array([axis.motor_ratio for axis in self.axes])
        if speeds is not None and not any(isinstance(limit, Speed) for limit in limits):
            yield Speed(self.axes, [*speeds])
        for limit in limits:
            if isinstance(limit, (Acceleration, Jerk)):
                yield _bound_limit(limit, self.axes, eased * limit.below, eased * limit.bounds)
            elif isinstance(limit, Speed) and speeds is not None:
                yield _bound_limit(limit, self.axes, np.minimum(limit.below, speeds), np.minimum(limit.bounds, speeds))
            else:
                yield limit


def _bound_limit(limit: AxisLimit, axes: Sequence[Axis], below: Array, bounds: Array) -> Limit:
    return type(limit)(axes, [*zip(below.tolist(), bounds.tolist(), strict=True)])
