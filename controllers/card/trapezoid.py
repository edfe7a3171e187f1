"""Trapezoidal moves, absolute and relative, velocity moves, and changes of speed and target on the
fly.

A change takes a move from wherever it is to a target, at other speeds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from controllers.card.channels import Channels, Command, broadcast_lanes
from controllers.card.model import Refused
from controllers.card.profile import MoveProfile, merge_lanes, registers_of
from kinematics.foundation.arrays import Array


def is_locked(now: Channels) -> np.ndarray:
    """(…) whether a move is under way that takes no change."""
    return np.asarray(np.isinf(registers_of(now.running)[0]) & (now.running.end > now.begin))


def is_steerable(now: Channels) -> np.ndarray:
    """(…) whether a trapezoidal move is under way."""
    return np.asarray(np.isfinite(registers_of(now.running)[0]) & (now.running.end > now.begin))


def lock_move(move: MoveProfile) -> MoveProfile:
    """The move as one that takes no change on the fly."""
    return replace(move, registers=np.full((4, *move.begin.shape), np.inf))


def steer_move(now: Channels, target: Array, registers: Array, *, overshoots: bool) -> MoveProfile:
    """From position and speed of the instant to a target at registers (start speed u, top speed w,
    rates up and down).

    Where the way is too short to ramp down to u at the rate of the ramp down, or leads back: the
    channel ramps down, and returns as a move that starts at u (`overshoots`); or it goes on to the
    target, and stops dead there.
    """
    # lanes without registers of their own are not looked at: any numbers serve
    low, top, up, down = np.where(np.isfinite(registers[0]), registers, 1.0)
    way, fast = target - now.position, np.abs(now.speed)
    toward = np.where(way < 0, -1.0, 1.0) * now.speed
    braking = np.maximum(fast * fast - low * low, 0.0) / (2 * down)
    over = ((toward < 0) | (braking > np.abs(way))) if overshoots else np.zeros(way.shape, bool)
    time = np.where(over, np.maximum(fast - low, 0.0) / down, 0.0)
    turn = now.position + np.where(over, np.sign(now.speed) * braking, 0.0)
    sign = np.where(target - turn < 0, -1.0, 1.0)
    lengths, speeds, rates = _plan_pieces(
        np.abs(target - turn), np.where(over, low, fast), top, low, up, down
    )
    # infinite rates come with ramps of no length
    brake = -np.sign(now.speed) * np.where(np.isfinite(down), down, 0.0)
    return MoveProfile(
        now.begin,
        now.position,
        target,
        np.concatenate([time[None], lengths]),
        np.concatenate([now.speed[None], sign * speeds]),
        np.concatenate([brake[None], sign * rates]),
        registers=registers,
    )


def _plan_pieces(
    way: Array, v: Array, w: Array, u: Array, up: Array, down: Array
) -> tuple[Array, Array, Array]:
    """Lengths, speeds and rates of three pieces over a way: from speed v to w at rate `up`, held,
    to u at rate `down`.

    Where that does not fit, the ramps meet at vp: rising, vp² = (2D + v²/up + u²/down)/(1/up +
    1/down); falling to w < v more slowly than the ramp down, vp² = (v²/up − u²/down − 2D)/(1/up −
    1/down). Where even braking at once is too late, or the slower ramp is the ramp down, it brakes
    at once, as far as the way goes.
    """
    slow_up, slow_down = 1 / up, 1 / down
    first, last = np.abs(w * w - v * v) * slow_up / 2, np.abs(w * w - u * u) * slow_down / 2
    fits = first + last <= way
    rising = w >= v
    sum_, gap = slow_up + slow_down, slow_up - slow_down
    meet = np.where(
        rising,
        (2 * way + v * v * slow_up + u * u * slow_down) / np.where(sum_ > 0, sum_, 1.0),
        np.where(gap > 0, v * v * slow_up - u * u * slow_down - 2 * way, 0.0)
        / np.where(gap > 0, gap, 1.0),
    )
    inside = np.where(rising, meet >= v * v, (gap > 0) & (meet <= v * v) & (meet >= w * w))
    top = np.where(fits, w, np.where(inside, np.sqrt(np.maximum(meet, 0.0)), v))
    first = np.minimum(np.abs(top * top - v * v) * slow_up / 2, way)
    left = way - first
    last = np.where(fits, last, left)
    fall = np.where(u > top, 1.0, -1.0)
    rate = fall * np.where(np.isfinite(down), down, 0.0)
    final = np.sqrt(np.maximum(top * top + 2 * rate * last, 0.0))
    held = np.where(fits, left - last, 0.0)
    some = np.where(top + final > 0, top + final, 1.0)
    lengths = np.stack(
        (np.abs(top - v) * slow_up, held / np.where(top > 0, top, 1.0), 2 * last / some)
    )
    rise = np.where(np.isfinite(up), np.where(top >= v, up, -up), 0.0)
    return lengths, np.stack((v, top, top)), np.stack((rise, np.zeros_like(rise), rate))


@dataclass(frozen=True, slots=True)
class TAMove(Command):
    """Trapezoidal move to an absolute position, one value per lane.

    Speeds count as magnitudes; the direction is the sign of target − command position. The speed
    runs from `start_speed` to `max_speed` linearly within `tacc` (downwards too, when the start
    speed is the larger), holds, and runs back to the start speed within `tdec` before the target.
    tdec = 0 stops dead on the target. The channel then waits there.

    The card's documents do not say all of this. Assumed are:
    - magnitudes, the downward ramp, the dead stop and the waiting;
    - acceleration is given as time for the full change of speed: a move too short for it keeps the
      rate and lowers the top speed; with `Card.short_moves = "keep time"` it keeps the time;
    - a command during a move replaces it from the command position of that instant, which keeps its
      share of a pulse (the pulse generator's phase), and starts at its own start speed at once;
      `Card.while_moving = "queue"` is one other reading, `Card.start_from = "current"` another: the
      speed of that instant instead, which becomes `max_speed` within `tacc`, where it leads the
      same way; where it is too late to ramp down, the channel stops dead on the target;
    - a speed below one step of the speed register runs at one step, so every move arrives, if
      slowly: in a law that commands zero speed at its last sample, what rounding left undone creeps
      home;
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
        broadcast_lanes(self, "position", "start_speed", "max_speed")

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        return (continue_move(self, now, now.target(np.rint(self.position))),)


@dataclass(frozen=True, slots=True)
class TRMove(Command):
    """Trapezoidal move by a distance from the command position of the instant: otherwise as
    `TAMove`.

    distance    (…) pulses, rounded to whole ones; the target is that far from the counter
    start_speed, max_speed  (…) pulses/s
    tacc, tdec  s
    """

    distance: Array
    start_speed: Array
    max_speed: Array
    tacc: float
    tdec: float

    def __post_init__(self) -> None:
        broadcast_lanes(self, "distance", "start_speed", "max_speed")

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        return (continue_move(self, now, now.add_distance(self.distance)),)


class Ramps(Protocol):
    """What trapezoidal and S-curve moves say of their speed."""

    @property
    def start_speed(self) -> Array: ...
    @property
    def max_speed(self) -> Array: ...
    @property
    def tacc(self) -> float: ...
    @property
    def tdec(self) -> float: ...


def continue_move(command: Ramps, now: Channels, target: Array) -> MoveProfile:
    """The trapezoidal move of a command, from the speed of the instant in lanes where the card says
    so.
    """
    move = plan_move(command, now, target)
    on = now.goes_on(target - now.position)
    if not on.any():
        return move
    low, top, _, down = registers_of(move)
    change, tacc = np.abs(top - np.abs(now.speed)), now.ramp("acceleration", command.tacc)
    up = np.where(change > 0, change, np.inf) / tacc if tacc else np.full_like(low, np.inf)
    return merge_lanes(
        steer_move(now, target, np.stack((low, top, up, down)), overshoots=False), move, on
    )


def plan_move(command: Ramps, now: Channels, target: Array) -> MoveProfile:
    """The trapezoidal move of a command to a target (…) that the counters hold."""
    v0, v1 = (
        now.magnitude("start speed", command.start_speed),
        now.magnitude("max speed", command.max_speed),
    )
    tacc, tdec = now.ramp("acceleration", command.tacc), now.ramp("deceleration", command.tdec)
    return trapezoid(now.begin, now.position, target, v0, v1, tacc, tdec, now.card.short_moves)


def trapezoid(
    begin: Array,
    start: Array,
    target: Array,
    v0: Array,
    v1: Array,
    tacc: float,
    tdec: float,
    short_moves: Literal["keep rate", "keep time"] = "keep rate",
) -> MoveProfile:
    """Speed from v0 to v1 linearly within tacc, held, and back to v0 within tdec before the target;
    there it stops.

    Over the distance D = |target − start| the ramps take d = (v0 + v1)/2 · (tacc + tdec). If D < d,
    the rates are kept and the top speed is what can be reached, vp² = v0² + 2 D (v1 − v0)/(tacc +
    tdec), each ramp being shortened by the factor λ = (vp − v0)/(v1 − v0) = 2 D/((tacc + tdec)(v0 +
    vp)). All of it holds for v1 < v0 too, where the ramp leads downwards. Where the time is kept,
    and v1 > v0: vp = 2 D/(tacc + tdec) − v0 at rates (vp − v0)/tacc, or v0 where that is less.

    v0, v1  (…) pulses/s > 0;  tacc, tdec  s ≥ 0;  the others as in `MoveProfile`
    """
    way = target - start
    sign, distance, ramps = np.where(way < 0, -1.0, 1.0), np.abs(way), tacc + tdec
    needed = (v0 + v1) / 2 * ramps
    short = distance < needed
    # without ramps no move is short: any divisor serves
    time = ramps if ramps > 0 else 1.0
    in_time = short & (v1 > v0) & (short_moves == "keep time")
    reached = np.sqrt(np.maximum(v0 * v0 + 2 * distance * (v1 - v0) / time, 0.0))
    reached = np.where(in_time, np.maximum(2 * distance / time - v0, v0), reached)
    top = np.where(short, reached, v1)
    share = np.where(short, 2 * distance / (time * (v0 + top)), 1.0)
    held = np.where(short, 0.0, (distance - needed) / v1)
    rise = sign * np.where(in_time, top - v0, v1 - v0)
    lengths = np.stack((share * tacc, held, share * tdec))
    speeds = np.stack((sign * v0, sign * top, sign * top))
    rates = np.stack((rise / (tacc or 1.0), np.zeros_like(held), -rise / (tdec or 1.0)))
    # without a ramp, or without a change of speed in it, a later change finds no rate: it is at
    # once (assumed)
    up, down = (
        np.where(rise == 0, np.inf, np.abs(rise) / seconds) if seconds else np.full_like(v1, np.inf)
        for seconds in (tacc, tdec)
    )
    registers = np.stack((v0, v1, up, down))
    return MoveProfile(begin, start, target, lengths, speeds, rates, registers=registers)


@dataclass(frozen=True, slots=True)
class TVMove(Command):
    """Velocity move without a target: the speed runs from `start_speed` to `speed` linearly within
    `tacc`, and holds.

    Assumed: speeds are signed, positive where the axis' own coordinate grows; where the two signs
    differ, the channel ramps down to a stop and turns, at the one rate (speed − start_speed)/tacc;
    a speed of zero is a stop, of which the channel keeps its share of a pulse; it runs from the
    command position of the instant, as `TAMove` does. A move that is queued behind it begins when
    it is at rest. With `Card.start_from = "current"` it begins at the speed of the instant instead
    of `start_speed`, where that leads the same way.

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

    Of a velocity move it makes another one, see `TVMove`. A trapezoidal move keeps its target, its
    start speed and the rate of its ramp down; `speed` is its new top speed, a magnitude. Drops what
    is queued. Assumed: it stops dead on the target where it cannot ramp down in time; a channel
    that stands begins a velocity move from rest. Refused while a channel runs an S-curve, an
    interpolation, a dwell or a home return.

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
        tacc, speed = now.ramp("acceleration", self.tacc), now.register_speed("speed", self.speed)
        free = ramp(now.begin, now.position, now.speed, speed, tacc)
        now.forbid(
            is_locked(now),
            "only a velocity move or a trapezoidal move takes a change of speed; stop it first",
        )
        bound = is_steerable(now)
        if not bound.any():
            return (free,)
        low, _, _, down = registers_of(now.running)
        top = now.magnitude("speed", self.speed)
        change = np.abs(top - np.abs(now.speed))
        up = np.where(change > 0, change, np.inf) / tacc if tacc else np.full_like(low, np.inf)
        found = steer_move(
            now, now.running.target, np.stack((low, top, up, down)), overshoots=False
        )
        return (merge_lanes(found, free, bound),)


def start_and_end_speeds(now: Channels, start_speed: Array, speed: Array) -> tuple[Array, Array]:
    """Speeds (…), signed, at which a velocity move begins and to which it leads."""
    v0, v1 = now.register_speed("start speed", start_speed), now.register_speed("speed", speed)
    return np.where(now.goes_on(np.where(v1 == 0, v0, v1)), now.speed, v0), v1


def ramp(begin: Array, start: Array, v0: Array, v1: Array, tacc: float) -> MoveProfile:
    """Speed from v0 to v1 (signed) linearly within tacc, then held, for ever unless v1 = 0; parted
    where it turns.
    """
    turns = v0 * v1 < 0
    first = np.where(turns, tacc * v0 / np.where(turns, v0 - v1, 1.0), tacc)
    rate = (v1 - v0) / (tacc or 1.0)
    lengths = np.stack((first, tacc - first, np.where(v1 == 0, 0.0, np.inf)))
    speeds, rates = (
        np.stack((v0, np.where(turns, 0.0, v1), v1)),
        np.stack((rate, rate, np.zeros_like(rate))),
    )
    return MoveProfile(begin, start, start + tacc * (v0 + v1) / 2, lengths, speeds, rates)


@dataclass(frozen=True, slots=True)
class PChange(Command):
    """A new target for the trapezoidal move under way, on the fly; on the 8164 alone [Sahbaz 2007,
    Appendix A].

    Assumed: top speed, start speed and the rates of both ramps stay those of the move; a channel
    that ramps down already speeds up again; one that would pass the new target at the rate of its
    ramp down, or runs away from it, ramps down to its start speed, and returns from there. Drops
    what is queued. Refused where no such move is under way.

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
            raise Refused(
                f"{now.card.name} cannot change a position on the fly; send a new move, or use a PCI-8164"
            )
        now.forbid(
            ~is_steerable(now),
            "no trapezoidal move is under way whose position could change; send a new move",
        )
        target = now.target(np.rint(self.position))
        return (steer_move(now, target, registers_of(now.running), overshoots=True),)
