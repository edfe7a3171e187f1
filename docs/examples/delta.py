"""A linear delta: carriages on three upright rails, and rods to a platform that never turns."""

from collections.abc import Iterable
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np

from kinematics.files.keys import key
from kinematics.files.schema import TableSchema
from kinematics.foundation.arrays import LEAST_POSITIVE, finite_array, freeze_array
from kinematics.foundation.units import Unit
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
from kinematics.machine.load import Load
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose

NAMES = ("a", "b", "c")


class Delta(Machine):
    """q_i = z + √(L² − |p − r_i|²): the height of a carriage.

    p = (x, y), r_i its rail, L the length of the rods. The rails stand on a circle about the base's
    z axis, the first on x. radius (m): that of the rails less that of the platform's joints, since
    only the difference counts.
    """

    freedom = ("x", "y", "z")
    sorts = ("linear", "linear", "linear")

    def __init__(
        self,
        radius: float,
        rod: float,
        *,
        axes: Iterable[Axis],
        home: Pose,
        name: str = "delta",
        load: Load | None = None,
    ) -> None:
        self.radius = float(
            finite_array(radius, f"machine {name}: radius", (), unit="m", least=LEAST_POSITIVE)
        )
        self.rod = float(
            finite_array(rod, f"machine {name}: rod", (), unit="m", least=LEAST_POSITIVE)
        )
        angles = np.arange(3) * 2 * np.pi / 3
        self.rails = freeze_array(self.radius * np.stack([np.cos(angles), np.sin(angles)], 1))
        self.characteristic_length = self.radius
        super().__init__(name, axes, home, load=load)

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        over = [ca.sqrt(self.rod**2 - ca.sumsqr(position[:2] - rail)) for rail in self.rails]
        heights: ca.SX = position[2] + ca.vertcat(*over)
        return heights


class Geometry(TableSchema):
    """How a delta is built."""

    radius: Annotated[float, Unit("m", above=0)] = key(
        "radius of the rails minus that of the platform's joints"
    )
    rod: Annotated[float, Unit("m", above=0)] = key("length of a rod between its joint centres")
    home: HomeTable = HOME


class Own(LinearAxis):
    """What one carriage has of its own."""

    name: Literal["a", "b", "c"]


class DeltaFile(LoadedFile):
    """A delta, key by key."""

    kind: Literal["delta"] = KIND
    geometry: Geometry = GEOMETRY
    axes: LinearDefaults = AXES
    axis: tuple[Own, ...] = OWN_AXES

    @staticmethod
    def geometry_of(machine: Delta, complete: bool) -> dict[str, Any]:
        return {"radius": machine.radius, "rod": machine.rod, "home": home_entries(machine)}


def delta(file: DeltaFile, name: str, folder: Path | Traversable) -> Delta:
    geometry = file.geometry
    carriages = axes(NAMES, dict.fromkeys(NAMES, file.axes), file.axis, file)
    return Delta(
        geometry.radius,
        geometry.rod,
        axes=carriages,
        home=geometry.home.numbers,
        name=name,
        load=file.load(),
    )
