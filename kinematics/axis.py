"""One driven axis of a machine: its coordinate, its limits and its wiring, as data."""

from dataclasses import dataclass
from math import inf, isinf
from typing import Literal

from kinematics.errors import MotionError


@dataclass(frozen=True, slots=True)
class Axis:
    """A linear (m) or rotary (rad) actuator; limits are magnitudes in SI units, None means unlimited.

    travel          (lo, hi) relative to home; both ends or neither, since its use is counted from the middle
    pulse           m or rad that one pulse moves the axis
    direction       +1/-1: the sign in which a positive coordinate is counted by the wiring
    torque_speed    ((speed, force), ...) pull-out curve of the motor, speeds rising: what force it gives at a speed and
                    at every lower one; below the first point as there, none beyond the last
    friction        N s/m or N m s/rad: a viscous force, against q̇
    reflected       kg or kg m²: rotors and screws as the axis feels them
    max_pulse_rate  1/s
    backlash        m or rad lost at every reversal
    lead_error      ((position, error), ...) of the screw, positions rising: where the axis is beyond where it counts
    card, channel   which motion card drives it, and which of the card's axes it is
    """

    name: str
    kind: Literal["linear", "rotary"] = "linear"
    travel: tuple[float, float] = (-inf, inf)
    pulse: float = 1e-6
    direction: Literal[1, -1] = 1
    max_speed: float | None = None
    max_acceleration: float | None = None
    max_jerk: float | None = None
    max_force: float | None = None
    torque_speed: tuple[tuple[float, float], ...] | None = None
    friction: float = 0.0
    reflected: float = 0.0
    max_pulse_rate: float | None = None
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
        for field in ("max_speed", "max_acceleration", "max_jerk", "max_force", "max_pulse_rate"):
            value = getattr(self, field)
            if value is not None and not 0 < value < inf:
                raise MotionError(f"axis {self.name}: {field} {value} must be positive and finite (or None: unlimited)")

        for field in ("friction", "reflected"):
            if not 0 <= getattr(self, field) < inf:
                raise MotionError(
                    f"axis {self.name}: {field} {getattr(self, field)} must be finite and not below 0 (0: none)"
                )

    @property
    def unit(self) -> str:
        return "m" if self.kind == "linear" else "rad"
