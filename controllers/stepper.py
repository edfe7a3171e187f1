"""A stepper axis as data: a rotor in a field that the pulses turn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kinematics.array import finite
from kinematics.errors import MotionError


@dataclass(frozen=True, slots=True)
class Stepper:
    """One open-loop stepper axis in the coordinate of its output: metres and newtons, or radians and newton metres.

    With x the position, v the speed and r the field's position, which runs straight from the count of one sample of the
    drive to that of the next:

        torque   τ = −T(|ṙ|) sin(π/2 · (x − r)/full step) − d (v − ṙ)
        rotor    J v̇ = τ − b v − c sign(v); at rest it sticks while |τ| ≤ c

    So the rotor has a stable place every four full steps: when the torque is exceeded it falls behind by four, or a
    multiple of it, and what it lost stays lost. Assumed: the torque curve is that of the rate of steps, not of the
    rotor's speed; the drive's microsteps make the field turn evenly; the play is kinematic, as a servo's.

    torque_speed   ((speed, torque), …) speeds rising from 0: the peak torque at a rate of steps; none beyond the last
    full_step      m or rad
    inertia        J, kg or kg·m², load included
    damping        d, against slip between rotor and field; friction  b, viscous; both N·s/m or N·m·s/rad
    coulomb        c, N or N·m
    play           m or rad between motor and output
    encoder        counts per m or rad, which the host may read; 0: there is none, and it reads the pulses sent
    sample         s, period at which the field's course is set
    """

    torque_speed: tuple[tuple[float, float], ...]
    full_step: float
    inertia: float
    damping: float = 0.0
    friction: float = 0.0
    coulomb: float = 0.0
    play: float = 0.0
    encoder: float = 0.0
    sample: float = 0.25e-3

    def __post_init__(self) -> None:
        curve = finite(self.torque_speed, "stepper: torque_speed", (None, 2), least=0.0)
        if len(curve) < 2 or curve[0, 0] != 0 or (np.diff(curve[:, 0]) <= 0).any() or curve[0, 1] == 0:
            raise MotionError(
                f"stepper: torque_speed {self.torque_speed} must be two or more points, speeds rising from 0, "
                "with a torque at rest"
            )
        object.__setattr__(self, "torque_speed", tuple(map(tuple, curve.tolist())))
        for name in ("full_step", "inertia", "damping", "friction", "coulomb", "play", "encoder", "sample"):
            value = getattr(self, name)
            lowest = np.finfo(float).tiny if name in ("full_step", "inertia", "sample") else 0.0
            if not lowest <= value < float("inf"):
                raise MotionError(f"stepper: {name} {value} must be finite, and {'above' if lowest else 'not below'} 0")
        if self.swing * self.sample > 1.0:
            raise MotionError(
                f"stepper: sample {self.sample} s is too long for a rotor that swings at {self.swing:.4g} rad/s; "
                f"take {1 / self.swing:.2g} s or less"
            )

    @property
    def torque_limit(self) -> float:
        """N or N·m: the most it gives at any rate of steps."""
        return max(torque for _, torque in self.torque_speed)

    def disturbed(self, inertia: float, friction: float) -> Stepper:
        """The same axis with other true inertia and friction (factors)."""
        return replace(
            self,
            inertia=self.inertia * inertia,
            friction=self.friction * friction,
            coulomb=self.coulomb * friction,
        )

    @property
    def swing(self) -> float:
        """rad/s of small oscillations about a step at rest: ω² = π T(0)/(2 · full step · J)."""
        return float(np.sqrt(np.pi / 2 * self.torque_speed[0][1] / self.full_step / self.inertia))
