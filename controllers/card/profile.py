"""A move of the card as a value: its position as piecewise polynomials of time, and the pulses that
it fires.

Moves of some lanes and moves of others are put together into one. Pulses fire at the instants at
which a channel's command position passes half counts, in closed form piece by piece. A card adds
integers to one another at every tick of its clock, and fires when the sum passes the next half
count. These closed forms, rounded to ticks, are the same pulses within one tick: the tests hold
every pulse of every kind of piece against such a generator in whole numbers, which knows of no
closed form. Counts and ticks are int64 throughout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import zip_longest
from math import cos, inf, pi
from typing import Any, NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.polynomials import solve_heights


class Edges(NamedTuple):
    """Pulses of one channel in the order of time.

    t          (pulses,) s
    direction  (pulses,) int8, ±1
    counted    (pulses,) bool: whether the position counter counts it (compensation of play is not
               counted)
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
        """When ways are made that lie between 0 and way(tau), where the piece runs one way: the
        root in [0, tau].

        Of a straight speed it is 2δ / (v ± √(v² + 2aδ)), which stays exact as a → 0; of a bent one
        a root of its cubic.
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
    """The half counts that a channel passes from `since` to `until`; arguments as in `Profile`, of
    one lane.
    """
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
                s = (
                    levels - start
                    if arc is None
                    else _arc_ways(levels, start, arc, (near + far) / 2)
                )
                tau = piece.time(s - way, t1) if t1 > 0 else np.zeros(len(s))
                sign = np.full(len(s), 1 if q > p else -1, np.int8)
                found = found.then(
                    Edges(elapsed + np.maximum(tau, t0), sign, np.ones(len(s), bool))
                )
        way, elapsed = (
            way + piece.way(piece.length) if piece.length < inf else way,
            elapsed + piece.length,
        )
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
    """The half counts that are passed on the way from p to q, in order: as many as the nearest
    whole numbers change.
    """
    low, high = np.rint(p), np.rint(q)
    step = 1.0 if high >= low else -1.0
    return np.asarray(low + step * (np.arange(abs(int(high - low))) + 0.5))


MAX_DURATION = 1e15
"""s."""


@dataclass(frozen=True, slots=True)
class MoveProfile:
    """One move of channels in lanes: s(t) = Σᵢ (vᵢ τᵢ + aᵢ τᵢ²/2 + jᵢ τᵢ³/6), τᵢ = clip(t − begin −
    Tᵢ, 0, lengthᵢ).

    Tᵢ is the sum of the lengths before piece i. The command position is p = start + s, or on an arc
    of radius R p = start + R (cos(φ + κ s) − cos φ), s being the way along it. p is held before the
    first piece, and after the last, where it is `target` exactly. Within a piece p runs one way.
    The position counter is the whole number nearest to p: so a pulse fires where p passes half way
    between two counts, and a share of a pulse (the generator's phase) is never lost.

    Lanes (…) are channels (n,), or runs by channels (B, n): all arithmetic is lane by lane.

    begin      (…) s, when each channel starts (channels of a queued move may start apart)
    start      (…) pulses, the command position then, with its share of a pulse
    target     (…) pulses, where the channel stands in the end
    lengths    (pieces, …) s; the last may be endless
    speeds     (pieces, …) pulses/s, signed, at the start of each piece
    rates      (pieces, …) pulses/s², at the start of each piece
    jerks      (pieces, …) pulses/s³, constant in each piece; None: zero
    arc        (3, …) R in pulses, φ in rad, κ = ±1/R in rad per pulse; R = 0 in lanes that run
               straight; None: all do
    registers  (4, …) of moves that can be changed on the fly: start and top speed, pulses/s, and
               the rates of the ramps up and down, pulses/s²; NaN in other lanes; None: no lane can
    slack      (2, …) compensation of play, fired before `begin` and not counted: pulses, signed,
               and pulses/s
    zero       (…) pulses, where the counter's zero lies by the coordinates of power-up; None: at
               theirs
    """

    begin: Array
    start: Array
    target: Array
    lengths: Array
    speeds: Array
    rates: Array
    jerks: Array | None = None
    arc: Array | None = None
    registers: Array | None = None
    slack: Array | None = None
    zero: Array | None = None

    def __post_init__(self) -> None:
        freeze_fields(self, *MoveProfile.__slots__, dtype=np.float64)

    @property
    def end(self) -> Array:
        """(…) s, when each channel stands on its target; inf where it runs on."""
        return np.asarray(self.begin + self.lengths.sum(0))

    def position(self, t: Array) -> Array:
        """Command position (N, …), pulses, at instants t (N,)."""
        if not t.size:
            return np.empty((0, *self.begin.shape))
        first, last, since = t.min(), t.max(), self.begin
        t = t.reshape(t.shape + (1,) * self.begin.ndim)
        rest, way = t - self.begin, None
        # what no lane comes to is left out: a pass over all instants takes longer than all else
        # here
        for i, length in enumerate(self.lengths):
            until = since + length
            if length.any() and (since < last).any():
                tau = rest if (since <= first).all() else np.maximum(rest, 0.0)
                tau = tau if (until >= last).all() else np.minimum(tau, length)
                part = self.way(i, tau)
                way = part if way is None else way + part
                rest = rest - length if (until < last).any() else rest
            since = until
        position = self.position_after(np.zeros(rest.shape) if way is None else way)
        return (
            position if (self.end > last).all() else np.where(t >= self.end, self.target, position)
        )

    def way_and_speed(self, t: float) -> tuple[Array, Array]:
        """The way s (…), pulses, and its speed (…), pulses/s, just after t."""
        rest, way, found = t - self.begin, np.zeros(self.begin.shape), np.zeros(self.begin.shape)
        for i, length in enumerate(self.lengths):
            tau = np.minimum(np.maximum(rest, 0.0), length)
            way += self.way(i, tau)
            bend = 0.0 if self.jerks is None else tau * (self.jerks[i] / 2)
            inside = (rest >= 0) & (rest < length)
            found = np.where(inside, self.speeds[i] + tau * (self.rates[i] + bend), found)
            rest = rest - length
        return way, found

    def speed(self, t: float) -> Array:
        """Speed (…), pulses/s, signed, just after t."""
        way, found = self.way_and_speed(t)
        if self.arc is None:
            return found
        radius, phase, turn = self.arc
        return np.where(radius > 0, -radius * turn * np.sin(phase + turn * way) * found, found)

    def pulses(self, t: float) -> np.ndarray:
        """Pulses (…) fired until t in either direction, those of compensation among them, int64."""
        rest, way = t - self.begin, np.zeros(self.begin.shape)
        before, fired = np.rint(self.start), np.abs(self.compensation_fired(t))
        for i, length in enumerate(self.lengths):
            way = way + self.way(i, np.minimum(np.maximum(rest, 0.0), length))
            after = np.rint(self.position_after(way))
            fired = fired + np.abs(after - before)
            rest, before = rest - length, after
        # the last position is the target, that of the sum but for rounding
        return np.asarray(
            fired + np.where(t >= self.end, np.abs(np.rint(self.target) - before), 0.0), np.int64
        )

    def compensation_fired(self, t: float) -> Array:
        """Pulses (…) of compensation fired until t, signed: the k-th of N is due (N − k + ½)/speed
        before `begin`.
        """
        if self.slack is None:
            return np.zeros(self.begin.shape)
        pulses, speed = self.slack
        size, begins = np.abs(pulses), np.isfinite(self.begin)
        # bounded, since t may be the end of all times
        rest = np.clip(t - np.where(begins, self.begin, 0.0), -MAX_DURATION, MAX_DURATION)
        due = np.where(begins, np.floor(rest * speed + size + 0.5), 0.0)
        return np.asarray(np.sign(pulses) * np.clip(due, 0.0, size))

    def edges(
        self, lane: int | tuple[int, ...], since: float = -np.inf, until: float = np.inf
    ) -> Edges:
        """The pulses of a lane from `since` to before `until`, in closed form; as many as its
        counter changes by.
        """
        i = lane if isinstance(lane, tuple) else (lane,)
        jerks = np.zeros(self.lengths.shape) if self.jerks is None else self.jerks
        rows = (
            np.moveaxis(of, 0, -1)[i].tolist()
            for of in (self.lengths, self.speeds, self.rates, jerks)
        )
        pieces = [CardPiece(*numbers) for numbers in zip(*rows, strict=True)]
        arc = (
            None
            if self.arc is None or self.arc[(0, *i)] == 0
            else tuple(np.moveaxis(self.arc, 0, -1)[i].tolist())
        )
        begin, start, target = (float(of[i]) for of in (self.begin, self.start, self.target))
        found = find_crossings(begin, start, target, pieces, arc, since, until)
        if self.slack is None or not self.slack[(0, *i)]:
            return found
        pulses, speed = np.moveaxis(self.slack, 0, -1)[i]
        t = begin - (np.abs(pulses) - 0.5 - np.arange(abs(int(pulses)))) / speed
        t = t[(t >= since) & (t < until)]
        extra = Edges(t, np.full(len(t), np.sign(pulses), np.int8), np.zeros(len(t), bool))
        return extra.then(found)

    def way(self, i: int, tau: Array) -> Array:
        """The way, pulses, within piece i at τ s after its start."""
        if self.jerks is None:
            return np.asarray(tau * (self.speeds[i] + tau * (self.rates[i] / 2)))
        return np.asarray(
            tau * (self.speeds[i] + tau * (self.rates[i] / 2 + tau * (self.jerks[i] / 6)))
        )

    def position_after(self, way: Array) -> Array:
        """The command position, pulses, after a way."""
        if self.arc is None:
            return np.asarray(self.start + way)
        radius, phase, turn = self.arc
        bent = self.start + radius * (np.cos(phase + turn * way) - np.cos(phase))
        return np.where(radius > 0, bent, self.start + way)


def standstill(position: np.ndarray) -> MoveProfile:
    """The move that is none: channels that stand."""
    none = np.zeros((1, *position.shape))
    return MoveProfile(np.zeros(position.shape), position, position, none, none, none)


PIECEWISE = ("lengths", "speeds", "rates", "jerks")
ROWS = {"jerks": None, "arc": 3, "registers": 4, "slack": 2, "zero": 0}
"""Rows of what a profile may leave out; jerks have one for each piece."""


def merge_lanes(mine: MoveProfile, theirs: MoveProfile, where: np.ndarray) -> MoveProfile:
    """`mine` in the lanes where it says so, `theirs` in the others."""
    if where.all():
        return mine
    pieces = max(len(mine.lengths), len(theirs.lengths))
    parts: dict[str, Any] = {}
    for field in fields(MoveProfile):
        pair = [getattr(move, field.name) for move in (mine, theirs)]
        if pair[0] is None and pair[1] is None:
            continue
        pair = [
            _default_field(field.name, move, pieces) if of is None else of
            for of, move in zip(pair, (mine, theirs), strict=True)
        ]
        if field.name in PIECEWISE:
            pair = [
                np.concatenate([rows, np.zeros((pieces - len(rows), *where.shape))])
                for rows in pair
            ]
        parts[field.name] = np.where(where, *pair)
    return MoveProfile(**parts)


def merge_sequences(
    mine: Sequence[MoveProfile], theirs: Sequence[MoveProfile], where: np.ndarray
) -> tuple[MoveProfile, ...]:
    """The same of moves that run one after another."""
    return tuple(
        merge_lanes(a or idle_move(b), b or idle_move(a), where)
        for a, b in zip_longest(mine, theirs)
    )


def registers_of(move: MoveProfile) -> Array:
    """The registers (4, …) of a move, NaN where it has none."""
    return _default_field("registers", move, 0) if move.registers is None else move.registers


def idle_move(move: MoveProfile) -> MoveProfile:
    """A move of the same lanes that does not begin."""
    none = np.zeros((1, *move.begin.shape))
    return MoveProfile(
        np.full(move.begin.shape, np.inf), move.target, move.target, none, none, none
    )


def current_move(moves: Sequence[MoveProfile], begun: Sequence[np.ndarray]) -> MoveProfile:
    """In each lane the last of the moves that has begun there."""
    found = moves[0]
    for move, has in zip(moves[1:], begun[1:], strict=True):
        found = merge_lanes(move, found, has)
    return found


def cut(move: MoveProfile, at: Array) -> MoveProfile:
    """The move ended at instants (…), s, where these come before its end; it stands there then."""
    if not (at < move.end).any():
        return move
    ends = at < move.end
    rest, way, lengths = (
        np.maximum(np.where(ends, at, move.begin) - move.begin, 0.0),
        np.zeros(at.shape),
        [],
    )
    for i, length in enumerate(move.lengths):
        part = np.minimum(np.maximum(rest, 0.0), length)
        lengths.append(np.where(ends, part, length))
        way, rest = way + move.way(i, part), rest - length
    return replace(
        move,
        lengths=np.stack(lengths),
        target=np.where(ends, move.position_after(way), move.target),
    )


def _default_field(name: str, move: MoveProfile, pieces: int) -> Array:
    lanes, rows = move.begin.shape, ROWS[name]
    shape = lanes if rows == 0 else (pieces if rows is None else rows, *lanes)
    return np.full(shape, np.nan if name == "registers" else 0.0)
