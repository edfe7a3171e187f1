"""Ours: velocity and acceleration feedforward with dead-time shift."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.law import Feedback, Gain, Grid, Reference, Timer, check_gain, format_gain, ramp
from controllers.laws.nominal import NominalAxes, usual_axes
from kinematics.foundation.arrays import Array


@dataclass(frozen=True, slots=True)
class Feedforward:
    """The command that a nominal drive turns into the reference: c(t) = r + α ṙ/K + γ r̈/(K ω), all at t + delay.

    A position loop of gain K lags ṙ/K behind, so it is commanded ahead by that much. Of a speed loop without integral
    r̈/(K ω) is left; the integral (time T, some 30 ms) takes that over where it is slower than 1/T, so γ = 0 by default.
    Each step sends `ramp` from the card's counter to c(t + dt) with the speeds ċ at both ends: open loop, no encoder is
    read.

    Between motor and output there may be play, which an encoder at the motor does not see: half of it is added the way
    that the axis runs, within the step in which it starts or turns.

    speed, acceleration, play  α, γ, and of the play; shares of what the nominal axes ask for
    axes                       K, ω, delay, play; (n,) or (1,)
    """

    speed: Gain = 1.0
    acceleration: Gain = 0.0
    play: Gain = 1.0
    axes: NominalAxes = field(default_factory=usual_axes)
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"speed": (0.9, 0.95, 1.0, 1.05), "acceleration": (0.0, 1.0), "play": (0.0, 1.0)}

    def __post_init__(self) -> None:
        for name in ("speed", "acceleration", "play"):
            advice = "1 is what the nominal drive asks for"
            object.__setattr__(self, name, check_gain("feedforward", name, getattr(self, name), advice))

    @property
    def name(self) -> str:
        return (
            f"feedforward speed={format_gain(self.speed)} acceleration={format_gain(self.acceleration)} "
            f"play={format_gain(self.play)}"
        )

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        _, start = self.wanted(np.asarray(k), reference)
        target, end = self.wanted(np.asarray(k) + 1, reference, before=True)
        taken = (
            self.play
            * self.axes.play
            / 2
            * reference.heading((np.asarray(k)[..., None] + 1) * reference.dt + 0 * self.axes.delay)
        )
        return ramp(target + taken, start, end, feedback.counter, reference.dt)

    def wanted(self, k: np.ndarray, reference: Reference, *, before: bool = False) -> tuple[Array, Array]:
        """c and ċ (…, n) at k·dt, k (…,), just after or just `before` it; without play."""
        r, rd, rdd = reference.between(k[..., None] * reference.dt + self.axes.delay, before=before)
        lag = self.speed / self.axes.position_gain
        bend = self.acceleration / (self.axes.position_gain * self.axes.speed_loop)
        return np.asarray(r + lag * rd + bend * rdd), np.asarray(rd + lag * rdd)
