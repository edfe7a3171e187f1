"""Clearance of the machine's bodies: no two of them overlap."""

import numpy as np

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.machine import Machine
from kinematics.margins import clearance_use
from planner.limits.limit import Limit, Motion, Quantity


class Clearance(Limit):
    """One channel per pair: a leg and another, or a leg and a platform's disc; a machine without bodies has none.

    The value is the distance of the pair's axes (of axis and disc), its use contact / distance as in `Margins`: 1 where
    the bodies touch. Told is how far apart their surfaces are, held against 0; below it they overlap.
    """

    name, relief = "clearance", "keeps {} more"

    def __init__(self, machine: Machine) -> None:
        self.bodies = machine.bodies
        self.channels = self.bodies.names if self.bodies else ()
        self.bounds: Array = frozen(self.bodies.contact if self.bodies else [])
        self.units = (("mm", 1e3),) * len(self.channels)

    def value(self, motion: Motion) -> Quantity:
        if self.bodies is None:
            raise MotionError("a machine without bodies has no clearance")
        return motion.distances(self.bodies)

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return clearance_use(low - self.bounds, self.bounds)

    def tight(self, met: Array) -> Array:
        """Distances have no smooth bound: a thousandth of the contact is near enough, and less where they overlap."""
        return np.where(met > 1, 0.05 * met, 1e-3)

    def told(self, value: float, channel: int) -> tuple[float, float]:
        return value - float(self.bounds[channel]), 0.0
