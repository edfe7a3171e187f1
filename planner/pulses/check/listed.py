"""Pulses of a digital differential analyser between listed points of the motion: where each is due."""

from dataclasses import dataclass, replace

import numpy as np

from kinematics.array import Array, frozen
from planner.pulses.check.band import check_band
from planner.pulses.check.samples import HALF_TICK, Samples
from planner.pulses.check.search import Search
from planner.pulses.motion import Motion
from planner.pulses.schedule import PulseSchedule, Ticks


@dataclass(frozen=True, slots=True)
class Listed:
    """Bursts of `size` pulses at a rate (1/s), each of one direction.

    Of the c counts of an axis in a move of k steps, the n-th is sent at step ⌈(n·k - 1)/c⌉ of 1 … k (k = 1: at the
    one), and the steps share the time between two listed points evenly.
    began (B,) s, sign (B,): of all bursts of the axis, as the motion at the listed points asks for them
    """

    size: int
    rate: float
    began: Array
    sign: Array

    @property
    def exact(self) -> bool:
        return True

    @property
    def wait(self) -> float:
        return 2 * HALF_TICK

    @classmethod
    def of(cls, motion: Motion, k: int, schedule: PulseSchedule, spacing: float, size: int, rate: float) -> "Listed":
        moves = max(1, int(np.ceil(motion.duration / spacing)))
        gap = motion.duration / moves
        listed = motion.at(np.minimum(np.arange(moves + 1) * gap, motion.duration)).q
        pulse, home = (np.array([getattr(axis, name) for axis in schedule.axes]) for name in ("pulse", "home"))
        x = (listed - home) / pulse
        counts = np.diff(np.rint((x - x[0]) / size).astype(np.int64), axis=0)
        steps, own = abs(counts).max(axis=1), abs(counts[:, k])
        move = np.repeat(np.arange(moves), own)
        nth = np.arange(len(move)) - np.repeat(np.cumsum(own) - own, own) + 1
        step = -(-(nth * steps[move] - (steps[move] > 1)) // own[move])
        began = (move + (step - 1) / steps[move]) * gap
        return cls(size, rate, frozen(began), frozen(np.sign(counts[move, k])))

    @property
    def begins(self) -> tuple[float, float]:
        return 0.5, 0.5

    def sides(self, search: Search, s: Samples) -> tuple[Array, Array]:
        bound = np.full(len(s.t), search.axis.bound)
        return bound, bound

    def judge(self, search: Search, ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        check_band(search, s)
        check_band(search, replace(s, count=s.count - sign))
        burst, nth = np.divmod(first + np.arange(len(ticks)), self.size)
        known = burst < len(self.began)
        burst = np.minimum(burst, len(self.began) - 1)
        error = np.full(len(ticks), np.inf)
        if known.any():
            due = (self.began[burst] + nth / self.rate) / search.tick
            error[known] = (ticks - due)[known]
            wrong = known & (sign != self.sign[burst])
            search.report(
                "against the motion", ticks[wrong], "its listed points ask for {:+.0f}", self.sign[burst][wrong]
            )
        near = abs(error) <= search.shift + HALF_TICK
        search.due(ticks, error, np.full(len(ticks), HALF_TICK), near)

    def conclude(self, search: Search) -> None:
        missing = len(self.began) * self.size - search.pulses
        if missing:
            end = np.array([search.motion.duration / search.tick])
            search.report("pulses", np.rint(end), "{:.0f} fewer than its listed points ask for", np.array([missing]))
