"""The schema of what every segment of a program's TOML may say beside where it leads, and of a
segment by equations:

    [[segment]] curve = { x = "r*cos(t)", y = "r*sin(t)", z = 25, from = 0, to = "2*pi", constants =
    { r = 15 } }

t is a number without a unit, and sin, cos and tan take radians, whatever the file declares. The
equations must begin where the path stands, and be smooth.
"""

from math import pi
from typing import Annotated, Any, Literal, Self

from casadi import SX
from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo, model_validator

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import Number, TableSchema
from kinematics.foundation.errors import as_validation_error, validation_error
from kinematics.foundation.formula import check_names, constant, formula
from kinematics.foundation.units import Unit, describe_value
from planner.program.model import Curve, Segment
from planner.program.modifiers import (
    CORNER_ANGLE,
    STOP,
    Blend,
    Fit,
    Free,
    Join,
    Stop,
    Through,
    Trigger,
)


def _check_has_speed(constant: bool, info: ValidationInfo) -> bool:
    if (
        constant and info.data.get("speed", 1.0) is None
    ):  # a faulty speed is not there, and told of already
        raise validation_error('needs a speed: add e.g. speed = "20 mm/s"')
    return constant


def _check_begins(after_rest: bool, info: ValidationInfo) -> bool:
    if after_rest and info.data.get("at", 0.0) != 0:
        raise validation_error("true: is of the start of its segment: give at = 0 with it")
    return after_rest


def _check_name(name: str) -> str:
    if not name:
        raise validation_error("empty: give the name of the output line or event")
    return name


def _trigger_type(value: object) -> Any:
    return TriggerTable if isinstance(value, dict) else Name


def _join_type(value: object) -> Any:
    if isinstance(value, dict):
        return FitTable if "fit" in value else BlendTable
    if value not in ("stop", "through"):
        raise validation_error(
            f'{describe_value(value)} is not a join: write "stop", "through", {{ blend = "0.05 mm" }} or '
            '{ fit = "0.02 mm" }'
        )
    return Literal["stop", "through"]


ToolSpeed = Annotated[float, Unit("m/s", above=0)]
ToolAcceleration = Annotated[float, Unit("m/s^2", above=0)]
ToolJerk = Annotated[float, Unit("m/s^3", above=0)]
AngularSpeed = Annotated[float, Unit("rad/s", above=0)]
Name = Annotated[str, AfterValidator(_check_name)]


class BlendTable(TableSchema):
    """A join that is rounded."""

    blend: Annotated[float, Unit("m", above=0, plain="length")] = key(
        "largest distance of the curve from the lines or arcs that meet"
    )
    angle: Annotated[float, Unit("rad", above=0, plain="angle")] | None = key(
        "largest change of the orientation; if not stated, the angle that moves points at the machine's "
        "characteristic length as far",
        default=None,
    )


class FitTable(TableSchema):
    """A join inside a chain of short lines and arcs that becomes a smooth curve."""

    fit: Annotated[float, Unit("m", above=0, plain="length")] = key(
        "largest distance of the curve from the chain"
    )
    angle: Annotated[float, Unit("rad", above=0, plain="angle")] | None = key(
        "largest change of the orientation; if not stated, the angle that moves points at the machine's "
        "characteristic length as far",
        default=None,
    )
    corner: Annotated[float, Unit("rad", above=0, most=pi, plain="angle")] = key(
        "angle between two directions above which a corner remains, rounded like a blend; 35 deg if not stated",
        default=CORNER_ANGLE,
    )
    stop: bool = key(
        "true: the motion stops at such a corner instead of rounding it", default=False
    )


JoinEntry = Annotated[Literal["stop", "through"] | BlendTable | FitTable, Chosen(_join_type)]


