"""Tables of axes, which every kind's file has: `[axes]` for all, `[[axis]]` for what one has of its own, `[wiring]`."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, AllowInfNan, Field, PlainValidator, ValidationInfo

from kinematics.files.schema import File, TableSchema, chosen
from kinematics.files.toml_document import Key
from kinematics.foundation.errors import BadValue, MotionError, validation_error
from kinematics.foundation.names import closest, nearest
from kinematics.foundation.units import Angle, Length, Unit, describe_value
from kinematics.machine.axis import Axis, Magnitude, StepTiming, find_drive

MICROSTEPS = tuple(sorted({200, 400, 1000, 2000, 5000, 10_000, 25_000, 50_000} | {400 << k for k in range(8)}))
"""Steps per revolution that microstepping drives make of a 1.8° motor: decimal, and binary to 51 200 [KMITL 2005]."""


def _check_direction(direction: int) -> int:
    if direction not in (1, -1):
        raise validation_error(f"{direction} is neither 1 nor -1")
    return direction


def _check_travel(travel: tuple[float, float]) -> tuple[float, float]:
    if not travel[0] < travel[1]:
        raise validation_error("empty travel: the first bound must be the smaller")
    return travel


def check_rising(curve: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if len(curve) < 2 or any(after[0] <= before[0] for before, after in pairwise(curve)):
        raise validation_error("needs two or more points in the order of rising first values")
    return curve


def _check_steps(count: int) -> int:
    if count not in MICROSTEPS:
        raise validation_error(
            f"{count} is no drive's number of steps per revolution; drives have {', '.join(map(str, MICROSTEPS))}"
        )
    return count


def _magnitude(unit: str) -> PlainValidator:
    """Annotation of a bound: one quantity, or two (towards smaller and towards greater positions)."""
    one = Annotated[float, Unit(unit, above=0)]
    two = tuple.__class_getitem__((one, one))
    return chosen(lambda value: two if isinstance(value, tuple) else one)


Rate = Annotated[float, Unit("1/s", above=0)]
Force = Annotated[float, Unit("N", above=0)]
Steps = Annotated[int, AfterValidator(_check_steps)]
RATIO = 1e6
"""Of what one pulse, or one turn, may stand for another."""
Teeth = Annotated[int, Field(ge=1, le=10**9)]


class PulseRate(float):
    """An edge of a resonance band in 1/s of the axis' pulses, until its pulse is known."""


def _edge(unit: str) -> PlainValidator:
    """Annotation of an edge of a resonance band: a speed, or the pulse rate at which the axis has it."""
    speed, rate = (
        Annotated[float, Unit(unit, above=0)],
        Annotated[float, Unit("1/s", above=0), AfterValidator(PulseRate)],
    )
    pulses = Unit("1/s")

    def pick(value: Any) -> Any:
        try:
            pulses.quantity(value)
        except MotionError:
            return speed
        return rate

    return chosen(pick)


