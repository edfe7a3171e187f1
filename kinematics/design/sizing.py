"""Sizing a stepper motor for an axis that a leadscrew drives: its parts, what it must do, and
whether the motor can.
"""

from dataclasses import dataclass, fields
from math import inf, isfinite, pi, sqrt, tau
from typing import Any

import numpy as np

from kinematics.foundation.arrays import finite_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table

STEEL = 7850.0
"""kg/m³."""


@dataclass(frozen=True, slots=True)
class Leadscrew:
    """lead m per revolution, diameter m, length m, efficiency 0 to 1, drag N·m of nut and bearings,
    density kg/m³.
    """

    lead: float
    diameter: float
    length: float
    efficiency: float = 1.0
    drag: float = 0.0
    density: float = STEEL

    def __post_init__(self) -> None:
        _require_positive(self, "leadscrew", zero=("drag",))
        if self.efficiency > 1:
            raise MotionError(f"leadscrew: efficiency {self.efficiency} must be at most 1")

    @property
    def inertia(self) -> float:
        """kg·m² of the solid bar: I = π ρ L D⁴ / 32."""
        return pi * self.density * self.length * self.diameter**4 / 32


@dataclass(frozen=True, slots=True)
class Slide:
    """mass kg, friction N of the guides, lift: the share of its weight that the screw carries (1
    vertical, 0 level).
    """

    mass: float
    friction: float = 0.0
    lift: float = 0.0

    def __post_init__(self) -> None:
        _require_positive(self, "slide", zero=("friction", "lift"))
        if self.lift > 1:
            raise MotionError(f"slide: lift {self.lift} must be between 0 (level) and 1 (vertical)")


@dataclass(frozen=True, slots=True)
class StepMotor:
    """step rad, rotor inertia kg·m², holding torque N·m, pull_out: (steps/s, N·m) points of the
    falling curve.

    None is not stated. Half steps are steps of half the angle.
    """

    step: float
    inertia: float
    holding: float | None = None
    pull_out: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        _require_positive(self, "motor", skip=("pull_out",))
        if self.pull_out is None:
            return
        points = finite_array(self.pull_out, "motor: pull_out")
        if points.ndim != 2 or points.shape[1] != 2:
            raise MotionError(
                f"motor: pull_out must be points (steps/s, N·m), not of shape {points.shape}"
            )
        if len(points) < 2 or not (np.diff(points[:, 0]) > 0).all():
            raise MotionError(
                "motor: pull_out needs two or more (steps/s, N·m) points in the order of rising rates"
            )
        if (points < 0).any():
            raise MotionError("motor: pull_out must hold values that are not negative")

    def torque(self, rate: float) -> float | None:
        """N·m that it can give at every rate up to this one (steps/s); 0 beyond its curve, None
        without one.
        """
        if self.pull_out is None:
            return None
        rates, torques = np.array(self.pull_out, float).T
        if rate > rates[-1]:
            return 0.0
        return float(min(np.interp(rate, rates, torques), torques[rates <= rate].min(initial=inf)))


@dataclass(frozen=True, slots=True)
class Traverse:
    """Requirements on the axis: travel m within time s, ramps of `ramp` s each, accuracy m;
    optional top speed m/s.
    """

    travel: float
    time: float
    ramp: float
    accuracy: float
    speed: float | None = None

    def __post_init__(self) -> None:
        _require_positive(self, "traverse")
        if 2 * self.ramp > self.time:
            raise MotionError(
                f"traverse: two ramps of {self.ramp:g} s do not fit into {self.time:g} s; "
                f"give ramps of at most {self.time / 2:g} s"
            )

    @property
    def least_speed(self) -> float:
        """m/s: the top speed of the trapezoid that takes exactly the time allowed, travel/(time −
        ramp).
        """
        return self.travel / (self.time - self.ramp)


def _require_positive(
    values: Any, what: str, zero: tuple[str, ...] = (), skip: tuple[str, ...] = ()
) -> None:
    """Every field is a positive, finite number; those in `zero` may be 0, None where that is the
    default.
    """
    for field in fields(values):
        value = getattr(values, field.name)
        if field.name in skip or (value is None and field.default is None):
            continue
        number = finite_array(value, f"{what}: {field.name}", (), unit="SI units")
        if number < 0 or (number == 0 and field.name not in zero):
            least = "zero or more" if field.name in zero else "positive"
            raise MotionError(f"{what}: {field.name} {value} must be {least} and finite (SI units)")


GRAVITY = 9.80665
"""m/s², standard."""
STEPS_PER_ACCURACY = 5.0
"""Steps that the wanted accuracy must hold at least [Sasidhar 1981, Appendix B]."""


@dataclass(frozen=True, slots=True)
class Check:
    """One rule: what is offered and needed, in `unit`; holds is None where the offer is not
    stated.
    """

    name: str
    offered: float | None
    needed: float
    unit: str
    holds: bool | None


