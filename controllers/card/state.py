"""The card at work: moves under way, position counters, the pulses it fires, and what it does with a command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from controllers.card.backlash import compensated
from controllers.card.channels import Channels, Command
from controllers.card.lanes import chained, under_way
from controllers.card.limits import within_limits
from controllers.card.model import Card, Refused
from controllers.card.profile import Profile, standstill
from kinematics.array import Array, frozen
from planner.pulses.counter import COUNTER


@dataclass(frozen=True, slots=True)
class CardState:
    """Moves under way, the running one first and those behind it, and what was fired before them.

    Lanes (…) are channels (n,), or runs by channels (B, n).

    fired  (…) pulses in either direction, int64
    taken  (…) pulses of backlash compensation, signed; None: the card has none
    """

    moves: tuple[Profile, ...]
    fired: np.ndarray
    taken: Array | None = None

    def position(self, t: ArrayLike) -> Array:
        """Command positions (N, …) in pulses at instants t (N,), none before the last command."""
        instants = np.atleast_1d(np.asarray(t, float))
        position = self.moves[0].position(instants)
        for move in self.moves[1:]:
            begun = instants.reshape(instants.shape + (1,) * move.begin.ndim) >= move.begin
            position = np.where(begun, move.position(instants), position)
        return position

    def counter(self, t: ArrayLike) -> np.ndarray:
        """Position counters (N, …), int64, at instants t (N,), none before the last command: the nearest counts.

        Of velocity moves they may have left the 28 bits: `reading` is what the host would read.
        """
        return np.rint(self.position(t)).astype(np.int64)

    def pulses(self, t: float) -> np.ndarray:
        """Pulses (…) fired until t in either direction, int64."""
        return np.asarray(self.fired + sum(move.pulses(t) for move in self.moves), np.int64)

    def running(self, t: float) -> Profile:
        """The moves under way at t, lane by lane."""
        return under_way(self.moves, [t >= move.begin for move in self.moves])


def at_rest(counts: ArrayLike) -> CardState:
    """The card before its first command, its counters at `counts` (…)."""
    counts = np.atleast_1d(np.asarray(counts, np.int64))
    return CardState((standstill(counts),), frozen(np.zeros_like(counts)))


def send(card: Card, state: CardState, command: Command, t: float, due: np.ndarray | None = None) -> CardState:
    """The card's state after a command sent at t (s), no earlier than the one before. Raises Refused, with reasons.

    due  (…) bool, the lanes that are sent it; the others go on as they were. None: all.
    """
    lanes = state.fired.shape
    every = np.broadcast_to(command.addressed(card, lanes), lanes)
    every = every if due is None else every & due
    queued = card.while_moving == "queue" and command.waits
    if queued:
        last = under_way(state.moves, [np.isfinite(move.begin) for move in state.moves])
        waiting = _standing(state, tuple(old for old in state.moves if (old.end > t).any()), t)
        now = Channels(card, every, np.maximum(last.end, t), last.target, np.zeros(lanes), last)
    else:
        running = state.running(t)
        now = Channels(card, every, np.full(lanes, t), running.position(np.array([t]))[0], running.speed(t), running)
        waiting = ()
    new = command.moves(now)
    if now.running.zero is not None:
        new = tuple(move if move.zero is not None else replace(move, zero=now.running.zero) for move in new)
    if card.soft_limits is not None and command.limited:
        new = tuple(within_limits(now, move, command.joint) for move in new)
    fired, taken = state.pulses(t) - sum(move.pulses(t) for move in waiting), None
    if card.backlash is not None:
        taken = _taken(state, state.moves, t) - _taken(None, waiting, t)
        new = compensated(card, new, taken + _taken(None, waiting, np.inf), every, command.joint)
    moves = (*waiting, *new)
    if not every.all():
        moves, fired = chained(moves, state.moves, every), np.where(every, fired, state.fired)
        if taken is not None:
            taken = np.where(every, taken, 0.0 if state.taken is None else state.taken)
    return CardState(moves, frozen(fired), None if taken is None else frozen(taken))


def _standing(state: CardState, waiting: tuple[Profile, ...], t: float) -> tuple[Profile, ...]:
    """Moves that are kept of a state; a lane that has none in the first of them stands where what is left out ended."""
    if not waiting or np.isfinite(waiting[0].begin).all():
        return waiting
    first, stand = waiting[0], state.position(t)[0]
    has = np.isfinite(first.begin)
    held = replace(first, start=np.where(has, first.start, stand), target=np.where(has, first.target, stand))
    return (held, *waiting[1:])


def reading(card: Card, state: CardState, t: ArrayLike) -> np.ndarray:
    """What the host reads of the position counters (N, …) at instants t (N,): 28 bits.

    Raises Refused for a position beyond them, unless the card is set to wrap round.
    """
    low, high = COUNTER
    counts = state.counter(t)
    if card.beyond_counter == "wrap":
        return (counts - low) % (high - low + 1) + low
    wrong = (counts < low) | (counts > high)
    if wrong.any():
        at = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
        raise Refused(
            f"{card.name}, channel {int(at[-1]) + 1}: position {counts[at]} is outside {low} … {high} pulses of the "
            "28-bit position counter; stop the move before, or set the card to wrap round"
        )
    return counts


def current_speed(card: Card, state: CardState, t: float) -> Array:
    """The output rates (…), pulses/s, that the host reads at t (s): `GetCurrentSpeed` of [Sahbaz 2007, Appendix E].

    Assumed: it is the rate of the instant, zero where a move has come to its target, and not rounded to registers;
    whether it has a sign is an option of the card.
    """
    rate = state.running(t).speed(t)
    return np.abs(rate) if card.current_speed == "magnitude" else rate


def pulse_ticks(card: Card, move: Profile, lane: int | tuple[int, ...], until: float = np.inf) -> np.ndarray:
    """Ticks (pulses,) of the card's clock at which a lane's pulses fire before `until`: `ticked` instants."""
    return ticked(card, move.pulse_times(lane, until))


def ticked(card: Card, t: Array) -> np.ndarray:
    """Ticks (pulses,) of the card's clock, int64, nearest to the instants t (pulses,) and strictly increasing.

    Where a channel is turned round within a tick of a pulse, the pulse back waits for the next free tick.
    """
    order = np.arange(len(t))
    ticks = np.rint(t * card.clock_hz).astype(np.int64) - order
    return np.asarray(np.maximum.accumulate(ticks) + order if len(t) else ticks)


def _taken(state: CardState | None, moves: Sequence[Profile], t: float) -> Array:
    base = 0.0 if state is None or state.taken is None else state.taken
    return np.asarray(base + sum(move.taken(t) for move in moves))