def _check_bands(bands: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    edges = [edge for band in bands for edge in band]
    if len({isinstance(edge, PulseRate) for edge in edges}) > 1:
        raise validation_error("mixes speeds and pulse rates: state all edges as the one or the other")
    if not edges or any(after <= before for before, after in pairwise(edges)):
        raise validation_error("needs one or more bands, each from its lower to its upper speed, rising and apart")
    return bands


class TimingTable(TableSchema):
    """The timing of a drive that has no name here."""

    high: Annotated[float, Unit("s", above=0, like="1 us")]
    low: Annotated[float, Unit("s", above=0, like="1 us")]
    setup: Annotated[float, Unit("s", least=0, like="1 us")]
    hold: Annotated[float, Unit("s", least=0, like="1 us")]
    max_rate: Annotated[float, Unit("1/s", above=0, like="500 kHz")] | None = None


def _timing(value: object, info: ValidationInfo) -> StepTiming:
    if isinstance(value, str):
        try:
            return find_drive(value)
        except MotionError as error:
            raise validation_error(error) from None
    table = TimingTable.model_validate(value, strict=True, context=info.context)
    return StepTiming(**table.model_dump(exclude_none=True))


Timing = Annotated[StepTiming, PlainValidator(_timing)]


class Input(TableSchema):
    """What no unit of its own depends on.

    pulse_factor     what a calibration found a pulse to be, over what is stated
    electronic_gear  (n, d): the drive makes n/d steps of each pulse, and a pulse is so much longer
    drive  instead of `pulse`: the drive that makes it
    """

    direction: Annotated[int, AfterValidator(_check_direction)] | None = None
    max_pulse_rate: Rate | None = None
    timing: Timing | None = None
    compensate: tuple[Literal["lead", "backlash"], ...] | None = None
    pushed: Literal["+", "-"] | None = None
    pulse_factor: Annotated[float, Field(ge=1 / RATIO, le=RATIO), AllowInfNan(False)] | None = None
    electronic_gear: tuple[Teeth, Teeth] | None = None
    resonance_time: Annotated[float, Unit("s", above=0)] | None = None


class MachineFile(File):
    """What every kind's file has.

    kind      what it is
    geometry  how it is built
    axes      what all axes have
    axis      `[[axis]]` tables by `name`: what one has of its own
    wiring    by axis: which card drives it, and which of the card's axes it is, from 0
    """

    what: ClassVar[str] = "machine file"
    wiring: dict[str, tuple[str, Annotated[int, Field(ge=0)]]] = Field(default_factory=dict)


class LinearDrive(TableSchema):
    """A stepper on a screw: one pulse moves lead / steps.

    steps  pulses for one turn of the motor
    lead   travel for one turn of the screw
    """

    steps: Steps
    lead: Annotated[float, Unit("m", above=0)]

    @property
    def pulse(self) -> float:
        return self.lead / self.steps


class LinearAxis(Input):
    """Travel, wiring and limits of a linear axis, as far as the file states them; an absent limit is none.

    max_force  that the actuator bears; kept where the file states masses, friction or a wrench
    resonance  rising bands ((low, high), ...) of speed, or of pulse rate ("180 1/s", times the axis' own pulse): there
               the motor resonates
    """

    travel: Annotated[tuple[Length, Length], AfterValidator(_check_travel)] | None = None
    pulse: Annotated[float, Unit("m", above=0)] | None = None
    drive: LinearDrive | None = None
    max_speed: Annotated[Magnitude, _magnitude("m/s")] | None = None
    max_acceleration: Annotated[Magnitude, _magnitude("m/s^2")] | None = None
    max_jerk: Annotated[Magnitude, _magnitude("m/s^3")] | None = None
    resonance: (
        Annotated[
            tuple[tuple[Annotated[float, _edge("m/s")], Annotated[float, _edge("m/s")]], ...],
            AfterValidator(_check_bands),
        ]
        | None
    ) = None
    max_force: Force | None = None
    torque_speed: (
        Annotated[
            tuple[tuple[Annotated[float, Unit("m/s", least=0)], Annotated[float, Unit("N", least=0)]], ...],
            AfterValidator(check_rising),
        ]
        | None
    ) = None
    friction: Annotated[float, Unit("N*s/m", least=0)] | None = None
    reflected: Annotated[float, Unit("kg", least=0)] | None = None
    backlash: Annotated[float, Unit("m", least=0)] | None = None
    take_up_acceleration: Annotated[float, Unit("m/s^2", above=0)] | None = None
    lead_error: Annotated[tuple[tuple[Length, Length], ...], AfterValidator(check_rising)] | None = None


class RotaryDrive(TableSchema):
    """A stepper behind a gear: one pulse turns 1/(steps · gear) of a revolution.

    steps  pulses for one turn of the motor
    gear   turns of the motor for one of the axis
    """

    steps: Steps
    gear: Annotated[float, Field(ge=1 / RATIO, le=RATIO), AllowInfNan(False)] = 1.0

    @property
    def pulse(self) -> float:
        return 6.283185307179586 / (self.steps * self.gear)


class RotaryAxis(Input):
    """The same of a rotary axis; without travel it may turn any number of times."""

    travel: Annotated[tuple[Angle, Angle], AfterValidator(_check_travel)] | None = None
    pulse: Annotated[float, Unit("rad", above=0)] | None = None
    drive: RotaryDrive | None = None
    max_speed: Annotated[Magnitude, _magnitude("rad/s")] | None = None
    max_acceleration: Annotated[Magnitude, _magnitude("rad/s^2")] | None = None
    max_jerk: Annotated[Magnitude, _magnitude("rad/s^3")] | None = None
    resonance: (
        Annotated[
            tuple[tuple[Annotated[float, _edge("rad/s")], Annotated[float, _edge("rad/s")]], ...],
            AfterValidator(_check_bands),
        ]
        | None
    ) = None
    max_force: Annotated[float, Unit("N*m", above=0)] | None = None
    torque_speed: (
        Annotated[
            tuple[tuple[Annotated[float, Unit("rad/s", least=0)], Annotated[float, Unit("N*m", least=0)]], ...],
            AfterValidator(check_rising),
        ]
        | None
    ) = None
    friction: Annotated[float, Unit("N*m*s/rad", least=0)] | None = None
    reflected: Annotated[float, Unit("kg*m^2", least=0)] | None = None
    backlash: Annotated[float, Unit("rad", least=0)] | None = None
    take_up_acceleration: Annotated[float, Unit("rad/s^2", above=0)] | None = None
    lead_error: Annotated[tuple[tuple[Angle, Angle], ...], AfterValidator(check_rising)] | None = None


class LinearDefaults(LinearAxis):
    """What all linear axes have unless their own table says otherwise."""

    travel: Annotated[
        tuple[Length, Length], AfterValidator(_check_travel), Field(description='write e.g. ["0 mm", "50 mm"]')
    ]


AxisTable = LinearAxis | RotaryAxis


def axes(
    names: Sequence[str], defaults: Mapping[str, AxisTable], overrides: Sequence[Any], file: MachineFile
) -> list[Axis]:
    """The axes by name: what all of their kind have, and what each has of its own (a `drive` gives its pulse)."""
    own = {override.name: _stated_values(override) for override in overrides}
    kinds = {LinearAxis: "linear", RotaryAxis: "rotary"}
    made = []
    for name in names:
        common = defaults[name]
        kind = next(kind for table, kind in kinds.items() if isinstance(common, table))
        card, channel = file.wiring.get(name, (None, None))
        wired = {"name": name, "card": card, "channel": channel}
        made.append(Axis(**_resolve_pulse({"kind": kind} | _stated_values(common) | own.get(name, {}) | wired)))
    return made


def _resolve_pulse(values: dict[str, Any]) -> dict[str, Any]:
    """With the pulse as it is behind its factor and the drive's gear, and pulse rates of resonance as speeds."""
    steps, pulses = values.pop("electronic_gear", (1, 1))
    factor = values.pop("pulse_factor", 1.0)
    pulse = values["pulse"] * factor * steps / pulses
    if bands := values.get("resonance"):
        speeds = (tuple(edge * pulse if isinstance(edge, PulseRate) else edge for edge in band) for band in bands)
        values = values | {"resonance": tuple(speeds)}
    return values | {"pulse": pulse}


def _stated_values(table: Any) -> dict[str, Any]:
    values = {name: value for name in type(table).model_fields if (value := getattr(table, name)) is not None}
    drive = values.pop("drive", None)
    return values | ({"pulse": drive.pulse} if drive is not None else {})


def find_pulse_faults(data: Mapping[str, Any]) -> Iterator[tuple[Key, str]]:
    """A table that states both a pulse and the drive that makes it, or neither where all axes need one."""
    own = data.get("axis", ())
    tables: list[tuple[Key, Any, bool]] = [((key,), data.get(key), True) for key in ("axes", "rotary")]
    tables += [(("axis", n), table, False) for n, table in enumerate(own if isinstance(own, tuple) else ())]
    for key, table, needed in tables:
        given = {"pulse", "drive"} & table.keys() if isinstance(table, dict) else {"pulse"}
        if len(given) == 2:
            yield (*key, "drive"), "pulse and drive exclude each other: give one"
        if needed and not given:
            yield (*key, "pulse"), 'missing: write e.g. "0.75 um", or a drive with its steps'


def find_wiring_faults(names: Sequence[str], data: Mapping[str, Any]) -> Iterator[tuple[Key, MotionError]]:
    """Every key of [wiring] that is none of the axes' names; of no names nothing is known."""
    wiring = data.get("wiring")
    for name in wiring if isinstance(wiring, dict) and names else ():
        if name not in names:
            known = ", ".join(names)
            told = f"{describe_value(name)} is no axis{nearest(name, names)}; axes: {known}"
            yield ("wiring", name), BadValue(told, allowed=known, nearest=closest(name, names))


def find_repeated_names(data: Mapping[str, Any], array: str = "axis") -> Iterator[tuple[Key, str]]:
    """Every [[axis]] table (or of another array) after the first of its name."""
    seen = set()
    tables = data.get(array, ())
    for n, table in enumerate(tables if isinstance(tables, tuple) else ()):
        name = table.get("name") if isinstance(table, dict) else None
        if isinstance(name, str) and name in seen:
            yield (array, n, "name"), f"{describe_value(name)} has an [[{array}]] table already"
        seen.add(name if isinstance(name, str) else None)
