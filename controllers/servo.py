"""A servo axis as data: position loop around a speed loop around an inertia with friction, behind a gear with play."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from kinematics.axis import Axis
from kinematics.errors import MotionError


@dataclass(frozen=True, slots=True)
class Servo:
    """One servo axis in the coordinate of its output: metres and newtons, or radians and newton metres.

    Per sample of the drive, with x the motor's position, v its speed, x̂ the encoder's reading and r the position
    command of `command_delay` samples ago:

        speed error    ε = K (r − x̂) − v
        torque         τ = sat(J ω ε + I),  ω = 2π · speed loop; set `loop_delay` samples later
        integral       I ← I + (J ω / T) ε · sample, while τ does not saturate
        motor          J′ v̇ = τ − b v − c sign(v), τ held over the sample; at rest it sticks while |τ| ≤ c
        output         y ∈ [x − play/2, x + play/2]: it stays where it is until an end of the play pushes it

    Assumed of a drive whose documents print only its gains: the speed loop's gain is normalised by the inertia J that
    the drive is set to (the inertia ratio), whatever the true J′ = J · inertia_factor is; the speed is measured without
    quantization (an observer), at the motor; the integral stops while the torque saturates. Assumed of the play: it is
    kinematic. The output is held by friction, the motor feels the whole inertia all the time, and the gear does not
    twist. At the start the output stands in the middle of the play.

    position_gain  K, 1/s
    speed_loop     Hz;  integral_time  T, s
    torque_limit   N or N·m;  inertia  J, kg or kg·m², load included;  friction  b, viscous, N·s/m or N·m·s/rad
    encoder        counts per m or rad
    sample         s, period of the drive's loops
    coulomb        c, N or N·m
    play           m or rad between motor and output
    feedback       where the encoder sits: x̂ is the reading of x ("motor") or of y ("output")
    command_delay, loop_delay  samples
    """

    position_gain: float
    speed_loop: float
    integral_time: float
    torque_limit: float
    inertia: float
    friction: float
    encoder: float
    sample: float = 0.25e-3
    coulomb: float = 0.0
    play: float = 0.0
    feedback: Literal["motor", "output"] = "motor"
    command_delay: int = 0
    loop_delay: int = 0
    inertia_factor: float = 1.0

    def __post_init__(self) -> None:
        if self.feedback not in ("motor", "output"):
            raise MotionError(f'servo: feedback "{self.feedback}" is neither "motor" nor "output"')
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "feedback":
                continue
            if field.name.endswith("_delay") and value != int(value):
                raise MotionError(f"servo: {field.name} {value} must be a whole number of samples")
            lowest = 0.0 if field.name in _MAY_BE_ZERO else np.finfo(float).tiny
            if not lowest <= value < float("inf"):
                zero = ", ".join(_MAY_BE_ZERO)
                raise MotionError(f"servo: {field.name} {value} must be a positive finite number ({zero} may be zero)")

    def disturbed(self, inertia: float, friction: float) -> Servo:
        """The same axis with other true inertia and friction (factors), of which its drive knows nothing."""
        return replace(
            self,
            inertia_factor=self.inertia_factor * inertia,
            friction=self.friction * friction,
            coulomb=self.coulomb * friction,
        )


_MAY_BE_ZERO = ("friction", "coulomb", "play", "command_delay", "loop_delay")


def leg_servo(axis: Axis) -> Servo:
    """A servo to put behind an axis where one is wanted and none is known, normalised in the axis' coordinate.

    An assumption, which whoever makes a rig of it states by its name: no command and no function puts it anywhere.

    From [Sahbaz 2007, Table 7.4]: position loop 30 1/s (Pn102), speed loop 30 Hz (Pn100), integral 30 ms (Pn101,
    printed as 3000 in units of 0.01 ms), four encoder counts per command pulse (Pn202/Pn203, 2048 × 4 counts per
    revolution). Assumed: unit inertia (the loops are normalised by it, so it matters for saturation and friction
    alone), viscous friction of 5 1/s of it, and as torque limit the 220 N of the hexapod's actuator [Sahbaz 2007,
    Table 3.1]. The hexapod itself has stepper legs: this servo answers what it would do behind the drives of the
    thesis' other rig.
    """
    return Servo(
        position_gain=30.0,
        speed_loop=30.0,
        integral_time=30e-3,
        torque_limit=220.0,
        inertia=1.0,
        friction=5.0,
        encoder=4 / axis.pulse,
    )
