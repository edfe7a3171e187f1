"""Tables of axes, which every kind's file has: `[axes]` for all, `[[axis]]` for what one has of its
own, `[wiring]`.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import AfterValidator, AllowInfNan, Field, create_model

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import NAME, File, Name, TableSchema, tables_in, unit_validator
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, validation_error
from kinematics.foundation.units import Length, Unit
from kinematics.kinds.shaper_keys import NO_SHAPER, StatedShaper, VibrationTable
from kinematics.machine.axis import Axis, AxisKind, Magnitude, StepTiming, find_drive

MOTOR_STEPS = (24, 48, 93, 96, 100, 200, 400)
"""Full steps per revolution of motors [KMITL 2005, table 2.1].

The table prints 93 for 3.75°; 360/3.75 is 96.
"""
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
        raise validation_error("empty range: the first value must be the smaller: swap them")
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
    """Annotation of a bound: one quantity, or two (towards smaller and towards greater
    positions).
    """
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
    """Annotation of an edge of a resonance band: a speed, or the pulse rate at which the axis has
    it.
    """
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
        raise validation_error(
            "mixes speeds and pulse rates: state all edges as the one or the other"
        )
    if not edges or any(after <= before for before, after in pairwise(edges)):
        raise validation_error(
            "needs one or more bands, each from its lower to its upper speed, rising and apart"
        )
    return bands


class TimingTable(TableSchema):
    """The timing of a drive that has no name here."""

    high: Annotated[float, Unit("s", above=0, like="1 us", file_unit="us")] = key(
        "shortest time for which STEP is high"
    )
    low: Annotated[float, Unit("s", above=0, like="1 us", file_unit="us")] = key(
        "shortest time for which STEP is low"
    )
    setup: Annotated[float, Unit("s", least=0, like="1 us", file_unit="us")] = key(
        "shortest time from a change of DIR to the next rise of STEP"
    )
    hold: Annotated[float, Unit("s", least=0, like="1 us", file_unit="us")] = key(
        "shortest time from a rise of STEP to the next change of DIR"
    )
    max_rate: Annotated[float, Unit("1/s", above=0, like="500 kHz")] | None = key(
        "highest pulse rate; what high and low allow if not stated", default=None
    )


def _timing(stated: str | TimingTable) -> StepTiming:
    if isinstance(stated, TimingTable):
        return StepTiming(**stated.model_dump(exclude_none=True))
    try:
        return find_drive(stated)
    except MotionError as error:
        raise validation_error(error) from None


Timing = Annotated[
    Any,
    Chosen(lambda value: str if isinstance(value, str) else TimingTable),
    AfterValidator(_timing),
]


Gear = Annotated[float, Field(ge=1 / MAX_RATIO, le=MAX_RATIO), AllowInfNan(False)]


class LinearDrive(TableSchema):
    """A stepper with a gear and a screw: one pulse moves lead / (steps · gear).

    [Motion 2-D] writes N = 200 R n (l - l0), with the gear ratio R and n = 1 / lead.
    """

    steps: Steps = key("steps per revolution of the motor, microsteps included")
    lead: Annotated[float, Unit("m", above=0)] = key("travel per revolution of the screw")
    gear: Gear = key(
        "gear ratio: revolutions of the motor per revolution of the screw", default=1.0
    )

    @property
    def pulse(self) -> float:
        return self.lead / (self.steps * self.gear)


class RotaryDrive(TableSchema):
    """A stepper with a gear: one pulse turns 1/(steps · gear) of a revolution."""

    steps: Steps = key("steps per revolution of the motor, microsteps included")
    gear: Gear = key("gear ratio: revolutions of the motor per revolution of the axis", default=1.0)

    @property
    def pulse(self) -> float:
        return 6.283185307179586 / (self.steps * self.gear)


class AxisTable(TableSchema):
    """Travel, wiring and limits of an axis, as far as the file states them; an absent limit is
    none.
    """

    kind: ClassVar[AxisKind]


TRAVEL = '["0 mm", "50 mm"]'
TRAVEL_KEYS = {"travel", "leg_length"}
"""A table of axes states one of these."""
Table = TypeVar("Table", bound=AxisTable)


def declares_keys(table: type[Table]) -> type[Table]:
    """Decorator: a table of axes with every key that an axis may have, in the units of its kind."""
    linear = table.kind == "linear"
    way, force, viscosity, inertia = (
        ("m", "N", "N*s/m", "kg") if linear else ("rad", "N*m", "N*m*s/rad", "kg*m^2")
    )
    place = Annotated[float, Unit(way)]
    speed = Annotated[float, Unit(f"{way}/s", least=0)]

    def choose(linear_axes: str, rotary_axes: str) -> str:
        return linear_axes if linear else rotary_axes

    class Keys(AxisTable):
        travel: Annotated[tuple[place, place], AfterValidator(check_range)] | None = key(
            "lowest and highest position, counted from home",
            choose(TRAVEL, '["-90 deg", "90 deg"]'),
            None,
        )
        pulse: (
            Annotated[
                float,
                Unit(
                    way, above=0, like=choose("0.75 um", "0.01 deg"), file_unit=choose("um", "rad")
                ),
            ]
            | None
        ) = key(
            choose("travel per pulse", "angle per pulse"),
            choose('"1 um"', '"0.01 deg"'),
            None,
            instead=["drive"],
        )
        drive: Annotated[Any, Chosen(lambda _: LinearDrive if linear else RotaryDrive)] = key(
            choose(
                "steps per revolution, microsteps included, and travel per revolution; with a gear: gear = 2.0",
                "steps per revolution, microsteps included; with a gear: gear = 74.0",
            ),
            choose('{ steps = 400, lead = "0.5 mm" }', "{ steps = 400, gear = 1.0 }"),
            None,
            instead=["pulse"],
        )
        electronic_gear: tuple[Teeth, Teeth] | None = key(
            "electronic gear ratio [n, d]: the drive makes n/d steps per pulse", "[2, 1]", None
        )
        pulse_factor: (
            Annotated[float, Field(ge=1 / MAX_RATIO, le=MAX_RATIO), AllowInfNan(False)] | None
        ) = key(
            "from a calibration: measured travel per pulse divided by the stated one",
            "1.0001",
            None,
        )
        direction: Annotated[int, AfterValidator(_check_direction)] | None = key(
            "1 if pulses count up as the position increases, -1 if they count down", "-1", None
        )
        max_speed: Annotated[Magnitude, _magnitude(f"{way}/s")] | None = key(
            "speed limit; two values: towards smaller, towards greater positions; unlimited if not stated",
            choose('"20 mm/s"', '"60 deg/s"'),
            None,
        )
        max_acceleration: Annotated[Magnitude, _magnitude(f"{way}/s^2")] | None = key(
            "acceleration limit; one or two values, as max_speed; unlimited if not stated",
            choose('"225 mm/s^2"', '"240 deg/s^2"'),
            None,
        )
        max_jerk: Annotated[Magnitude, _magnitude(f"{way}/s^3")] | None = key(
            "jerk limit; one or two values, as max_speed; without it, plans do not limit jerk",
            choose('"4000 mm/s^3"', '"4000 deg/s^3"'),
            None,
        )
        max_force: Annotated[float, Unit(force, above=0)] | None = key(
            choose("force limit", "torque limit")
            + " of the actuator; needs the mass in [platform]",
            choose('"220 N"', '"10 N*m"'),
            None,
        )
        torque_speed: (
            Annotated[
                tuple[tuple[speed, Annotated[float, Unit(force, least=0)]], ...],
                AfterValidator(check_rising),
            ]
            | None
        ) = key(
            choose("force", "torque")
            + " that the motor has at each speed, speeds rising; needs the mass in [platform]",
            choose(
                '[["0 mm/s", "220 N"], ["50 mm/s", "80 N"]]',
                '[["0 deg/s", "10 N*m"], ["90 deg/s", "4 N*m"]]',
            ),
            None,
        )
        friction: Annotated[float, Unit(viscosity, least=0)] | None = key(
            "viscous friction", choose('"100 N*s/m"', '"0.1 N*m*s/rad"'), None
        )
        reflected: Annotated[float, Unit(inertia, least=0)] | None = key(
            choose("mass of rotor and screw", "inertia of the rotor") + ", reflected to the axis",
            choose('"2 kg"', '"0.01 kg*m^2"'),
            None,
        )
        max_pulse_rate: Annotated[float, Unit("1/s", above=0)] | None = key(
            "highest pulse rate of the motion card or the drive", '"500 kHz"', None
        )
        start_stop_rate: Annotated[float, Unit("1/s", above=0)] | None = key(
            "highest pulse rate at which the motor starts, stops and reverses without a ramp (pull-in rate)",
            '"400 1/s"',
            None,
        )
        timing: Timing | None = key(
            "shortest STEP and DIR times, by the name of the drive or as "
            '{ high = "1 us", low = "1 us", setup = "1 us", hold = "1 us" }; max_rate = "500 kHz" may be added',
            '"DRV8825"',
            None,
        )
        resonance: (
            Annotated[
                tuple[
                    tuple[Annotated[float, _edge(f"{way}/s")], Annotated[float, _edge(f"{way}/s")]],
                    ...,
                ],
                AfterValidator(_check_bands),
            ]
            | None
        ) = key(
            'resonance bands of the stepper, in rising order: speeds, or pulse rates as [["180 1/s", "220 1/s"]]',
            choose('[["4 mm/s", "5 mm/s"]]', '[["20 deg/s", "25 deg/s"]]'),
            None,
        )
        resonance_time: Annotated[float, Unit("s", above=0, file_unit="ms")] | None = key(
            "longest passage through a resonance band; if not stated, the axis stays below the first band",
            '"20 ms"',
            None,
            needs=["resonance"],
        )
        backlash: Annotated[float, Unit(way, least=0)] | None = key(
            choose("travel", "angle") + " lost at each reversal",
            choose('"0.01 mm"', '"0.02 deg"'),
            None,
        )
        pushed: Literal["+", "-"] | None = key(
            'backlash at the start: "+" as after a move towards greater positions, "-" towards smaller',
            '"+"',
            None,
        )
        lead_error: (
            Annotated[tuple[tuple[place, place], ...], AfterValidator(check_rising)] | None
        ) = key(
            choose("screw", "position")
            + " error: pairs of a position from home, rising, and how far the axis is beyond it",
            choose(
                '[["0 mm", "0 mm"], ["50 mm", "0.01 mm"]]',
                '[["0 deg", "0 deg"], ["90 deg", "0.01 deg"]]',
            ),
            None,
        )
        compensate: tuple[Literal["lead", "backlash"], ...] | None = key(
            'errors that the pulses compensate: "backlash", "lead" (lead_error)',
            '["backlash"]',
            None,
            needs=["backlash"],
        )
        take_up_acceleration: Annotated[float, Unit(f"{way}/s^2", above=0)] | None = key(
            "acceleration of the motor while it crosses the backlash; max_acceleration if not stated",
            choose('"500 mm/s^2"', '"500 deg/s^2"'),
            None,
        )
        shaper: StatedShaper | None = key(
            "input shaper against a vibration that the axis excites: zv, mzv, zvd or ei; an array against several; "
            '"none" for no shaper where [axes] has one',
            '{ kind = "zv", frequency = "35 Hz", damping = 0.05 }',
            None,
        )

    bases: tuple[Any, ...] = (table, Keys)
    made: type[Table] = create_model(
        table.__name__, __base__=bases, __module__=table.__module__, __doc__=table.__doc__
    )
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
        "lowest and highest position, counted from home", TRAVEL, remedy=f"write e.g. {TRAVEL}"
    )


KIND = key("kind of machine")
GEOMETRY = key("dimensions of the machine")
AXES = key("values that all axes share")
OWN_AXES = key("values of one axis that differ: any key of [axes]; one table per axis", default=())


class MachineFile(File):
    """What every kind's file has.

    first_place   mm from home where the circle of a program to start from begins, within reach of
                  the kind's presets
    """

    what: ClassVar[str] = "machine file"
    first_place: ClassVar[tuple[float, float, float]] = (0, 0, 20)
    name: Name | None = NAME
    length: Annotated[str, unit_validator("m")] | None = key(
        "unit of joint coordinates and other lengths without a unit", '"mm"', None
    )
    wiring: dict[str, tuple[str, Annotated[int, Field(ge=0)]]] = key(
        "motion card of each axis, and its channel on the card, counted from 0", default={}
    )
    vibration: tuple[VibrationTable, ...] = key(
        "vibration along a direction: each axis that moves the platform along it gets this shaper too",
        default=(),
    )

    def list_axes(self) -> list[Axis] | None:
        """List the axes as the file states them; None: only the machine has them.

        Raises MotionError.
        """
        return None

    def list_freedom(self) -> tuple[str, ...]:
        """List the components of a pose that the machine controls.

        A kind with `list_axes` has this too.
        """
        raise NotImplementedError

    @staticmethod
    def geometry_of(machine: Any, complete: bool) -> Mapping[str, Any] | None:
        """What [geometry] says of a machine of the kind, by key, SI; None: machines of the kind are
        not written.

        complete  with what holds where nothing is said
        """
        return None

    @classmethod
    def tables_of(cls, name: str) -> list[type[TableSchema]]:
        """The schemas of which a table of the file has one; none where the file has no such
        table.
        """
        return (
            list(tables_in(cls.model_fields[name].annotation)) if name in cls.model_fields else []
        )


def axes(
    names: Sequence[str],
    defaults: Mapping[str, AxisTable],
    overrides: Sequence[Any],
    file: MachineFile,
    home_lengths: Callable[[], Array] | None = None,
) -> list[Axis]:
    """Return the axes by name: the values of their kind, then those of each axis.

    A `drive` gives the pulse.

    home_lengths  gives the lengths of legs at home, which turn `leg_length` into travel
    """
    own = {override.name: _stated_values(override) for override in overrides}
    made = []
    for n, name in enumerate(names):
        common = defaults[name]
        card, channel = file.wiring.get(name, (None, None))
        wired = {"name": name, "card": card, "channel": channel}
        shared, differing = _stated_values(common), own.get(name, {})
        if TRAVEL_KEYS & differing.keys():
            shared = {key: value for key, value in shared.items() if key not in TRAVEL_KEYS}
        values = {"kind": common.kind} | shared | differing | wired
        if home_lengths is not None and (lengths := values.pop("leg_length", None)):
            at_home = float(home_lengths()[n])
            values["travel"] = (lengths[0] - at_home, lengths[1] - at_home)
        if values.get("shaper") == NO_SHAPER:
            del values["shaper"]
        made.append(Axis(**_resolve_pulse(values)))
    return made


def _resolve_pulse(values: dict[str, Any]) -> dict[str, Any]:
    """With the pulse as it is behind its factor and the drive's gear, and pulse rates of resonance
    as speeds.
    """
    steps, pulses = values.pop("electronic_gear", (1, 1))
    factor = values.pop("pulse_factor", 1.0)
    pulse = values["pulse"] * factor * steps / pulses
    if bands := values.get("resonance"):
        speeds = (
            tuple(edge * pulse if isinstance(edge, PulseRateEdge) else edge for edge in band)
            for band in bands
        )
        values = values | {"resonance": tuple(speeds)}
    return values | {"pulse": pulse}


def _stated_values(table: Any) -> dict[str, Any]:
    values = {
        name: value
        for name in type(table).model_fields
        if (value := getattr(table, name)) is not None
    }
    drive = values.pop("drive", None)
    return values | ({"pulse": drive.pulse} if drive is not None else {})
