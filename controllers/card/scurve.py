"""S-curve moves: absolute, relative, and without a target."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.card.channels import Channels, Command, broadcast_lanes
from controllers.card.model import Refused
from controllers.card.profile import MoveProfile, registers_of
from controllers.card.trapezoid import lock_move, plan_move, start_and_end_speeds
from kinematics.foundation.arrays import Array

MIN_BEND_TIME = 1e-12
"""s: a bent piece of a ramp that is shorter than any clock's tick is none, and its jerk would be
beyond all numbers.
"""


@dataclass(frozen=True, slots=True)
class SAMove(Command):
    """S-curve move to an absolute position: a `TAMove` whose ramps begin and end with pieces of
    constant jerk.

    A ramp takes the same time and the same way as the straight one. Of its change of speed Δ the
    parts `curve` at both ends are bent: the rate rises to (Δ + 2 curve)/tacc within 2 curve/rate,
    holds, and falls. curve = 0, or half of Δ and more, bends all of it. Assumed: that reading of
    the card's "velocity interval of the S", and that a move too short for its speed keeps the
    greatest rate and the shape of its ramps, as they lower the top speed. It takes no change on the
    fly.

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
        broadcast_lanes(self, "position", "start_speed", "max_speed")

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        move = plan_move(self, now, now.target(np.rint(self.position)))
        return (curve_ramps(now, move, self.curve_acc, self.curve_dec),)


@dataclass(frozen=True, slots=True)
class SRMove(Command):
    """S-curve move by a distance (…), pulses, from the counter of the instant: otherwise as
    `SAMove`.
    """

    distance: Array
    start_speed: Array
    max_speed: Array
    tacc: float
    tdec: float
    curve_acc: float = 0.0
    curve_dec: float = 0.0

    def __post_init__(self) -> None:
        broadcast_lanes(self, "distance", "start_speed", "max_speed")

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        return (
            curve_ramps(
                now,
                plan_move(self, now, now.add_distance(self.distance)),
                self.curve_acc,
                self.curve_dec,
            ),
        )


@dataclass(frozen=True, slots=True)
class SVMove(Command):
    """S-curve velocity move without a target: a `TVMove` whose ramp begins and ends with pieces of
    constant jerk.

    `sv_move` of the 8164, `start_s_move` of the 8132, which the source calls an S profile of
    constant motion [Sahbaz 2007, Table A.1]. The ramp takes the time and the way of the straight
    one, bent as those of `SAMove`. Assumed: all that `TVMove` assumes of signs, stops and what
    begins it; and that it takes a change of speed on the fly as a `TVMove` does, by a straight ramp
    from the speed of the instant.

    start_speed, speed  (…) pulses/s, signed;  tacc  s;  curve_acc  pulses/s
    """

    start_speed: Array
    speed: Array
    tacc: float
    curve_acc: float = 0.0

    def __post_init__(self) -> None:
        broadcast_lanes(self, "start_speed", "speed")

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        v0, v1 = start_and_end_speeds(now, self.start_speed, self.speed)
        tacc = now.ramp("acceleration", self.tacc)
        _refuse_interval(now, self.curve_acc)
        change, none = v1 - v0, np.zeros_like(v0)
        bent = _bend_ramp(
            np.full_like(v0, tacc),
            v0,
            change / (tacc or 1.0),
            _share(self.curve_acc, np.abs(change)),
        )
        pieces = [part for piece in bent for part in _split_at_rest(*piece)]
        pieces.append((np.where(v1 == 0, 0.0, np.inf), v1, none, none))
        lengths, speeds, rates, jerks = (np.stack(rows) for rows in zip(*pieces, strict=True))
        return (
            MoveProfile(
                now.begin,
                now.position,
                now.position + tacc * (v0 + v1) / 2,
                lengths,
                speeds,
                rates,
                jerks,
            ),
        )


def curve_ramps(
    now: Channels, move: MoveProfile, curve_acc: float, curve_dec: float
) -> MoveProfile:
    """A trapezoidal move with its ramps bent. Raises Refused for intervals that are none."""
    for curve in (curve_acc, curve_dec):
        _refuse_interval(now, curve)
    low, top = registers_of(move)[:2]
    change, pieces = np.abs(top - low), []
    for length, speed, rate, curve in zip(
        move.lengths, move.speeds, move.rates, (curve_acc, 0.0, curve_dec), strict=True
    ):
        pieces += _bend_ramp(length, speed, rate, _share(curve, change))
    lengths, speeds, rates, jerks = (np.stack(rows) for rows in zip(*pieces, strict=True))
    return lock_move(replace(move, lengths=lengths, speeds=speeds, rates=rates, jerks=jerks))


Pieces = tuple[Array, Array, Array, Array]
"""Length, speed, rate and jerk of a piece, lane by lane."""


def _refuse_interval(now: Channels, curve: float) -> None:
    if not 0 <= curve < float("inf"):
        raise Refused(
            f"{now.card.name}: velocity interval {curve} pulses/s of the S must be zero or more"
        )


def _share(curve: float, change: Array) -> Array:
    """The part of a change of speed that is bent at either end of a ramp."""
    return (
        np.minimum(curve / np.where(change > 0, change, 1.0), 0.5)
        if curve
        else np.full_like(change, 0.5)
    )


def _bend_ramp(length: Array, speed: Array, rate: Array, share: Array) -> list[Pieces]:
    """A straight ramp as three pieces of the same time and way: the rate rises, holds, and
    falls.
    """
    none = np.zeros_like(speed)
    most = rate * (1 + 2 * share)
    bent = length * 2 * share / (1 + 2 * share)
    bent = np.where(bent > MIN_BEND_TIME, bent, 0.0)
    jerk = np.where(bent > 0, most / np.where(bent > 0, bent, 1.0), 0.0)
    straight = length - 2 * bent
    rising = speed + most * bent / 2
    return [
        (bent, speed, none, jerk),
        (straight, rising, most, none),
        (bent, rising + most * straight, most, -jerk),
    ]


def _split_at_rest(length: Array, speed: Array, rate: Array, jerk: Array) -> tuple[Pieces, Pieces]:
    """A piece in two, where its speed passes zero: there τ = −2 v/(a ± √(a² − 2 j v)), of the sign
    of its change.
    """
    last = speed + length * (rate + length * jerk / 2)
    turns = speed * last < 0
    root = np.sqrt(np.maximum(rate * rate - 2 * jerk * speed, 0.0))
    slope = rate + np.where(last < speed, -root, root)
    first = np.where(turns, np.clip(-2 * speed / np.where(turns, slope, 1.0), 0.0, length), length)
    return (
        (first, speed, rate, jerk),
        (length - first, np.where(turns, 0.0, last), rate + first * jerk, jerk),
    )
