"""Velocity moves, and the change of speed on the fly.

The change of a move's target on the fly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.card.channels import Channels, Command, broadcast_lanes
from controllers.card.model import Refused
from controllers.card.profile import MoveProfile, merge_lanes, registers_of
from controllers.card.trapezoid import is_locked, is_steerable, steer_move
from kinematics.foundation.arrays import Array


@dataclass(frozen=True, slots=True)
class TVMove(Command):
    """Velocity move without a target: the speed runs from `start_speed` to `speed` linearly within `tacc`, and holds.

    Assumed: speeds are signed, positive where the axis' own coordinate grows; where the two signs differ, the channel
    ramps down to a stop and turns, at the one rate (speed − start_speed)/tacc; a speed of zero is a stop, of which the
    channel keeps its share of a pulse; it runs from the command position of the instant, as `TAMove` does. A move that
    is queued behind it begins when it is at rest. With `Card.start_from = "current"` it begins at the speed of the
    instant instead of `start_speed`, where that leads the same way.

    start_speed, speed  (…) pulses/s;  tacc  s
    """

    start_speed: Array
    speed: Array
    tacc: float

    def __post_init__(self) -> None:
        broadcast_lanes(self, "start_speed", "speed")

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        v0, v1 = start_and_end_speeds(now, self.start_speed, self.speed)
        return (ramp(now.begin, now.position, v0, v1, now.ramp("acceleration", self.tacc)),)


@dataclass(frozen=True, slots=True)
class VChange(Command):
    """Change of speed on the fly: from the speed of the instant to `speed` linearly within `tacc`.

    Of a velocity move it makes another one, see `TVMove`. A trapezoidal move keeps its target, its start speed and the
    rate of its ramp down; `speed` is its new top speed, a magnitude. Drops what is queued. Assumed: it stops dead on
    the target where it cannot ramp down in time; a channel that stands begins a velocity move from rest. Refused while
    a channel runs an S-curve, an interpolation, a dwell or a home return.

    speed  (…) pulses/s;  tacc  s
    """

    speed: Array
    tacc: float

    def __post_init__(self) -> None:
        broadcast_lanes(self, "speed")

    @property
    def waits(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        tacc, speed = now.ramp("acceleration", self.tacc), now.signed("speed", self.speed)
        free = ramp(now.begin, now.position, now.speed, speed, tacc)
        now.forbid(is_locked(now), "only a velocity move or a trapezoidal move takes a change of speed; stop it first")
        bound = is_steerable(now)
        if not bound.any():
            return (free,)
        low, _, _, down = registers_of(now.running)
        top = now.magnitude("speed", self.speed)
        change = np.abs(top - np.abs(now.speed))
        up = np.where(change > 0, change, np.inf) / tacc if tacc else np.full_like(low, np.inf)
        found = steer_move(now, now.running.target, np.stack((low, top, up, down)), overshoots=False)
        return (merge_lanes(found, free, bound),)


def start_and_end_speeds(now: Channels, start_speed: Array, speed: Array) -> tuple[Array, Array]:
    """Speeds (…), signed, at which a velocity move begins and to which it leads."""
    v0, v1 = now.signed("start speed", start_speed), now.signed("speed", speed)
    return np.where(now.goes_on(np.where(v1 == 0, v0, v1)), now.speed, v0), v1


def ramp(begin: Array, start: Array, v0: Array, v1: Array, tacc: float) -> MoveProfile:
    """Speed from v0 to v1 (signed) linearly within tacc, then held, for ever unless v1 = 0; parted where it turns."""
    turns = v0 * v1 < 0
    first = np.where(turns, tacc * v0 / np.where(turns, v0 - v1, 1.0), tacc)
    rate = (v1 - v0) / (tacc or 1.0)
    lengths = np.stack((first, tacc - first, np.where(v1 == 0, 0.0, np.inf)))
    speeds, rates = np.stack((v0, np.where(turns, 0.0, v1), v1)), np.stack((rate, rate, np.zeros_like(rate)))
    return MoveProfile(begin, start, start + tacc * (v0 + v1) / 2, lengths, speeds, rates)


@dataclass(frozen=True, slots=True)
class PChange(Command):
    """A new target for the trapezoidal move under way, on the fly; on the 8164 alone [Sahbaz 2007, Appendix A].

    Assumed: top speed, start speed and the rates of both ramps stay those of the move; a channel that ramps down
    already speeds up again; one that would pass the new target at the rate of its ramp down, or runs away from it,
    ramps down to its start speed, and returns from there. Drops what is queued. Refused where no such move is under
    way.

    position  (…) pulses, absolute; rounded to whole ones
    """

    position: Array

    def __post_init__(self) -> None:
        broadcast_lanes(self, "position")

    @property
    def waits(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        if not now.card.moves_target:
            raise Refused(f"{now.card.name} cannot change a position on the fly; send a new move, or use a PCI-8164")
        now.forbid(~is_steerable(now), "no trapezoidal move is under way whose position could change; send a new move")
        target = now.target(np.rint(self.position))
        return (steer_move(now, target, registers_of(now.running), overshoots=True),)
