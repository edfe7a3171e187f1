"""Law 3: open loop, position."""

from dataclasses import dataclass

import numpy as np

from controllers.card import TAMove
from controllers.laws.law import Feedback, Reference


@dataclass(frozen=True, slots=True)
class OpenPosition:
    """TAMove(ang(k+1), npuls(k), npuls(k+1), dt, 0) at step k [Sahbaz 2007, Table 7.5, algorithm 3]."""

    @property
    def name(self) -> str:
        return "open-position"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        return TAMove(reference.ang(k + 1), reference.npuls(k), reference.npuls(k + 1), reference.dt, 0.0)
