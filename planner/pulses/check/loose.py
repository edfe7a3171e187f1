"""Pulses of which nothing is known but by how much their count may be from the motion."""

from dataclasses import replace

import numpy as np

from kinematics.array import Array
from planner.pulses.check.band import check_band
from planner.pulses.check.samples import HALF_TICK, Samples
from planner.pulses.check.search import Search
from planner.pulses.schedule import Ticks


class Loose:
    """|count - x| ≤ bound + one tick's travel; a pulse against the motion brings the count nearer to it."""

    exact, wait = False, 2 * HALF_TICK
    begins = np.inf, np.inf

    def sides(self, search: Search, s: Samples) -> tuple[Array, Array]:
        bound = np.full(len(s.t), search.axis.bound)
        return bound, bound

    def judge(self, search: Search, ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        check_band(search, s)
        before = replace(s, count=s.count - sign)
        check_band(search, before)
        away = sign * (s.x - before.count) < 0.5 - search.noise(s)
        astray = away & (sign * s.v < -(abs(s.a) * search.tick) - search.noise(s) / search.tick)
        search.report("against the motion", ticks[astray], "x moves at {:+.4g} pulses/s", s.v[astray])

    def conclude(self, search: Search) -> None:
        """Nothing that it could miss."""
