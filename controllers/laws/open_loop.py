"""Open loop: laws 1 and 2 (velocity), law 3 (position), and ours (feedforward).

Law 1 is for a host that watches the card's counter, law 2 for one that sleeps; a variant of law 3
brakes in every step; ours feeds speed and acceleration forward, shifted by the dead time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from controllers.card import TAMove, TVMove, VChange
from controllers.laws.law import (
    Feedback,
    Gain,
    Grid,
    Reference,
    check_gain,
    check_ramp,
    format_gain,
    ramp,
    trapezoid,
)
from controllers.laws.nominal import NominalAxes, usual_axes
from controllers.rig import Timer
from kinematics.foundation.arrays import Array


@dataclass(frozen=True, slots=True)
class OpenPosition:
    """TAMove(ang(k+1), npuls(k), npuls(k+1), dt, 0) at step k [Sahbaz 2007, Table 7.5, algorithm
    3].
    """

    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {}

    @property
    def name(self) -> str:
        return "open-position"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        return TAMove(
            reference.ang(k + 1), reference.npuls(k), reference.npuls(k + 1), reference.dt, 0.0
        )


@dataclass(frozen=True, slots=True)
class OpenPositionTrapezoid:
    """TAMove(ang(k+1), 0, |ang(k+1) − counter|/(dt − ta), ta, ta), ta = ramp · dt: law 3t without
    feedback.

    Law 3 by whole trapezoids from rest to rest, to show their effect without feedback. This law is
    ours: the full trapezoids of [Sahbaz 2007] are `ClosedPositionTrapezoid`.

    ramp  share of the step, above 0 and at most ½ (a triangle)
    """

    ramp: float = 0.25
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {}

    def __post_init__(self) -> None:
        check_ramp("open-position-trapezoid", self.ramp)

    @property
    def name(self) -> str:
        return f"open-position-trapezoid ramp={self.ramp:g}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        return trapezoid(reference.ang(k + 1), feedback.counter, reference.dt, self.ramp)


@dataclass(frozen=True, slots=True)
class OpenVelocity:
    """TVMove(npuls(0), npuls(1), dt) first, then VChange(npuls(k+1), dt) [Sahbaz 2007, Table 7.5,
    algorithms 1 and 2].

    Only speeds are sent, so nothing brings back what rounding of the speeds and lateness of the
    host leave undone.

    host  "counter" is algorithm 1; "sleep" is algorithm 2
    """

    host: Timer = "counter"
    grid: ClassVar[Grid] = {}

    @property
    def name(self) -> str:
        return "open-velocity" + ("-sleep" if self.host == "sleep" else "")

    def command(
        self, k: int | np.ndarray, reference: Reference, feedback: Feedback
    ) -> TVMove | VChange:
        # all runs of a batch start at once: a run at step 0 beside others beyond it is not due
        if np.all(np.asarray(k) == 0):
            return TVMove(reference.npuls(k), reference.npuls(k + 1), reference.dt)
        return VChange(reference.npuls(k + 1), reference.dt)


@dataclass(frozen=True, slots=True)
class Feedforward:
    """Feedforward: the nominal drive outputs the reference for c(t) = r + α ṙ/K + γ r̈/(K ω), all
    at t + delay.

    A position loop of gain K lags ṙ/K behind, so it is commanded ahead by that much. Of a speed
    loop without integral r̈/(K ω) is left; the integral (time T, some 30 ms) takes that over where
    it is slower than 1/T, so γ = 0 by default. Each step sends `ramp` from the card's counter to
    c(t + dt) with the speeds ċ at both ends: open loop, no encoder is read.

    Between motor and output there may be play, which an encoder at the motor does not see: half of
    it is added the way that the axis runs, within the step in which it starts or turns.

    speed, acceleration, play  α, γ, and of the play; shares of what the nominal axes ask for
    axes                       K, ω, delay, play; (n,) or (1,)
    """

    speed: Gain = 1.0
    acceleration: Gain = 0.0
    play: Gain = 1.0
    axes: NominalAxes = field(default_factory=usual_axes)
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {
        "speed": (0.9, 0.95, 1.0, 1.05),
        "acceleration": (0.0, 1.0),
        "play": (0.0, 1.0),
    }

    def __post_init__(self) -> None:
        for name in ("speed", "acceleration", "play"):
            advice = "1 is what the nominal drive asks for"
            object.__setattr__(
                self, name, check_gain("feedforward", name, getattr(self, name), advice)
            )

    @property
    def name(self) -> str:
        return (
            f"feedforward speed={format_gain(self.speed)} acceleration={format_gain(self.acceleration)} "
            f"play={format_gain(self.play)}"
        )

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        _, start = self.target_motion(np.asarray(k), reference)
        target, end = self.target_motion(np.asarray(k) + 1, reference, before=True)
        taken = (
            self.play
            * self.axes.play
            / 2
            * reference.heading((np.asarray(k)[..., None] + 1) * reference.dt + 0 * self.axes.delay)
        )
        return ramp(target + taken, start, end, feedback.counter, reference.dt)

    def target_motion(
        self, k: np.ndarray, reference: Reference, *, before: bool = False
    ) -> tuple[Array, Array]:
        """c and ċ (…, n) at k·dt, k (…,), just after or just `before` it; without play."""
        r, rd, rdd = reference.between(k[..., None] * reference.dt + self.axes.delay, before=before)
        lag = self.speed / self.axes.position_gain
        bend = self.acceleration / (self.axes.position_gain * self.axes.speed_loop)
        return np.asarray(r + lag * rd + bend * rdd), np.asarray(rd + lag * rdd)
