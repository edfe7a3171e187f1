"""Moves of some lanes and moves of others, put together into one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import zip_longest
from typing import Any

import numpy as np

from controllers.card.profile import Profile
from kinematics.array import Array

PIECEWISE = ("lengths", "speeds", "rates", "jerks")
ROWS = {"jerks": None, "arc": 3, "registers": 4, "slack": 2, "zero": 0}
"""Rows of what a profile may leave out; jerks have one for each piece."""


def merged(mine: Profile, theirs: Profile, where: np.ndarray) -> Profile:
    """`mine` in the lanes where it says so, `theirs` in the others."""
    if where.all():
        return mine
    pieces = max(len(mine.lengths), len(theirs.lengths))
    parts: dict[str, Any] = {}
    for field in fields(Profile):
        pair = [getattr(move, field.name) for move in (mine, theirs)]
        if pair[0] is None and pair[1] is None:
            continue
        pair = [
            _left_out(field.name, move, pieces) if of is None else of
            for of, move in zip(pair, (mine, theirs), strict=True)
        ]
        if field.name in PIECEWISE:
            pair = [np.concatenate([rows, np.zeros((pieces - len(rows), *where.shape))]) for rows in pair]
        parts[field.name] = np.where(where, *pair)
    return Profile(**parts)


def chained(mine: Sequence[Profile], theirs: Sequence[Profile], where: np.ndarray) -> tuple[Profile, ...]:
    """The same of moves that run one after another."""
    return tuple(merged(a or never(b), b or never(a), where) for a, b in zip_longest(mine, theirs))


def registers_of(move: Profile) -> Array:
    """The registers (4, …) of a move, NaN where it has none."""
    return _left_out("registers", move, 0) if move.registers is None else move.registers


def never(move: Profile) -> Profile:
    """A move of the same lanes that does not begin."""
    none = np.zeros((1, *move.begin.shape))
    return Profile(np.full(move.begin.shape, np.inf), move.target, move.target, none, none, none)


def under_way(moves: Sequence[Profile], begun: Sequence[np.ndarray]) -> Profile:
    """In each lane the last of the moves that has begun there."""
    found = moves[0]
    for move, has in zip(moves[1:], begun[1:], strict=True):
        found = merged(move, found, has)
    return found


def cut(move: Profile, at: Array) -> Profile:
    """The move ended at instants (…), s, where these come before its end; it stands there then."""
    if not (at < move.end).any():
        return move
    ends = at < move.end
    rest, way, lengths = np.maximum(np.where(ends, at, move.begin) - move.begin, 0.0), np.zeros(at.shape), []
    for i, length in enumerate(move.lengths):
        part = np.minimum(np.maximum(rest, 0.0), length)
        lengths.append(np.where(ends, part, length))
        way, rest = way + move.way(i, part), rest - length
    return replace(move, lengths=np.stack(lengths), target=np.where(ends, move.placed(way), move.target))


def _left_out(name: str, move: Profile, pieces: int) -> Array:
    lanes, rows = move.begin.shape, ROWS[name]
    shape = lanes if rows == 0 else (pieces if rows is None else rows, *lanes)
    return np.full(shape, np.nan if name == "registers" else 0.0)
