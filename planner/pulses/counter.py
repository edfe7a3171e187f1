"""The position counters of the motion cards: what they hold, and the refusal of a motion that leaves them."""

import numpy as np

from kinematics.axis import Axis
from kinematics.errors import MotionError
from planner.pulses.schedule import AxisPulses

COUNTER = -(1 << 27), (1 << 27) - 1
"""What the 28-bit position counters of the cards hold [Sahbaz 2007]."""


def refuse_counter(pulses: AxisPulses, axis: Axis) -> None:
    """Raise MotionError where an axis, at rest or moving, stands at a count that its card's register does not hold.

    The register counts as the wiring does: an axis of direction -1 the other way.
    """
    counts = np.cumsum(pulses.direction, dtype=np.int64)
    for away in (counts.min(initial=0), counts.max(initial=0)):
        wired = (pulses.start + int(away)) * axis.direction
        if not COUNTER[0] <= wired <= COUNTER[1]:
            raise MotionError(
                f"axis {axis.name}: the motion counts to {wired}, beyond the {COUNTER[0]} .. {COUNTER[1]} of the "
                f"28-bit position counter of card {axis.card}; use a longer pulse, or work nearer to home"
            )
