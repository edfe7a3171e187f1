"""Backlash compensation: pulses that take up play when a channel turns round, and that the counter does not see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from controllers.card.lanes import never
from controllers.card.model import Card, Refused
from controllers.card.profile import Profile
from kinematics.array import Array


def compensated(
    card: Card, moves: Sequence[Profile], taken: Array, due: np.ndarray, joint: bool
) -> tuple[Profile, ...]:
    """The moves with pulses of compensation before each that runs the other way, by which it and the later are delayed.

    Assumed: at power-up the play is taken up in the positive direction; a move that is replaced while it compensates
    leaves the play where it is, and the next one takes up the rest; of an interpolation all channels start when the
    last has compensated, and a turn within it is not compensated; other moves that turn round stop for it.

    taken  (…) pulses of compensation until now, signed: from −backlash (taken up in the negative direction) to 0
    due    (…) bool, the lanes of the moves
    """
    if card.backlash is None:
        return tuple(moves)
    if len(card.backlash) != due.shape[-1]:
        raise Refused(f"{card.name}: {len(card.backlash)} backlashes for {due.shape[-1]} channels; give each its own")
    play, late, found = np.array(card.backlash, float), np.zeros(due.shape), []
    for whole in moves:
        for move in (whole,) if joint or whole.arc is not None else _parted(whole):
            begun = np.isfinite(move.begin)
            sign = np.where(begun, _directions(move)[1], 0.0)
            need = np.where(sign > 0, -taken, np.where(sign < 0, -play - taken, 0.0))
            last = np.abs(need) / card.backlash_speed
            if joint:
                last = np.where(due, np.where(due, last, 0.0).max(-1, keepdims=True), last)
            late, taken = late + last, taken + need
            slack = np.stack((need, np.full(due.shape, card.backlash_speed)))
            found.append(replace(move, begin=move.begin + late, slack=slack))
    return tuple(found)


def _directions(move: Profile) -> tuple[Array, Array]:
    """(pieces, …) the sign of each piece's way, 0 of none, and (…) that of the first that has one."""
    spans = np.where(np.isinf(move.lengths), 1.0, move.lengths)
    signs = np.sign(np.stack([move.way(i, span) for i, span in enumerate(spans)]))
    first = np.zeros(move.begin.shape)
    for sign in signs:
        first = np.where(first == 0, sign, first)
    return signs, first


def _parted(move: Profile) -> tuple[Profile, ...]:
    """A move and, in lanes where it turns round, the rest of it from there."""
    signs, first = _directions(move)
    turned = np.logical_or.accumulate(signs == -first, axis=0) & (first != 0)
    if not turned.any():
        return (move,)
    spans = np.where(turned | np.isinf(move.lengths), 0.0, move.lengths)
    way = sum(move.way(i, span) for i, span in enumerate(spans))
    some = turned.any(0)
    place = np.where(some, move.start + way, move.target)
    before, after = (np.where(which, move.lengths, 0.0) for which in (~turned, turned))
    begin = np.where(some, move.begin + np.where(some, before, 0.0).sum(0), np.inf)
    rest = replace(move, begin=begin, start=place, lengths=after)
    idle = never(move)
    return replace(move, target=place, lengths=before), replace(
        rest, start=np.where(some, place, idle.start), target=move.target
    )
