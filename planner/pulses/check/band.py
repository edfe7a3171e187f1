"""Between its pulses, too, an axis stays within its sides of the count."""

import numpy as np

from planner.pulses.check.samples import Samples
from planner.pulses.check.search import Search


def check_band(search: Search, s: Samples) -> None:
    """Each sample within the sides of its count."""
    beyond, wait = search.excess(s) - search.noise(s), search.standard.wait * search.tick
    told = beyond - s.travel(max(wait, search.tick))
    search.position_error = max(search.position_error, float(told.max(initial=0.0)))
    out = ~(beyond <= s.travel(wait))
    search.report("far from its count", np.rint(s.t[out] / search.tick), "{:.6g} pulses", abs(s.x - s.count)[out])


def check_between(search: Search, chain: Samples) -> None:
    """Halve the intervals between samples in which x might turn outside the band, and look there."""
    a, b = chain[:-1], chain[1:]
    while len(a.t):
        span = b.t - a.t
        steepest = np.maximum(abs(a.a), abs(b.a)) + span * np.maximum(abs(a.j), abs(b.j))
        bulge = steepest * span**2 / 8  # by how much x can pass both ends of the interval
        # up to b the count is that from a on
        seen = Samples(b.t, b.x, b.v, b.a, b.j, a.count, a.way)
        away = np.maximum(search.excess(a), search.excess(seen))
        stays = (away + bulge <= 0) | (bulge <= search.noise(a))
        monotone = np.maximum(abs(a.v), abs(b.v)) >= steepest * span
        unsure = ~(stays | monotone) & (span > search.tick) & np.isfinite(away)
        a, b = a[unsure], b[unsure]
        middle = search.sample((a.t + b.t) / 2, a.count, a.way)
        check_band(search, middle)
        a, b = a.followed_by(middle), middle.followed_by(b)