class TriggerTable(TableSchema):
    """An event along a segment."""

    name: Name = key("name of the output line or event")
    at: Annotated[float, Field(ge=0, le=1)] = key(
        "share of the segment after which the event occurs, from 0 to 1", default=1.0
    )
    after_rest: Annotated[bool, AfterValidator(_check_begins)] = key(
        "with at = 0: true if the event occurs when the motion continues after a rest there, not on arrival",
        default=False,
    )


class FreeTable(TableSchema):
    """Orientation that is left free."""

    yaw: bool = key("true: the planner chooses the rotation about the tool's z axis", default=False)
    tilt: Annotated[float, Unit("rad", least=0, most=1.57, plain="angle")] = key(
        "largest tilt of the tool's z axis that the planner may choose", default=0.0
    )


FreeEntry = Annotated[
    Literal["yaw"] | FreeTable,
    Chosen(lambda value: FreeTable if isinstance(value, dict) else Literal["yaw"]),
]
TriggerEntry = Annotated[Name | TriggerTable, Chosen(_trigger_type)]


def _check_rests(entry: Name | TriggerTable | None) -> Name | TriggerTable | None:
    if isinstance(entry, TriggerTable) and entry.after_rest:
        raise validation_error(
            "after_rest is of a segment that moves: leave it out, as at = 1 is the end of the rest"
        )
    return entry


DwellTriggerEntry = Annotated[TriggerEntry | None, AfterValidator(_check_rests)]


def read_trigger(entry: Name | TriggerTable | None) -> Trigger | None:
    """The trigger that a file states."""
    if entry is None:
        return None
    return (
        Trigger(entry.name, entry.at, entry.after_rest)
        if isinstance(entry, TriggerTable)
        else Trigger(entry)
    )


SPEED = key("limit of the tool speed along the segment", '"20 mm/s"', None)
ACCELERATION = key("limit of the tool acceleration along the segment", '"500 mm/s^2"', None)
JERK = key("limit of the tool jerk along the segment, in plans that limit jerk", '"50 m/s^3"', None)


class MovingEntry(TableSchema):
    """What every segment that moves has."""

    join: JoinEntry = key(
        'join to the next segment; "stop" if not stated; "through": no stop where the path is smooth; { blend = … }: '
        'corner rounded within a tolerance, and with angle = "0.1 deg" the orientation; { fit = "0.02 mm" }: short '
        'segments become a smooth curve, except at corners above corner = "35 deg"',
        '{ blend = "0.05 mm" }',
        "stop",
    )
    angular_speed: AngularSpeed | None = key(
        "limit of the tool's angular speed along the segment", '"30 deg/s"', None
    )
    trigger: TriggerEntry | None = key(
        "event; at: share of the segment, 1 (the end) if not stated; at = 0, after_rest = true: as the motion "
        "continues after a rest there",
        '{ name = "camera", at = 0.5 }',
        None,
    )

    @property
    def next_join(self) -> Join:
        if isinstance(self.join, BlendTable):
            return Blend(self.join.blend, self.join.angle)
        if isinstance(self.join, FitTable):
            return Fit(self.join.fit, self.join.angle, self.join.corner, self.join.stop)
        if self.join == "through":
            return Through()
        return Stop() if "join" in self.model_fields_set else STOP

    @property
    def event(self) -> Trigger | None:
        return read_trigger(self.trigger)


class PathEntry(MovingEntry):
    """What every segment that moves the tool has beside it."""

    speed: ToolSpeed | None = SPEED
    acceleration: ToolAcceleration | None = ACCELERATION
    max_tool_jerk: ToolJerk | None = JERK
    speed_constant: Annotated[bool, AfterValidator(_check_has_speed)] = key(
        "true: exactly this speed, except on ramps", "true", False, needs=["speed"]
    )
    free: FreeEntry | None = key(
        'orientation that the planner chooses: "yaw", rotation about the tool\'s z axis; tilt: tilt of that axis too',
        '{ yaw = true, tilt = "5 deg" }',
        None,
    )

    @property
    def freedom(self) -> Free | None:
        return (
            Free(self.free.yaw, self.free.tilt)
            if isinstance(self.free, FreeTable)
            else self.free and Free()
        )

    @property
    def modifiers(self) -> dict[str, Any]:
        """What its segment takes by name."""
        return {
            "speed": self.speed,
            "join": self.next_join,
            "acceleration": self.acceleration,
            "angular_speed": self.angular_speed,
            "max_tool_jerk": self.max_tool_jerk,
            "speed_constant": self.speed_constant,
            "trigger": self.event,
            "free": self.freedom,
        }


