"""Tilt of every joint against its rest axis: angle ≤ limit."""

import numpy as np

from kinematics.array import Array
from kinematics.machine import Machine
from planner.limits.limit import Limit, Motion, Quantity


class Tilt(Limit):
    """The value is the cosine of the angle, which is smooth where the angle is not (at the rest axis)."""

    name = "tilt"

    def __init__(self, machine: Machine) -> None:
        self.expression = machine.tilt_map
        self.channels, self.bounds = machine.tilt_names, machine.max_tilt
        self.units = (("deg", 180 / np.pi),) * len(self.channels)

    def value(self, motion: Motion) -> Quantity:
        return motion.evaluate(self.expression, motion.pose_rate(0))

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return np.arccos(np.clip(low, -1.0, 1.0)) / self.bounds

    def told(self, value: float, channel: int) -> tuple[float, float]:
        return float(np.arccos(np.clip(value, -1.0, 1.0))), float(self.bounds[channel])
