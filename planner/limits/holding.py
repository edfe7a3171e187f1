"""Force that holds the machine still, at every place of the path: what a motion along it needs at the very least."""

import numpy as np

from kinematics.axis import Axis
from kinematics.machine import Machine
from planner.limits.limit import AxisLimit, Motion, Quantity
from planner.limits.pull_out import Curve


class Holding(AxisLimit):
    """f(x, 0, 0), against max_force and what a motor gives at rest, the lesser of the two."""

    name, dimension = "holding force", ""

    def __init__(self, machine: Machine) -> None:
        super().__init__(machine.axes, [_most(axis) if machine.loaded else None for axis in machine.axes])
        self.machine, self.units = machine, force_units(machine)

    def remedy(self, over: float, unit: str) -> str:
        return (
            f"the machine cannot hold itself still there: take {over:.4g} {unit} off the axis, or give it a max_force "
            "that is so much larger"
        )

    def value(self, motion: Motion) -> Quantity:
        values = motion.evaluate(self.machine.holding_map.expression, motion.pose_rate(0), motion.q)
        return self.machine.holding_map.force(values)


def _most(axis: Axis) -> float:
    stated = [] if axis.max_force is None else [axis.max_force]
    stated += [] if axis.torque_speed is None else [Curve.of(axis).holding]
    return min(stated, default=np.inf)


def force_units(machine: Machine) -> tuple[tuple[str, float], ...]:
    return tuple(("N" if axis.kind == "linear" else "N m", 1.0) for axis in machine.axes)
