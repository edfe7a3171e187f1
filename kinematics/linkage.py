"""The linkage: two actuators in a plane, hinged to each other; one of them carries the point."""

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, frozen
from kinematics.axis import Axis
from kinematics.errors import MotionError, OutOfReach
from kinematics.load import Load
from kinematics.machine import Machine
from kinematics.pose import Pose


class Linkage(Machine):
    """q_a, q_b: distances from the base joints a, b to the joint J where the actuators meet.

    The point P lies at the distance h from J, at the angle θ_h from the direction J → a, in the sense that θ falls:
    P = J − h (cos(θ − θ_h), sin(θ − θ_h)), with θ the direction a → J. Then

        |P − a|² = q_a² + h² − 2 q_a h cos θ_h,   q_b = |J − b|.

    The platform's frame sits at P and turns with θ, which follows; at home it is as the home pose says. Source:
    [Motion 2-D], with its signs set right.

    base_a, base_b  (2,) base joints in the plane, m;  offset h (m), angle θ_h (rad)
    """

    freedom = ("x", "y")
    follows = ("rz",)

    def __init__(
        self,
        base_a: ArrayLike,
        base_b: ArrayLike,
        offset: float,
        angle: float,
        *,
        axes: Sequence[Axis],
        home: Pose,
        name: str = "linkage",
        load: Load | None = None,
    ) -> None:
        self.base_a, self.base_b = (_point(name, *pair) for pair in (("base_a", base_a), ("base_b", base_b)))
        if np.linalg.norm(self.base_b - self.base_a) < 1e-9:
            raise MotionError(f"machine {name}: base_a and base_b are the same point, {self.base_a * 1e3} mm")
        if not (0 <= offset < np.inf and np.isfinite(angle)):
            raise MotionError(
                f"machine {name}: offset {offset} m and angle {angle} rad must be finite, offset not below 0"
            )
        self.offset, self.angle = float(offset), float(angle)
        self.characteristic_length = max(self.offset, float(np.linalg.norm(self.base_b - self.base_a)) / 2)
        super().__init__(name, axes, home, load=load)
        c, s = np.asarray(self._joint(ca.DM(home.translation))[1]).ravel()
        self._at_home = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ home.rotation.as_matrix()

    def _joint(self, position: ca.SX | ca.DM) -> tuple[ca.SX, ca.SX]:
        """q_a and the unit vector from a to J."""
        across, along = self.offset * np.sin(self.angle), self.offset * np.cos(self.angle)
        way = position[:2] - self.base_a
        square = ca.sumsqr(way)
        straight = ca.sqrt(square - across**2)
        direction = ca.vertcat(
            way[0] * straight + way[1] * across,
            way[1] * straight - way[0] * across,
        )
        return straight + along, direction / square

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        length, direction = self._joint(position)
        return ca.vertcat(length, ca.norm_2(self.base_a + length * direction - self.base_b))

    def carried(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        _, u = self._joint(position)
        theta = ca.vertcat(ca.horzcat(u[0], -u[1], 0), ca.horzcat(u[1], u[0], 0), ca.horzcat(0, 0, 1))
        turned: ca.SX = theta @ self._at_home
        return position, turned

    def realised(self, q: ArrayLike, side: int = 1) -> Array:
        """P (N, 2) of coordinates q (N, 2) in closed form: θ from the law of cosines at a.

        side: J lies to the left (1) or to the right (−1) of a → b. Raises OutOfReach where no triangle closes over the
        base.
        """
        rows = np.atleast_2d(np.asarray(q, float))
        base = self.base_b - self.base_a
        apart = float(np.hypot(*base))
        cosine = (rows[:, 0] ** 2 + apart**2 - rows[:, 1] ** 2) / (2 * rows[:, 0] * apart)
        open_ = ~(np.abs(cosine) <= 1)
        if open_.any():
            row = int(np.argmax(open_))
            raise OutOfReach(
                f"machine {self.name}: lengths {rows[row] * 1e3} mm (row {row}) do not close a triangle over the base "
                f"of {apart * 1e3:.6g} mm"
            )
        theta = np.arctan2(base[1], base[0]) + np.sign(side) * np.arccos(cosine)
        joint = self.base_a + rows[:, :1] * np.stack([np.cos(theta), np.sin(theta)], 1)
        back = theta - self.angle
        return np.asarray(joint - self.offset * np.stack([np.cos(back), np.sin(back)], 1), float)


def _point(machine: str, what: str, values: ArrayLike) -> Array:
    point = np.asarray(values, float)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise MotionError(f"machine {machine}: {what} must be a finite point (2,) in m, not {values!r}")
    return frozen(point)
