"""Where an axis turns round, as play feels it."""

import numpy as np

from kinematics.axis import Axis
from planner.pulses.stretches import Stretches

# Share of a pulse within which an axis rests.
STILL = 1e-4


def turning_points(stretches: Stretches, axis: Axis) -> tuple[list[tuple[float, float, float]], float]:
    """When an axis comes to a turn, when it leaves it, and which way; the farthest run back that turns nothing.

    Runs back by less than half a pulse turn nothing. Before its first move an axis has come from where `pushed` says.
    """
    pulse, ends, start = axis.pulse, stretches.ends, stretches.start
    stop = start + stretches.length
    turns: list[tuple[float, float, float]] = []
    way, extreme, reached, left = float(f"{axis.pushed}1"), float(ends[0]), float(start[0]), float(start[0])
    rest, gone, farthest, unturned = extreme, False, 0.0, 0.0
    for k in np.flatnonzero(np.diff(ends)).tolist():
        x = float(ends[k + 1])
        if (x - extreme) * way > 0:
            extreme, unturned, farthest = x, max(unturned, farthest), 0.0
            if (x - rest) * way > STILL * pulse:
                rest, reached, gone = x, float(stop[k]), False
            continue
        back = (extreme - x) * way
        if not gone and back > STILL * pulse:  # the first stretch away from the extreme
            left, gone = max(reached, float(start[k])), True
        farthest = max(farthest, back)
        if back >= pulse / 2:
            way = -way
            turns.append((reached, left, way))
            extreme, rest, reached, gone, farthest = x, x, float(stop[k]), False, 0.0
    return turns, max(unturned, farthest)
