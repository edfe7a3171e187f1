"""What a card did with a list of commands: its counters at any time, and the pulses of every
channel as clock ticks.

The levels of a channel's two lines are as `set_pls_outmode` says.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from controllers.card.channels import Command
from controllers.card.model import Card, Refused
from controllers.card.profile import Edges
from controllers.card.state import CardState, round_to_ticks, send
from kinematics.foundation.arrays import Array, freeze_fields


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
        freeze_fields(self, "ticks", "direction", "counted", "count")


@dataclass(frozen=True, slots=True)
class Record:
    """A card from its first state on: the states that commands put it into, and since when (s); it
    ends at `until`.
    """

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
        for since, until, state in zip(
            self.since, (*self.since[1:], self.until), self.states, strict=True
        ):
            for move in state.moves:
                edges = move.edges(i, since, until)
                if len(edges.t):
                    first = np.rint(move.position(np.array([since]))[(0, *i)])
                    parts.append(edges)
                    counts.append(first + np.cumsum(edges.direction * edges.counted))
        empty = Edges(np.empty(0), np.empty(0, np.int8), np.empty(0, bool))
        t, direction, counted = (np.concatenate(of) for of in zip(empty, *parts, strict=True))
        return Train(
            round_to_ticks(self.card, t),
            direction,
            counted,
            np.concatenate([np.empty(0), *counts]).astype(np.int64),
        )


def play(
    card: Card, state: CardState, sent: Iterable[tuple[float, Command]], until: float
) -> Record:
    """The card from `state` on, sent commands at instants (s, from 0 on, in order), until an
    instant.
    """
    since, states = [0.0], [state]
    for t, command in sent:
        states.append(send(card, states[-1], command, t))
        since.append(t)
    return Record(card, tuple(since), tuple(states), until)


@dataclass(frozen=True, slots=True)
class Wires:
    """The two lines of a channel: OUT and DIR, or CW and CCW.

    names   of the lines
    ticks   (edges,) int64 of the card's clock, strictly increasing, at which a line changes
    levels  (edges + 1, 2) uint8, before the first change and from each on
    """

    names: tuple[str, str]
    ticks: np.ndarray
    levels: np.ndarray

    def __post_init__(self) -> None:
        freeze_fields(self, "ticks", "levels")


def wires(card: Card, train: Train, width: int, setup: int | None = None) -> Wires:
    """The lines of a channel of a card that fires a train of pulses, by `Card.output_mode`.

    A pulse begins at its tick and lasts `width` ticks; DIR changes `setup` ticks before the pulse
    that it is for (None: `width`). ASSUMPTION: no source says how wide the card's pulses are, or
    when it turns DIR.

    Raises Refused where the pulses come too fast for that.
    """
    lead = width if setup is None else setup
    for what, span in (("pulse width", width), ("direction set-up", lead)):
        if span < 1:
            raise Refused(f"{card.name}: {what} of {span} ticks must be one or more")
    single, idle = card.output_mode.startswith("OUT"), 1 if "FALLING" in card.output_mode else 0
    forward = train.direction > 0
    turns = np.flatnonzero(np.diff(forward)) + 1 if single else np.empty(0, np.int64)
    _refuse_close(card, train, width, lead, turns)
    line = np.zeros(len(forward), np.int64) if single else np.where(forward, 0, 1)
    first = np.array([idle, idle])
    # tick, line and level of every change
    begin = np.stack((train.ticks, line, np.full(len(line), 1 - idle)), axis=1)
    changes = [begin, begin + np.array([width, 0, 2 * idle - 1])]
    if single:
        level = np.where(forward ^ card.output_mode.endswith("LOW"), 1, 0)
        first[1] = level[0] if len(level) else not card.output_mode.endswith("LOW")
        changes.append(
            np.stack(
                (train.ticks[turns] - lead, np.ones(len(turns), np.int64), level[turns]), axis=1
            )
        )
    ticks, levels = _levels(first, np.concatenate(changes).astype(np.int64))
    return Wires(("OUT", "DIR") if single else ("CW", "CCW"), ticks, levels)


def _refuse_close(card: Card, train: Train, width: int, lead: int, turns: np.ndarray) -> None:
    """Raise Refused for the first pulses that leave no time for a pulse and, at a turn, for the
    set-up of DIR.
    """
    gaps = np.diff(train.ticks)
    needed = np.full(len(gaps), width + 1)
    needed[turns - 1] += lead
    if (gaps < needed).any():
        k = int(np.argmax(gaps < needed))
        and_setup = f" and direction set-up {lead}" if k + 1 in turns else ""
        raise Refused(
            f"{card.name}: pulses {k + 1} and {k + 2} are {gaps[k]} ticks apart; width {width}{and_setup} need "
            f"{needed[k]}: make them shorter, or the motion slower"
        )


def _levels(first: np.ndarray, changes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ticks at which any line changes, and the levels before the first and from each on, from
    single changes.
    """
    changes = changes[np.argsort(changes[:, 0], kind="stable")]
    ticks, place = np.unique(changes[:, 0], return_inverse=True)
    levels = np.empty((len(ticks) + 1, 2), np.uint8)
    for line in (0, 1):
        own = changes[:, 1] == line
        last = np.zeros(len(ticks) + 1, np.int64)
        last[place[own] + 1] = np.arange(1, own.sum() + 1)
        levels[:, line] = np.concatenate((first[line : line + 1], changes[own, 2]))[
            np.maximum.accumulate(last)
        ]
    return ticks, levels
