"""Velocity moves, and the change of speed on the fly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card.channels import Channels, lanewise
from controllers.card.profile import Profile
from kinematics.array import Array


@dataclass(frozen=True, slots=True)
class TVMove:
    """Velocity move without a target: the speed runs from `start_speed` to `speed` linearly within `tacc`, and holds.

    Assumed: speeds are signed, positive where the axis' own coordinate grows; where the two signs differ, the channel
    ramps down to a stop and turns, at the one rate (speed − start_speed)/tacc; a speed of zero is a stop, of which the
    channel keeps its share of a pulse; it runs from the command position of the instant, as `TAMove` does.

    start_speed, speed  (…) pulses/s;  tacc  s
    """

    start_speed: Array
    speed: Array
    tacc: float
    waits: ClassVar[bool] = True

    def __post_init__(self) -> None:
        lanewise(self, "start_speed", "speed")

    def move(self, now: Channels) -> Profile:
        v0, v1 = now.signed("start speed", self.start_speed), now.signed("speed", self.speed)
        return ramp(now.begin, now.position, v0, v1, now.ramp("acceleration", self.tacc))


@dataclass(frozen=True, slots=True)
class VChange:
    """Change of speed on the fly: from the speed of the instant to `speed` linearly within `tacc`; otherwise `TVMove`.

    speed  (…) pulses/s;  tacc  s
    """

    speed: Array
    tacc: float
    waits: ClassVar[bool] = False

    def __post_init__(self) -> None:
        lanewise(self, "speed")

    def move(self, now: Channels) -> Profile:
        tacc = now.ramp("acceleration", self.tacc)
        return ramp(now.begin, now.position, now.speed, now.signed("speed", self.speed), tacc)


def ramp(begin: Array, start: Array, v0: Array, v1: Array, tacc: float) -> Profile:
    """Speed from v0 to v1 (signed) linearly within tacc, then held, for ever unless v1 = 0; parted where it turns."""
    turns = v0 * v1 < 0
    first = np.where(turns, tacc * v0 / np.where(turns, v0 - v1, 1.0), tacc)
    rate = (v1 - v0) / (tacc or 1.0)
    lengths = np.stack((first, tacc - first, np.where(v1 == 0, 0.0, np.inf)))
    speeds, rates = np.stack((v0, np.where(turns, 0.0, v1), v1)), np.stack((rate, rate, np.zeros_like(rate)))
    return Profile(begin, start, start + tacc * (v0 + v1) / 2, lengths, speeds, rates)