def _constants(given: dict[str, float]) -> dict[str, float]:
    with as_validation_error():
        check_names(given)
    return given


def _text(value: object) -> str:
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return repr(float(value))
        except OverflowError:
            raise validation_error(f"{describe_value(value)}: not a finite number") from None
    if not isinstance(value, str):
        raise validation_error(f'{describe_value(value)} is no formula: write e.g. "15*cos(t)"')
    return value


def _formula_validator(declared: str, unit: str) -> PlainValidator:
    """Validator of a formula of t whose values are plain numbers of a declared unit: its text, and
    the unit in SI.
    """

    def validate(value: object, info: ValidationInfo) -> tuple[str, float]:
        text = _text(value)
        with as_validation_error():
            formula(text, info.data.get("constants", {}), SX.sym("t"))
        scales = info.context or {}
        if declared not in scales:
            raise validation_error(
                f'values without a unit: add the line {declared} = "{unit}" at the top'
            )
        return text, scales[declared]

    return PlainValidator(validate)


def _read_bound(value: object, info: ValidationInfo) -> float:
    with as_validation_error():
        return constant(_text(value), info.data.get("constants", {}))


Length = Annotated[tuple[str, float], _formula_validator("length", "mm")]
Angle = Annotated[tuple[str, float], _formula_validator("angle", "deg")]
Bound = Annotated[float, PlainValidator(_read_bound)]


_WAY = "position: a formula of t, or a number, in the unit of `length`"
_TURN = "orientation Rx · Ry · Rz: formulas in the unit of `angle`; 0 if another is stated, else unchanged"
_BOUND = "first or last value of t: a number, or a formula without t"


class CurveTable(TableSchema):
    """A curve by equations."""

    # first: the others are read with them
    constants: Annotated[dict[str, Number], AfterValidator(_constants)] = key(
        "named numbers, for all formulas of the curve", default={}
    )
    x: Length = key(_WAY)
    y: Length = key(_WAY)
    z: Length = key(_WAY)
    rx: Angle | None = key(_TURN, default=None)
    ry: Angle | None = key(_TURN, default=None)
    rz: Angle | None = key(_TURN, default=None)
    begin: Bound = key(_BOUND, alias="from")
    end: Bound = key(_BOUND, alias="to")

    @model_validator(mode="after")
    def _some_way(self) -> Self:
        if self.begin == self.end:
            raise validation_error(
                f"t runs from {self.begin:g} to {self.end:g}: the two must differ"
            )
        return self


class CurveEntry(PathEntry):
    curve: CurveTable = key(
        "curve by formulas of t, in the units above, from the end of the previous segment; rx, ry, rz: orientation; "
        "constants: named numbers",
        '{ x = "r*cos(t)", y = "r*sin(t)", z = "25", from = 0, to = "2*pi", constants = { r = 10 } }',
    )

    def segment(self, line_number: int | None) -> Segment:
        table = self.curve
        turns = [given for given in (table.rx, table.ry, table.rz) if given is not None]
        rx, ry, rz = (
            "0" if given is None else given[0] for given in (table.rx, table.ry, table.rz)
        )
        return Curve(
            (table.x[0], table.y[0], table.z[0]),
            table.begin,
            table.end,
            (rx, ry, rz) if turns else None,
            **self.modifiers,
            constants=tuple(table.constants.items()),
            length=table.x[1],
            angle=turns[0][1] if turns else 1.0,
            line_number=line_number,
        )
