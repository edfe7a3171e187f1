"""The card at work: moves under way, position counters, the pulses it fires, and what it does with a command."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from controllers.card.commands import Command, TAMove
from controllers.card.model import COUNTER, Card, Refused
from controllers.card.profile import Profile, standstill, trapezoid
from kinematics.array import Array, frozen


@dataclass(frozen=True, slots=True)
class CardState:
    """Moves under way, the running one first and those queued behind, and the pulses (…) fired before them.

    Lanes (…) are channels (n,), or runs by channels (B, n).
    """

    moves: tuple[Profile, ...]
    fired: np.ndarray

    def position(self, t: ArrayLike) -> Array:
        """Command positions (N, …) in pulses at instants t (N,), none before the last command."""
        instants = np.atleast_1d(np.asarray(t, float))
        position = self.moves[0].position(instants)
        for move in self.moves[1:]:
            position = np.where(_spread(instants, move) >= move.begin, move.position(instants), position)
        return position

    def counter(self, t: ArrayLike) -> np.ndarray:
        """Position counters (N, …), int64, at instants t (N,), none before the last command."""
        instants = np.atleast_1d(np.asarray(t, float))
        counter = self.moves[0].counter(instants)
        for move in self.moves[1:]:
            counter = np.where(_spread(instants, move) >= move.begin, move.counter(instants), counter)
        return counter

    def pulses(self, t: float) -> np.ndarray:
        """Pulses (…) fired until t in either direction, int64."""
        return np.asarray(self.fired + _pulses(self.moves, t))


def at_rest(counts: ArrayLike) -> CardState:
    """The card before its first command, its counters at `counts` (…)."""
    counts = np.atleast_1d(np.asarray(counts, np.int64))
    return CardState((standstill(counts),), frozen(np.zeros_like(counts)))


def send(card: Card, state: CardState, command: Command, t: float, due: np.ndarray | None = None) -> CardState:
    """The card's state after a command sent at t (s), no earlier than the one before. Raises Refused, with reasons.

    due  (…) bool, the lanes that are sent it; the others go on as they were. None: all.
    """
    lanes = state.fired.shape
    every = np.ones(lanes, bool) if due is None else np.broadcast_to(due, lanes)
    _check(card, command, lanes, every)
    v0, v1 = (
        np.broadcast_to(np.maximum(np.abs(speed), card.least_speed), lanes)
        for speed in (command.start_speed, command.max_speed)
    )
    if card.while_moving == "queue":
        last = state.moves[-1]
        begin, start, count = np.maximum(last.end, t), last.target.astype(float), last.target
        waiting = tuple(old for old in state.moves if (old.end > t).any())
    else:
        begin, start, count = np.full(lanes, t), state.position(t)[0], state.counter(t)[0]
        waiting = ()
    fired = state.pulses(t) - _pulses(waiting, t)
    wanted = command.position if isinstance(command, TAMove) else count + command.distance
    target = np.broadcast_to(wanted, lanes)
    low, high = COUNTER
    _refuse(card, "position", target, every, (target >= low) & (target <= high), f"{low} … {high} pulses", _COUNTER)
    # a ramp within one tick of the clock is none
    tacc, tdec = (0.0 if seconds * card.clock_hz < 1 else seconds for seconds in (command.tacc, command.tdec))
    new = trapezoid(begin, start, count, target.astype(np.int64), v0, v1, tacc, tdec)
    if not every.all():
        new, fired = _kept(state, new, every), np.where(every, fired, state.fired)
    return CardState((*waiting, new), frozen(fired))


def pulse_ticks(card: Card, move: Profile, lane: int | tuple[int, ...]) -> np.ndarray:
    """Ticks (pulses,) of the card's clock at which a lane's pulses fire, int64, nearest to the exact instants."""
    return np.rint(move.pulse_times(lane) * card.clock_hz).astype(np.int64)


_COUNTER = "28-bit position counter"


def _kept(state: CardState, new: Profile, due: np.ndarray) -> Profile:
    """`new` in the lanes that are due, the running move in the others."""
    (old,) = state.moves
    gap = len(new.lengths) - len(old.lengths)

    def longer(rows: Array, count: int) -> Array:
        return np.concatenate([rows, np.zeros((max(count, 0), *rows.shape[1:]))])

    parts = {name: np.where(due, getattr(new, name), getattr(old, name)) for name in _LANES}
    for name in ("lengths", "speeds", "rates"):
        parts[name] = np.where(due, longer(getattr(new, name), -gap), longer(getattr(old, name), gap))
    return replace(new, **parts)


_LANES = ("begin", "start", "count", "target")


def _spread(instants: Array, move: Profile) -> Array:
    return instants.reshape(instants.shape + (1,) * move.begin.ndim)


def _pulses(moves: tuple[Profile, ...], t: float) -> np.ndarray:
    now = np.array([t])
    return np.asarray(sum(np.abs(move.counter(now)[0] - move.count) for move in moves), np.int64)


def _check(card: Card, command: Command, lanes: tuple[int, ...], due: np.ndarray) -> None:
    if command.start_speed.shape[-1] != lanes[-1]:
        raise Refused(
            f"{card.name}: a command for {command.start_speed.shape[-1]} channels cannot start {lanes[-1]} channels"
        )
    for what, seconds in (("acceleration", command.tacc), ("deceleration", command.tdec)):
        if not 0 <= seconds < float("inf"):
            raise Refused(f"{card.name}: {what} time {seconds} s must be zero or more")
    for what, speed in (("start speed", command.start_speed), ("max speed", command.max_speed)):
        inside = np.abs(speed) <= card.max_speed
        _refuse(card, what, speed, due, inside, f"±{card.max_speed:.10g} pulses/s", "pulse generator")


def _refuse(card: Card, what: str, values: Array, due: np.ndarray, fine: np.ndarray, limit: str, owner: str) -> None:
    wrong = due & ~fine
    if wrong.any():
        lane = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
        raise Refused(
            f"{card.name}, channel {int(lane[-1]) + 1}: {what} {np.broadcast_to(values, wrong.shape)[lane]:.10g} is "
            f"outside {limit} of the {owner}; slow the motion down, or choose a card or a pulse that covers it"
        )
