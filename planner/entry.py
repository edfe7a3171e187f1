"""The schema of what every segment of a program's TOML may say beside where it leads."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo

from kinematics.schema import Table, chosen, wrong
from kinematics.units import Unit, shown
from planner.modifiers import Blend, Free, Join, Stop, Through, Trigger


def _with_speed(constant: bool, info: ValidationInfo) -> bool:
    if constant and info.data.get("speed", 1.0) is None:  # a faulty speed is not there, and told of already
        raise wrong('asks for a speed: add e.g. speed = "20 mm/s"')
    return constant


def _named(name: str) -> str:
    if not name:
        raise wrong("empty: give the name of the output line or event")
    return name


def _trigger_type(value: object) -> Any:
    return TriggerTable if isinstance(value, dict) else Name


def _join_type(value: object) -> Any:
    if isinstance(value, dict):
        return BlendTable
    if value not in ("stop", "through"):
        raise wrong(f'{shown(value)} is not a join: write "stop", "through" or {{ blend = "0.05 mm" }}')
    return Literal["stop", "through"]


ToolSpeed = Annotated[float, Unit("m/s", above=0)]
ToolAcceleration = Annotated[float, Unit("m/s^2", above=0)]
AngularSpeed = Annotated[float, Unit("rad/s", above=0)]
Name = Annotated[str, AfterValidator(_named)]


class BlendTable(Table):
    """A join that is rounded.

    blend  by how much the path may leave the corner
    angle  by how much the orientation may; if not stated, what turns points at the machine's characteristic length by
           as much
    """

    blend: Annotated[float, Unit("m", above=0, plain="length")]
    angle: Annotated[float, Unit("rad", above=0, plain="angle")] | None = None


JoinEntry = Annotated[Literal["stop", "through"] | BlendTable, chosen(_join_type)]


class TriggerTable(Table):
    """An event along a segment.

    name  of the output line or event
    at    share of the segment, from 0 to 1
    """

    name: Name
    at: Annotated[float, Field(ge=0, le=1)] = 1.0


class FreeTable(Table):
    """Orientation that is left free.

    yaw   whether the turn about the tool's z axis is free
    tilt  by how much that axis may lean
    """

    yaw: bool = False
    tilt: Annotated[float, Unit("rad", least=0, most=1.57, plain="angle")] = 0.0


FreeEntry = Annotated[
    Literal["yaw"] | FreeTable, chosen(lambda value: FreeTable if isinstance(value, dict) else Literal["yaw"])
]
TriggerEntry = Annotated[Name | TriggerTable, chosen(_trigger_type)]


class Entry(Table):
    """What every segment that moves has.

    join           to the next segment
    angular_speed  cap of the platform's turning
    trigger        an event along it
    """

    join: JoinEntry = "stop"
    angular_speed: AngularSpeed | None = None
    trigger: TriggerEntry | None = None

    @property
    def after(self) -> Join:
        if isinstance(self.join, BlendTable):
            return Blend(self.join.blend, self.join.angle)
        return Stop() if self.join == "stop" else Through()

    @property
    def event(self) -> Trigger | None:
        entry = self.trigger
        if entry is None:
            return None
        return Trigger(entry.name, entry.at) if isinstance(entry, TriggerTable) else Trigger(entry)


class Drawn(Entry):
    """What every segment that moves the tool has beside it.

    speed           cap of the tool's speed
    acceleration    cap of the tool's acceleration
    speed_constant  exactly this speed, between ramps
    free            what of the orientation is chosen for time
    """

    speed: ToolSpeed | None = None
    acceleration: ToolAcceleration | None = None
    speed_constant: Annotated[bool, AfterValidator(_with_speed)] = False
    free: FreeEntry | None = None

    @property
    def freedom(self) -> Free | None:
        return Free(self.free.yaw, self.free.tilt) if isinstance(self.free, FreeTable) else self.free and Free()

    @property
    def said(self) -> dict[str, Any]:
        """What its segment takes by name."""
        return {
            "speed": self.speed,
            "join": self.after,
            "acceleration": self.acceleration,
            "angular_speed": self.angular_speed,
            "speed_constant": self.speed_constant,
            "trigger": self.event,
            "free": self.freedom,
        }
