"""The commands of the motion card, as values.

A command addresses all channels at once, one value per lane: the host writes them one after another and starts them
together. Lanes (…) are channels (n,), or runs by channels (B, n). Positions are pulses of the step output, positive
where the axis' own coordinate grows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.array import Array, frozen


@dataclass(frozen=True, slots=True)
class TAMove:
    """Trapezoidal move to an absolute position, one value per lane.

    Speeds count as magnitudes; the direction is the sign of target − command position. The speed runs from
    `start_speed` to `max_speed` linearly within `tacc` (downwards too, when the start speed is the larger), holds, and
    runs back to the start speed within `tdec` before the target. tdec = 0 stops dead on the target. The channel then
    waits there.

    The card's documents do not say all of this. Assumed are:
    - magnitudes, the downward ramp, the dead stop and the waiting;
    - acceleration is given as time for the full change of speed: a move too short for it keeps the rate and lowers the
      top speed;
    - a command during a move replaces it from the command position of that instant, which keeps its share of a pulse
      (the pulse generator's phase), and starts at its own start speed at once; `Card.while_moving = "queue"` is the
      other reading;
    - a speed below one step of the speed register runs at one step, so every move arrives: in a law that commands zero
      speed at its last sample, this brings the rounding of the last pulse home;
    - a command takes effect at the instant it is sent.

    position    (…) pulses; rounded to whole ones here
    start_speed, max_speed  (…) pulses/s
    tacc, tdec  s
    """

    position: Array
    start_speed: Array
    max_speed: Array
    tacc: float
    tdec: float

    def __post_init__(self) -> None:
        _whole(self, "position")


@dataclass(frozen=True, slots=True)
class TRMove:
    """Trapezoidal move by a distance from the command position of the instant: otherwise as `TAMove`.

    distance    (…) pulses; the target is the whole pulse nearest to counter + distance
    start_speed, max_speed  (…) pulses/s
    tacc, tdec  s
    """

    distance: Array
    start_speed: Array
    max_speed: Array
    tacc: float
    tdec: float

    def __post_init__(self) -> None:
        _whole(self, "distance")


Command = TAMove | TRMove
"""What a law may send."""


def _whole(command: Command, name: str) -> None:
    target = np.rint(np.atleast_1d(np.asarray(getattr(command, name), float)))
    object.__setattr__(command, name, frozen(target))
    for speed in ("start_speed", "max_speed"):
        object.__setattr__(
            command, speed, frozen(np.broadcast_to(np.asarray(getattr(command, speed), float), target.shape))
        )
