"""Tables of axes, which every kind's file has: `[axes]` for all, `[[axis]]` for what one has of its own, `[wiring]`."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import AfterValidator, AllowInfNan, Field, create_model

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import File, TableSchema, tables_in
from kinematics.foundation.errors import MotionError, validation_error
from kinematics.foundation.units import Length, Unit
from kinematics.kinds.shaper_keys import NO_SHAPER, StatedShaper, VibrationTable
from kinematics.machine.axis import Axis, AxisKind, Magnitude, StepTiming, find_drive

MOTOR_STEPS = (24, 48, 93, 96, 100, 200, 400)
"""Full steps per revolution of motors [KMITL 2005, table 2.1]. The table prints 93 for 3.75°; 360/3.75 is 96."""
DIVISIONS = (*(1 << k for k in range(9)), 5, 10, 25, 50, 125, 250)
"""Microsteps that drives make of a full step: binary and decimal."""
MICROSTEPS = frozenset(steps * division for steps in MOTOR_STEPS for division in DIVISIONS)
"""Steps per revolution of a motor with its drive."""


def _check_direction(direction: int) -> int:
    if direction not in (1, -1):
        raise validation_error(f"{direction} is neither 1 nor -1")
    return direction


def check_range(travel: tuple[float, float]) -> tuple[float, float]:
    if not travel[0] < travel[1]:
        raise validation_error("empty range: the first bound must be the smaller")
    return travel


def check_rising(curve: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if len(curve) < 2 or any(after[0] <= before[0] for before, after in pairwise(curve)):
        raise validation_error("needs two or more points in the order of rising first values")
    return curve


def _check_steps(count: int) -> int:
    if count not in MICROSTEPS:
        raise validation_error(
            f"{count} is no drive's number of steps per revolution; motors have {', '.join(map(str, MOTOR_STEPS))}, "
            f"and drives make {', '.join(map(str, sorted(DIVISIONS)))} of each"
        )
    return count


def _magnitude(unit: str) -> Chosen:
    """Annotation of a bound: one quantity, or two (towards smaller and towards greater positions)."""
    one = Annotated[float, Unit(unit, above=0)]
    two = tuple.__class_getitem__((one, one))
    return Chosen(lambda value: two if isinstance(value, tuple) else one)


Steps = Annotated[int, AfterValidator(_check_steps)]
MAX_RATIO = 1e6
"""Of what one pulse, or one turn, may stand for another."""
Teeth = Annotated[int, Field(ge=1, le=10**9)]


class PulseRateEdge(float):
    """An edge of a resonance band in 1/s of the axis' pulses, until its pulse is known."""


def _edge(unit: str) -> Chosen:
    """Annotation of an edge of a resonance band: a speed, or the pulse rate at which the axis has it."""
    speed, rate = (
        Annotated[float, Unit(unit, above=0)],
        Annotated[float, Unit("1/s", above=0), AfterValidator(PulseRateEdge)],
    )
    pulses = Unit("1/s")

    def pick(value: Any) -> Any:
        try:
            pulses.quantity(value)
        except MotionError:
            return speed
        return rate

    return Chosen(pick)


