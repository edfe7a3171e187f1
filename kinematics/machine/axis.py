"""One driven axis of a machine as data: its coordinate, its limits and its wiring.

To the wiring belongs what the step and direction inputs of a drive ask of the pulses; some drives
are known by name.
"""

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from math import ceil, floor, inf, isfinite, isinf, pi
from numbers import Integral
from typing import Literal

from kinematics.foundation.arrays import LEAST_POSITIVE, MAX_FLOAT, finite_array, numeric_array
from kinematics.foundation.errors import BadValue, MotionError
from kinematics.foundation.names import closest, nearest
from kinematics.foundation.short_repr import fit_lines
from kinematics.machine.shaper import Shaper, ShaperSeries, join_shapers

TIME_ROUNDING = 1e-12
"""Share of a time that decimal fractions of seconds may be off."""
PER_TIME = {"pulse": "", "backlash": "", "max_speed": "/s", "max_acceleration": "/s²", "max_jerk": "/s³",
            "take_up_acceleration": "/s²", "resonance": "/s"}  # fmt: skip
"""What follows an axis' own unit, m or rad, in the unit of a field."""
PLAIN_UNITS = {"max_pulse_rate": "1/s", "start_stop_rate": "1/s", "resonance_time": "s"}
STATED_FROM = 9
"""The field of an axis from which on a repr says only that it is stated."""
MAX_SHORTENING_SHARE = 1e-3
"""Share of its interval by which whole ticks may shorten one at a stated rate; where a tick is
more, they do not.
"""


@dataclass(frozen=True, slots=True)
class StepTiming:
    """The least times (s) that a drive needs on its inputs, and the most pulses a second.

    high, low    that STEP stays at each level
    setup, hold  that DIR is right before STEP rises, and stays so after it
    max_rate     1/s; None: what high and low allow
    Raises MotionError for a time below 0, or a high or low of 0.
    """

    high: float
    low: float
    setup: float
    hold: float
    max_rate: float | None = None

    def __post_init__(self) -> None:
        for name, least in (
            ("high", LEAST_POSITIVE),
            ("low", LEAST_POSITIVE),
            ("setup", 0.0),
            ("hold", 0.0),
        ):
            object.__setattr__(
                self,
                name,
                float(finite_array(getattr(self, name), f"step timing: {name}", (), least=least)),
            )
        if self.max_rate is not None:
            rate = finite_array(self.max_rate, "step timing: max_rate", (), least=LEAST_POSITIVE)
            object.__setattr__(self, "max_rate", float(rate))

    @property
    def rate(self) -> float:
        """1/s: the most pulses one way."""
        levels = 1 / (self.high + self.low)
        return levels if self.max_rate is None else min(levels, self.max_rate)

    def ticks(self, clock_hz: int) -> tuple[int, int]:
        """Whole clock ticks from a pulse to the next, and to the next the other way, at least;
        times are rounded up.
        """
        levels = ceil_ticks(self.high + self.low, clock_hz)
        interval = (
            levels if self.max_rate is None else max(levels, rate_ticks(self.max_rate, clock_hz))
        )
        return interval, max(
            interval,
            ceil_ticks(max(self.high, self.hold), clock_hz) + ceil_ticks(self.setup, clock_hz),
        )


def ceil_ticks(time: float, clock_hz: int) -> int:
    """Clock ticks that last at least a time (s), but for rounding."""
    return ceil(time * clock_hz * (1 - TIME_ROUNDING))


def rate_ticks(rate: float, clock_hz: int, grain: int = 1) -> int:
    """Clock ticks, a multiple of `grain`, from a pulse to the next at a rate (1/s), at least.

    Pulses of just that rate lie on ticks only to one: it is rounded down where that is a thousandth
    or less, else up.
    """
    grains = clock_hz / (rate * grain)
    if grains * MAX_SHORTENING_SHARE >= 1:
        return grain * floor(grains * (1 + TIME_ROUNDING))
    return grain * max(1, ceil(grains * (1 - TIME_ROUNDING)))


