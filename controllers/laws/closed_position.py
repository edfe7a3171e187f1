"""Laws 6 and 7: closed loop, the target moved by the error; absolute and relative, as printed and repaired."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card import TAMove, TRMove
from controllers.laws.gain import Gain, Grid, checked, shown
from controllers.laws.law import Feedback, Reference, Timer


@dataclass(frozen=True, slots=True)
class ClosedPosition:
    """e = k·(ang(k) − pos(k−1)); TAMove(ang(k+1) + e, npuls(k), npuls(k+1), dt, 0).

    [Sahbaz 2007, Table 7.5, algorithms 6 and 7]; `gain` is k, 0.7 the best value by the thesis. pos(k−1) is read at the
    end of step k−1, when the reference is at ang(k), so e is the following error of that instant times k.

    Algorithm 6 moves the target only; the top speed stays that of the reference. So while an axis runs one way, a
    target further ahead is not reached any sooner and the command is that of law 3, whatever k, to the pulse that law 3
    may wait at its own target. Where an axis turns round, the error still points the old way and, speeds being
    magnitudes, sends the command on that way for a while; no later command may catch up, so the loss stays until the
    axis rests.

    relative  algorithm 7: TRMove(ang(k+1) − ang(k) + e, …), counted from the command position of the instant
    repaired  ours: the top speed carries the correction, npuls(k+1) + e/dt. The ramp to it lasts the whole step, in
              which half of e is caught up
    """

    gain: Gain = 0.7
    relative: bool = False
    repaired: bool = False
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"gain": (0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)}

    def __post_init__(self) -> None:
        object.__setattr__(self, "gain", checked("closed-position", "gain", self.gain, "the thesis used 0.5 to 0.9"))

    @property
    def name(self) -> str:
        variant = "-relative" * self.relative + "-repaired" * self.repaired
        return f"closed-position{variant} k={shown(self.gain)}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove | TRMove:
        here, there, dt = reference.ang(k), reference.ang(k + 1), reference.dt
        error = self.gain * (here - feedback.position)
        top = reference.npuls(k + 1) + (error / dt if self.repaired else 0.0)
        if self.relative:
            return TRMove(there - here + error, reference.npuls(k), top, dt, 0.0)
        return TAMove(there + error, reference.npuls(k), top, dt, 0.0)
