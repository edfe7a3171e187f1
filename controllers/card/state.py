"""The card at work: moves under way, position counters, the pulses it fires, and what it does with a command."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from controllers.card.channels import Channels, Command
from controllers.card.model import Card
from controllers.card.profile import Profile, standstill
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
            begun = instants.reshape(instants.shape + (1,) * move.begin.ndim) >= move.begin
            position = np.where(begun, move.position(instants), position)
        return position

    def counter(self, t: ArrayLike) -> np.ndarray:
        """Position counters (N, …), int64, at instants t (N,), none before the last command: the nearest counts."""
        return np.rint(self.position(t)).astype(np.int64)

    def pulses(self, t: float) -> np.ndarray:
        """Pulses (…) fired until t in either direction, int64."""
        return np.asarray(self.fired + sum(move.pulses(t) for move in self.moves), np.int64)


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
    if card.while_moving == "queue" and command.waits:
        last = state.moves[-1]
        waiting = tuple(old for old in state.moves if (old.end > t).any())
        now = Channels(card, every, np.maximum(last.end, t), last.target, np.zeros(lanes))
    else:
        waiting = ()
        now = Channels(card, every, np.full(lanes, t), state.position(t)[0], _speed(state, t))
    new = command.move(now)
    fired = state.pulses(t) - sum(move.pulses(t) for move in waiting)
    if not every.all():
        new, fired = _kept(state, new, every), np.where(every, fired, state.fired)
    return CardState((*waiting, new), frozen(fired))


def pulse_ticks(card: Card, move: Profile, lane: int | tuple[int, ...]) -> np.ndarray:
    """Ticks (pulses,) of the card's clock at which a lane's pulses fire, int64, nearest to the exact instants."""
    return np.rint(move.pulse_times(lane) * card.clock_hz).astype(np.int64)


def _speed(state: CardState, t: float) -> Array:
    speed = state.moves[0].speed(t)
    for move in state.moves[1:]:
        speed = np.where(t >= move.begin, move.speed(t), speed)
    return speed


def _kept(state: CardState, new: Profile, due: np.ndarray) -> Profile:
    """`new` in the lanes that are due, the running move in the others."""
    (old,) = state.moves
    parts = []
    for field in fields(Profile):
        mine, theirs = getattr(new, field.name), getattr(old, field.name)
        if mine.ndim > due.ndim:
            pieces = max(len(mine), len(theirs))
            mine, theirs = (
                np.concatenate([rows, np.zeros((pieces - len(rows), *due.shape))]) for rows in (mine, theirs)
            )
        parts.append(np.where(due, mine, theirs))
    return Profile(*parts)