def _timing_in_us(
    high: float, low: float, setup: float, hold: float, max_rate: float | None = None
) -> StepTiming:
    return StepTiming(high * 1e-6, low * 1e-6, setup * 1e-6, hold * 1e-6, max_rate)


DRIVES = {
    "A4988": _timing_in_us(1, 1, 0.2, 0.2),
    "DRV8825": _timing_in_us(1.9, 1.9, 0.65, 0.65, 250e3),
    "LV8729": _timing_in_us(0.5, 0.5, 0.5, 0.5),
    "DRV8884": _timing_in_us(0.97, 0.97, 0.2, 0.2, 500e3),
    "TMC2209": _timing_in_us(0.1, 0.1, 0.02, 0.02),
    "Pacific-6410": _timing_in_us(0.25, 0.25, 50, 0, 2e6),
    "Pacific-6410-filtered": _timing_in_us(1, 1, 50, 0, 500e3),
    # The sources state no set-up of the direction for the servo inputs. ASSUMPTION: as long as a
    # level of STEP.
    "servo-differential": _timing_in_us(1, 1, 1, 1, 500e3),
    "servo-open-collector": _timing_in_us(2.5, 2.5, 2.5, 2.5, 200e3),
    "servo-high-speed": _timing_in_us(0.125, 0.125, 0.125, 0.125, 4e6),
}
"""By name, as their data sheets state them: Pacific Scientific's in [KMITL 2005], the others in the
makers'.
"""


def find_drive(name: str) -> StepTiming:
    """The timing of a drive.

    Raises MotionError for an unknown name, with the nearest and all known ones.
    """
    if name not in DRIVES:
        told = f'no drive is called "{name}"{nearest(name, DRIVES)}; drives: {", ".join(DRIVES)}'
        raise BadValue(told, allowed=", ".join(DRIVES), nearest=closest(name, DRIVES))
    return DRIVES[name]


AxisKind = Literal["linear", "rotary"]
Magnitude = float | tuple[float, float]
"""Of both directions, or of each: (towards smaller q, towards greater q)."""


COMPENSATION_KINDS = ("lead", "backlash")
"""What the pulses of an axis can make up for."""


def directional_bounds(bound: Magnitude | None) -> tuple[float, float]:
    """A bound's magnitudes (towards smaller q, towards greater q); ∞ where it is None."""
    if bound is None:
        return inf, inf
    below, above = bound if isinstance(bound, tuple) else (bound, bound)
    return below, above


