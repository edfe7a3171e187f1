"""Laws 4 to 7 and 3t: closed loop.

4 and 5 send the error itself as target, of position, or of position and speed. 6 and 7 move the
target by the error: absolute and relative, as printed and repaired. 3t does so too, and brakes to
rest in every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card import TAMove, TRMove
from controllers.laws.law import (
    Feedback,
    Gain,
    Grid,
    Reference,
    check_gain,
    check_ramp,
    format_gain,
    trapezoid,
)
from controllers.rig import Timer


@dataclass(frozen=True, slots=True)
class ClosedPosition:
    """e = k·(ang(k) − pos(k−1)); TAMove(ang(k+1) + e, npuls(k), npuls(k+1), dt, 0).

    [Sahbaz 2007, Table 7.5, algorithms 6 and 7]; `gain` is k, 0.7 the best value by the thesis.
    pos(k−1) is read at the end of step k−1, when the reference is at ang(k), so e is the following
    error of that instant times k.

    Algorithm 6 moves the target only; the top speed stays that of the reference. So while an axis
    runs one way, a target further ahead is not reached any sooner and the command is that of law 3,
    whatever k, to the pulse that law 3 may wait at its own target. Where an axis turns round, the
    error still points the old way and, speeds being magnitudes, sends the command on that way for a
    while; no later command may catch up, so the loss stays until the axis rests.

    relative  algorithm 7: TRMove(ang(k+1) − ang(k) + e, …), counted from the command position of
              the instant
    repaired  ours: the top speed carries the correction, npuls(k+1) + e/dt. The ramp to it lasts
              the whole step, in which half of e is caught up
    """

    gain: Gain = 0.7
    relative: bool = False
    repaired: bool = False
    reads_encoder: ClassVar[bool] = True
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"gain": (0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)}

    def __post_init__(self) -> None:
        object.__setattr__(
            self,
            "gain",
            check_gain("closed-position", "gain", self.gain, "the thesis used 0.5 to 0.9"),
        )

    @property
    def formula(self) -> str:
        """Command as text, for lists of laws."""
        top = "npuls(k+1) + e/dt" if self.repaired else "npuls(k+1)"
        move = "TRMove(ang(k+1) − ang(k) + e" if self.relative else "TAMove(ang(k+1) + e"
        return f"e = k·(ang(k) − pos(k−1)); {move}, npuls(k), {top}, dt, 0)"

    @property
    def name(self) -> str:
        variant = "-relative" * self.relative + "-repaired" * self.repaired
        return f"closed-position{variant} k={format_gain(self.gain)}"

    def command(
        self, k: int | np.ndarray, reference: Reference, feedback: Feedback
    ) -> TAMove | TRMove:
        here, there, dt = reference.ang(k), reference.ang(k + 1), reference.dt
        error = self.gain * (here - feedback.position)
        top = reference.npuls(k + 1) + (error / dt if self.repaired else 0.0)
        if self.relative:
            return TRMove(there - here + error, reference.npuls(k), top, dt, 0.0)
        return TAMove(there + error, reference.npuls(k), top, dt, 0.0)


@dataclass(frozen=True, slots=True)
class ClosedPositionTrapezoid:
    """e = k·(ang(k) − pos(k−1)); TAMove(ang(k+1) + e, 0, |ang(k+1) + e − counter|/(dt − ta), ta,
    ta).

    The closed-loop program for two servos [Sahbaz 2007, section 7.4, figure 7.8] sends a full
    trapezoid in every step of 50.25 ms along the sine (equation 7.5): the axes accelerate and brake
    in all steps, which tracks well and shakes the shafts. `gain` is k. The thesis prints the
    command (equation 7.4) without its values. ASSUMPTIONS: the error enters the target as in law 6;
    a step starts and ends at rest, with ramps of a quarter of the step each; the top speed covers
    what the card's own counter is short of the target in exactly one step.

    ramp  ta/dt, above 0 and at most ½ (a triangle)
    """

    gain: Gain = 0.7
    ramp: float = 0.25
    reads_encoder: ClassVar[bool] = True
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"gain": (0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)}

    def __post_init__(self) -> None:
        gain = check_gain("closed-position-trapezoid", "gain", self.gain, "0.7 is usual")
        object.__setattr__(self, "gain", gain)
        check_ramp("closed-position-trapezoid", self.ramp)

    @property
    def name(self) -> str:
        return f"closed-position-trapezoid k={format_gain(self.gain)} ramp={self.ramp:g}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        error = self.gain * (reference.ang(k) - feedback.position)
        target = np.rint(reference.ang(k + 1) + error)
        return trapezoid(target, feedback.counter, reference.dt, self.ramp)


_ADVICE = "the thesis used 0.7 for the position, 1 for the speed"


@dataclass(frozen=True, slots=True)
class ClosedError:
    """TAMove(kp·(ang(k+1) − pos(k−1)), npuls(k), npuls(k+1), dt, 0) [Sahbaz 2007, Table 7.5,
    algorithm 4].

    The *error* is sent as an absolute target, so the axis is called to a place near zero as soon as
    it follows well: the thesis found it unstable (its figure 7.14, kp = 0.7). `gain` is kp.
    """

    gain: Gain = 0.7
    reads_encoder: ClassVar[bool] = True
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"gain": (0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)}

    def __post_init__(self) -> None:
        object.__setattr__(self, "gain", check_gain("closed-error", "gain", self.gain, _ADVICE))

    @property
    def name(self) -> str:
        return f"closed-error kp={format_gain(self.gain)}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        target = self.gain * (reference.ang(k + 1) - feedback.position)
        return TAMove(target, reference.npuls(k), reference.npuls(k + 1), reference.dt, 0.0)


@dataclass(frozen=True, slots=True)
class ClosedErrorSpeed:
    """TAMove(kp·(ang(k+1) − pos(k−1)), npuls(k), kv·(npuls(k+1) − v(k−1)), dt, 0).

    [Sahbaz 2007, Table 7.5, algorithm 5]. The table is implemented. The program printed in the
    thesis' appendix differs: its first command is the table's, but later ones start at kverr(k−1),
    the top speed of the step before, instead of npuls(k); where npuls(k+1) < 0 it adds v(k−1)
    instead of subtracting it; and since that stands in a one-line If, kverr is multiplied out for
    negative speeds only and stays zero for the others. Its v(k−1) is `GetCurrentSpeed`, the card's
    output rate (`Host.speed_from`). If that has no sign (`Card.current_speed`), to add it where
    npuls(k+1) < 0 is what the table means, as long as the axis runs the way it is commanded to.

    `gain` is kp, `speed_gain` kv.
    """

    gain: Gain = 0.7
    speed_gain: Gain = 1.0
    reads_encoder: ClassVar[bool] = True
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"gain": (0.1, 0.3, 0.5, 0.7, 0.9), "speed_gain": (0.5, 1.0)}

    def __post_init__(self) -> None:
        for name in ("gain", "speed_gain"):
            object.__setattr__(
                self, name, check_gain("closed-error-speed", name, getattr(self, name), _ADVICE)
            )

    @property
    def name(self) -> str:
        return f"closed-error-speed kp={format_gain(self.gain)} kv={format_gain(self.speed_gain)}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        target = self.gain * (reference.ang(k + 1) - feedback.position)
        top = self.speed_gain * (reference.npuls(k + 1) - feedback.speed)
        return TAMove(target, reference.npuls(k), top, reference.dt, 0.0)
