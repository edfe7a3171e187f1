"""How far apart an axis asks for its pulses: written down again from what axes and drives state, without their code."""

from dataclasses import dataclass
from math import inf

import numpy as np

from kinematics.array import Array
from kinematics.axis import Axis
from planner.pulses.check.search import Search
from planner.pulses.schedule import Signs, Ticks

SHORTENED = 1e-3  # of the interval of a stated rate, which whole ticks may shorten by less
ROUNDING = 1e-9  # ticks


@dataclass(frozen=True, slots=True)
class Gaps:
    """Least times (s) of an axis: from a pulse to the next, and to the next the other way; from 0 to the first.

    1/max_pulse_rate, 1/max_rate and high + low of its drive, whichever is longest; for a reversal DIR has to have held
    after the one pulse and be set up before the other.
    """

    one: float
    other: float
    first: float

    @classmethod
    def of(cls, axis: Axis) -> "Gaps":
        rates = [axis.max_pulse_rate or inf]
        levels = turn = first = 0.0
        if (drive := axis.timing) is not None:
            rates.append(drive.max_rate or inf)
            levels, turn = drive.high + drive.low, max(drive.high, drive.hold) + drive.setup
            first = drive.setup
        one = max(levels, (1 - SHORTENED) / min(rates))
        return cls(one, max(one, turn), first)

    def check(self, search: Search, ticks: Ticks, direction: Signs, way: int) -> None:
        """Report those of the next pulses (N,) that come too soon; way: of the pulse before them, 0 for none."""
        before = search.latest
        had = np.diff(ticks, prepend=0 if before is None else before)
        turned = np.diff(direction, prepend=way) != 0
        least: Array = np.where(turned, self.other, self.one)
        kinds = np.where(turned, "spacing at a reversal", "spacing")
        if before is None:
            least[0], kinds[0] = self.first, "direction set-up"
        short = had < least / search.tick - ROUNDING
        for kind in np.unique(kinds[short]).tolist():
            these = np.flatnonzero(short & (kinds == kind))
            text = f"{{:.6g}} us, and the axis takes {1e6 * least[these[0]]:.6g} us"
            search.report(kind, ticks[these], text, 1e6 * had[these] * search.tick)
