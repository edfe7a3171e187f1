"""Laws 1 and 2: open loop, velocity; on a host that watches the card's counter, and on one that sleeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card import TVMove, VChange
from controllers.laws.gain import Grid
from controllers.laws.law import Feedback, Reference, Timer


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
