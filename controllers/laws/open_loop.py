"""Law 3: open loop, position; and its variant that brakes in every step.

Laws 1 and 2: open loop, velocity; on a host that watches the card's counter, and on one that sleeps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card import TAMove, TVMove, VChange
from controllers.laws.law import Feedback, Grid, Reference, Timer
from kinematics.foundation.errors import MotionError


@dataclass(frozen=True, slots=True)
class OpenPosition:
    """TAMove(ang(k+1), npuls(k), npuls(k+1), dt, 0) at step k [Sahbaz 2007, Table 7.5, algorithm 3]."""

    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {}

    @property
    def name(self) -> str:
        return "open-position"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        return TAMove(reference.ang(k + 1), reference.npuls(k), reference.npuls(k + 1), reference.dt, 0.0)


@dataclass(frozen=True, slots=True)
class OpenPositionTrapezoid:
    """TAMove(ang(k+1), 0, |ang(k+1) − counter|/(dt − ta), ta, ta), ta = ramp · dt: a whole trapezoid in every step.

    It starts and ends each step at rest: it tracks, but shakes the shaft [Sahbaz 2007, section 7.3, figure 7.8]. The
    thesis prints neither the share of the ramps nor the top speed. ASSUMPTIONS: ramps of a quarter of the step each,
    and the top speed that covers what the card's own counter is short of the target in exactly one step.

    ramp  share of the step, above 0 and at most ½ (a triangle)
    """

    ramp: float = 0.25
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {}

    def __post_init__(self) -> None:
        if not 0 < self.ramp <= 0.5:
            raise MotionError(
                f"law open-position-trapezoid: ramp {self.ramp} must be above 0 and at most 0.5 of the step"
            )

    @property
    def name(self) -> str:
        return f"open-position-trapezoid ramp={self.ramp:g}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        target, ramp = reference.ang(k + 1), self.ramp * reference.dt
        top = np.abs(target - feedback.counter) / (reference.dt - ramp)
        return TAMove(np.broadcast_to(target, top.shape), np.zeros_like(top), top, ramp, ramp)


@dataclass(frozen=True, slots=True)
class OpenVelocity:
    """TVMove(npuls(0), npuls(1), dt) first, then VChange(npuls(k+1), dt) [Sahbaz 2007, Table 7.5, algorithms 1 and 2].

    Only speeds are sent, so nothing brings back what rounding of the speeds and lateness of the host leave undone.

    host  "counter" is algorithm 1; "sleep" is algorithm 2
    """

    host: Timer = "counter"
    grid: ClassVar[Grid] = {}

    @property
    def name(self) -> str:
        return "open-velocity" + ("-sleep" if self.host == "sleep" else "")

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TVMove | VChange:
        # all runs of a batch start at once: a run at step 0 beside others beyond it is not due
        if np.all(np.asarray(k) == 0):
            return TVMove(reference.npuls(k), reference.npuls(k + 1), reference.dt)
        return VChange(reference.npuls(k + 1), reference.dt)
