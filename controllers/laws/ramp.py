"""A stretch of command whose speed is a straight line, as one command of the card."""

import numpy as np

from controllers.card import TAMove
from kinematics.array import Array


def ramp(target: Array, start: Array, end: Array, counter: Array, dt: float) -> TAMove:
    """TAMove to `target` in exactly dt, the speed going from about `start` to about `end` (signed, pulses/s).

    The speeds are both moved by what makes their mean (target − counter)/dt: so what rounding left undone before is
    made up for here, and nothing adds up. A speed that then points the other way becomes zero and the other twice the
    mean: one command of the card does not turn round.

    target, counter  (…) pulses, the target rounded to whole ones
    """
    way = np.rint(target) - counter
    mean, side = np.abs(way) / dt, np.where(way < 0, -1.0, 1.0)
    half = np.clip(side * (end - start) / 2, -mean, mean)
    return TAMove(counter + way, mean - half, mean + half, dt, 0.0)
