"""Limits of the place alone: travel, room, tilt and clearance.

lo ≤ q − home ≤ hi of every axis; lo ≤ x, y, z ≤ hi of the platform; the angle of every joint to its
rest axis ≤ its limit; and no two of the machine's bodies overlap.
"""

from collections.abc import Hashable, Sequence

import numpy as np

from kinematics.analysis.clearance import clearance_use
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.limits.limit import AxisLimit, Limit, LimitState, Quantity


class Travel(AxisLimit):
    """Counted as |q − middle| / half range, so that 1 is an end of travel."""

    name, dimension, convex = "travel", "", True

    def __init__(self, axes: Sequence[Axis], home: Array) -> None:
        lo, hi = np.array([axis.travel for axis in axes]).T
        super().__init__(axes, list((hi - lo) / 2))
        self.travel = freeze_array(np.stack([lo, hi], 1))
        with np.errstate(invalid="ignore"):  # unlimited both ways: ∞ − ∞
            self.middle = freeze_array(np.nan_to_num(home + (lo + hi) / 2, nan=0.0))

    @property
    def content(self) -> Hashable:
        return (
            self.name,
            self.channels,
            self.middle.tobytes(),
            self.below.tobytes(),
            self.bounds.tobytes(),
        )

    def value(self, motion: LimitState) -> Quantity:
        return motion.q - self.middle

    def report_value(self, value: float, channel: int, piece: int) -> tuple[float, float]:
        """The stroke from home, and the end of travel on its side."""
        lo, hi = self.travel[channel]
        middle = (lo + hi) / 2 if np.isfinite([lo, hi]).all() else 0.0
        return value + middle, float(hi if value > 0 else lo)


class Room(Limit):
    """Where x, y and z of the platform's origin may be, counted as travel is: 1 is a wall."""

    name, channels, units = "room", ("x", "y", "z"), (("mm", 1e3),) * 3

    def __init__(self, machine: Machine) -> None:
        lo, hi = np.array(machine.room, float).T
        self.bounds = freeze_array((hi - lo) / 2)
        with np.errstate(invalid="ignore"):  # unlimited both ways: ∞ − ∞
            self.middle = freeze_array(np.nan_to_num((lo + hi) / 2, nan=0.0))

    @property
    def content(self) -> Hashable:
        return self.name, self.middle.tobytes(), self.bounds.tobytes()

    def value(self, motion: LimitState) -> Quantity:
        return motion.pose_rate(0)[:, :3] - self.middle

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return np.asarray(np.maximum(-low, high) / self.bounds + 0.0)  # no −0

    def report_value(self, value: float, channel: int, piece: int) -> tuple[float, float]:
        middle = float(self.middle[channel])
        return value + middle, middle + float(np.copysign(self.bounds[channel], value))


class Tilt(Limit):
    """The value is the cosine of the angle, which is smooth where the angle is not (at the rest
    axis).
    """

    name = "tilt"

    def __init__(self, machine: Machine) -> None:
        self.expression = machine.tilt_map
        self.channels, self.bounds = machine.tilt_names, machine.max_tilt
        self.units = (("deg", 180 / np.pi),) * len(self.channels)

    @property
    def content(self) -> Hashable:
        return self.name, self.channels, self.expression, self.bounds.tobytes()

    @property
    def binds(self) -> bool:
        return bool((self.bounds < np.pi).any())

    def value(self, motion: LimitState) -> Quantity:
        return motion.evaluate(self.expression, motion.pose_rate(0))

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        tilt = np.arccos(np.clip(low, -1.0, 1.0))
        return np.where(self.bounds < np.pi, tilt / self.bounds, 0.0)

    def report_value(self, value: float, channel: int, piece: int) -> tuple[float, float]:
        return float(np.arccos(np.clip(value, -1.0, 1.0))), float(self.bounds[channel])


class Clearance(Limit):
    """One channel per pair: a leg and another, or a leg and a platform's disc; a machine without
    bodies has none.

    The value is the distance of the pair's axes (of axis and disc), its use contact / distance as
    in `Margins`: 1 where the bodies touch. Told is how far apart their surfaces are, held against
    0; below it they overlap.
    """

    name, relief = "clearance", "keeps {} more"

    def __init__(self, machine: Machine) -> None:
        self.bodies = machine.bodies
        self.channels = self.bodies.names if self.bodies else ()
        self.bounds: Array = freeze_array(self.bodies.contact if self.bodies else [])
        self.units = (("mm", 1e3),) * len(self.channels)

    @property
    def content(self) -> Hashable:
        return self.name, self.bodies and self.bodies.content, self.bounds.tobytes()

    def value(self, motion: LimitState) -> Quantity:
        if self.bodies is None:
            raise MotionError("a machine without bodies has no clearance")
        return motion.distances(self.bodies)

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return clearance_use(low - self.bounds, self.bounds)

    def tight(self, met: Array) -> Array:
        """Distances have no smooth bound: a thousandth of the contact is near enough, and less
        where they overlap.
        """
        return np.where(met > 1, 0.05 * met, 1e-3)

    def report_value(self, value: float, channel: int, piece: int) -> tuple[float, float]:
        return value - float(self.bounds[channel]), 0.0
