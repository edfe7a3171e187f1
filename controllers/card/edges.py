"""The instants at which one channel's command position passes half counts, in closed form piece by piece.

A card adds integers to one another at every tick of its clock, and fires when the sum passes the next half count. These
closed forms, rounded to ticks, are the same pulses within one tick: the tests hold every pulse of every kind of piece
against such a generator in whole numbers, which knows of no closed form. Counts and ticks are int64 throughout.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, pi
from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.polynomials import solve_heights


class Edges(NamedTuple):
    """Pulses of one channel in the order of time.

    t          (pulses,) s
    direction  (pulses,) int8, ±1
    counted    (pulses,) bool: whether the position counter counts it (compensation of play is not counted)
    """

    t: Array
    direction: np.ndarray
    counted: np.ndarray

    def then(self, later: Edges) -> Edges:
        return Edges(*(np.concatenate(pair) for pair in zip(self, later, strict=True)))


NO_EDGES = Edges(np.empty(0), np.empty(0, np.int8), np.empty(0, bool))


class CardPiece(NamedTuple):
    """Way v τ + a τ²/2 + j τ³/6 over a time."""

    length: float
    v: float
    a: float
    j: float

    def way(self, tau: float) -> float:
        # the same operations in the same order as Profile's, so that both round alike
        if self.j == 0:
            return tau * (self.v + tau * (self.a / 2))
        return tau * (self.v + tau * (self.a / 2 + tau * (self.j / 6)))

    def time(self, way: Array, tau: float) -> Array:
        """When ways are made that lie between 0 and way(tau), where the piece runs one way: the root in [0, tau].

        Of a straight speed it is 2δ / (v ± √(v² + 2aδ)), which stays exact as a → 0; of a bent one a root of its cubic.
        """
        sign = 1.0 if self.way(tau) >= 0 else -1.0
        v, a, j, delta = sign * self.v, sign * self.a, sign * self.j, sign * way
        if j == 0:
            root = v + np.sqrt(np.maximum(v * v + 2 * a * delta, 0.0))
            return np.minimum(2 * delta / np.where(root > 0, root, 1.0), tau)
        cubic = np.array([[tau * v], [tau**2 * a / 2], [tau**3 * j / 6], [0.0], [0.0]])
        share, _ = solve_heights(cubic, np.zeros(len(delta), np.intp), delta, np.zeros(1))
        return tau * share


def find_crossings(
    begin: float,
    start: float,
    target: float,
    pieces: Sequence[CardPiece],
    arc: tuple[float, ...] | None,
    since: float,
    until: float,
) -> Edges:
    """The half counts that a channel passes from `since` to `until`; arguments as in `Profile`, of one lane."""
    if begin == inf:
        return NO_EDGES
    last = 0.0
    for piece in pieces:  # in the order of Profile.end
        last += piece.length
    last += begin
    found, way, elapsed = NO_EDGES, 0.0, begin
    from_, to = since - begin, until - begin
    for i, piece in enumerate(pieces):
        t0, t1 = min(max(from_, 0.0), piece.length), min(max(to, 0.0), piece.length)
        if t1 > t0 or i == len(pieces) - 1:
            near, far = way + piece.way(t0), way + piece.way(t1)
            p, q = (_position_after(start, arc, s) for s in (near, far))
            if i == len(pieces) - 1:
                p, q = (target if t >= last else x for t, x in ((since, p), (until, q)))
            levels = _halves(p, q)
            if len(levels):
                s = levels - start if arc is None else _arc_ways(levels, start, arc, (near + far) / 2)
                tau = piece.time(s - way, t1) if t1 > 0 else np.zeros(len(s))
                sign = np.full(len(s), 1 if q > p else -1, np.int8)
                found = found.then(Edges(elapsed + np.maximum(tau, t0), sign, np.ones(len(s), bool)))
        way, elapsed = way + piece.way(piece.length) if piece.length < inf else way, elapsed + piece.length
        from_, to = from_ - piece.length, to - piece.length
    return found


def _position_after(start: float, arc: tuple[float, ...] | None, way: float) -> float:
    if arc is None:
        return start + way
    radius, phase, turn = arc
    return float(start + radius * (np.cos(phase + turn * way) - np.cos(phase)))


def _arc_ways(levels: Array, start: float, arc: tuple[float, ...], middle: float) -> Array:
    """The ways along an arc to positions on it, on the half turn on which its way `middle` lies."""
    radius, phase, turn = arc
    half = np.floor((phase + turn * middle) / pi)
    angle = np.arccos(np.clip((levels - start) / radius + cos(phase), -1.0, 1.0))
    return np.asarray((half * pi + np.where(half % 2 == 0, angle, pi - angle) - phase) / turn)


def _halves(p: float, q: float) -> Array:
    """The half counts that are passed on the way from p to q, in order: as many as the nearest whole numbers change."""
    low, high = np.rint(p), np.rint(q)
    step = 1.0 if high >= low else -1.0
    return np.asarray(low + step * (np.arange(abs(int(high - low))) + 0.5))
