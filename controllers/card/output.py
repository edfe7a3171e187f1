"""How pulses leave the card: `set_pls_outmode`, the levels of the two lines of a channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from controllers.card.model import Card, OutputMode, Refused
from kinematics.foundation.arrays import freeze_array

if TYPE_CHECKING:
    from controllers.card.record import Train

OUTPUT_MODES: Mapping[int, OutputMode] = {
    0: "OUT_FALLING_DIR_HIGH",
    1: "OUT_RISING_DIR_HIGH",
    2: "OUT_FALLING_DIR_LOW",
    3: "OUT_RISING_DIR_LOW",
    4: "CW_CCW_FALLING",
    5: "CW_CCW_RISING",
}
"""The modes by the number that `set_pls_outmode` takes. The source uses OUT_RISING_DIR_LOW and OUT_RISING_DIR_HIGH by
name [Sahbaz 2007, Appendix E], and says of the function no more than "type of the motion" (Table A.1). ASSUMPTION: the
other names and all numbers, as the card's manual is remembered; HIGH and LOW are the level of DIR towards greater
counts, RISING and FALLING the edge with which a pulse begins."""


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
        for name in ("ticks", "levels"):
            object.__setattr__(self, name, freeze_array(getattr(self, name)))


def wires(card: Card, train: Train, width: int, setup: int | None = None) -> Wires:
    """The lines of a channel of a card that fires a train of pulses, by `Card.output_mode`.

    A pulse begins at its tick and lasts `width` ticks; DIR changes `setup` ticks before the pulse that it is for (None:
    `width`). ASSUMPTION: no source says how wide the card's pulses are, or when it turns DIR.

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
        changes.append(np.stack((train.ticks[turns] - lead, np.ones(len(turns), np.int64), level[turns]), axis=1))
    ticks, levels = _levels(first, np.concatenate(changes).astype(np.int64))
    return Wires(("OUT", "DIR") if single else ("CW", "CCW"), ticks, levels)


def _refuse_close(card: Card, train: Train, width: int, lead: int, turns: np.ndarray) -> None:
    """Raise Refused for the first pulses that leave no time for a pulse and, at a turn, for the set-up of DIR."""
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
    """Ticks at which any line changes, and the levels before the first and from each on, from single changes."""
    changes = changes[np.argsort(changes[:, 0], kind="stable")]
    ticks, place = np.unique(changes[:, 0], return_inverse=True)
    levels = np.empty((len(ticks) + 1, 2), np.uint8)
    for line in (0, 1):
        own = changes[:, 1] == line
        last = np.zeros(len(ticks) + 1, np.int64)
        last[place[own] + 1] = np.arange(1, own.sum() + 1)
        levels[:, line] = np.concatenate((first[line : line + 1], changes[own, 2]))[np.maximum.accumulate(last)]
    return ticks, levels
