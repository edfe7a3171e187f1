"""One driven axis of a machine: its coordinate, its limits and its wiring, as data."""

from dataclasses import dataclass
from itertools import pairwise
from math import inf, isinf
from numbers import Integral
from typing import Literal

import numpy as np

from kinematics.array import LARGEST, finite, number
from kinematics.errors import MotionError

Magnitude = float | tuple[float, float]
"""Of both directions, or of each: (towards smaller q, towards greater q)."""


def sides(bound: Magnitude | None) -> tuple[float, float]:
    """A bound's magnitudes (towards smaller q, towards greater q); ∞ where it is None."""
    if bound is None:
        return inf, inf
    below, above = bound if isinstance(bound, tuple) else (bound, bound)
    return below, above


# Fields that hold numbers, or None for no limit; those of them that may hold one for each way.
_LIMITS = ("max_speed", "max_acceleration", "max_jerk", "max_force", "max_pulse_rate", "resonance_time")
_SIDED = ("max_speed", "max_acceleration", "max_jerk")


@dataclass(frozen=True, slots=True)
class Axis:
    """A linear (m) or rotary (rad) actuator; limits are magnitudes in SI units, None means unlimited.

    travel          (lo, hi) relative to home; both ends or neither, since its use is counted from the middle. Home may
                    lie outside, as a switch beyond the working range does
    max_speed, max_acceleration, max_jerk  one number, or two: (towards smaller q, towards greater q)
    pulse           m or rad that one pulse moves the axis
    direction       +1/-1: the sign in which a positive coordinate is counted by the wiring
    torque_speed    ((speed, force), ...) curve of the motor, speeds rising; the forces mostly fall
    max_pulse_rate  1/s
    resonance       ((low, high), ...) rising bands of speed |q̇| in which a stepper resonates [Sasidhar 1981]
    resonance_time  s that each stay in a band may last; None: the axis keeps below the first band
    backlash        m or rad lost at every reversal
    lead_error      ((position, error), ...) of the screw, positions rising: where the axis is beyond where it counts;
                    past either end as at that end
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
    max_pulse_rate: float | None = None
    resonance: tuple[tuple[float, float], ...] | None = None
    resonance_time: float | None = None
    backlash: float = 0.0
    lead_error: tuple[tuple[float, float], ...] | None = None
    card: str | None = None
    channel: int | None = None

    def __post_init__(self) -> None:
        self._are_what_they_say()
        lo, hi = self.travel
        if not lo < hi:
            raise MotionError(f"axis {self.name}: travel {lo} .. {hi} is empty; the first bound must be the smaller")
        if isinf(lo) != isinf(hi):
            raise MotionError(
                f"axis {self.name}: travel {lo} .. {hi} {self.unit} has one end only; "
                "give both, or leave travel out where there is no end"
            )
        if not 0 < self.pulse < inf:
            raise MotionError(f"axis {self.name}: pulse {self.pulse} {self.unit} must be positive and finite")
        if self.direction not in (1, -1):
            raise MotionError(f"axis {self.name}: direction {self.direction} is neither 1 nor -1")
        for field in ("max_speed", "max_acceleration", "max_jerk"):
            value = getattr(self, field)
            if isinstance(value, tuple) and len(value) != 2:
                raise MotionError(
                    f"axis {self.name}: {field} {value} must be one number, or two: "
                    "towards smaller and towards greater positions"
                )
        for field in ("max_speed", "max_acceleration", "max_jerk", "max_force", "max_pulse_rate", "resonance_time"):
            value = getattr(self, field)
            if value is not None and not all(0 < side < inf for side in sides(value)):
                raise MotionError(f"axis {self.name}: {field} {value} must be positive and finite (or None: unlimited)")

        edges = [edge for band in self.resonance or () for edge in band]
        if any(not slower < faster for slower, faster in pairwise([0.0, *edges, inf])):
            raise MotionError(
                f"axis {self.name}: resonance {self.resonance} must be bands (low, high) of speeds above 0, "
                "rising and apart"
            )
        if self.resonance_time is not None and self.resonance is None:
            raise MotionError(f"axis {self.name}: resonance_time without resonance; give the bands that it crosses")

    def _are_what_they_say(self) -> None:
        """The types of all fields; tuples of floats, whatever sequences were given."""
        if not isinstance(self.name, str) or not self.name:
            raise MotionError(f"an axis needs a name, a text that is not empty, not {self.name!r}")
        if self.kind not in ("linear", "rotary"):
            raise MotionError(f'axis {self.name}: kind {self.kind!r} is neither "linear" nor "rotary"')
        ends = finite(f"axis {self.name}: travel must be two numbers", self.travel, (2,), least=-inf, most=inf)
        object.__setattr__(self, "travel", tuple(ends.tolist()))
        for field in ("pulse", *_LIMITS):
            value = getattr(self, field)
            for each in value if field in _SIDED and isinstance(value, tuple) else (value,):
                if each is not None or field not in _LIMITS:
                    number(f"axis {self.name}: {field} must be a number", each, least=-inf, most=inf)
        if number(f"axis {self.name}: direction must be 1 or -1", self.direction) in (1, -1):
            object.__setattr__(self, "direction", int(self.direction))
        number(f"axis {self.name}: backlash must be a number of {self.unit}, not below 0", self.backlash, least=0)
        self._curve("lead_error", -LARGEST)
        self._curve("torque_speed", 0.0)
        if (self.card is None) != (self.channel is None):
            raise MotionError(
                f"axis {self.name}: card {self.card!r} and channel {self.channel!r}: give both or neither"
            )
        if self.card is not None and (not isinstance(self.card, str) or not self.card):
            raise MotionError(f"axis {self.name}: card must be a name, a text that is not empty, not {self.card!r}")
        whole = isinstance(self.channel, Integral) and not isinstance(self.channel, bool)
        if self.channel is not None and not (whole and self.channel >= 0):
            raise MotionError(f"axis {self.name}: channel must be a whole number, not below 0, not {self.channel!r}")

    def _curve(self, field: str, least: float) -> None:
        """Two or more points, the first values rising."""
        values = getattr(self, field)
        if values is None:
            return
        told = f"axis {self.name}: {field} must be two or more points ((first, second), ...), the first values rising"
        points = finite(told + (", none below 0" if least == 0 else ""), values, (None, 2), least=least)
        if len(points) < 2 or (np.diff(points[:, 0]) <= 0).any():
            raise MotionError(f"{told}, not {points.tolist()}")
        object.__setattr__(self, field, tuple(map(tuple, points.tolist())))

    @property
    def unit(self) -> str:
        return "m" if self.kind == "linear" else "rad"
