"""Ours: a command learned over trials, played open loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.law import Feedback, Grid, Reference, Timer, ramp
from kinematics.foundation.arrays import Array, freeze_array


@dataclass(frozen=True, slots=True)
class Learned:
    """The corrected position table of one motion, sent as `ramp` from step to step, whatever the reference says.

    `controllers.learning.learn` makes it. It is right for the motion and the host's step it was learned on, and for no
    other. Of the feedback only the card's own counter is read.

    position  (N + 1, n) pulses, command at k·dt
    turn      (N, n) pulses/s, by how much the speed grows within step k
    """

    position: Array
    turn: Array
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {}

    def __post_init__(self) -> None:
        for name in ("position", "turn"):
            object.__setattr__(self, name, freeze_array(getattr(self, name), np.float64))

    @property
    def name(self) -> str:
        return "learned"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        steps = len(self.turn)
        turn = np.where(np.asarray(k)[..., None] < steps, self.turn[np.minimum(k, steps - 1)], 0.0)
        target = np.broadcast_to(self.position[np.minimum(np.asarray(k) + 1, steps)], feedback.counter.shape)
        return ramp(target, -turn / 2, turn / 2, feedback.counter, reference.dt)
