"""The linkage: two actuators in a plane, hinged to each other, one of which carries the point; and
its TOML.
"""

from collections.abc import Iterable
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.files.keys import key
from kinematics.files.schema import TableSchema
from kinematics.foundation.arrays import LEAST_POSITIVE, Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.units import Angle, Dimension, Unit
from kinematics.kinds.axis_keys import (
    AXES,
    GEOMETRY,
    KIND,
    OWN_AXES,
    LinearAxis,
    LinearDefaults,
    axes,
)
from kinematics.kinds.load_keys import HOME, HomeTable, LoadedFile, home_entries
from kinematics.machine.axis import Axis
from kinematics.machine.kind import Bar, Pivot, Skeleton, side
from kinematics.machine.load import Load
from kinematics.machine.machine import Machine
from kinematics.machine.pose import PoseLike


class Linkage(Machine):
    """q_a, q_b: distances from the base joints a, b to the joint J where the actuators meet.

    The point P lies at the distance h from J, at the angle θ_h from the direction J → a, in the
    sense that θ falls: P = J − h (cos(θ − θ_h), sin(θ − θ_h)), with θ the direction a → J. Then

        |P − a|² = q_a² + h² − 2 q_a h cos θ_h,   q_b = |J − b|,

    q_a = h cos θ_h ± √(|P − a|² − h² sin² θ_h): the sign is that of `near` (both are real where θ_h
    is acute, and P is near enough to a). The platform's frame sits at P and turns with θ, which
    follows; at home it is as the home pose says. Source: [Motion 2-D], with its signs set right.

    base_a, base_b  (2,) base joints in the plane, m;  offset h (m), angle θ_h (rad)
    near            (2,) coordinates that say which of the home pose's are meant; the longer q_a by
                    default
    """

    freedom = ("x", "y")
    follows = ("rz",)
    branched = True
    lengths = True
    sorts = ("linear", "linear")

    def __init__(
        self,
        base_a: ArrayLike,
        base_b: ArrayLike,
        offset: float,
        angle: float,
        *,
        axes: Iterable[Axis],
        home: PoseLike,
        near: ArrayLike | None = None,
        name: str = "linkage",
        load: Load | None = None,
    ) -> None:
        ends = (("base_a", base_a), ("base_b", base_b))
        self.base_a, self.base_b = (
            freeze_array(finite_array(p, f"machine {name}: {what}", (2,), unit="m"))
            for what, p in ends
        )
        if np.linalg.norm(self.base_b - self.base_a) < 1e-9:
            raise MotionError(
                f"machine {name}: base_a and base_b are the same point, {self.base_a * 1e3} mm"
            )
        self.offset = float(finite_array(offset, f"machine {name}: offset", (), unit="m", least=0))
        self.angle = float(finite_array(angle, f"machine {name}: angle", (), unit="rad"))
        self.characteristic_length = max(
            self.offset, float(np.linalg.norm(self.base_b - self.base_a)) / 2
        )
        longer = [self.offset * abs(np.cos(self.angle)) + 1.0, 0.0]
        super().__init__(name, axes, home, longer if near is None else near, load)
        for axis, length in zip(self.axes, self.home_q, strict=True):
            if np.isfinite(axis.travel[0]) and length + axis.travel[0] <= 0:
                raise MotionError(
                    f"machine {name}: axis {axis.name} measures {length * 1e3:.6g} mm at home, and its travel takes "
                    f"{-axis.travel[0] * 1e3:.6g} mm off that; no actuator is shorter than nothing"
                )
        position, rotation = self.home_numbers[0, :3], self.home_numbers[0, 3:].reshape(3, 3)
        c, s = np.asarray(self._joint(ca.DM(position), ca.DM(self.home_q))[1]).ravel()
        base, way = self.base_b - self.base_a, np.array([c, s])
        self._side = 1 if base[0] * way[1] - base[1] * way[0] >= 0 else -1
        self._at_home = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ rotation

    def _joint(self, position: ca.SX | ca.DM, near: ca.SX | ca.DM) -> tuple[ca.SX, ca.SX]:
        """q_a and the unit vector from a to J."""
        across, along = self.offset * np.sin(self.angle), self.offset * np.cos(self.angle)
        way = position[:2] - self.base_a
        square = ca.sumsqr(way)
        straight = side(near[0] - along) * ca.sqrt(square - across**2)
        direction = ca.vertcat(
            way[0] * straight + way[1] * across,
            way[1] * straight - way[0] * across,
        )
        return straight + along, direction / square

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        length, direction = self._joint(position, near)
        return ca.vertcat(length, ca.norm_2(self.base_a + length * direction - self.base_b))

    def fill_pose(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        _, u = self._joint(position, q)
        theta = ca.vertcat(
            ca.horzcat(u[0], -u[1], 0), ca.horzcat(u[1], u[0], 0), ca.horzcat(0, 0, 1)
        )
        turned: ca.SX = theta @ self._at_home
        return position, turned

    def skeleton(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> Skeleton:
        """Both actuators from the base to J, and the arm from there to P, which actuator a
        turns.
        """
        length, direction = self._joint(position, q)
        a, b = (ca.DM([*base, 0.0]) for base in (self.base_a, self.base_b))
        joint = ca.vertcat(self.base_a + length * direction, 0.0)
        first, second = (axis.name for axis in self.axes)
        bars = (
            Bar("actuator", a, joint, first),
            Bar("actuator", b, joint, second),
            Bar("frame", a, b),
            Bar("platform", joint, position),
        )
        return Skeleton(bars, (Pivot(a), Pivot(b), Pivot(joint)))

    def realised(self, q: ArrayLike, side: int | None = None) -> Array:
        """P (N, 2) of coordinates q (N, 2), (2,) of one, in closed form: θ from the law of cosines
        at a.

        side: J lies to the left (1) or to the right (−1) of a → b; as at home by default. Raises
        OutOfReach where no triangle closes over the base.
        """
        given = finite_array(
            q, f"machine {self.name}: lengths", (2,), (None, 2), unit="m", least=LEAST_POSITIVE
        )
        rows = np.atleast_2d(given)
        if side not in (None, 1, -1):
            raise MotionError(
                f"machine {self.name}: side {side} is neither 1 (left of a -> b) nor -1 (right)"
            )
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
        theta = np.arctan2(base[1], base[0]) + (side or self._side) * np.arccos(cosine)
        joint = self.base_a + rows[:, :1] * np.stack([np.cos(theta), np.sin(theta)], 1)
        back = theta - self.angle
        points = joint - self.offset * np.stack([np.cos(back), np.sin(back)], 1)
        return np.asarray(points[0] if given.ndim == 1 else points, float)


NAMES = ("a", "b")


class LinkageGeometry(TableSchema):
    """How a linkage is built."""

    base_a: tuple[Dimension, Dimension] = key("x and y of the base hinge of actuator a")
    base_b: tuple[Dimension, Dimension] = key("x and y of the base hinge of actuator b")
    offset: Annotated[float, Unit("m", least=0, plain="length", unit_written=True)] = key(
        "distance from the joint of the two actuators to the tool point"
    )
    angle: Angle = key("angle at that joint, from actuator a to the tool point")
    home: HomeTable = HOME
    near: tuple[Dimension, Dimension] | None = key(
        "lengths of a and b at home, where two solutions exist; the longer a if not stated",
        '["367 mm", "409 mm"]',
        None,
    )


class LinkageAxisTable(LinearAxis):
    name: Literal["a", "b"]


class LinkageFile(LoadedFile):
    """A linkage, key by key."""

    first_place = (0, 20, 0)
    kind: Literal["linkage"] = KIND
    geometry: LinkageGeometry = GEOMETRY
    axes: LinearDefaults = AXES
    axis: tuple[LinkageAxisTable, ...] = OWN_AXES

    def list_freedom(self) -> tuple[str, ...]:
        return Linkage.freedom

    def list_axes(self) -> list[Axis]:
        return axes(NAMES, dict.fromkeys(NAMES, self.axes), self.axis, self)

    @staticmethod
    def geometry_of(machine: Linkage, complete: bool) -> dict[str, Any]:
        shorter = machine.home_q[0] < machine.offset * np.cos(
            machine.angle
        )  # else the longer one is meant
        return {
            "base_a": machine.base_a,
            "base_b": machine.base_b,
            "offset": machine.offset,
            "angle": machine.angle,
            "home": home_entries(machine),
            "near": machine.home_q if complete or shorter else None,
        }


def build_linkage(file: LinkageFile, name: str, folder: Path | Traversable) -> Linkage:
    geometry = file.geometry
    return Linkage(
        geometry.base_a,
        geometry.base_b,
        geometry.offset,
        geometry.angle,
        axes=file.list_axes(),
        home=geometry.home.numbers,
        near=geometry.near,
        name=name,
        load=file.load(),
    )
