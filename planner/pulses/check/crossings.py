"""Pulses that stand for crossings of evenly spaced levels: of half a pulse, of whole counts, with hysteresis or not."""

from dataclasses import dataclass

import numpy as np

from kinematics.array import Array
from planner.pulses.check.samples import HALF_TICK, Samples
from planner.pulses.check.search import Search, turned
from planner.pulses.schedule import Ticks

LOOKED = 33  # instants about a pulse that was moved for its drive


@dataclass(frozen=True, slots=True)
class Crossings:
    """A pulse wherever x crosses k + above, on the nearest whole `grain` of ticks; between pulses x crosses none.

    hysteresis  pulses: the first pulse after one the other way, and the very first, is so far beyond its level
    """

    above: float
    hysteresis: float = 0.0
    grain: int = 1

    @property
    def exact(self) -> bool:
        return True

    @property
    def wait(self) -> float:
        return HALF_TICK * self.grain if self.grain == 1 else float(self.grain)  # the last may be cut to the end

    @property
    def begins(self) -> tuple[float, float]:
        return 1 - self.above, self.above

    def sides(self, search: Search, s: Samples) -> tuple[Array, Array]:
        below, above = np.where(s.way >= 0, self.hysteresis, 0.0), np.where(s.way <= 0, self.hysteresis, 0.0)
        return below + (1 - self.above + search.widened), above + (self.above + search.widened)

    def judge(self, search: Search, ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        """Each pulse at the crossing of the level between its two counts, going its way, on an axis that moves."""
        tick, noise = search.tick, search.noise(s)
        beyond = sign * self.hysteresis * turned(sign, search.way)
        level = s.count - (1 + sign) / 2 + self.above + beyond
        miss = level - s.x
        miss = np.sign(miss) * np.maximum(abs(miss) - noise, 0.0)
        # The nearer root of v τ + a τ²/2 = miss: how long after the sample x is at the level.
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(np.maximum(s.v**2 + 2 * s.a * miss, 0.0))
            wait = np.where(miss == 0, 0.0, 2 * miss / (s.v + np.copysign(root, s.v)))
        error = (ticks * tick - s.t - wait) / tick
        error[np.isnan(error)] = np.inf
        tolerance = np.full(len(ticks), HALF_TICK * self.grain)
        if self.grain > 1:
            final = search.motion.duration / tick // self.grain * self.grain
            tolerance[ticks == final] = self.grain * (1 + 1e-3)
            error[ticks % self.grain != 0] = np.inf  # the timer's clock has no such tick
        near = np.zeros(len(ticks), bool)
        late = np.flatnonzero(abs(error) > tolerance)
        if search.shift and len(late) <= sum(one.pulses for one in search.schedule.moves):
            near[late] = self._near(search, ticks[late], level[late])
        search.due(ticks, error, tolerance, near)
        kept = ~near
        told = abs(miss) - s.travel(self.grain * tick) - search.widened * near
        search.position_error = max(search.position_error, float(told.max(initial=0.0)))
        astray = kept & (sign * s.v < -(abs(s.a) * tick + abs(s.j) * tick**2) * self.grain - noise / tick)
        search.report("against the motion", ticks[astray], "x moves at {:+.4g} pulses/s", s.v[astray])
        still = np.flatnonzero(kept & (s.v == 0))
        around = np.concatenate((s.t[still] - tick, s.t[still] + tick)).clip(0.0, search.motion.duration)
        resting = still[(search.at(around).v.reshape(2, -1) == 0).all(axis=0)]
        search.report("at rest", ticks[resting], "the axis stands still at {:.9g} s", s.t[resting])

    def conclude(self, search: Search) -> None:
        """What is missing leaves the sides of the count."""

    def _near(self, search: Search, ticks: Ticks, level: Array) -> np.ndarray:
        """(N,) whether x comes by the level within the largest shift that is stated for the axis."""
        reach = search.shift + HALF_TICK * self.grain
        t = ((ticks + np.linspace(-reach, reach, LOOKED)[:, None]) * search.tick).clip(0.0, search.motion.duration)
        s = search.at(t.ravel())
        x, blur = (each.reshape(t.shape) for each in (s.x, search.noise(s)))
        near: np.ndarray = (x.min(axis=0) - blur[0] <= level) & (level <= x.max(axis=0) + blur[0])
        return near
