"""What a profile uses of every limit, looked at closely: cheap, and no proof."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit
from planner.timing.profile import Profile

# Instants of each time piece that are looked at: a parabola's peak between them is missed by 1/1024 of its height; and
# of pieces without jerk, which are more and shorter, by 1/64.
LOOKED, WITHOUT_JERK = np.linspace(0.0, 1.0, 33), np.linspace(0.0, 1.0, 9)


def seen(path: ActuatorPath, limits: Sequence[Limit], profile: Profile) -> dict[str, Array]:
    """The largest share (M,) of each limit on time that is met in each time piece."""
    motion = profile.along(path)
    looked = LOOKED if profile.j.any() else WITHOUT_JERK
    k = np.repeat(np.arange(len(profile.h)), len(looked))
    state = motion.within(k, (profile.h[:, None] * looked).ravel())
    found = {}
    for limit in limits:
        if not limit.geometric:
            value = limit.value(state)
            found[limit.name] = limit.use(value, value, state.piece).max(1).reshape(-1, len(looked)).max(1)
    return found
