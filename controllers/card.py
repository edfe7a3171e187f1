"""The virtual motion card: commands, position counters, and why it refuses.

A command addresses all channels at once, one value per channel (n,): the host writes them one after another and starts
them together. Positions are pulses of the step output, positive where the axis' own coordinate grows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from controllers.profile import Profile, standstill, trapezoid
from kinematics.array import Array, frozen
from kinematics.errors import MotionError

COUNTER = (-(2**27), 2**27 - 1)
"""Range of the 28-bit position counters [Sahbaz 2007, Appendix A]."""
SPEED_STEPS = 65535
"""Largest value of the 16-bit speed registers; the smallest is 1."""


class Refused(MotionError):
    """A command that the card does not take."""


@dataclass(frozen=True, slots=True)
class Card:
    """A model of motion card; its figures are those of [Sahbaz 2007, Appendix A].

    max_speed     pulses/s that a channel can emit at most
    clock_hz      reference clock: a pulse falls on one of its ticks
    while_moving  what a command does that arrives during a move: "replace" it from the command position of that
                  instant, or "queue" behind it (each channel begins when its own move ends)
    """

    name: str
    max_speed: float
    clock_hz: int
    while_moving: Literal["replace", "queue"] = "replace"

    @property
    def least_speed(self) -> float:
        """Pulses/s of one step of the speed register, whose range is the card's whole range."""
        return self.max_speed / SPEED_STEPS


PCI_8132 = Card("PCI-8132", 2.4e6, 9_830_400)
PCI_8164 = Card("PCI-8164", 6.55e6, 19_660_800)


@dataclass(frozen=True, slots=True)
class TAMove:
    """Trapezoidal move to an absolute position, one value per channel.

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

    position    (n,) pulses; rounded to whole ones here
    start_speed, max_speed  (n,) pulses/s
    tacc, tdec  s
    """

    position: Array
    start_speed: Array
    max_speed: Array
    tacc: float
    tdec: float

    def __post_init__(self) -> None:
        target = np.rint(np.atleast_1d(np.asarray(self.position, float)))
        object.__setattr__(self, "position", frozen(target))
        for name in ("start_speed", "max_speed"):
            object.__setattr__(
                self, name, frozen(np.broadcast_to(np.asarray(getattr(self, name), float), target.shape))
            )


Move = TAMove
"""What a law may send."""


@dataclass(frozen=True, slots=True)
class CardState:
    """Moves under way, the running one first and those queued behind, and the pulses (n,) fired before them."""

    moves: tuple[Profile, ...]
    fired: np.ndarray

    def position(self, t: ArrayLike) -> Array:
        """Command positions (N, n) in pulses at instants t (N,), none before the last command."""
        instants = np.atleast_1d(np.asarray(t, float))
        position = self.moves[0].position(instants)
        for move in self.moves[1:]:
            position = np.where(instants[:, None] >= move.begin, move.position(instants), position)
        return position

    def counter(self, t: ArrayLike) -> np.ndarray:
        """Position counters (N, n), int64, at instants t (N,), none before the last command."""
        instants = np.atleast_1d(np.asarray(t, float))
        counter = self.moves[0].counter(instants)
        for move in self.moves[1:]:
            counter = np.where(instants[:, None] >= move.begin, move.counter(instants), counter)
        return counter

    def pulses(self, t: float) -> np.ndarray:
        """Pulses (n,) fired until t in either direction, int64."""
        return np.asarray(self.fired + _pulses(self.moves, t))


def at_rest(counts: ArrayLike) -> CardState:
    """The card before its first command, its counters at `counts` (n,)."""
    counts = np.atleast_1d(np.asarray(counts, np.int64))
    return CardState((standstill(counts),), frozen(np.zeros_like(counts)))


def send(card: Card, state: CardState, move: Move, t: float) -> CardState:
    """The card's state after a command sent at t (s), no earlier than the one before. Raises Refused, with reasons."""
    _check(card, move, len(state.fired))
    v0, v1 = (np.maximum(np.abs(speed), card.least_speed) for speed in (move.start_speed, move.max_speed))
    if card.while_moving == "queue":
        last = state.moves[-1]
        begin, start, count = np.maximum(last.end, t), last.target.astype(float), last.target
        waiting = tuple(old for old in state.moves if (old.end > t).any())
    else:
        begin, start, count = np.full(len(v0), t), state.position(t)[0], state.counter(t)[0]
        waiting = ()
    fired = state.pulses(t) - _pulses(waiting, t)
    # a ramp within one tick of the clock is none
    tacc, tdec = (0.0 if seconds * card.clock_hz < 1 else seconds for seconds in (move.tacc, move.tdec))
    new = trapezoid(begin, start, count, move.position.astype(np.int64), v0, v1, tacc, tdec)
    return CardState((*waiting, new), frozen(fired))


def pulse_ticks(card: Card, move: Profile, channel: int) -> np.ndarray:
    """Ticks (pulses,) of the card's clock at which a channel's pulses fire, int64, nearest to the exact instants."""
    return np.rint(move.pulse_times(channel) * card.clock_hz).astype(np.int64)


def _pulses(moves: tuple[Profile, ...], t: float) -> np.ndarray:
    now = np.array([t])
    return np.asarray(sum(np.abs(move.counter(now)[0] - move.count) for move in moves), np.int64)


def _check(card: Card, move: Move, channels: int) -> None:
    if len(move.position) != channels:
        raise Refused(f"{card.name}: a command for {len(move.position)} channels cannot start {channels} channels")
    for what, seconds in (("acceleration", move.tacc), ("deceleration", move.tdec)):
        if not 0 <= seconds < float("inf"):
            raise Refused(f"{card.name}: {what} time {seconds} s must be zero or more")
    low, high = COUNTER
    inside = (move.position >= low) & (move.position <= high)
    _refuse(card, "position", move.position, inside, f"{low} … {high} pulses", "28-bit position counter")
    for what, speed in (("start speed", move.start_speed), ("max speed", move.max_speed)):
        inside = np.abs(speed) <= card.max_speed
        _refuse(card, what, speed, inside, f"±{card.max_speed:.10g} pulses/s", "pulse generator")


def _refuse(card: Card, what: str, values: Array, fine: np.ndarray, limit: str, owner: str) -> None:
    if not fine.all():
        channel = int(np.argmin(fine))
        raise Refused(
            f"{card.name}, channel {channel + 1}: {what} {values[channel]:.10g} is outside {limit} of the {owner}; "
            f"slow the motion down, or choose a card or a pulse that covers it"
        )
