"""The traverser: slides on leadscrews, and a rotary axis that may turn any number of times."""

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import frozen
from kinematics.axis import Axis
from kinematics.errors import MotionError
from kinematics.load import Load
from kinematics.machine import Machine
from kinematics.pose import Pose

# Sine of the angle between two slides below which they count as one.
PARALLEL = 1e-6


class Traverser(Machine):
    """q = (D⁻¹ p, φ): slide positions along the columns of D, and the turn about base z, the nearest to `near`.

    directions  (3, 3) unit vectors of the X, Y and Z slides in the base frame, one per row; the base axes by default
    length      m that count as one radian (the lever at which a turn is felt)

    Source: [Sasidhar 1981].
    """

    freedom = ("x", "y", "z", "rz")
    branched = True

    def __init__(
        self,
        *,
        axes: Sequence[Axis],
        home: Pose,
        directions: ArrayLike | None = None,
        length: float = 0.1,
        name: str = "traverser",
        load: Load | None = None,
    ) -> None:
        given = np.asarray(np.eye(3) if directions is None else directions, float)
        if given.shape != (3, 3) or not np.isfinite(given).all() or not np.linalg.norm(given, axis=1).all():
            raise MotionError(
                f"machine {name}: directions must be three vectors (3, 3), finite and not zero, not {directions!r}"
            )
        unit = given / np.linalg.norm(given, axis=1, keepdims=True)
        if abs(np.linalg.det(unit)) < PARALLEL:
            raise MotionError(f"machine {name}: the slides' directions {given.tolist()} do not span space")
        if not 0 < length < np.inf:
            raise MotionError(f"machine {name}: length {length} m per radian must be positive and finite")
        self.directions, self.characteristic_length = frozen(unit), float(length)
        self._held = home.rotation.as_matrix()
        super().__init__(name, axes, home, load=load)

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        turn = rotation @ self._held.T
        return ca.vertcat(np.linalg.inv(self.directions.T) @ position, nearest(turn[1, 0], turn[0, 0], near[3]))


def nearest(sine: ca.SX, cosine: ca.SX, near: ca.SX) -> ca.SX:
    """The angle of r (cos φ, sin φ) within half a turn of `near`."""
    s, c = ca.sin(near), ca.cos(near)
    return near + ca.atan2(sine * c - cosine * s, cosine * c + sine * s)
