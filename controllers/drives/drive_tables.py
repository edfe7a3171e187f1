"""Tables of drives in a rig's TOML, in terms of the motor's shaft, and the drives in the axis'
coordinate they make.
"""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, AllowInfNan, Field

from controllers.drives.servo import Servo
from controllers.drives.stepper import Stepper
from kinematics.files.keys import key
from kinematics.files.schema import TableSchema
from kinematics.foundation.units import Unit
from kinematics.kinds.axis_keys import check_rising
from kinematics.machine.axis import Axis

Samples = Annotated[int, Field(ge=0)]
Ratio = Annotated[float, Field(ge=0), AllowInfNan(False)]
Torque = Annotated[float, Unit("N*m", least=0, like="0.3 N*m")]
Curve = Annotated[
    tuple[tuple[Annotated[float, Unit("rad/s", least=0, like="600 rpm")], Torque], ...],
    AfterValidator(check_rising),
]


class Gear(TableSchema):
    """Turns of the motor for one of the axis; play at the axis."""

    ratio: Annotated[float, Field(gt=0, le=1e6), AllowInfNan(False)] = key(
        "revolutions of the motor per revolution of the axis"
    )
    play: Annotated[float, Unit("rad", least=0, like="3 arcmin")] = key(
        "backlash at the axis", default=0.0
    )

    @property
    def travel(self) -> float:
        """Of the axis for one radian of the motor."""
        return 1 / self.ratio


class Screw(TableSchema):
    """Travel of the axis for one turn of the motor; play at the axis."""

    lead: Annotated[float, Unit("m", above=0, like="2 mm")] = key(
        "travel per revolution of the motor"
    )
    play: Annotated[float, Unit("m", least=0, like="10 um")] = key(
        "backlash at the axis", default=0.0
    )

    @property
    def travel(self) -> float:
        return self.lead / (2 * np.pi)


class DriveTable(TableSchema):
    """What drives of every kind have, as far as it is stated; torques, inertias and speeds are the
    motor's.
    """

    needed: ClassVar[tuple[str, ...]] = ("rotor_inertia",)

    gear: Gear | None = key("gear of a rotary axis", "{ ratio = 74 }", None)
    screw: Screw | None = key("screw of a linear axis", '{ lead = "2 mm" }', None)
    rotor_inertia: Annotated[float, Unit("kg*m^2", above=0, like="3.6e-6 kg*m^2")] | None = key(
        "inertia of the rotor; needed, here or for every axis", default=None
    )
    inertia_ratio: Ratio | None = key(
        "inertia of the load, reflected to the motor, divided by that of the rotor", default=None
    )
    viscous: Annotated[float, Unit("N*m*s/rad", least=0, like="5e-5 N*m*s/rad")] | None = key(
        "viscous friction", default=None
    )
    coulomb: Torque | None = key("dry friction", default=None)
    counts: Ratio | None = key("encoder counts per revolution of the motor", "8192", None)
    sample: Annotated[float, Unit("s", above=0, like="0.25 ms")] | None = key(
        "period of the drive's loops", default=None
    )


class ServoTable(DriveTable):
    """See `Servo`."""

    needed: ClassVar[tuple[str, ...]] = (
        *DriveTable.needed, "position_gain", "speed_loop", "integral_time", "torque_limit", "counts"
    )  # fmt: skip

    position_gain: Annotated[float, Unit("1/s", above=0, like="30 1/s")] | None = key(
        "gain of the position loop; needed", default=None
    )
    speed_loop: Annotated[float, Unit("1/s", above=0, like="30 Hz")] | None = key(
        "bandwidth of the speed loop; needed", default=None
    )
    integral_time: Annotated[float, Unit("s", above=0, like="30 ms")] | None = key(
        "integral time of the speed loop; needed", default=None
    )
    torque_limit: Annotated[float, Unit("N*m", above=0, like="0.9 N*m")] | None = key(
        "torque limit of the motor; needed", default=None
    )
    feedback: Literal["motor", "output"] | None = key(
        "position of the encoder: at the motor or at the output", default=None
    )
    command_delay: Samples | None = key(
        "delay of the command, in samples of the drive", default=None
    )
    loop_delay: Samples | None = key(
        "delay of the control loop, in samples of the drive", default=None
    )

    @staticmethod
    def drive(values: Mapping[str, Any], r: float, common: Mapping[str, Any]) -> Servo:
        loops = (
            "position_gain",
            "speed_loop",
            "integral_time",
            "feedback",
            "command_delay",
            "loop_delay",
        )
        return Servo(
            torque_limit=values["torque_limit"] / r, **_pick_stated(values, *loops), **common
        )


class StepperTable(DriveTable):
    """See `Stepper`; steps: full steps of a turn."""

    needed: ClassVar[tuple[str, ...]] = (*DriveTable.needed, "steps", "torque_speed")

    steps: Annotated[int, Field(gt=0, le=10**9)] | None = key(
        "full steps per revolution; needed", "200", None
    )
    torque_speed: Curve | None = key(
        "peak torque at each motor speed, from 0; needed",
        '[["0 rpm", "0.3 N*m"], ["3000 rpm", "0.1 N*m"]]',
        None,
    )
    damping: Annotated[float, Unit("N*m*s/rad", least=0, like="5e-4 N*m*s/rad")] | None = key(
        "damping of the slip between rotor and field", default=None
    )

    @staticmethod
    def drive(values: Mapping[str, Any], r: float, common: Mapping[str, Any]) -> Stepper:
        curve = tuple((speed * r, torque / r) for speed, torque in values["torque_speed"])
        full_step, damping = 2 * np.pi * r / values["steps"], values.get("damping", 0.0) / r**2
        return Stepper(torque_speed=curve, full_step=full_step, damping=damping, **common)


KINDS: dict[str, type[ServoTable] | type[StepperTable]] = {
    "servo": ServoTable,
    "stepper": StepperTable,
}
"""Kinds of drive by the name of their table."""
TRANSMISSION = {"rotary": "gear", "linear": "screw"}
"""What leads from the motor to an axis of a kind."""


def drive_of(kind: str, axis: Axis, values: Mapping[str, Any]) -> Servo | Stepper:
    """The drive behind an axis, from the values of its table.

    With r the axis' travel per radian of the motor:

    J = rotor inertia · (1 + inertia ratio)/r²;  b, d by 1/r²;  torques by 1/r;  speeds by r;
                                                 counts by 1/(2π r).
    """
    transmission = values[TRANSMISSION[axis.kind]]
    r = transmission.travel
    common = {
        "inertia": values["rotor_inertia"] * (1 + values.get("inertia_ratio", 0.0)) / r**2,
        "friction": values.get("viscous", 0.0) / r**2,
        "coulomb": values.get("coulomb", 0.0) / r,
        "encoder": values.get("counts", 0.0) / (2 * np.pi * r),
        "play": transmission.play,
    }
    return KINDS[kind].drive(values, r, common | _pick_stated(values, "sample"))


def _pick_stated(values: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: values[name] for name in names if name in values}
