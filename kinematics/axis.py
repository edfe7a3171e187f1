"""One driven axis of a machine: its coordinate, its limits and its wiring, as data."""

from dataclasses import dataclass
from itertools import pairwise
from math import inf, isinf
from numbers import Integral
from typing import Literal

from kinematics.array import LARGEST, POSITIVE, finite, plain
from kinematics.errors import BadValue, MotionError
from kinematics.step_timing import StepTiming, rate_ticks

Magnitude = float | tuple[float, float]
"""Of both directions, or of each: (towards smaller q, towards greater q)."""


COMPENSATED = ("lead", "backlash")
"""What the pulses of an axis can make up for."""


def sides(bound: Magnitude | None) -> tuple[float, float]:
    """A bound's magnitudes (towards smaller q, towards greater q); ∞ where it is None."""
    if bound is None:
        return inf, inf
    below, above = bound if isinstance(bound, tuple) else (bound, bound)
    return below, above


@dataclass(frozen=True, slots=True)
class Axis:
    """A linear (m) or rotary (rad) actuator; limits are magnitudes in SI units, None means unlimited.

    travel          (lo, hi) relative to home; both ends or neither, since its use is counted from the middle. Home may
                    lie outside, as a switch beyond the working range does
    max_speed, max_acceleration, max_jerk  one number, or two: (towards smaller q, towards greater q)
    pulse           m or rad that one pulse moves the axis
    direction       +1/-1: the sign in which a positive coordinate is counted by the wiring
    torque_speed    ((speed, force), ...) pull-out curve of the motor, speeds rising: what force it gives at a speed and
                    at every lower one; below the first point as there, none beyond the last
    friction        N s/m or N m s/rad: a viscous force, against q̇
    reflected       kg or kg m²: rotors and screws as the axis feels them
    max_pulse_rate  1/s
    resonance       ((low, high), ...) rising bands of speed |q̇| in which a stepper resonates [Sasidhar 1981]
    resonance_time  s that each stay in a band may last; None: the axis keeps below the first band
    backlash        m or rad lost at every reversal
    pushed          "+" or "-": the side on which its play is when a program begins, as after a move towards greater or
                    smaller positions. ASSUMPTION where nothing is stated: "+", how axes are usually homed
    lead_error      ((position, error), ...) of the screw, positions rising: where the axis is beyond where it counts;
                    past either end as at that end
    take_up_acceleration  m/s² or rad/s² that its motor may do while it crosses the play and moves no load; None:
                    max_acceleration
    compensate      what its pulses make up for, of "lead" and "backlash": then they count the motor, not the axis
    timing          what its drive asks of the pulses; None: nothing
    card, channel   which motion card drives it, and which of the card's axes it is: both or neither
    """

    name: str
    kind: Literal["linear", "rotary"] = "linear"
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
    resonance: tuple[tuple[float, float], ...] | None = None
    resonance_time: float | None = None
    backlash: float = 0.0
    pushed: Literal["+", "-"] = "+"
    take_up_acceleration: float | None = None
    lead_error: tuple[tuple[float, float], ...] | None = None
    compensate: tuple[str, ...] = ()
    timing: StepTiming | None = None
    card: str | None = None
    channel: int | None = None

    def __post_init__(self) -> None:
        """Everything is what it says, sequences become tuples of floats; else MotionError names the field."""
        if not isinstance(self.name, str) or not self.name:
            raise MotionError(f"an axis needs a name, a text that is not empty, not {self.name!r}")
        if self.kind not in ("linear", "rotary"):
            raise MotionError(f'axis {self.name}: kind {self.kind!r} is neither "linear" nor "rotary"')
        self._travel()
        self._numbers("pulse", (), least=POSITIVE)
        for field in ("backlash", "friction", "reflected"):
            self._numbers(field, (), least=0.0)
        if finite(self.direction, f"axis {self.name}: direction", ()) not in (1, -1):
            raise MotionError(f"axis {self.name}: direction {self.direction!r} is neither 1 nor -1")
        object.__setattr__(self, "direction", int(self.direction))
        for field in ("max_speed", "max_acceleration", "max_jerk"):
            ways = "unlimited; two: towards smaller and towards greater positions"
            self._numbers(field, (), (2,), least=POSITIVE, none=ways)
        for field in ("max_force", "max_pulse_rate", "resonance_time"):
            self._numbers(field, (), least=POSITIVE, none="unlimited")
        self._numbers("take_up_acceleration", (), least=POSITIVE, none="max_acceleration")
        self._numbers("resonance", (None, 2), least=POSITIVE, none="no band")
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
            if curve is not None and (len(curve) < 2 or any(not b[0] > a[0] for a, b in pairwise(curve))):
                raise MotionError(f"axis {self.name}: {field} {curve} must be two or more points, first values rising")
        if self.pushed not in ("+", "-"):
            raise MotionError(f'axis {self.name}: pushed {self.pushed!r} is neither "+" nor "-"')
        object.__setattr__(self, "compensate", tuple(self.compensate))
        for kind in self.compensate:
            if kind not in COMPENSATED:
                raise MotionError(f"axis {self.name}: compensate {kind!r} is none of {', '.join(COMPENSATED)}")
        if min(self._slopes()) <= 0:
            raise BadValue(
                f"axis {self.name}: its lead error falls by more than the way between two points: "
                "nothing that it counts leads through there; mend the table",
                key=(self.name, "lead_error"),
            )
        if self.timing is not None and not isinstance(self.timing, StepTiming):
            raise MotionError(f"axis {self.name}: timing must be a StepTiming, or None, not {self.timing!r:.100}")
        self._wiring()

    def _travel(self) -> None:
        ends = plain(self.travel)
        if ends is None or ends.shape != (2,):
            raise MotionError(f"axis {self.name}: travel must be two numbers (low, high), not {self.travel!r:.100}")
        lo, hi = ends.tolist()
        object.__setattr__(self, "travel", (lo, hi))
        if not lo < hi:
            raise MotionError(f"axis {self.name}: travel {lo} .. {hi} is empty; the first bound must be the smaller")
        if isinf(lo) != isinf(hi):
            raise MotionError(
                f"axis {self.name}: travel {lo} .. {hi} {self.unit} has one end only; "
                "give both, or leave travel out where there is no end"
            )

    def _wiring(self) -> None:
        if (self.card is None) != (self.channel is None):
            raise MotionError(
                f"axis {self.name}: card {self.card!r} and channel {self.channel!r}: give both or neither"
            )
        if self.card is not None and (not isinstance(self.card, str) or not self.card):
            raise MotionError(f"axis {self.name}: card must be a name, a text that is not empty, not {self.card!r}")
        whole = isinstance(self.channel, Integral) and not isinstance(self.channel, bool)
        if self.channel is not None and not (whole and self.channel >= 0):
            raise MotionError(f"axis {self.name}: channel must be a whole number, not below 0, not {self.channel!r}")

    def _numbers(self, field: str, *shapes: tuple[int | None, ...], least: float = -LARGEST, none: str = "") -> None:
        """none: what None means where it is allowed."""
        value, told = getattr(self, field), f"axis {self.name}: {field}"
        if value is not None or not none:
            array = finite(value, f"{told} (None: {none})" if none else told, *shapes, least=least)
            rows = array.tolist()
            pairs = tuple(tuple(row) if array.ndim == 2 else row for row in rows) if array.ndim else rows
            object.__setattr__(self, field, pairs)

    @property
    def pulse_rate(self) -> float:
        """1/s: the most pulses that the axis takes, as stated and as its drive's timing allows; ∞: any number."""
        stated = inf if self.max_pulse_rate is None else self.max_pulse_rate
        return stated if self.timing is None else min(stated, self.timing.rate)

    def pulse_ticks(self, clock_hz: int, grain: int = 1) -> tuple[int, int]:
        """Clock ticks from a pulse to the next, and to the next the other way, at least; `grain` where any will do.

        grain  ticks: pulses come at whole multiples of it
        """
        one = grain if self.max_pulse_rate is None else rate_ticks(self.max_pulse_rate, clock_hz, grain)
        other = one
        if self.timing is not None:
            straight, back = (-(-ticks // grain) * grain for ticks in self.timing.ticks(clock_hz))
            one, other = max(one, straight), max(one, back)
        return one, other

    def held_rate(self, clock_hz: int, grain: int = 1) -> float:
        """1/s: the most pulses that ticks of a clock, by whole grains, keep as far apart as the axis takes; ∞: any."""
        if isinf(self.pulse_rate):
            return inf
        return min(self.pulse_rate, clock_hz / self.pulse_ticks(clock_hz, grain)[0])

    @property
    def motor_ratio(self) -> float:
        """Largest way of the motor per way of the axis: 1/(1 + slope) of a lead error made up for; 1 without."""
        return max(1.0, *(1 / slope for slope in self._slopes()))

    @property
    def axis_ratio(self) -> float:
        """Largest way of the axis per way of the motor: 1 + slope of a lead error made up for; 1 without."""
        return max(1.0, *self._slopes())

    def _slopes(self) -> list[float]:
        made_up = self.lead_error if "lead" in self.compensate and self.lead_error is not None else ((0, 0), (1, 0))
        return [1 + (after[1] - before[1]) / (after[0] - before[0]) for before, after in pairwise(made_up)]

    @property
    def unit(self) -> str:
        return "m" if self.kind == "linear" else "rad"
