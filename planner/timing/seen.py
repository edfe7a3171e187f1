"""What a profile uses of every limit, looked at closely: cheap, and no proof."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit, order_of
from planner.timing.profile import Profile

# Instants of each time piece that are looked at: a parabola through each three of them tells its own peak exactly, and
# so misses what a piece's fourth derivative adds, 1/LOOKED⁴ and less of it. Without jerk, pieces are more and shorter.
LOOKED, WITHOUT_JERK = 9, 3


def seen(path: ActuatorPath, limits: Sequence[Limit], profile: Profile) -> dict[str, Array]:
    """The largest share (M,) of each limit on time that is met in each time piece."""
    motion, pieces = profile.along(path), len(profile.h)
    share = np.linspace(0.0, 1.0, LOOKED if profile.j.any() else WITHOUT_JERK)
    state = motion.within(
        np.repeat(np.arange(pieces), len(share)), (profile.h[:, None] * share).ravel(), jerk=order_of(limits) == 3
    )
    found = {}
    for limit in limits:
        if not limit.geometric:
            low, high = _ranges(limit.value(state).reshape(pieces, len(share), -1))
            found[limit.name] = limit.use(low, high, profile.piece).max(1)
    return found


def _ranges(values: Array) -> tuple[Array, Array]:
    """The least and the largest (M, m) of (M, 2n + 1, m) values: of parabolas through each three of them."""
    first, middle, last = values[:, :-2:2], values[:, 1::2], values[:, 2::2]
    bend = first - 2 * middle + last
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (first - last) / (2 * bend)  # of the peak from the middle, in steps
        peak = np.where(np.abs(at) < 1, middle - bend * at**2 / 2, middle)
    return np.minimum(values.min(1), peak.min(1)), np.maximum(values.max(1), peak.max(1))
