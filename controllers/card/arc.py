"""Moves along arcs: the way along the arc is a profile, an axis' position the cosine of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import ceil, floor, pi

import numpy as np

from controllers.card.edges import Piece
from controllers.card.profile import Profile
from kinematics.array import Array


def bent(move: Profile, arc: Array, reached: np.ndarray) -> Profile:
    """A straight move laid along an arc, its pieces parted where an axis turns round, φ + κ s a multiple of π.

    arc      (3, …) as in `Profile`; lanes of radius 0 stay as they are
    reached  (…) bool, lanes whose `target` stands; in the others it is where the way ends
    """
    jerks = np.zeros(move.lengths.shape) if move.jerks is None else move.jerks
    target, tables = np.array(move.target), {}
    for lane in np.ndindex(move.begin.shape):
        at = (slice(None), *lane)
        rows = zip(*(of[at].tolist() for of in (move.lengths, move.speeds, move.rates, jerks)), strict=True)
        radius, phase, turn = arc[at].tolist()
        pieces = [Piece(*row) for row in rows]
        if radius > 0:
            way = sum(piece.way(piece.length) for piece in pieces if piece.length < np.inf)
            if not reached[lane]:
                target[lane] = move.start[lane] + radius * (np.cos(phase + turn * way) - np.cos(phase))
            pieces = _parted(pieces, phase, turn)
        tables[lane] = pieces
    most = max(len(pieces) for pieces in tables.values())
    table = np.zeros((4, most, *move.begin.shape))
    for lane, pieces in tables.items():
        table[(slice(None), slice(len(pieces)), *lane)] = np.array(pieces).T
    lengths, speeds, rates, bends = table
    return replace(move, target=target, lengths=lengths, speeds=speeds, rates=rates, jerks=bends, arc=arc)


def _parted(pieces: list[Piece], phase: float, turn: float) -> list[Piece]:
    found, way = [], 0.0
    for piece in pieces:
        further = way + piece.way(piece.length) if piece.length < np.inf else way
        low, high = sorted((phase + turn * way, phase + turn * further))
        halves = np.arange(floor(low / pi) + 1, ceil(high / pi)) * pi
        ways = np.sort(np.abs((halves - phase) / turn - way)) * (1.0 if further >= way else -1.0)
        inner = piece.time(ways, piece.length) if len(ways) else ways
        cuts = np.concatenate([[0.0], inner, [piece.length]]).tolist()
        for t0, t1 in pairwise(cuts):
            v = piece.v + t0 * (piece.a + t0 * piece.j / 2)
            found.append(Piece(t1 - t0, v, piece.a + t0 * piece.j, piece.j))
        way = further
    return found
