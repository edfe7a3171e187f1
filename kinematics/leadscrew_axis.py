"""An axis that a stepper motor drives by a leadscrew: its parts, and what it must do."""

from dataclasses import dataclass, fields
from math import inf, pi
from typing import Any

import numpy as np

from kinematics.array import finite
from kinematics.errors import MotionError

STEEL = 7850.0
"""kg/m³."""


@dataclass(frozen=True, slots=True)
class Leadscrew:
    """lead m per revolution, diameter m, length m, efficiency 0 to 1, drag N·m of nut and bearings, density kg/m³."""

    lead: float
    diameter: float
    length: float
    efficiency: float = 1.0
    drag: float = 0.0
    density: float = STEEL

    def __post_init__(self) -> None:
        _positive(self, "leadscrew", zero=("drag",))
        if self.efficiency > 1:
            raise MotionError(f"leadscrew: efficiency {self.efficiency} must be at most 1")

    @property
    def inertia(self) -> float:
        """kg·m² of the solid bar: I = π ρ L D⁴ / 32."""
        return pi * self.density * self.length * self.diameter**4 / 32


@dataclass(frozen=True, slots=True)
class Slide:
    """mass kg, friction N of the guides, lift: the share of its weight that the screw carries (1 vertical, 0 level)."""

    mass: float
    friction: float = 0.0
    lift: float = 0.0

    def __post_init__(self) -> None:
        _positive(self, "slide", zero=("friction", "lift"))
        if self.lift > 1:
            raise MotionError(f"slide: lift {self.lift} must be between 0 (level) and 1 (vertical)")


@dataclass(frozen=True, slots=True)
class StepMotor:
    """step rad, rotor inertia kg·m², holding torque N·m, pull_out: (steps/s, N·m) points of the falling curve.

    None is not stated. Half steps are steps of half the angle.
    """

    step: float
    inertia: float
    holding: float | None = None
    pull_out: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        _positive(self, "motor", skip=("pull_out",))
        if self.pull_out is None:
            return
        points = finite(self.pull_out, "motor: pull_out")
        if points.ndim != 2 or points.shape[1] != 2:
            raise MotionError(f"motor: pull_out must be points (steps/s, N·m), not of shape {points.shape}")
        if len(points) < 2 or not (np.diff(points[:, 0]) > 0).all():
            raise MotionError("motor: pull_out needs two or more (steps/s, N·m) points in the order of rising rates")
        if (points < 0).any():
            raise MotionError("motor: pull_out must hold values that are not negative")

    def torque(self, rate: float) -> float | None:
        """N·m that it can give at every rate up to this one (steps/s); 0 beyond its curve, None without one."""
        if self.pull_out is None:
            return None
        rates, torques = np.array(self.pull_out, float).T
        if rate > rates[-1]:
            return 0.0
        return float(min(np.interp(rate, rates, torques), torques[rates <= rate].min(initial=inf)))


@dataclass(frozen=True, slots=True)
class Traverse:
    """What the axis must do: travel m within time s, ramps of `ramp` s each, accuracy m; top speed m/s if chosen."""

    travel: float
    time: float
    ramp: float
    accuracy: float
    speed: float | None = None

    def __post_init__(self) -> None:
        _positive(self, "traverse")
        if 2 * self.ramp > self.time:
            raise MotionError(
                f"traverse: two ramps of {self.ramp:g} s do not fit into {self.time:g} s; "
                f"give ramps of at most {self.time / 2:g} s"
            )

    @property
    def least_speed(self) -> float:
        """m/s: the top speed of the trapezoid that takes exactly the time allowed, travel/(time − ramp)."""
        return self.travel / (self.time - self.ramp)


def _positive(values: Any, what: str, zero: tuple[str, ...] = (), skip: tuple[str, ...] = ()) -> None:
    """Every field is a positive, finite number; those in `zero` may be 0, None where that is the default."""
    for field in fields(values):
        value = getattr(values, field.name)
        if field.name in skip or (value is None and field.default is None):
            continue
        number = finite(value, f"{what}: {field.name}", (), unit="SI units")
        if number < 0 or (number == 0 and field.name not in zero):
            least = "zero or more" if field.name in zero else "positive"
            raise MotionError(f"{what}: {field.name} {value} must be {least} and finite (SI units)")
