"""The firing rule `sampled`: at each period, one pulse towards the motion if it is more than half a
pulse away.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from planner.parallel import Progress
from planner.pulses.generation.firing_rule import Rule, require_whole
from planner.pulses.generation.levels import BLOCK_PULSES
from planner.pulses.generation.motion_parts import Fired, MotionPart
from planner.pulses.generation.pieces import FIT_TOLERANCE, bound_rate, fit, rate_error
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import AxisPulses, Ticks


@dataclass(frozen=True, slots=True)
class Sampled(Rule):
    """At every period Δt, where |x - count| > ½, one pulse towards x = (q(t) - home)/pulse [Motion
    2-D, 4.4.b].

    |count - x| ≤ ½ + max|ẋ|·Δt, + one tick's travel. An axis gets one pulse a period at most, so one that runs faster
    than 1/Δt would fall behind: it is refused. The last instant is the end of the motion, so the
    final counts are
    exact; the first is less than Δt after the start.
    """

    name: ClassVar[str] = "sampled"
    period: float = option(2e-5, "sampling period; a whole number of clock ticks", "s")

    def __post_init__(self) -> None:
        if not 0 < self.period < np.inf:
            raise MotionError(f"period {self.period!r} s: must be positive, e.g. 20 us")

    @property
    def whole_reason(self) -> str:
        return "it looks at the motion at even times up to its end"

    def grain(self, clock_hz: int) -> int:
        period = round(self.period * clock_hz)
        if not (period >= 1 and abs(period / clock_hz - self.period) <= 1e-9 * self.period):
            raise MotionError(
                f"period {self.period!r} s is {self.period * clock_hz!r} ticks of {clock_hz} Hz: must be a whole "
                f"number, e.g. {1e6 * max(period, 1) / clock_hz!r} us"
            )
        return period

    def fire(self, part: MotionPart) -> Fired:
        """Raises Infeasible for an axis faster than a pulse a period, MotionError for a period of
        no whole ticks, and for a part of a motion.
        """
        require_whole(self, part)
        motion, axes, home, clock_hz = part.motion, part.axes, part.home, part.clock_hz
        pulse = np.array([axis.pulse for axis in axes])
        pieces = fit(motion, FIT_TOLERANCE * pulse)
        widest = []
        for k, axis in enumerate(axes):
            speed, t = bound_rate(pieces, k, 1)
            rate = speed / axis.pulse
            if rate * self.period > 1:
                raise rate_error(
                    motion, axis, t, rate, 1 / self.period, _describe_remedy(rate, clock_hz)
                )
            widest.append(0.5 + rate * self.period)
        ticks, counts = self._counts(motion, home, pulse, clock_hz, part.tell)
        fired = []
        for k, axis in enumerate(axes):
            change = np.diff(counts[:, k])
            at = np.flatnonzero(change)
            sign = change[at].astype(np.int8)
            start = int(counts[0, k])
            fired.append(
                AxisPulses(axis.name, ticks[at], sign, start, axis.pulse, float(home[k]), widest[k])
            )
        return Fired(tuple(fired), (0,) * len(fired))

    def _counts(
        self, motion: AxesMotion, home: Array, pulse: Array, clock_hz: int, tell: Progress
    ) -> tuple[Ticks, Ticks]:
        """The instants (N,) in ticks, and the counts (N+1, axes) before the first and after
        each.
        """
        period = self.grain(clock_hz)
        end = round(motion.duration * clock_hz)
        ticks = np.arange(end % period, end + 1, period, dtype=np.int64)
        x = np.empty((len(ticks) + 1, len(pulse)))
        x[0] = (motion.at(np.zeros(1)).q[0] - home) / pulse
        for lo in range(0, len(ticks), BLOCK_PULSES):
            t = np.minimum(ticks[lo : lo + BLOCK_PULSES] / clock_hz, motion.duration)
            x[lo + 1 : lo + 1 + len(t)] = (motion.at(t).q - home) / pulse
            tell(lo + len(t), len(ticks))
        low, high = np.ceil(x - 0.5).astype(np.int64), np.floor(x + 0.5).astype(np.int64)
        for i, k in zip(*np.nonzero(high > low), strict=True):  # half-way: the count stays
            if i > 0 and low[i - 1, k] > low[i, k]:
                low[i, k] = high[i, k]
        return ticks, low


def _describe_remedy(rate: float, clock_hz: int) -> str:
    """rate: pulses/s that no period may be longer for."""
    ticks = int(clock_hz / rate)
    shorter = (
        f"a period of {1e6 * ticks / clock_hz:.10g} us or less"
        if ticks
        else "a faster clock and a shorter period"
    )
    return f"slow the motion, use a longer pulse, or {shorter}"
