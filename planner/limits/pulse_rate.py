"""Pulse rate of every axis: |q̇| r/pulse ≤ f."""

from collections.abc import Sequence

from kinematics.array import Array, frozen
from kinematics.axis import Axis
from planner.actuation import Points
from planner.limits.limit import AxisLimit, Motion, Quantity, Rows, Term


class PulseRate(AxisLimit):
    """A speed in pulses: what the axis' drive or card takes.

    r = max 1/(1 + slope) of a lead error that is made up for, else 1: behind such a screw the motor runs ahead.
    """

    name, dimension = "pulse rate", "/s"
    terms = frozenset({Term.SD})

    def __init__(self, axes: Sequence[Axis]) -> None:
        super().__init__(axes, [axis.pulse_rate for axis in axes])
        self.pulse: Array = frozen([axis.pulse / axis.motor_ratio for axis in axes])
        self.units = (("1/s", 1.0),) * len(axes)

    def value(self, motion: Motion) -> Quantity:
        return motion.qd * (1 / self.pulse)

    def rows(self, points: Points) -> Rows:
        return Rows({Term.SD: points.derivatives[1] / self.pulse}, self.bounds)
