"""Motions beside which their ramps of jerk are brief: of hours to decades, or under a jerk limit next to none.

No solver tells a ramp of s̈ that takes a billionth of the motion from none, and an average over it cancels digits. But
an order-2 motion is no longer than one with jerk limits too, so that its own average over a window w, longer than it by
w, is within w of the fastest. Each step of s̈ becomes a ramp over w. With the motion's s, ṡ, s̈ at a step, and s̈₀ before,
the ramp begins at

    s − ṡ w/2 + s̈₀ w²/6,  ṡ − s̈₀ w/2,  s̈₀,  and has s⃛ = (s̈ − s̈₀)/w

which holds wherever no interval of the motion is shorter than w.
"""

import numpy as np

from kinematics.foundation.arrays import Array
from planner.timing.profile import Profile

# A window up to this share of the motion is brief, and one of at least LEAST of it is told from the rounding of
# instants; it is so many times as long as ramps need at least, as s̈ may step from its limit to that the other way.
BRIEF, LEAST, WIDE = 1e-5, 1e-9, 4.0


def ramped(motion: Profile, window: float, breaks: Array, first: int) -> Profile | None:
    """The average of an order-2 motion from rest to rest over a window about `window`, as long and as much longer.

    breaks (P+1,) of its run, whose pieces begin with number `first`. None where ramps are not brief, or overlap.
    """
    window = max(WIDE * window, LEAST * motion.duration)
    if not window <= min(BRIEF * motion.duration, float(motion.h.min())):
        return None
    s, v = np.append(motion.s, breaks[-1]), np.append(motion.v, 0.0)
    before, after = np.append(0.0, motion.a), np.append(motion.a, 0.0)
    j = (after - before) / window
    begun = s - v * window / 2 + before * window**2 / 6, v - before * window / 2, before, j, np.full(len(s), window)
    begun[0][0], begun[1][-1] = breaks[0], -before[-1] * window / 2
    # after each ramp but the last s̈ stays until the next one begins
    held = (
        s[:-1] + motion.v * window / 2 + motion.a * window**2 / 6,
        motion.v + motion.a * window / 2,
        motion.a,
        np.zeros(len(motion.h)),
        motion.h - window,
    )
    columns = [np.insert(ramp, np.arange(1, len(ramp)), hold) for ramp, hold in zip(begun, held, strict=True)]
    lasting = columns[4] > 0
    s, v, a, j, h = (column[lasting] for column in columns)
    return Profile(s, v, a, j, h, np.full(len(h), first)).cut(breaks, first)
