"""The traverser: slides on leadscrews, and a rotary axis that may turn any number of times; and its
TOML.
"""

from collections.abc import Iterable
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import Direction, TableSchema
from kinematics.foundation.arrays import (
    LEAST_POSITIVE,
    Array,
    finite_array,
    freeze_array,
    unit_vectors,
)
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import Unit
from kinematics.kinds.axis_keys import (
    GEOMETRY,
    KIND,
    OWN_AXES,
    LinearAxis,
    LinearDefaults,
    RotaryAxis,
    axes,
)
from kinematics.kinds.load_keys import HOME, HomeTable, LoadedFile, Pull, home_entries
from kinematics.machine.axis import Axis
from kinematics.machine.kind import Bar, Pivot, Skeleton, Sort
from kinematics.machine.load import Load
from kinematics.machine.machine import Machine
from kinematics.machine.pose import PoseLike, read_numbers

# Sine of the angle between two slides below which they count as one.
MIN_SLIDE_SINE = 1e-6


class Traverser(Machine):
    """q = (D⁻¹ p, φ): slide positions along the columns of D, and the turn about base z, the
    nearest to `near`.

    directions  (3, 3) unit vectors of the X, Y and Z slides in the base frame, one per row; the
                base axes by default
    length      m that count as one radian (the lever at which a turn is felt)

    X is vertical, so gravity points down along it unless the load states another. Source: [Sasidhar
    1981].
    """

    freedom = ("x", "y", "z", "rz")
    sorts = ("linear", "linear", "linear", "rotary")
    branched = True

    def __init__(
        self,
        *,
        axes: Iterable[Axis],
        home: PoseLike,
        directions: ArrayLike | None = None,
        length: float = 0.1,
        name: str = "traverser",
        load: Load | None = None,
    ) -> None:
        given = np.eye(3) if directions is None else directions
        self.directions = freeze_array(unit_vectors(given, f"machine {name}: directions", (3, 3)))
        if abs(np.linalg.det(self.directions)) < MIN_SLIDE_SINE:
            raise MotionError(
                f"machine {name}: the slides' directions {self.directions.tolist()} do not span space"
            )
        self.characteristic_length = float(
            finite_array(length, f"machine {name}: length", (), unit="m", least=LEAST_POSITIVE)
        )
        self._held = read_numbers(name, "home", home)[0, 3:].reshape(3, 3)
        super().__init__(name, axes, home, load=load)

    @property
    def vertical(self) -> Array:
        return freeze_array(self.directions[0])

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        turn = rotation @ self._held.T
        return ca.vertcat(
            np.linalg.inv(self.directions.T) @ position,
            nearest_turn(turn[1, 0], turn[0, 0], near[3]),
        )

    def skeleton(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> Skeleton:
        """A rail for each slide, as long as its travel, and a hand as long as the lever that shows
        the turn.

        ASSUMPTION, for the drawing alone: X carries Y, and Y carries Z; coordinates do not depend
        on it.
        """
        *slides, rotary = self.axes
        ways = [ca.DM(direction) for direction in self.directions]
        carriages = [
            sum((q[i] * ways[i] for i in range(k)), ca.SX.zeros(3)) for k in range(len(slides) + 1)
        ]
        rails, pivots = [], []
        for k, axis in enumerate(slides):
            # a slide whose travel has no end is drawn from its zero to where it is
            low, high = (self.home_q[k] + end for end in axis.travel)
            low, high = (low, high) if np.isfinite([low, high]).all() else (0.0, q[k])
            sort: Sort = "link" if k else "frame"
            rails.append(
                Bar(sort, carriages[k] + low * ways[k], carriages[k] + high * ways[k], axis.name)
            )
            pivots.append(Pivot(carriages[k + 1]))
        hand = rotation[:, 0] * self.characteristic_length
        return Skeleton(
            (*rails, Bar("link", position, position + hand, rotary.name)), tuple(pivots)
        )


def nearest_turn(sine: ca.SX, cosine: ca.SX, near: ca.SX) -> ca.SX:
    """The angle of r (cos φ, sin φ) within half a turn of `near`."""
    s, c = ca.sin(near), ca.cos(near)
    return near + ca.atan2(sine * c - cosine * s, cosine * c + sine * s)


SLIDES, ROTARY = ("X", "Y", "Z"), "R"


class TraverserGeometry(TableSchema):
    """How a traverser is built."""

    home: HomeTable = HOME
    directions: tuple[Direction, Direction, Direction] | None = key(
        "directions of X, Y and Z in the base frame; its x, y and z if not stated",
        "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
        None,
    )
    length: Annotated[float, Unit("m", above=0)] = key(
        "lever arm that makes a rotation comparable to a length", '"100 mm"', 0.1
    )


class OwnSlide(LinearAxis):
    name: Literal["X", "Y", "Z"]


class OwnRotary(RotaryAxis):
    name: Literal["R"]


def _axis_table_type(value: Any) -> type[TableSchema]:
    return OwnRotary if isinstance(value, dict) and value.get("name") == ROTARY else OwnSlide


class TraverserFile(LoadedFile):
    """A traverser, key by key: `axes` is what the slides have, `rotary` what the turning axis
    has.
    """

    first_place = (20, 20, 20)
    gravity: tuple[Pull, Pull, Pull] | None = key(
        "gravity in the base frame; down along X if not stated",
        '["-9.80665 m/s^2", "0 m/s^2", "0 m/s^2"]',
        None,
    )
    kind: Literal["traverser"] = KIND
    geometry: TraverserGeometry = GEOMETRY
    axes: LinearDefaults = key("values that all slides share")
    rotary: RotaryAxis = key("values of the rotary axis, which needs no travel")
    axis: tuple[Annotated[Any, Chosen(_axis_table_type)], ...] = OWN_AXES

    def list_freedom(self) -> tuple[str, ...]:
        return Traverser.freedom

    def list_axes(self) -> list[Axis]:
        return axes(
            (*SLIDES, ROTARY),
            dict.fromkeys(SLIDES, self.axes) | {ROTARY: self.rotary},
            self.axis,
            self,
        )

    @staticmethod
    def geometry_of(machine: Traverser, complete: bool) -> dict[str, Any]:
        straight = not complete and (machine.directions == np.eye(3)).all()
        return {
            "home": home_entries(machine),
            "directions": None if straight else machine.directions,
            "length": machine.characteristic_length,
        }


def build_traverser(file: TraverserFile, name: str, folder: Path | Traversable) -> Traverser:
    return Traverser(
        axes=file.list_axes(),
        home=file.geometry.home.numbers,
        directions=file.geometry.directions,
        length=file.geometry.length,
        name=name,
        load=file.load(),
    )
