"""Pulses of looks at the motion at even times: at each, one towards it where it is more than half a pulse away."""

from dataclasses import dataclass, replace

import numpy as np

from kinematics.array import Array
from planner.pulses.check.band import check_band
from planner.pulses.check.samples import HALF_TICK, Samples
from planner.pulses.check.search import Search
from planner.pulses.schedule import Ticks

BLOCK = 1 << 15  # looks gone through together


@dataclass(frozen=True, slots=True)
class Looks:
    """Every pulse at a look, towards x, which is ½ or more from the count; after each look it is no farther than ½.

    Looks are a period (ticks) apart, and the last at the end of the motion. With those two there is no other schedule,
    but where x is half-way to rounding. Pulses that were moved apart are late for as many looks as their
    largest shift holds, at most; within that number another pulse may be late unseen.
    """

    period: int

    @property
    def exact(self) -> bool:
        return True

    @property
    def wait(self) -> float:
        return 2 * HALF_TICK

    @property
    def begins(self) -> tuple[float, float]:
        return 0.5, 0.5

    def sides(self, search: Search, s: Samples) -> tuple[Array, Array]:
        bound = np.full(len(s.t), search.axis.bound)
        return bound, bound

    def judge(self, search: Search, ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        before = replace(s, count=s.count - sign)
        check_band(search, s)
        check_band(search, before)
        offset = round(search.motion.duration / search.tick) % self.period
        error = (ticks - offset + self.period // 2) % self.period - self.period // 2
        far = sign * (s.x - before.count)
        asked = far >= 0.5 - search.noise(s)
        early = search.shift > 0 and far >= 0.5 - search.noise(s) - search.widened
        needless = ~(asked | early)
        search.report("not asked for", ticks[needless], "x is {:+.6g} pulses on its way", far[needless])
        # by whole periods, too, a pulse may have been moved to before it was asked for
        off = np.where((error == 0) & ~asked & early, self.period, error).astype(float)
        search.due(ticks, off, np.full(len(ticks), HALF_TICK), early | (abs(off) <= search.shift))
        until = int(ticks[-1]) if len(ticks) else round(search.motion.duration / search.tick)
        self._looked(search, ticks, sign, until, offset)

    def conclude(self, search: Search) -> None:
        """No more looks found x farther than ½ than those that moved pulses were late for."""
        stated = sum(one.pulses for one in search.schedule.moves if one.axis == search.axis.name)
        late = search.moved[1] - search.moved[0]
        if late > stated * (search.shift // self.period + 1):
            search.report("late at looks", np.zeros(1, np.int64), "{:.0f} in all", np.array([late]))

    def _looked(self, search: Search, ticks: Ticks, sign: Array, until: int, offset: int) -> None:
        """After every look since the pulses before, up to a tick, x is at most ½ from the count."""
        counts = search.count + np.concatenate(([0.0], np.cumsum(sign)))
        begin = -(-(search.seen - offset) // self.period) * self.period + offset
        for lo in range(begin, until + 1, self.period * BLOCK):
            looks = np.arange(lo, min(lo + self.period * BLOCK, until + 1), self.period)
            s = search.at((looks * search.tick).clip(0.0, search.motion.duration))
            away = abs(s.x - counts[np.searchsorted(ticks, looks, side="right")])
            late = ~(away <= 0.5 + search.noise(s))
            # a pulse that was moved may be due at the look, and come after
            far = late & ~((search.shift > 0) & (away <= search.axis.bound + s.travel(search.tick) + search.noise(s)))
            search.report("late at a look", looks[far], "{:.6g} pulses away", away[far])
            least, most = search.moved
            search.moved = least, most + int((late & ~far).sum())
        search.seen = until + 1
