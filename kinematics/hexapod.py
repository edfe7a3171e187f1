"""The hexapod: six legs of variable length between a base and a moving platform."""

import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array
from kinematics.assembly import assembly_modes
from kinematics.legs import Legged
from kinematics.pose import Pose


def joint_circle(radius: float, gap: float, height: float) -> Array:
    """Joint centres (6, 3) on a circle, paired: azimuths γ/2, 120°∓γ/2, 240°∓γ/2, −γ/2 for the gap γ (rad) of a pair.

    Source: [Sahbaz 2007, chapter 5].
    """
    third, half = np.deg2rad(120), gap / 2
    azimuth = np.array([half, third - half, third + half, 2 * third - half, 2 * third + half, -half])
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(6, height)], 1)


class Hexapod(Legged):
    """Six legs, all six freedoms: joint centres (6, 3) in base and platform frames, of any geometry.

    Everything else as `Legged` has it.
    """

    legs = 6
    sorts = ("linear",) * 6

    def assembly_modes(self, q: ArrayLike) -> Pose:
        """Every pose with leg lengths q (6,), as far as they are found: see `kinematics.assembly`."""
        return assembly_modes(self, q)