@dataclass(frozen=True, slots=True)
class StepperSizing(Result):
    """The sizing line by line, SI. Torques at the motor's shaft.

    resolution           coarsest step allowed, m
    coarsest_lead        the lead at which the motor's step is that, m/rev
    step                 travel of one step, m
    average_speed        m/s, travel over time
    least_speed          m/s, the top speed of the trapezoid that takes exactly the time allowed
    speed, rate          top speed, m/s, and its steps/s
    duration             s that the travel then takes
    slide_inertia, screw_inertia, rotor_inertia, inertia  kg·m² as the motor sees them, and their
                                                          sum
    acceleration         rad/s²
    acceleration_torque, friction_torque, gravity_torque, torque  N·m, and their sum, wanted at
    every rate up to `rate`
    standstill_torque    N·m that the motor must hold against the weight, counting on no friction
    checks               rules, each met or not
    """

    resolution: float
    coarsest_lead: float
    step: float
    average_speed: float
    least_speed: float
    speed: float
    duration: float
    rate: float
    slide_inertia: float
    screw_inertia: float
    rotor_inertia: float
    inertia: float
    acceleration: float
    acceleration_torque: float
    friction_torque: float
    gravity_torque: float
    torque: float
    standstill_torque: float
    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """No rule is broken (one whose offer is not stated is not)."""
        return all(check.holds is not False for check in self.checks)

    def tables(self) -> tuple[Table, ...]:
        """The sizing line by line; the rules."""
        names = [field.name for field in fields(self) if field.name != "checks"]
        lines = (
            Column("quantity", [name.replace("_", " ") for name in names]),
            Column(
                "value", [getattr(self, name) for name in names], [_unit(name) for name in names]
            ),
        )
        own = [check.unit for check in self.checks]
        rules = (
            Column("rule", [check.name for check in self.checks]),
            Column("offered", [check.offered for check in self.checks], own),
            Column("needed", [check.needed for check in self.checks], own),
            Column(
                "holds",
                [check.holds for check in self.checks],
                words={"None": "not stated", "False": "NO"},
            ),
        )
        return Table("sizing of a stepper", lines), Table("rules", rules)


def _unit(name: str) -> str:
    return _UNITS.get(name.rpartition("_")[2], "m")


UPPER_BOUNDED = ("step", "time")
"""Rules by which no more may be offered than is needed."""
_UNITS = {
    "lead": "m/rev",
    "speed": "m/s",
    "duration": "s",
    "rate": "1/s",
    "inertia": "kg m^2",
    "acceleration": "rad/s^2",
    "torque": "N m",
}


@check_arguments()
def size_stepper(
    slide: Slide,
    screw: Leadscrew,
    motor: StepMotor,
    traverse: Traverse,
    share: float = STEPS_PER_ACCURACY,
) -> StepperSizing:
    """Size the motor of a leadscrew axis.

    lead λ per revolution, r = λ/2π, efficiency η, step angle θ, top speed v:
    rate = v/λ · 2π/θ;  α = (v/r)/ramp;  I = m r² + π ρ L D⁴/32 + I_rotor
    T_A = (m r²/η + I_screw + I_rotor) α;  T_F = F r/η + drag;  T_G = lift m g r/η;  T = T_A + T_F +
                                           T_G
    standstill: lift m g r (a screw's friction helps to hold, but is not counted on)
    Source: [Sasidhar 1981, Appendix B], with exact factors for its rounded ones, and the slide's
    inertia through the
    screw's efficiency.

    Parameters
    ----------
    slide, screw, motor
        The parts of the axis.
    traverse
        What the axis must do.
    share
        Resolution rule: step λθ/2π ≤ accuracy/share.

    Returns
    -------
    StepperSizing
        Whose `checks` lists the rules that are met and those that are not.

    Raises
    ------
    MotionError
        A value makes no sense.
    """
    if not (isfinite(share) and share >= 1):
        raise MotionError(f"sizing: share {share} must be at least 1 step within the accuracy")
    radius = screw.lead / tau
    step = radius * motor.step
    speed = traverse.least_speed if traverse.speed is None else traverse.speed
    rate = speed / step
    slide_inertia = slide.mass * radius**2
    acceleration = speed / radius / traverse.ramp
    acceleration_torque = (
        slide_inertia / screw.efficiency + screw.inertia + motor.inertia
    ) * acceleration
    friction_torque = slide.friction * radius / screw.efficiency + screw.drag
    weight_torque = slide.lift * slide.mass * GRAVITY * radius
    torque = acceleration_torque + friction_torque + weight_torque / screw.efficiency
    resolution = traverse.accuracy / share
    duration = trapezoid_time(traverse.travel, speed, traverse.ramp)
    return StepperSizing(
        resolution=resolution,
        coarsest_lead=resolution * tau / motor.step,
        step=step,
        average_speed=traverse.travel / traverse.time,
        least_speed=traverse.least_speed,
        speed=speed,
        duration=duration,
        rate=rate,
        slide_inertia=slide_inertia,
        screw_inertia=screw.inertia,
        rotor_inertia=motor.inertia,
        inertia=slide_inertia + screw.inertia + motor.inertia,
        acceleration=acceleration,
        acceleration_torque=acceleration_torque,
        friction_torque=friction_torque,
        gravity_torque=weight_torque / screw.efficiency,
        torque=torque,
        standstill_torque=weight_torque,
        checks=(
            _check_at_most("step", step, resolution, "m"),
            _check_at_most("time", duration, traverse.time, "s"),
            _check_at_least(f"torque up to {rate:.6g} steps/s", motor.torque(rate), torque, "N m"),
            _check_at_least("holding torque", motor.holding, weight_torque, "N m"),
        ),
    )


def trapezoid_time(travel: float, speed: float, ramp: float) -> float:
    """s from rest to rest with ramps of `ramp` s to `speed`; a triangle where the travel is too
    short for them.
    """
    if travel < speed * ramp:
        return 2 * sqrt(travel * ramp / speed)
    return travel / speed + ramp


SLACK = 1e-12
"""Share by which rounding may break a rule that is met exactly."""


def _check_at_most(name: str, offered: float, needed: float, unit: str) -> Check:
    return Check(name, offered, needed, unit, bool(offered <= needed * (1 + SLACK)))


def _check_at_least(name: str, offered: float | None, needed: float, unit: str) -> Check:
    return Check(
        name,
        offered,
        needed,
        unit,
        None if offered is None else bool(offered >= needed * (1 - SLACK)),
    )
