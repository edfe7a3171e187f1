"""Sampled use of the limits by a motion: quick, and no proof.

The certificate bounds every limit over continuous time and takes far longer. While a run is being
solved, samples show where it still exceeds a limit.
"""

from collections.abc import Sequence
from functools import reduce

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from planner.limits.limit import Limit, order_of, select_timed
from planner.path.actuation import ActuatorPath
from planner.timing.profile import Profile

# Instants of each time piece. Parabolas through each three of them give a quadratic's peak exactly,
# and miss about the third derivative's share of others. Pieces without jerk are more and shorter.
INSTANTS = 5
INSTANTS_WITHOUT_JERK = 3
# A limit that is used less than this is not sampled again while a run is being solved.
MIN_WATCHED_USE = 0.5
# Pieces that are sampled together: memory stays small, however long a run is.
BATCH = 2000


def sample_limit_use(
    path: ActuatorPath,
    limits: Sequence[Limit],
    profile: Profile,
) -> dict[str, Array]:
    """Return the largest use (M,) of each limit on time that is sampled on each time piece."""
    motion = profile.along(path)
    timed = select_timed(limits)
    pieces = np.arange(len(profile.h))
    use = {limit.name: np.empty(len(pieces)) for limit in timed}
    count = INSTANTS if profile.j.any() else INSTANTS_WITHOUT_JERK
    share = np.linspace(0.0, 1.0, count)
    for first in range(0, len(pieces), BATCH):
        batch = pieces[first : first + BATCH]
        tau = (profile.h[batch, None] * share).ravel()
        state = motion.within(np.repeat(batch, count), tau, jerk=order_of(limits) == 3)
        for limit in timed:
            values = limit.value(state).reshape(len(batch), count, -1)
            low, high = _bound_parabolas(values)
            use[limit.name][batch] = largest_in_rows(limit.use(low, high, profile.piece[batch]))
    return use


def _bound_parabolas(values: Array) -> tuple[Array, Array]:
    """Return the least and largest (M, m) of parabolas through each three of values (M, 2n+1,
    m).
    """
    first = values[:, :-2:2]
    middle = values[:, 1::2]
    last = values[:, 2::2]
    second_difference = first - 2 * middle + last
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = (first - last) / (2 * second_difference)  # in steps from the middle
        extreme = middle - second_difference * vertex**2 / 2
        peak = np.where(np.abs(vertex) < 1, extreme, middle)
    candidates = [*np.moveaxis(values, 1, 0), *np.moveaxis(peak, 1, 0)]
    return reduce(np.minimum, candidates), reduce(np.maximum, candidates)
