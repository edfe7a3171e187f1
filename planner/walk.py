"""A path walked at unit speed: what depends on the place alone is the same under every timing, so this one serves."""

import numpy as np

from planner.actuation import ActuatorPath
from planner.trajectory import Trajectory

# Parts of a piece at least, and for each radian that it turns.
PARTS, PER_RADIAN = 8, 4


def walk(path: ActuatorPath) -> Trajectory:
    """The whole path at ṡ = 1, every piece in equal parts."""
    counts = np.maximum(PARTS, np.ceil(PER_RADIAN * path.turns)).astype(int)
    s = [np.linspace(path.breaks[k], path.breaks[k + 1], count + 1)[:-1] for k, count in enumerate(counts)]
    knots = np.append(np.concatenate(s), path.breaks[-1])
    nothing = np.zeros(len(knots) - 1)
    piece = np.repeat(np.arange(len(counts)), counts)
    return Trajectory(path, knots - knots[0], knots[:-1], nothing + 1, nothing, nothing, piece)