@dataclass(frozen=True, slots=True)
class Axis:
    """A linear (m) or rotary (rad) actuator; limits are magnitudes in SI units, None means
    unlimited.

    name, kind      what messages call it; "linear" or "rotary"
    travel          (lo, hi) relative to home; both ends or neither, since its use is counted from
                    the middle. Home may lie outside, as a switch beyond the working range does
    max_speed, max_acceleration, max_jerk  one number, or two: (towards smaller q, towards greater
                                           q)
    pulse           m or rad that one pulse moves the axis
    direction       +1/-1: the sign in which a positive coordinate is counted by the wiring
    max_force       N or N m
    torque_speed    ((speed, force), ...) pull-out curve of the motor, speeds rising: what force it
                    gives at a speed and at every lower one; below the first point as there, none
                    beyond the last
    friction        N s/m or N m s/rad: a viscous force, against q̇
    reflected       kg or kg m²: rotors and screws as the axis feels them
    max_pulse_rate  1/s
    start_stop_rate 1/s: up to it the motor starts, stops and turns at once (its pull-in rate);
    None: at any rate
    resonance       ((low, high), ...) rising bands of speed |q̇| in which a stepper resonates
                    [Sasidhar 1981]
    resonance_time  s that each stay in a band may last; None: the axis keeps below the first band
    backlash        m or rad lost at every reversal
    pushed          "+" or "-": the side on which its play is when a program begins, as after a move
                    towards greater or smaller positions. ASSUMPTION where nothing is stated: "+",
                    how axes are usually homed
    lead_error      ((position, error), ...) of the screw, positions rising: where the axis is
                    beyond where it counts; past either end as at that end
    take_up_acceleration  m/s² or rad/s² that its motor may do while it crosses the play and moves
                          no load; None:
                    max_acceleration
    compensate      what its pulses make up for, of "lead" and "backlash": then they count the
                    motor, not the axis
    timing          what its drive asks of the pulses; None: nothing
    shaper          what its motion is convolved with, against vibrations of what it moves; None:
                    nothing
    card, channel   which motion card drives it, and which of the card's axes it is: both or neither
    """

    name: str
    kind: AxisKind = "linear"
    travel: tuple[float, float] = (-inf, inf)
    pulse: float = 1e-6
    direction: Literal[1, -1] = 1
    max_speed: Magnitude | None = None
    max_acceleration: Magnitude | None = None
    max_jerk: Magnitude | None = None
    max_force: float | None = None
    torque_speed: tuple[tuple[float, float], ...] | None = None
    friction: float = 0.0
    reflected: float = 0.0
    max_pulse_rate: float | None = None
    start_stop_rate: float | None = None
    resonance: tuple[tuple[float, float], ...] | None = None
    resonance_time: float | None = None
    backlash: float = 0.0
    pushed: Literal["+", "-"] = "+"
    take_up_acceleration: float | None = None
    lead_error: tuple[tuple[float, float], ...] | None = None
    compensate: tuple[str, ...] = ()
    timing: StepTiming | None = None
    shaper: Shaper | ShaperSeries | None = None
    card: str | None = None
    channel: int | None = None

    def __post_init__(self) -> None:
        """Everything is what it says, sequences become tuples of floats; else MotionError names the
        field.
        """
        if not isinstance(self.name, str) or not self.name:
            raise MotionError(f"an axis needs a name, a text that is not empty, not {self.name!r}")
        if not isinstance(self.kind, str) or self.kind not in ("linear", "rotary"):
            raise MotionError(
                f'axis {self.name}: kind {self.kind!r} is neither "linear" nor "rotary"'
            )
        self._travel()
        self._numbers("pulse", (), least=LEAST_POSITIVE)
        for field in ("backlash", "friction", "reflected"):
            self._numbers(field, (), least=0.0)
        if finite_array(self.direction, f"axis {self.name}: direction", ()) not in (1, -1):
            raise MotionError(f"axis {self.name}: direction {self.direction!r} is neither 1 nor -1")
        object.__setattr__(self, "direction", int(self.direction))
        for field in ("max_speed", "max_acceleration", "max_jerk"):
            ways = "unlimited; two: towards smaller and towards greater positions"
            self._numbers(field, (), (2,), least=LEAST_POSITIVE, none=ways)
        for field in ("max_force", "max_pulse_rate", "start_stop_rate", "resonance_time"):
            self._numbers(field, (), least=LEAST_POSITIVE, none="unlimited")
        self._numbers("take_up_acceleration", (), least=LEAST_POSITIVE, none="max_acceleration")
        self._numbers("resonance", (None, 2), least=LEAST_POSITIVE, none="no band")
        edges = [edge for band in self.resonance or () for edge in band]
        if any(not slower < faster for slower, faster in pairwise(edges)):
            raise MotionError(
                f"axis {self.name}: resonance {self.resonance} must be bands (low, high) of speeds above 0, "
                "rising and apart"
            )
        if self.resonance_time is not None and self.resonance is None:
            told = f"axis {self.name}: resonance_time without resonance; give the bands that it crosses"
            raise BadValue(told, key=(self.name, "resonance_time"))
        self._numbers("torque_speed", (None, 2), least=0.0, none="no curve")
        self._numbers("lead_error", (None, 2), none="no error")
        for field in ("torque_speed", "lead_error"):
            curve = getattr(self, field)
            if curve is not None and (
                len(curve) < 2 or any(not b[0] > a[0] for a, b in pairwise(curve))
            ):
                raise MotionError(
                    f"axis {self.name}: {field} {curve} must be two or more points, first values rising"
                )
        if not isinstance(self.pushed, str) or self.pushed not in ("+", "-"):
            raise MotionError(f'axis {self.name}: pushed {self.pushed!r} is neither "+" nor "-"')
        if not isinstance(self.compensate, tuple | list):
            wanted = f"a list of {' and '.join(COMPENSATION_KINDS)}"
            raise MotionError(
                f"axis {self.name}: compensate must be {wanted}, not {self.compensate!r:.100}"
            )
        object.__setattr__(self, "compensate", tuple(self.compensate))
        for kind in self.compensate:
            if not isinstance(kind, str) or kind not in COMPENSATION_KINDS:
                known = ", ".join(COMPENSATION_KINDS)
                raise MotionError(f"axis {self.name}: compensate {kind!r:.100} is none of {known}")
        if min(self._slopes()) <= 0:
            raise BadValue(
                f"axis {self.name}: its lead error falls by more than the way between two points: "
                "nothing that it counts leads through there; mend the table",
                key=(self.name, "lead_error"),
            )
        if self.timing is not None and not isinstance(self.timing, StepTiming):
            raise MotionError(
                f"axis {self.name}: timing must be a StepTiming, or None, not {self.timing!r:.100}"
            )
        if self.shaper is not None:
            self._check_shaper(self.shaper)
        self._check_wiring()

    def _travel(self) -> None:
        ends = numeric_array(self.travel)
        if ends is None or ends.shape != (2,):
            raise MotionError(
                f"axis {self.name}: travel must be two numbers (low, high), not {self.travel!r:.100}"
            )
        lo, hi = ends.tolist()
        object.__setattr__(self, "travel", (lo, hi))
        if not lo < hi:
            raise MotionError(
                f"axis {self.name}: travel {lo} .. {hi} is empty; the first bound must be the smaller"
            )
        if isinf(lo) != isinf(hi):
            raise MotionError(
                f"axis {self.name}: travel {lo} .. {hi} {self.unit} has one end only; "
                "give both, or leave travel out where there is no end"
            )

    def _check_wiring(self) -> None:
        if (self.card is None) != (self.channel is None):
            raise MotionError(
                f"axis {self.name}: card {self.card!r} and channel {self.channel!r}: give both or neither"
            )
        if self.card is not None and (not isinstance(self.card, str) or not self.card):
            raise MotionError(
                f"axis {self.name}: card must be a name, a text that is not empty, not {self.card!r}"
            )
        whole = isinstance(self.channel, Integral) and not isinstance(self.channel, bool)
        if self.channel is not None and not (whole and self.channel >= 0):
            raise MotionError(
                f"axis {self.name}: channel must be a whole number, not below 0, not {self.channel!r}"
            )

    def _numbers(
        self, field: str, *shapes: tuple[int | None, ...], least: float = -MAX_FLOAT, none: str = ""
    ) -> None:
        """none: what None means where it is allowed."""
        value, told = getattr(self, field), f"axis {self.name}: {field}"
        if value is not None or not none:
            wanted = f"{told} (None: {none})" if none else told
            array = finite_array(value, wanted, *shapes, unit=self._unit_of(field), least=least)
            rows = array.tolist()
            pairs = (
                tuple(tuple(row) if array.ndim == 2 else row for row in rows)
                if array.ndim
                else rows
            )
            object.__setattr__(self, field, pairs)

    def _unit_of(self, field: str) -> str:
        if field in PER_TIME:
            return f"{self.unit}{PER_TIME[field]}"
        return {"max_force": "N·m" if self.rotary else "N", **PLAIN_UNITS}.get(field, "")

    def add_shaper(self, shaper: Shaper | ShaperSeries) -> "Axis":
        """The axis with a shaper more than it has; as it is where it has that one already.

        Raises MotionError.
        """
        self._check_shaper(shaper)
        own = self.shaper.parts if self.shaper else ()
        return replace(
            self, shaper=join_shapers([*own, *(part for part in shaper.parts if part not in own)])
        )

    def _check_shaper(self, shaper: object) -> None:
        if not isinstance(shaper, Shaper | ShaperSeries):
            wanted = "a Shaper, a ShaperSeries of several, or None"
            raise MotionError(f"axis {self.name}: shaper must be {wanted}, not {shaper!r:.100}")

    @property
    def pulse_rate(self) -> float:
        """1/s: the most pulses that the axis takes, as stated and as its drive's timing allows; ∞:
        any number.
        """
        stated = inf if self.max_pulse_rate is None else self.max_pulse_rate
        return stated if self.timing is None else min(stated, self.timing.rate)

    def pulse_ticks(self, clock_hz: int, grain: int = 1) -> tuple[int, int]:
        """Clock ticks from a pulse to the next, and to the next the other way, at least; `grain`
        where any will do.

        grain  ticks: pulses come at whole multiples of it
        """
        one = (
            grain
            if self.max_pulse_rate is None
            else rate_ticks(self.max_pulse_rate, clock_hz, grain)
        )
        other = one
        if self.timing is not None:
            straight, back = (-(-ticks // grain) * grain for ticks in self.timing.ticks(clock_hz))
            one, other = max(one, straight), max(one, back)
        return one, other

    def held_rate(self, clock_hz: int, grain: int = 1) -> float:
        """1/s: the most pulses that ticks of a clock, by whole grains, keep as far apart as the
        axis takes; ∞: any.
        """
        if isinf(self.pulse_rate):
            return inf
        return min(self.pulse_rate, clock_hz / self.pulse_ticks(clock_hz, grain)[0])

    @property
    def motor_ratio(self) -> float:
        """Largest way of the motor per way of the axis: 1/(1 + slope) of a lead error made up for;
        1 without.
        """
        return max(1.0, *(1 / slope for slope in self._slopes()))

    @property
    def axis_ratio(self) -> float:
        """Largest way of the axis per way of the motor: 1 + slope of a lead error made up for; 1
        without.
        """
        return max(1.0, *self._slopes())

    def _slopes(self) -> list[float]:
        made_up = (
            self.lead_error
            if "lead" in self.compensate and self.lead_error is not None
            else ((0, 0), (1, 0))
        )
        return [
            1 + (after[1] - before[1]) / (after[0] - before[0])
            for before, after in pairwise(made_up)
        ]

    @property
    def unit(self) -> str:
        return "m" if self.kind == "linear" else "rad"

    @property
    def rotary(self) -> bool:
        """Whether it turns: its coordinate is an angle (rad), else a length (m)."""
        return self.kind == "rotary"

    def __repr__(self) -> str:
        unit, scale = ("deg", 180 / pi) if self.rotary else ("mm", 1e3)
        low, high = (f"{scale * end:.6g}" for end in self.travel)
        told = [
            f"{self.kind}",
            f"travel {low} to {high} {unit}" if isfinite(self.travel[1]) else "no end of travel",
        ]
        told.append(f"pulse {scale * self.pulse:.6g} {unit}")
        for name, per in (("speed", "/s"), ("acceleration", "/s²"), ("jerk", "/s³")):
            if (most := getattr(self, f"max_{name}")) is not None:
                ways = most if isinstance(most, tuple) else (most,)
                told.append(
                    f"{name} {' and '.join(f'{scale * way:.6g}' for way in ways)} {unit}{per}"
                )
        if self.max_force is not None:
            told.append(f"force {self.max_force:.6g} {'N·m' if self.rotary else 'N'}")
        own = [
            field.name
            for field in fields(self)[STATED_FROM:]
            if getattr(self, field.name) != field.default
        ]
        return fit_lines(f"<Axis {self.name}: {', '.join([*told, *own])}>")
