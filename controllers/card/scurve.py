"""S-curve moves, absolute and relative."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.card.channels import Channels, Command, lanewise
from controllers.card.lanes import registers_of
from controllers.card.model import Refused
from controllers.card.profile import Profile
from controllers.card.steer import lock
from controllers.card.trapezoid import planned
from kinematics.array import Array


@dataclass(frozen=True, slots=True)
class SAMove(Command):
    """S-curve move to an absolute position: a `TAMove` whose ramps begin and end with pieces of constant jerk.

    A ramp takes the same time and the same way as the straight one. Of its change of speed Δ the parts `curve` at both
    ends are bent: the rate rises to (Δ + 2 curve)/tacc within 2 curve/rate, holds, and falls. curve = 0, or half of Δ
    and more, bends all of it. Assumed: that reading of the card's "velocity interval of the S", and that a move too
    short for its speed keeps the greatest rate and the shape of its ramps, as they lower the top speed. It takes no
    change on the fly.

    position    (…) pulses; rounded to whole ones
    start_speed, max_speed  (…) pulses/s
    tacc, tdec  s
    curve_acc, curve_dec    pulses/s
    """

    position: Array
    start_speed: Array
    max_speed: Array
    tacc: float
    tdec: float
    curve_acc: float = 0.0
    curve_dec: float = 0.0

    def __post_init__(self) -> None:
        lanewise(self, "position", "start_speed", "max_speed")

    def moves(self, now: Channels) -> tuple[Profile, ...]:
        move = planned(self, now, now.target(np.rint(self.position)))
        return (curved(now, move, self.curve_acc, self.curve_dec),)


@dataclass(frozen=True, slots=True)
class SRMove(Command):
    """S-curve move by a distance (…), pulses, from the counter of the instant: otherwise as `SAMove`."""

    distance: Array
    start_speed: Array
    max_speed: Array
    tacc: float
    tdec: float
    curve_acc: float = 0.0
    curve_dec: float = 0.0

    def __post_init__(self) -> None:
        lanewise(self, "distance", "start_speed", "max_speed")

    def moves(self, now: Channels) -> tuple[Profile, ...]:
        return (curved(now, planned(self, now, now.after(self.distance)), self.curve_acc, self.curve_dec),)


def curved(now: Channels, move: Profile, curve_acc: float, curve_dec: float) -> Profile:
    """A trapezoidal move with its ramps bent. Raises Refused for intervals that are none."""
    for curve in (curve_acc, curve_dec):
        if not 0 <= curve < float("inf"):
            raise Refused(f"{now.card.name}: velocity interval {curve} pulses/s of the S must be zero or more")
    low, top = registers_of(move)[:2]
    change, none, pieces = np.abs(top - low), np.zeros_like(low), []
    for length, speed, rate, curve in zip(
        move.lengths, move.speeds, move.rates, (curve_acc, 0.0, curve_dec), strict=True
    ):
        share = np.minimum(curve / np.where(change > 0, change, 1.0), 0.5) if curve else np.full_like(change, 0.5)
        most = rate * (1 + 2 * share)
        bent = length * 2 * share / (1 + 2 * share)
        jerk = np.where(bent > 0, most / np.where(bent > 0, bent, 1.0), 0.0)
        straight = length - 2 * bent
        rising = speed + most * bent / 2
        pieces += [
            (bent, speed, none, jerk),
            (straight, rising, most, none),
            (bent, rising + most * straight, most, -jerk),
        ]
    lengths, speeds, rates, jerks = (np.stack(rows) for rows in zip(*pieces, strict=True))
    return lock(replace(move, lengths=lengths, speeds=speeds, rates=rates, jerks=jerks))
