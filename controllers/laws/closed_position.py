"""Law 6: closed loop, position."""

from dataclasses import dataclass

import numpy as np

from controllers.card import TAMove
from controllers.laws.law import Feedback, Reference
from kinematics.errors import MotionError


@dataclass(frozen=True, slots=True)
class ClosedPosition:
    """e = k·(ang(k) − pos(k−1)); TAMove(ang(k+1) + e, npuls(k), npuls(k+1), dt, 0).

    [Sahbaz 2007, Table 7.5, algorithm 6]; `gain` is k, 0.7 the best value by the thesis. pos(k−1) is read at the end of
    step k−1, when the reference is at ang(k), so e is the following error of that instant times k.

    It moves the target only; the top speed stays that of the reference. So while an axis runs one way, a target further
    ahead is not reached any sooner and the command is that of law 3, whatever k, to the pulse that law 3 may wait at
    its own target. Where an axis turns round, the error still points the old way and, speeds being magnitudes, sends
    the command on that way for a while; no later command may catch up, so the loss stays until the axis rests.
    """

    gain: float = 0.7

    def __post_init__(self) -> None:
        if not abs(self.gain) < float("inf"):
            raise MotionError(
                f"law closed-position: gain {self.gain} must be a finite number; the thesis used 0.5 to 0.9"
            )

    @property
    def name(self) -> str:
        return f"closed-position k={self.gain:g}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        error = self.gain * (reference.ang(k) - feedback.position)
        return TAMove(reference.ang(k + 1) + error, reference.npuls(k), reference.npuls(k + 1), reference.dt, 0.0)
