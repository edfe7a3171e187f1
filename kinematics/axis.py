"""One driven axis of a machine: its coordinate, its limits and its wiring, as data."""

from dataclasses import dataclass
from itertools import pairwise
from math import inf, isinf
from typing import Literal

from kinematics.errors import MotionError

Magnitude = float | tuple[float, float]
"""Of both directions, or of each: (towards smaller q, towards greater q)."""


def sides(bound: Magnitude | None) -> tuple[float, float]:
    """A bound's magnitudes (towards smaller q, towards greater q); ∞ where it is None."""
    if bound is None:
        return inf, inf
    below, above = bound if isinstance(bound, tuple) else (bound, bound)
    return below, above


@dataclass(frozen=True, slots=True)
class Axis:
    """A linear (m) or rotary (rad) actuator; limits are magnitudes in SI units, None means unlimited.

    travel          (lo, hi) relative to home; both ends or neither, since its use is counted from the middle
    max_speed, max_acceleration, max_jerk  one number, or two: (towards smaller q, towards greater q)
    pulse           m or rad that one pulse moves the axis
    direction       +1/-1: the sign in which a positive coordinate is counted by the wiring
    torque_speed    ((speed, force), ...) falling curve of the motor, speeds rising
    max_pulse_rate  1/s
    resonance       ((low, high), ...) rising bands of speed |q̇| in which a stepper resonates [Sasidhar 1981]
    resonance_time  s that each stay in a band may last; None: the axis keeps below the first band
    backlash        m or rad lost at every reversal
    lead_error      ((position, error), ...) of the screw, positions rising: where the axis is beyond where it counts
    card, channel   which motion card drives it, and which of the card's axes it is
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

    @property
    def unit(self) -> str:
        return "m" if self.kind == "linear" else "rad"