def _check_bands(bands: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    edges = [edge for band in bands for edge in band]
    if len({isinstance(edge, PulseRateEdge) for edge in edges}) > 1:
        raise validation_error("mixes speeds and pulse rates: state all edges as the one or the other")
    if not edges or any(after <= before for before, after in pairwise(edges)):
        raise validation_error("needs one or more bands, each from its lower to its upper speed, rising and apart")
    return bands


class TimingTable(TableSchema):
    """The timing of a drive that has no name here."""

    high: Annotated[float, Unit("s", above=0, like="1 us", file_unit="us")] = key("that STEP stays high")
    low: Annotated[float, Unit("s", above=0, like="1 us", file_unit="us")] = key("that STEP stays low")
    setup: Annotated[float, Unit("s", least=0, like="1 us", file_unit="us")] = key(
        "that DIR is right before STEP rises"
    )
    hold: Annotated[float, Unit("s", least=0, like="1 us", file_unit="us")] = key("that DIR stays so after it")
    max_rate: Annotated[float, Unit("1/s", above=0, like="500 kHz")] | None = key(
        "of pulses; what high and low allow if not stated", default=None
    )


def _timing(stated: str | TimingTable) -> StepTiming:
    if isinstance(stated, TimingTable):
        return StepTiming(**stated.model_dump(exclude_none=True))
    try:
        return find_drive(stated)
    except MotionError as error:
        raise validation_error(error) from None


Timing = Annotated[Any, Chosen(lambda value: str if isinstance(value, str) else TimingTable), AfterValidator(_timing)]


Gear = Annotated[float, Field(ge=1 / MAX_RATIO, le=MAX_RATIO), AllowInfNan(False)]


class LinearDrive(TableSchema):
    """A stepper with a gear and a screw: one pulse moves lead / (steps · gear).

    [Motion 2-D] writes N = 200 R n (l - l0), with the gear ratio R and n = 1 / lead.
    """

    steps: Steps = key("pulses for one turn of the motor")
    lead: Annotated[float, Unit("m", above=0)] = key("travel for one turn of the screw")
    gear: Gear = key("turns of the motor for one of the screw", default=1.0)

    @property
    def pulse(self) -> float:
        return self.lead / (self.steps * self.gear)


class RotaryDrive(TableSchema):
    """A stepper with a gear: one pulse turns 1/(steps · gear) of a revolution."""

    steps: Steps = key("pulses for one turn of the motor")
    gear: Gear = key("turns of the motor for one of the axis", default=1.0)

    @property
    def pulse(self) -> float:
        return 6.283185307179586 / (self.steps * self.gear)


class AxisTable(TableSchema):
    """Travel, wiring and limits of an axis, as far as the file states them; an absent limit is none."""

    kind: ClassVar[AxisKind]


TRAVEL = '["0 mm", "50 mm"]'
Table = TypeVar("Table", bound=AxisTable)


def declares_keys(table: type[Table]) -> type[Table]:
    """Decorator: a table of axes with every key that an axis may have, in the units of its kind."""
    linear = table.kind == "linear"
    way, force, viscosity, inertia = ("m", "N", "N*s/m", "kg") if linear else ("rad", "N*m", "N*m*s/rad", "kg*m^2")
    place = Annotated[float, Unit(way)]
    speed = Annotated[float, Unit(f"{way}/s", least=0)]

    def choose(linear_axes: str, rotary_axes: str) -> str:
        return linear_axes if linear else rotary_axes

    class Keys(AxisTable):
        travel: Annotated[tuple[place, place], AfterValidator(check_range)] | None = key(
            "of each axis from home", choose(TRAVEL, '["-90 deg", "90 deg"]'), None
        )
        pulse: Annotated[float, Unit(way, above=0, file_unit=choose("um", "rad"))] | None = key(
            "way of one pulse", choose('"1 um"', '"0.01 deg"'), None, instead=["drive"]
        )
        drive: Annotated[Any, Chosen(lambda _: LinearDrive if linear else RotaryDrive)] = key(
            choose(
                "a screw: steps and travel of one revolution; with a gear: gear = 2.0",
                "steps of one revolution; with a gear: gear = 74.0",
            ),
            choose('{ steps = 400, lead = "0.5 mm" }', "{ steps = 400, gear = 1.0 }"),
            None,
            instead=["pulse"],
        )
        electronic_gear: tuple[Teeth, Teeth] | None = key(
            "(n, d): the drive makes n/d steps of each pulse", "[2, 1]", None
        )
        pulse_factor: Annotated[float, Field(ge=1 / MAX_RATIO, le=MAX_RATIO), AllowInfNan(False)] | None = key(
            "what a calibration found a pulse to be, over what is stated", "1.0001", None
        )
        direction: Annotated[int, AfterValidator(_check_direction)] | None = key(
            "1 or -1: how a greater position is counted", "-1", None
        )
        max_speed: Annotated[Magnitude, _magnitude(f"{way}/s")] | None = key(
            "unlimited if not stated; two: towards smaller, towards greater positions",
            choose('"20 mm/s"', '"60 deg/s"'),
            None,
        )
        max_acceleration: Annotated[Magnitude, _magnitude(f"{way}/s^2")] | None = key(
            "likewise", choose('"225 mm/s^2"', '"240 deg/s^2"'), None
        )
        max_jerk: Annotated[Magnitude, _magnitude(f"{way}/s^3")] | None = key(
            "likewise; without it plans are of order 2", choose('"4000 mm/s^3"', '"4000 deg/s^3"'), None
        )
        max_force: Annotated[float, Unit(force, above=0)] | None = key(
            "of the actuator; needs masses, below", choose('"220 N"', '"10 N*m"'), None
        )
        torque_speed: (
            Annotated[
                tuple[tuple[speed, Annotated[float, Unit(force, least=0)]], ...],
                AfterValidator(check_rising),
            ]
            | None
        ) = key(
            "force that the motor has at rising speeds; needs masses",
            choose('[["0 mm/s", "220 N"], ["50 mm/s", "80 N"]]', '[["0 deg/s", "10 N*m"], ["90 deg/s", "4 N*m"]]'),
            None,
        )
        friction: Annotated[float, Unit(viscosity, least=0)] | None = key(
            "viscous", choose('"100 N*s/m"', '"0.1 N*m*s/rad"'), None
        )
        reflected: Annotated[float, Unit(inertia, least=0)] | None = key(
            "rotor and screw, as the axis feels them", choose('"2 kg"', '"0.01 kg*m^2"'), None
        )
        max_pulse_rate: Annotated[float, Unit("1/s", above=0)] | None = key(
            "that the card or the drive takes", '"500 kHz"', None
        )
        start_stop_rate: Annotated[float, Unit("1/s", above=0)] | None = key(
            "rate of pulses up to which the motor starts, stops and turns at once (pull-in)", '"400 1/s"', None
        )
        timing: Timing | None = key(
            'of the drive\'s inputs, by its name; or { high = "1 us", low = "1 us", setup = "1 us", hold = "1 us" }, '
            'with max_rate = "500 kHz" if it has one',
            '"DRV8825"',
            None,
        )
        resonance: (
            Annotated[
                tuple[tuple[Annotated[float, _edge(f"{way}/s")], Annotated[float, _edge(f"{way}/s")]], ...],
                AfterValidator(_check_bands),
            ]
            | None
        ) = key(
            'bands in which a stepper resonates, rising: of speed, or of pulse rate as [["180 1/s", "220 1/s"]]',
            choose('[["4 mm/s", "5 mm/s"]]', '[["20 deg/s", "25 deg/s"]]'),
            None,
        )
        resonance_time: Annotated[float, Unit("s", above=0, file_unit="ms")] | None = key(
            "that a stay in a band may last; never in one if not stated", '"20 ms"', None, needs=["resonance"]
        )
        backlash: Annotated[float, Unit(way, least=0)] | None = key(
            "lost at every reversal", choose('"0.01 mm"', '"0.02 deg"'), None
        )
        pushed: Literal["+", "-"] | None = key('"+" or "-": the side on which the play is at first', '"+"', None)
        lead_error: Annotated[tuple[tuple[place, place], ...], AfterValidator(check_rising)] | None = key(
            "of the screw: positions from home, rising, and how far beyond each the axis is",
            choose('[["0 mm", "0 mm"], ["50 mm", "0.01 mm"]]', '[["0 deg", "0 deg"], ["90 deg", "0.01 deg"]]'),
            None,
        )
        compensate: tuple[Literal["lead", "backlash"], ...] | None = key(
            'what the pulses make up for: "backlash", "lead"', '["backlash"]', None, needs=["backlash"]
        )
        take_up_acceleration: Annotated[float, Unit(f"{way}/s^2", above=0)] | None = key(
            "of a motor that crosses its play; max_acceleration if not stated",
            choose('"500 mm/s^2"', '"500 deg/s^2"'),
            None,
        )
        shaper: StatedShaper | None = key(
            "input shaper against a vibration of what it moves: zv, zvd, mzv or ei; an array of them against several; "
            '"none" where all others have one',
            '{ kind = "zv", frequency = "35 Hz", damping = 0.05 }',
            None,
        )

    bases: tuple[Any, ...] = (table, Keys)
    made: type[Table] = create_model(table.__name__, __base__=bases, __module__=table.__module__, __doc__=table.__doc__)
    return made


@declares_keys
class LinearAxis(AxisTable):
    """The table of a linear axis."""

    kind = "linear"


@declares_keys
class RotaryAxis(AxisTable):
    """The table of a rotary axis; without travel it may turn any number of times."""

    kind = "rotary"


class LinearDefaults(LinearAxis):
    """What all linear axes have unless their own table says otherwise."""

    travel: Annotated[tuple[Length, Length], AfterValidator(check_range)] = key(
        "of each axis from home", TRAVEL, remedy=f"write e.g. {TRAVEL}"
    )


KIND = key("what it is")
GEOMETRY = key("how it is built")
AXES = key("what all axes have")
OWN_AXES = key("what one axis has of its own: any key of [axes]; a table for each such axis", default=())


class MachineFile(File):
    """What every kind's file has.

    first_place   mm from home where the circle of a program to start from begins, within reach of the kind's presets
    """

    what: ClassVar[str] = "machine file"
    first_place: ClassVar[tuple[float, float, float]] = (0, 0, 20)
    wiring: dict[str, tuple[str, Annotated[int, Field(ge=0)]]] = key(
        "by axis: which card drives it, and which of the card's axes it is, from 0", default={}
    )
    vibration: tuple[VibrationTable, ...] = key(
        "along a direction: every axis that moves the platform along it has the shaper beside its own", default=()
    )

    def list_axes(self) -> list[Axis] | None:
        """List the axes as the file states them; None: only the machine has them. Raises MotionError."""
        return None

    def list_freedom(self) -> tuple[str, ...]:
        """List the components of a pose that the machine controls. A kind with `list_axes` has this too."""
        raise NotImplementedError

    @staticmethod
    def geometry_of(machine: Any, complete: bool) -> Mapping[str, Any] | None:
        """What [geometry] says of a machine of the kind, by key, SI; None: machines of the kind are not written.

        complete  with what holds where nothing is said
        """
        return None

    @classmethod
    def tables_of(cls, name: str) -> list[type[TableSchema]]:
        """The schemas of which a table of the file has one; none where the file has no such table."""
        return list(tables_in(cls.model_fields[name].annotation)) if name in cls.model_fields else []


def axes(
    names: Sequence[str], defaults: Mapping[str, AxisTable], overrides: Sequence[Any], file: MachineFile
) -> list[Axis]:
    """The axes by name: what all of their kind have, and what each has of its own (a `drive` gives its pulse)."""
    own = {override.name: _stated_values(override) for override in overrides}
    made = []
    for name in names:
        common = defaults[name]
        card, channel = file.wiring.get(name, (None, None))
        wired = {"name": name, "card": card, "channel": channel}
        values = {"kind": common.kind} | _stated_values(common) | own.get(name, {}) | wired
        if values.get("shaper") == NO_SHAPER:
            del values["shaper"]
        made.append(Axis(**_resolve_pulse(values)))
    return made


def _resolve_pulse(values: dict[str, Any]) -> dict[str, Any]:
    """With the pulse as it is behind its factor and the drive's gear, and pulse rates of resonance as speeds."""
    steps, pulses = values.pop("electronic_gear", (1, 1))
    factor = values.pop("pulse_factor", 1.0)
    pulse = values["pulse"] * factor * steps / pulses
    if bands := values.get("resonance"):
        speeds = (tuple(edge * pulse if isinstance(edge, PulseRateEdge) else edge for edge in band) for band in bands)
        values = values | {"resonance": tuple(speeds)}
    return values | {"pulse": pulse}


def _stated_values(table: Any) -> dict[str, Any]:
    values = {name: value for name in type(table).model_fields if (value := getattr(table, name)) is not None}
    drive = values.pop("drive", None)
    return values | ({"pulse": drive.pulse} if drive is not None else {})
