"""Sampled use of the limits by a motion: quick, and no proof.

The certificate bounds every limit over continuous time and takes far longer. While a run is being
solved, samples show where it still exceeds a limit.
"""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from kinematics.foundation.kernels import Floats2, Floats3, kernel
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
            low, high = bound_parabolas(values)
            use[limit.name][batch] = largest_in_rows(limit.use(low, high, profile.piece[batch]))
    return use


def bound_parabolas(values: Array) -> tuple[Array, Array]:
    """Return the least and largest (M, m) of parabolas through threes of values (M, 2n + 1, m)."""
    low = np.full(values[:, 0].shape, np.inf)
    high = -low
    _widen_range(np.ascontiguousarray(values), low, high)
    return low, high


@kernel
def _widen_range(values: Floats3, low: Floats2, high: Floats2) -> None:
    """Widen the range from low to high (M, m) to all values, and to the vertices between them."""
    pieces, instants, channels = values.shape
    for k in range(pieces):
        for i in range(1, instants, 2):
            for c in range(channels):
                first = values[k, i - 1, c]
                middle = values[k, i, c]
                last = values[k, i + 1, c]
                least = min(first, middle, last)
                most = max(first, middle, last)
                second_difference = first - 2 * middle + last
                if not np.isfinite(second_difference):  # nothing is known of the range
                    least = -np.inf
                    most = np.inf
                # a vertex between first and last
                if abs(first - last) < 2 * abs(second_difference):
                    vertex = middle - (first - last) ** 2 / (8 * second_difference)
                    least = min(least, vertex)
                    most = max(most, vertex)
                low[k, c] = min(low[k, c], least)
                high[k, c] = max(high[k, c], most)
