"""The table of a machine: its axes and their limits."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from kinematics.axis import Axis, Magnitude, sides
from kinematics.table import Column, Table

if TYPE_CHECKING:
    from kinematics.machine import Machine

UNLIMITED = {"inf": "unlimited", "-inf": "unlimited", "None": "unlimited"}


def axes_table(machine: "Machine") -> Table:
    """Travel, pulse and limits of each axis; both ways, towards smaller positions first, where they differ on one."""
    axes, units = machine.axes, [axis.unit for axis in machine.axes]
    forces = ["N" if axis.kind == "linear" else "N m" for axis in axes]
    columns = [
        Column("axis", [axis.name for axis in axes]),
        Column("travel from", [axis.travel[0] for axis in axes], units, "human", words=UNLIMITED),
        Column("to", [axis.travel[1] for axis in axes], units, "human", words=UNLIMITED),
        Column("pulse", [axis.pulse for axis in axes], units, "micro"),
    ]
    limits: tuple[tuple[str, Callable[[Axis], Magnitude | None], str], ...] = (
        ("speed", lambda axis: axis.max_speed, "/s"),
        ("acceleration", lambda axis: axis.max_acceleration, "/s^2"),
        ("jerk", lambda axis: axis.max_jerk, "/s^3"),
    )
    for name, bound, per in limits:
        below, above = zip(*(sides(bound(axis)) for axis in axes), strict=True)
        ways = {name: above} if below == above else {f"{name} down": below, f"{name} up": above}
        columns += [
            Column(way, values, [f"{unit}{per}" for unit in units], "human", words=UNLIMITED)
            for way, values in ways.items()
        ]
    if any(axis.max_force is not None for axis in axes):
        columns.append(Column("force", [axis.max_force for axis in axes], forces, words=UNLIMITED))
    if any(axis.max_pulse_rate is not None for axis in axes):
        columns.append(Column("pulse rate", [axis.max_pulse_rate for axis in axes], "1/s", words=UNLIMITED))
    title = f"{machine.name}: {type(machine).__name__.lower()}, moves {' '.join(machine.freedom)}"
    return Table(title, tuple(columns))
