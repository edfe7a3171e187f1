"""Laws 4 and 5: closed loop, the error itself sent as target; of position, and of position and speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.gain import Gain, Grid, checked, shown
from controllers.laws.law import Feedback, Reference, Timer

_ADVICE = "the thesis used 0.7 for the position, 1 for the speed"


@dataclass(frozen=True, slots=True)
class ClosedError:
    """TAMove(kp·(ang(k+1) − pos(k−1)), npuls(k), npuls(k+1), dt, 0) [Sahbaz 2007, Table 7.5, algorithm 4].

    The *error* is sent as an absolute target, so the axis is called to a place near zero as soon as it follows well:
    the thesis found it unstable (its figure 7.14, kp = 0.7). `gain` is kp.
    """

    gain: Gain = 0.7
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"gain": (0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)}

    def __post_init__(self) -> None:
        object.__setattr__(self, "gain", checked("closed-error", "gain", self.gain, _ADVICE))

    @property
    def name(self) -> str:
        return f"closed-error kp={shown(self.gain)}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        target = self.gain * (reference.ang(k + 1) - feedback.position)
        return TAMove(target, reference.npuls(k), reference.npuls(k + 1), reference.dt, 0.0)


@dataclass(frozen=True, slots=True)
class ClosedErrorSpeed:
    """TAMove(kp·(ang(k+1) − pos(k−1)), npuls(k), kv·(npuls(k+1) − v(k−1)), dt, 0).

    [Sahbaz 2007, Table 7.5, algorithm 5]. The table is implemented. The program printed in the thesis'
    appendix differs: its first command is the table's, but later ones start at kverr(k−1), the top speed of the step
    before, instead of npuls(k); where npuls(k+1) < 0 it adds v(k−1) instead of subtracting it; and since that stands in
    a one-line If, kverr is multiplied out for negative speeds only and stays zero for the others. Its v(k−1) is
    `GetCurrentSpeed`, the card's output rate (`Host.speed_from`). If that has no sign (`Card.current_speed`), to add it
    where npuls(k+1) < 0 is what the table means, as long as the axis runs the way it is commanded to.

    `gain` is kp, `speed_gain` kv.
    """

    gain: Gain = 0.7
    speed_gain: Gain = 1.0
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"gain": (0.1, 0.3, 0.5, 0.7, 0.9), "speed_gain": (0.5, 1.0)}

    def __post_init__(self) -> None:
        for name in ("gain", "speed_gain"):
            object.__setattr__(self, name, checked("closed-error-speed", name, getattr(self, name), _ADVICE))

    @property
    def name(self) -> str:
        return f"closed-error-speed kp={shown(self.gain)} kv={shown(self.speed_gain)}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        target = self.gain * (reference.ang(k + 1) - feedback.position)
        top = self.speed_gain * (reference.npuls(k + 1) - feedback.speed)
        return TAMove(target, reference.npuls(k), top, reference.dt, 0.0)
