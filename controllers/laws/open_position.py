"""Law 3: open loop, position; and its variant that brakes in every step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.gain import Gain, Grid, checked, shown
from controllers.laws.law import Feedback, Reference, Timer
from kinematics.errors import MotionError


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

    ramp: Gain = 0.25
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"ramp": (0.1, 0.25, 0.5)}

    def __post_init__(self) -> None:
        advice = "above 0 and at most 0.5 of the step"
        object.__setattr__(self, "ramp", checked("open-position-trapezoid", "ramp", self.ramp, advice))
        if not (np.all(np.asarray(self.ramp) > 0) and np.all(np.asarray(self.ramp) <= 0.5)):
            raise MotionError(f"law open-position-trapezoid: ramp {shown(self.ramp)} must be {advice}")
        if np.min(self.ramp) != np.max(self.ramp):
            raise MotionError(
                "law open-position-trapezoid: all runs of a batch share one ramp, since a command has one time of "
                f"acceleration; {shown(self.ramp)} needs a batch for each"
            )

    @property
    def name(self) -> str:
        return f"open-position-trapezoid ramp={shown(self.ramp)}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        target, ramp = reference.ang(k + 1), float(np.min(self.ramp)) * reference.dt
        top = np.abs(target - feedback.counter) / (reference.dt - ramp)
        return TAMove(np.broadcast_to(target, top.shape), np.zeros_like(top), top, ramp, ramp)
