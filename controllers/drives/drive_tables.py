"""Tables of drives in a rig's TOML, in terms of the motor's shaft, and the drives in the axis' coordinate they make."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, AllowInfNan, Field

from controllers.drives.servo import Servo
from controllers.drives.stepper import Stepper
from kinematics.files.schema import TableSchema
from kinematics.foundation.units import Unit
from kinematics.kinds.axis_tables import check_rising
from kinematics.machine.axis import Axis

Samples = Annotated[int, Field(ge=0)]
Ratio = Annotated[float, Field(ge=0), AllowInfNan(False)]
Torque = Annotated[float, Unit("N*m", least=0, like="0.3 N*m")]
Curve = Annotated[
    tuple[tuple[Annotated[float, Unit("rad/s", least=0, like="600 rpm")], Torque], ...],
    AfterValidator(check_rising),
]


class Gear(TableSchema):
    """Turns of the motor for one of the axis; play at the axis.

    ratio  turns of the motor for one of the axis
    play   at the axis
    """

    ratio: Annotated[float, Field(gt=0, le=1e6), AllowInfNan(False)]
    play: Annotated[float, Unit("rad", least=0, like="3 arcmin")] = 0.0

    @property
    def travel(self) -> float:
        """Of the axis for one radian of the motor."""
        return 1 / self.ratio


class Screw(TableSchema):
    """Travel of the axis for one turn of the motor; play at the axis.

    lead  travel for one turn of the motor
    play  at the axis
    """

    lead: Annotated[float, Unit("m", above=0, like="2 mm")]
    play: Annotated[float, Unit("m", least=0, like="10 um")] = 0.0

    @property
    def travel(self) -> float:
        return self.lead / (2 * np.pi)


class DriveTable(TableSchema):
    """What drives of every kind have, as far as it is stated; torques, inertias and speeds are the motor's.

    inertia_ratio  of the load, as the motor feels it, to the rotor
    counts         of the encoder for one turn of the motor
    gear           of a rotary axis
    screw          of a linear axis
    rotor_inertia  needed, here or for every axis
    viscous        friction in proportion to speed
    coulomb        dry friction
    sample         period of the drive's loops
    """

    needed: ClassVar[tuple[str, ...]] = ("rotor_inertia",)

    gear: Gear | None = None
    screw: Screw | None = None
    rotor_inertia: Annotated[float, Unit("kg*m^2", above=0, like="3.6e-6 kg*m^2")] | None = None
    inertia_ratio: Ratio | None = None
    viscous: Annotated[float, Unit("N*m*s/rad", least=0, like="5e-5 N*m*s/rad")] | None = None
    coulomb: Torque | None = None
    counts: Ratio | None = None
    sample: Annotated[float, Unit("s", above=0, like="0.25 ms")] | None = None


class ServoTable(DriveTable):
    """See `Servo`.

    position_gain              of the position loop; needed
    speed_loop                 bandwidth of the speed loop; needed
    integral_time              of the speed loop; needed
    torque_limit               needed
    feedback                   where the encoder sits
    command_delay, loop_delay  samples of the drive
    """

    needed: ClassVar[tuple[str, ...]] = (
        *DriveTable.needed, "position_gain", "speed_loop", "integral_time", "torque_limit", "counts"
    )  # fmt: skip

    position_gain: Annotated[float, Unit("1/s", above=0, like="30 1/s")] | None = None
    speed_loop: Annotated[float, Unit("1/s", above=0, like="30 Hz")] | None = None
    integral_time: Annotated[float, Unit("s", above=0, like="30 ms")] | None = None
    torque_limit: Annotated[float, Unit("N*m", above=0, like="0.9 N*m")] | None = None
    feedback: Literal["motor", "output"] | None = None
    command_delay: Samples | None = None
    loop_delay: Samples | None = None

    @staticmethod
    def drive(values: Mapping[str, Any], r: float, common: Mapping[str, Any]) -> Servo:
        loops = ("position_gain", "speed_loop", "integral_time", "feedback", "command_delay", "loop_delay")
        return Servo(torque_limit=values["torque_limit"] / r, **_pick_stated(values, *loops), **common)


class StepperTable(DriveTable):
    """See `Stepper`; steps: full steps of a turn.

    steps         full steps of a turn; needed
    torque_speed  peak torque at rates of steps, from 0; needed
    damping       against slip between rotor and field
    """

    needed: ClassVar[tuple[str, ...]] = (*DriveTable.needed, "steps", "torque_speed")

    steps: Annotated[int, Field(gt=0, le=10**9, description="write e.g. 200")] | None = None
    torque_speed: Curve | None = None
    damping: Annotated[float, Unit("N*m*s/rad", least=0, like="5e-4 N*m*s/rad")] | None = None

    @staticmethod
    def drive(values: Mapping[str, Any], r: float, common: Mapping[str, Any]) -> Stepper:
        curve = tuple((speed * r, torque / r) for speed, torque in values["torque_speed"])
        full_step, damping = 2 * np.pi * r / values["steps"], values.get("damping", 0.0) / r**2
        return Stepper(torque_speed=curve, full_step=full_step, damping=damping, **common)


KINDS: dict[str, type[ServoTable] | type[StepperTable]] = {"servo": ServoTable, "stepper": StepperTable}
"""Kinds of drive by the name of their table."""
TRANSMISSION = {"rotary": "gear", "linear": "screw"}
"""What leads from the motor to an axis of a kind."""


def drive_of(kind: str, axis: Axis, values: Mapping[str, Any]) -> Servo | Stepper:
    """The drive behind an axis, from the values of its table. With r the axis' travel per radian of the motor:

    J = rotor inertia · (1 + inertia ratio)/r²;  b, d by 1/r²;  torques by 1/r;  speeds by r;  counts by 1/(2π r).
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
