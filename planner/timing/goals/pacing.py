"""Motions of a duration that cross resonance bands in time and are slow elsewhere."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis
from planner.certificate.resonance_dwell import Stay, find_stays
from planner.limits.axis import Acceleration, Jerk, Speed
from planner.limits.limit import AxisLimit, Limit
from planner.limits.resonance import Resonance, SpeedCap
from planner.timing.attempts import solve_run
from planner.timing.certify_loop import hold_axes
from planner.timing.grid import Task
from planner.timing.profile import Profile

# Shares of the axes' accelerations and jerks, tried in turn: the gentlest that crosses in time.
EASING_SHARES = (0.1, 0.3, 0.9)
# A motion may be this much shorter than the duration before it is slowed to that: room for the
# proof, and no more than what a crossing has to spare.
MIN_SHORTENING = 1e-4
MAX_SHORTENING = 2e-3
# Secant steps at most.
MOST_STEPS = 20


@dataclass(frozen=True, slots=True)
class Pacer:
    """Times one run for a given duration under lower speeds."""

    task: Task
    axes: tuple[Axis, ...]

    def pace(self, duration: float) -> Profile | None:
        """Return the fastest motion under lower and gentler limits that takes `duration` (s).

        An axis that would stay in a band too long is held below it. None where no motion is found.
        """
        caps: list[SpeedCap] = []
        for _ in range(1 + len(self._resonances)):
            late: list[Stay] = []
            for easing in EASING_SHARES:
                limits = hold_axes(self.task.limits, caps)
                profile = self._fit_duration(limits, easing, duration)
                if profile is not None:
                    late = self.find_late(profile)
                    if not late:
                        return profile
            if not late:
                return None
            caps += self._list_caps({stay.band.axis for stay in late})
        return None

    def find_late(self, profile: Profile) -> list[Stay]:
        """Find the stays in a band that last too long."""
        motion = profile.along(self.task.path)
        stays = [stay for limit in self._resonances for stay in find_stays(motion, limit)]
        return [stay for stay in stays if stay.use > 1]

    def hold_below(self) -> Task:
        """Return the task with every axis held below its bands."""
        caps = self._list_caps(set(range(len(self.axes))))
        return replace(self.task, limits=hold_axes(self.task.limits, caps))

    def solve_fastest(self, limits: Sequence[Limit]) -> Profile | None:
        """Return the fastest motion under other limits, or None."""
        whole = replace(self.task.run, whole=True)
        solution = solve_run(replace(self.task, limits=limits, run=whole))
        return solution.profile if solution.solved else None

    @property
    def _resonances(self) -> list[Resonance]:
        return [limit for limit in self.task.limits if isinstance(limit, Resonance) and limit.bands]

    def _list_caps(self, axes: set[int]) -> list[SpeedCap]:
        ends = self.task.run.breaks(self.task.path)[[0, -1]].tolist()
        bands = [band for limit in self._resonances for band in limit.bands]
        return [SpeedCap(band, *ends) for band in bands if band.axis in axes]

    def _fit_duration(
        self,
        limits: Sequence[Limit],
        easing: float,
        duration: float,
    ) -> Profile | None:
        """Return the fastest motion with all speeds lowered by the factor that gives the duration.

        The duration nearly goes with the factor, so that secants find it. The first factor is that
        by which the free motion would have to be slowed.
        """
        free = self.solve_fastest([*self._ease(limits, easing, None)])
        longest = duration * (1 - MIN_SHORTENING)
        shortest = duration * (1 - MAX_SHORTENING)
        if free is None or free.duration > longest:
            return None
        states = free.along(self.task.path).within(np.arange(len(free.h)), free.h)
        most = np.abs(states.qd).max(0)
        most[most == 0] = np.inf  # an axis at rest is not held there
        target = (shortest + longest) / 2
        best = motion = free
        factor = 1.0
        slope = 1 / free.duration
        for _ in range(MOST_STEPS):
            if shortest <= motion.duration <= longest:
                break
            step = slope * (target - motion.duration)
            factor += step
            slower = self.solve_fastest([*self._ease(limits, easing, most / factor)])
            if slower is None:
                return None
            if slower.duration == motion.duration:
                break
            slope = step / (slower.duration - motion.duration)
            motion = slower
            if best.duration < motion.duration <= longest:
                best = motion
        return best.slowed(duration / best.duration)

    def _ease(
        self,
        limits: Sequence[Limit],
        easing: float,
        speeds: Array | None,
    ) -> Iterator[Limit]:
        """Yield the limits with a share of the accelerations and jerks, and with lower speeds."""
        if speeds is not None:
            # the limit is of the motors' speeds
            speeds = speeds * np.array([axis.motor_ratio for axis in self.axes])
            if not any(isinstance(limit, Speed) for limit in limits):
                yield Speed(self.axes, [*speeds])
        for limit in limits:
            if isinstance(limit, (Acceleration, Jerk)):
                yield self._bound(limit, easing * limit.below, easing * limit.bounds)
            elif isinstance(limit, Speed) and speeds is not None:
                below = np.minimum(limit.below, speeds)
                yield self._bound(limit, below, np.minimum(limit.bounds, speeds))
            else:
                yield limit

    def _bound(self, limit: AxisLimit, below: Array, bounds: Array) -> Limit:
        return type(limit)(self.axes, [*zip(below.tolist(), bounds.tolist(), strict=True)])
