"""Limits of every axis: speed, acceleration, jerk and pulse rate.

−V₋ ≤ r q̇ ≤ V₊ (of the motor, behind a screw whose error it makes up for)
−A₋ ≤ q̈ ≤ A₊    −J₋ ≤ q⃛ ≤ J₊    |q̇| r/pulse ≤ f
"""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.machine.axis import Axis, Magnitude
from planner.limits.limit import AxisLimit, LimitState, Quantity, Rows, Term
from planner.path.actuation import Points


class Speed(AxisLimit):
    """q̇ = q′ ṡ, and ṡ ≥ 0: the sign of q′ says which way the axis goes.

    r = max 1/(1 + slope) of a lead error that is made up for, else 1: max_speed is the motor's.
    """

    name, dimension, by_axis, convex = "speed", "/s", True, True
    terms = frozenset({Term.SD})

    def __init__(self, axes: Sequence[Axis], bounds: Sequence[Magnitude | None]) -> None:
        super().__init__(axes, bounds)
        self.ratio: Array = freeze_array([axis.motor_ratio for axis in axes])

    def value(self, motion: LimitState) -> Quantity:
        return motion.qd if (self.ratio == 1.0).all() else motion.qd * self.ratio

    def rows(self, points: Points) -> Rows:
        q1 = points.derivatives[1] * self.ratio
        return Rows({Term.SD: q1}, np.where(q1 > 0, self.bounds, self.below))


class Acceleration(AxisLimit):
    """q̈ = q′ s̈ + q″ ṡ²."""

    name, dimension, by_axis, convex = "acceleration", "/s²", True, True
    terms = frozenset({Term.SDD, Term.SD2})

    def value(self, motion: LimitState) -> Quantity:
        return motion.qdd

    def rows(self, points: Points) -> Rows:
        return Rows(
            {Term.SDD: points.derivatives[1], Term.SD2: points.derivatives[2]},
            self.bounds,
            self.below,
        )


class Jerk(AxisLimit):
    """q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³."""

    name, dimension, by_axis, convex = "jerk", "/s³", True, True
    terms = frozenset({Term.SDDD, Term.SDSDD, Term.SD3})

    def value(self, motion: LimitState) -> Quantity:
        return motion.qddd

    def rows(self, points: Points) -> Rows:
        _, q1, q2, q3 = points.derivatives
        return Rows({Term.SDDD: q1, Term.SDSDD: 3 * q2, Term.SD3: q3}, self.bounds, self.below)


class PulseRate(AxisLimit):
    """A speed in pulses: what the axis' drive or card takes.

    r = max 1/(1 + slope) of a lead error that is made up for, else 1: behind such a screw the motor
    runs ahead.
    """

    name, dimension, by_axis, convex = "pulse rate", "/s", True, True
    terms = frozenset({Term.SD})

    def __init__(self, axes: Sequence[Axis]) -> None:
        super().__init__(axes, [axis.pulse_rate for axis in axes])
        self.pulse: Array = freeze_array([axis.pulse / axis.motor_ratio for axis in axes])
        self.units = (("1/s", 1.0),) * len(axes)

    def value(self, motion: LimitState) -> Quantity:
        return motion.qd * (1 / self.pulse)

    def rows(self, points: Points) -> Rows:
        return Rows({Term.SD: points.derivatives[1] / self.pulse}, self.bounds)
