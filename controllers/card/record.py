"""What a card did with a list of commands: its counters at any time, and the pulses of every channel as clock ticks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from controllers.card.channels import Command
from controllers.card.edges import Edges
from controllers.card.model import Card, Refused
from controllers.card.state import CardState, round_to_ticks, send
from kinematics.foundation.arrays import Array, freeze_array


@dataclass(frozen=True, slots=True)
class Train:
    """The pulses of one channel in the order of time.

    ticks      (pulses,) int64 of the card's clock, strictly increasing
    direction  (pulses,) int8, ±1
    counted    (pulses,) bool; compensation of play is not counted
    count      (pulses,) int64, the position counter after the pulse
    """

    ticks: np.ndarray
    direction: np.ndarray
    counted: np.ndarray
    count: np.ndarray

    def __post_init__(self) -> None:
        for name in ("ticks", "direction", "counted", "count"):
            object.__setattr__(self, name, freeze_array(getattr(self, name)))


@dataclass(frozen=True, slots=True)
class Record:
    """A card from its first state on: the states that commands put it into, and since when (s); it ends at `until`."""

    card: Card
    since: tuple[float, ...]
    states: tuple[CardState, ...]
    until: float

    def position(self, t: Array) -> Array:
        """Command positions (N, …), pulses, at instants t (N,) from the first on."""
        t = np.atleast_1d(np.asarray(t, float))
        found = np.empty((len(t), *self.states[0].fired.shape))
        index = np.searchsorted(self.since, t, side="right") - 1
        for k in np.unique(index):
            found[index == k] = self.states[max(k, 0)].position(t[index == k])
        return found

    def train(self, lane: int | tuple[int, ...]) -> Train:
        """The pulses of a lane until the record's end."""
        i = lane if isinstance(lane, tuple) else (lane,)
        parts, counts = [], []
        for since, until, state in zip(self.since, (*self.since[1:], self.until), self.states, strict=True):
            for move in state.moves:
                edges = move.edges(i, since, until)
                if len(edges.t):
                    first = np.rint(move.position(np.array([since]))[(0, *i)])
                    parts.append(edges)
                    counts.append(first + np.cumsum(edges.direction * edges.counted))
        empty = Edges(np.empty(0), np.empty(0, np.int8), np.empty(0, bool))
        t, direction, counted = (np.concatenate(of) for of in zip(empty, *parts, strict=True))
        return Train(
            round_to_ticks(self.card, t), direction, counted, np.concatenate([np.empty(0), *counts]).astype(np.int64)
        )

    def latched(self, lane: int | tuple[int, ...], t: Array) -> np.ndarray:
        """Position counters (N,) that a lane's latch input freezes at instants t (N,). Raises Refused without one."""
        i = lane if isinstance(lane, tuple) else (lane,)
        channel = i[-1]
        if channel % self.card.channels not in self.card.latches:
            inputs = ", ".join(str(own + 1) for own in self.card.latches) or "none"
            raise Refused(f"{self.card.name}, channel {channel + 1}: it has no latch input; those of a card: {inputs}")
        return np.asarray(np.rint(np.moveaxis(self.position(t), 0, -1)[i]), np.int64)

    def compared(self, lane: int | tuple[int, ...], counts: Array) -> np.ndarray:
        """Ticks at which the comparator's output fires, int64: one count after another, each when it is first reached.

        A count is loaded when the one before has fired, and fires with the pulse that brings the counter to it; it
        follows that fewer fire than are given where one is not reached. Raises Refused for counts that the comparator
        does not hold.
        """
        low, high = self.card.compares
        counts = np.atleast_1d(np.asarray(counts, np.int64))
        wrong = counts[(counts < low) | (counts > high)]
        if len(wrong):
            raise Refused(f"{self.card.name}: count {wrong[0]} is outside {low} … {high} pulses of the comparator")
        if len(counts) > self.card.compare_list:
            raise Refused(
                f"{self.card.name}: {len(counts)} counts to compare; the comparator holds {self.card.compare_list}; "
                "give the others when these have fired"
            )
        train, found, at = self.train(lane), [], 0
        count = np.where(train.counted, train.count, np.iinfo(np.int64).max)
        for wanted in counts.tolist():
            hits = np.flatnonzero(count[at:] == wanted)
            if not len(hits):
                break
            at += int(hits[0]) + 1
            found.append(int(train.ticks[at - 1]))
        return np.array(found, np.int64)


def play(card: Card, state: CardState, sent: Iterable[tuple[float, Command]], until: float) -> Record:
    """The card from `state` on, sent commands at instants (s, from 0 on, in order), until an instant."""
    since, states = [0.0], [state]
    for t, command in sent:
        states.append(send(card, states[-1], command, t))
        since.append(t)
    return Record(card, tuple(since), tuple(states), until)
