"""Interpolation: two to four channels along a straight line, or two along an arc.

Along an arc the way is a profile, and an axis' position the cosine of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, floor, pi

import numpy as np

from controllers.card.channels import Channels, Command
from controllers.card.model import Card, Refused
from controllers.card.profile import CardPiece, MoveProfile
from controllers.card.scurve import curve_ramps
from controllers.card.trapezoid import lock_move, trapezoid
from kinematics.foundation.arrays import Array, freeze_array


def bend_along_arc(move: MoveProfile, arc: Array, reached: np.ndarray) -> MoveProfile:
    """A straight move laid along an arc, its pieces parted where an axis turns round, φ + κ s a
    multiple of π.

    arc      (3, …) as in `MoveProfile`; lanes of radius 0 stay as they are
    reached  (…) bool, lanes whose `target` stands; in the others it is where the way ends
    """
    jerks = np.zeros(move.lengths.shape) if move.jerks is None else move.jerks
    target, tables = np.array(move.target), {}
    for lane in np.ndindex(move.begin.shape):
        at = (slice(None), *lane)
        rows = zip(
            *(of[at].tolist() for of in (move.lengths, move.speeds, move.rates, jerks)), strict=True
        )
        radius, phase, turn = arc[at].tolist()
        pieces = [CardPiece(*row) for row in rows]
        if radius > 0:
            way = sum(piece.way(piece.length) for piece in pieces if piece.length < np.inf)
            if not reached[lane]:
                target[lane] = move.start[lane] + radius * (
                    np.cos(phase + turn * way) - np.cos(phase)
                )
            pieces = _split_pieces(pieces, phase, turn)
        tables[lane] = pieces
    most = max(len(pieces) for pieces in tables.values())
    table = np.zeros((4, most, *move.begin.shape))
    for lane, pieces in tables.items():
        table[(slice(None), slice(len(pieces)), *lane)] = np.array(pieces).T
    lengths, speeds, rates, bends = table
    return replace(
        move, target=target, lengths=lengths, speeds=speeds, rates=rates, jerks=bends, arc=arc
    )


def _split_pieces(pieces: list[CardPiece], phase: float, turn: float) -> list[CardPiece]:
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
            found.append(CardPiece(t1 - t0, v, piece.a + t0 * piece.j, piece.j))
        way = further
    return found


@dataclass(frozen=True, slots=True)
class LinearMove(Command):
    """Channels together along a straight line, each at every instant where the line is, to half a
    pulse.

    The way along the line is a trapezoid, or an S-curve, of the vector speed √(Σ speeds²). Assumed:
    speeds are vector speeds; the line runs from the command positions of the instant, with their
    shares of a pulse; a channel of the line that is stopped or replaced alone leaves the others to
    theirs.

    axes        channels, counted from 0, two to four of one card
    position    (…, axes) pulses; rounded to whole ones
    start_speed, max_speed  (…) pulses/s along the line, one for each run of a batch
    tacc, tdec  s
    relative    whether `position` counts from the counters of the instant
    curve       (acc, dec) velocity intervals of the S, pulses/s, as in `SAMove`; None: straight
                ramps
    """

    axes: tuple[int, ...]
    position: Array
    start_speed: Array | float
    max_speed: Array | float
    tacc: float
    tdec: float
    relative: bool = False
    curve: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", freeze_array(np.array(self.position, float)))

    @property
    def joint(self) -> bool:
        return True

    def select_lanes(self, card: Card, lanes: tuple[int, ...]) -> np.ndarray:
        return select_channels(card, self.axes, lanes[-1], 2, 4)

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        axes, goal = list(self.axes), np.zeros(now.due.shape)
        goal[..., axes] = self.position
        goal = now.add_distance(goal) if self.relative else now.target(np.rint(goal))
        gap = np.where(now.due, goal - now.position, 0.0)
        distance = np.sqrt((gap * gap).sum(-1, keepdims=True))
        path = _path_profile(now, self, distance)
        u = gap / np.where(distance > 0, distance, 1.0)
        spread = np.broadcast_to(path.lengths, (len(path.lengths), *now.due.shape))
        jerks = None if path.jerks is None else path.jerks * u
        move = MoveProfile(
            path.begin + 0 * u, now.position, goal, spread, path.speeds * u, path.rates * u, jerks
        )
        return (lock_move(move),)


@dataclass(frozen=True, slots=True)
class ArcMove(Command):
    """Two channels together along an arc, each at every instant where the arc is, to half a pulse.

    The arc runs from the command positions of the instant about `centre`, to the direction in which
    `end` lies; an end that is the start makes a whole turn. The way along it is a trapezoid, or an
    S-curve, of the speed along the arc. Assumed: an end more than one pulse off the circle is
    refused; the channels come to rest where the circle is, at the whole counts nearest to it.

    axes         two channels of one card
    centre, end  (…, 2) pulses; the end rounded to whole ones
    turn         +1 from the first channel towards the second, −1 the other way round
    the others   as in `LinearMove`
    """

    axes: tuple[int, int]
    centre: Array
    end: Array
    start_speed: Array | float
    max_speed: Array | float
    tacc: float
    tdec: float
    turn: int = 1
    relative: bool = False
    curve: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("centre", "end"):
            object.__setattr__(self, name, freeze_array(np.array(getattr(self, name), float)))

    @property
    def joint(self) -> bool:
        return True

    def select_lanes(self, card: Card, lanes: tuple[int, ...]) -> np.ndarray:
        return select_channels(card, self.axes, lanes[-1], 2, 2)

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        axes = list(self.axes)
        here = now.position[..., axes]
        base = np.rint(here) if self.relative else 0.0
        centre, end = base + self.centre, np.rint(base + self.end)
        goal = np.zeros(now.due.shape)
        goal[..., axes] = end
        now.target(goal)
        out, far = here - centre, end - centre
        radius, off = (np.sqrt((of * of).sum(-1)) for of in (out, far))
        run = now.due[..., axes[0]]
        fits = (radius > 1) & (np.abs(off - radius) <= 1)
        if self.turn not in (1, -1) or not fits[run].all():
            raise Refused(
                f"{now.card.name}, channels {axes[0] + 1} and {axes[1] + 1}: an arc of turn {self.turn} from radius "
                f"{np.max(radius):.10g} pulses to {np.max(off):.10g}; turn is ±1, the radius above 1, and the end "
                "within 1 pulse of the circle: give an end that lies on it"
            )
        first, last = (np.arctan2(of[..., 1], of[..., 0]) for of in (out, far))
        angle = np.mod(self.turn * (last - first), 2 * pi)
        # an end within half a pulse of the start is the start
        angle = np.where(np.minimum(angle, 2 * pi - angle) * radius < 0.5, 2 * pi, angle)
        path = _path_profile(now, self, (radius * angle)[..., None])
        arc = np.zeros((3, *now.due.shape))
        for axis, ahead in zip(axes, (0.0, pi / 2), strict=True):
            arc[0, ..., axis], arc[1, ..., axis], arc[2, ..., axis] = (
                radius,
                first - ahead,
                self.turn / radius,
            )
        lengths, speeds, rates = (
            np.array(np.broadcast_to(of, (len(of), *now.due.shape)))
            for of in (path.lengths, path.speeds, path.rates)
        )
        jerks = None if path.jerks is None else np.broadcast_to(path.jerks, lengths.shape)
        straight = MoveProfile(
            path.begin + np.zeros(now.due.shape),
            now.position,
            now.position,
            lengths,
            speeds,
            rates,
            jerks,
        )
        return (lock_move(bend_along_arc(straight, arc, np.zeros(now.due.shape, bool))),)


def select_channels(card: Card, axes: tuple[int, ...], n: int, least: int, most: int) -> np.ndarray:
    """(n,) bool, the channels of an interpolation.

    Raises Refused where the card cannot join them.
    """
    most, different = min(most, card.channels), set(axes)
    cards = {axis // card.channels for axis in axes}
    fits = least <= len(axes) <= most and len(different) == len(axes) and len(cards) == 1
    if not fits or not different <= set(range(n)):
        named = ", ".join(str(axis + 1) for axis in axes)
        raise Refused(
            f"{card.name}: channels {named} of {n} cannot be interpolated: it takes {least} to {most} different ones, "
            f"all of one card of {card.channels}"
        )
    return np.isin(np.arange(n), axes)


def _path_profile(now: Channels, command: LinearMove | ArcMove, distance: Array) -> MoveProfile:
    """The way along the path, one lane (…, 1) for all its channels; it begins when all of them are
    ready.
    """
    v0, v1 = (
        now.magnitude(what, np.broadcast_to(np.asarray(speed, float)[..., None], now.due.shape))[
            ..., :1
        ]
        for what, speed in (("start speed", command.start_speed), ("max speed", command.max_speed))
    )
    tacc, tdec = now.ramp("acceleration", command.tacc), now.ramp("deceleration", command.tdec)
    begin = np.where(now.due, now.begin, -np.inf).max(-1, keepdims=True)
    begin = np.where(np.isfinite(begin), begin, now.begin[..., :1])
    path = trapezoid(
        begin, np.zeros_like(distance), distance, v0, v1, tacc, tdec, now.card.short_moves
    )
    return (
        path
        if command.curve is None
        else replace(curve_ramps(now, path, *command.curve), registers=None)
    )
