"""One driven axis of a machine: its coordinate, its limits and its wiring, as data."""

from dataclasses import dataclass
from typing import Literal

from kinematics.errors import MotionError


@dataclass(frozen=True, slots=True)
class Axis:
    """A linear (m) or rotary (rad) actuator; limits are magnitudes in SI units, None means unlimited.

    travel          (lo, hi) relative to home
    pulse           m or rad that one pulse moves the axis
    direction       +1/-1: the sign in which a positive coordinate is counted by the wiring
    torque_speed    ((speed, force), ...) falling curve of the motor, speeds rising
    max_pulse_rate  1/s
    """

    name: str
    kind: Literal["linear", "rotary"] = "linear"
    travel: tuple[float, float] = (-float("inf"), float("inf"))
    pulse: float = 1e-6
    direction: Literal[1, -1] = 1
    max_speed: float | None = None
    max_acceleration: float | None = None
    max_jerk: float | None = None
    max_force: float | None = None
    torque_speed: tuple[tuple[float, float], ...] | None = None
    max_pulse_rate: float | None = None

    def __post_init__(self) -> None:
        lo, hi = self.travel
        if not lo < hi:
            raise MotionError(f"axis {self.name}: travel {lo} .. {hi} is empty; the first bound must be the smaller")
        if not 0 < self.pulse < float("inf"):
            raise MotionError(f"axis {self.name}: pulse {self.pulse} must be a positive length or angle")
        for field in ("max_speed", "max_acceleration", "max_jerk", "max_force", "max_pulse_rate"):
            value = getattr(self, field)
            if value is not None and not value > 0:
                raise MotionError(f"axis {self.name}: {field} {value} must be positive (or absent: unlimited)")

    @property
    def unit(self) -> str:
        return "m" if self.kind == "linear" else "rad"
