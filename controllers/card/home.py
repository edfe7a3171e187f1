"""Home return: the counter's zero is brought to a switch, or to the index behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.card.channels import Channels, Command, lanewise
from controllers.card.model import Refused
from controllers.card.profile import Profile, standstill
from controllers.card.steer import lock
from controllers.card.trapezoid import trapezoid
from kinematics.array import Array


@dataclass(frozen=True, slots=True)
class Home(Command):
    """Home return, one value per lane: approach, stop, back off, latch zero.

    1. approach  in `direction`, from `start_speed` up to `speed` within `tacc`, until the switch closes;
    2. stop      down to the start speed at the same rate, at once then, beyond the switch;
    3. back off  at `creep` until the switch opens, and on to the first index pulse from there (where it opens, if there
                 is one);
    4. zero      there it stops dead, and the counter is set to 0.

    The cards' documents name the switch, the index and thirteen modes, not their steps: this is one of our own, for any
    card; `HomeMode` has the numbered ones as they are remembered. Assumed: a switch that stays closed beyond its edge,
    and no delay between the steps. A channel that begins on the switch skips 1 and 2. Takes no change on the fly; soft
    limits do not hold.

    switch     (…) whole pulses by the coordinates of power-up (`Profile.zero`), where the switch closes
    direction  (…) +1 or −1, where it lies
    start_speed, speed, creep  (…) pulses/s
    tacc       s
    index, index_spacing  whole pulses by the same coordinates, of one index pulse, and between two; None: no index
    """

    switch: Array
    direction: Array
    start_speed: Array
    speed: Array
    creep: Array
    tacc: float
    index: Array | None = None
    index_spacing: int | None = None

    def __post_init__(self) -> None:
        names = ("switch", "direction", "start_speed", "speed", "creep")
        lanewise(self, *names, *(("index",) if self.index is not None else ()))

    @property
    def limited(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[Profile, ...]:
        if (self.index is None) != (self.index_spacing is None) or (self.index_spacing or 1) < 1:
            raise Refused(
                f"{now.card.name}: home return: an index needs a spacing of whole pulses above zero, not "
                f"{self.index_spacing}"
            )
        sign = np.broadcast_to(self.direction, now.due.shape)
        now.forbid(np.abs(sign) != 1, "home return: direction must be +1 or −1")
        v0, v1, creep = (
            now.magnitude(what, speed)
            for what, speed in (("start speed", self.start_speed), ("speed", self.speed), ("creep", self.creep))
        )
        tacc = now.ramp("acceleration", self.tacc)
        zero = np.zeros(now.due.shape) if now.running.zero is None else now.running.zero
        edge = now.target(np.rint(self.switch) - zero)
        behind = np.zeros(now.due.shape)
        if self.index is not None and self.index_spacing is not None:
            behind = np.mod((np.rint(self.switch) - np.rint(self.index)) * sign, self.index_spacing)
        out = approach(now, (edge - now.position) * sign, sign, v0, v1, tacc)
        place = edge - sign * behind
        back = trapezoid(out.end, out.target, place, creep, creep, 0.0, 0.0)
        there = replace(standstill(np.zeros(now.due.shape)), begin=back.end, zero=zero + place)
        return (*(replace(lock(move), zero=zero) for move in (out, back)), there)


def approach(
    now: Channels, distance: Array, sign: Array, v0: Array, v1: Array, tacc: float, *, dead: bool = False
) -> Profile:
    """Up to a switch, and beyond it down to the start speed, or `dead` on it; nothing in lanes that are on it."""
    open_ = distance > 0
    way = np.where(open_, distance, 0.0)
    rate = (v1 - v0) / (tacc or 1.0)
    short = way < (v0 + v1) / 2 * tacc
    top = np.where(short, np.sqrt(np.maximum(v0 * v0 + 2 * way * rate, 0.0)), v1)
    up = np.where(short, 2 * way / (v0 + top), tacc)
    held = np.where(short, 0.0, (way - (v0 + v1) / 2 * tacc) / v1)
    down = np.where(open_ & (not dead), up, 0.0)
    lengths = np.stack((np.where(open_, up, 0.0), np.where(open_, held, 0.0), down))
    speeds, rates = np.stack((v0, top, top)) * sign, np.stack((rate, np.zeros_like(rate), -rate)) * sign
    target = now.position + sign * (way + np.where(open_, (v0 + top) / 2 * down, 0.0))
    return Profile(now.begin, now.position, target, lengths, speeds, rates)
