"""The card at work: moves under way, position counters, the pulses it fires, and what it does with
a command.

A command that would pass a soft limit is refused, or stops there. Backlash is compensated by pulses
that take up the play when a channel turns round; the counter does not see them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from controllers.card.channels import Channels, Command
from controllers.card.model import Card, Refused
from controllers.card.profile import (
    MoveProfile,
    current_move,
    cut,
    idle_move,
    merge_sequences,
    standstill,
)
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.names import count_noun
from planner.pulses.schedule import COUNTER


def insert_compensation(
    card: Card, moves: Sequence[MoveProfile], taken: Array, due: np.ndarray, joint: bool
) -> tuple[MoveProfile, ...]:
    """The moves with pulses of compensation before each that runs the other way, by which it and
    the later are delayed.

    Assumed: at power-up the play is taken up in the positive direction; a move that is replaced
    while it compensates leaves the play where it is, and the next one takes up the rest; of an
    interpolation all channels start when the last has compensated, and a turn within it is not
    compensated; other moves that turn round stop for it.

    taken  (…) pulses of compensation until now, signed: from −backlash (taken up in the negative
           direction) to 0
    due    (…) bool, the lanes of the moves
    """
    if card.backlash is None:
        return tuple(moves)
    if len(card.backlash) != due.shape[-1]:
        raise Refused(
            f"{card.name}: {len(card.backlash)} backlashes for {due.shape[-1]} channels; give each its own"
        )
    play, late, found = np.array(card.backlash, float), np.zeros(due.shape), []
    for whole in moves:
        for move in (whole,) if joint or whole.arc is not None else _split_at_turn(whole):
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


def _directions(move: MoveProfile) -> tuple[Array, Array]:
    """(pieces, …) the sign of each piece's way, 0 of none, and (…) that of the first that has
    one.
    """
    spans = np.where(np.isinf(move.lengths), 1.0, move.lengths)
    signs = np.sign(np.stack([move.way(i, span) for i, span in enumerate(spans)]))
    first = np.zeros(move.begin.shape)
    for sign in signs:
        first = np.where(first == 0, sign, first)
    return signs, first


def _split_at_turn(move: MoveProfile) -> tuple[MoveProfile, ...]:
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
    idle = idle_move(move)
    return replace(move, target=place, lengths=before), replace(
        rest, start=np.where(some, place, idle.start), target=move.target
    )


def limit_move(now: Channels, move: MoveProfile, joint: bool) -> MoveProfile:
    """The move as soft limits let it pass: ended dead on the limit, a joint one in all its channels
    at that instant.

    A channel that stands beyond a limit may move back. Raises Refused where the card refuses, but
    for endless moves.
    """
    card, lanes = now.card, now.due.shape
    limits = card.soft_limits
    if limits is None:
        return move
    if len(limits) != lanes[-1]:
        raise Refused(
            f"{card.name}: {count_noun(len(limits), 'soft limit')} for "
            f"{count_noun(lanes[-1], 'channel')}; give one pair for each"
        )
    at, target = np.full(lanes, np.inf), np.array(move.target)
    for lane in np.argwhere(now.due):
        i = tuple(lane)
        low, high = limits[lane[-1]]
        found, stand = _find_limit_crossing(move, i, low, high)
        if found == np.inf:
            continue
        if card.at_soft_limit == "refuse" and np.isfinite(move.end[i]):
            raise Refused(
                f"{card.name}, channel {lane[-1] + 1}: the move to {move.target[i]:.10g} passes the soft limits {low} "
                f"… {high} pulses; keep it inside, or move the limits"
            )
        at[i], target[i] = found, stand
    if joint:
        first = np.where(now.due, at, np.inf).min(-1, keepdims=True)
        target = np.where(at <= first, target, np.nan)
        at = np.where(now.due, first, at)
    stopped = cut(move, at)
    ends = at < move.end
    return replace(stopped, target=np.where(ends & ~np.isnan(target), target, stopped.target))


def _find_limit_crossing(
    move: MoveProfile, lane: tuple[int, ...], low: int, high: int
) -> tuple[float, float]:
    """When the channel first goes beyond a limit, s, and where it is to stand; (inf, 0) where it
    never does.
    """
    begin, p = float(move.begin[lane]), float(move.start[lane])
    if begin == np.inf:
        return np.inf, 0.0
    for i, length in enumerate(np.moveaxis(move.lengths, 0, -1)[lane].tolist()):
        at = begin + (length if length < np.inf else 0.0)
        q = float(move.position(np.array([at]))[(0, *lane)])
        rising = move.speeds[(i, *lane)] if length == np.inf else q - p
        for limit, sign in ((high, 1), (low, -1)):
            if sign * rising <= 0 or (length < np.inf and sign * (q - limit) <= 0):
                continue
            if sign * (p - limit) >= 0:
                return begin, p
            return _instant(move, lane, i, begin, length, p, limit), float(limit)
        begin, p = at, q
    return np.inf, 0.0


def _instant(
    move: MoveProfile,
    lane: tuple[int, ...],
    i: int,
    begin: float,
    length: float,
    p: float,
    limit: float,
) -> float:
    """When piece i of a channel comes to the limit: halved, since it runs one way, to the last
    bit.
    """
    if length == np.inf:
        return begin + (limit - p) / float(move.speeds[(i, *lane)])
    low, high = begin, begin + length
    while low < (middle := (low + high) / 2) < high:
        before = (float(move.position(np.array([middle]))[(0, *lane)]) - limit) * (p - limit) > 0
        low, high = (middle, high) if before else (low, middle)
    return high


@dataclass(frozen=True, slots=True)
class CardState:
    """Moves under way, the running one first and those behind it, and what was fired before them.

    Lanes (…) are channels (n,), or runs by channels (B, n).

    fired  (…) pulses in either direction, int64
    taken  (…) pulses of backlash compensation, signed; None: the card has none
    """

    moves: tuple[MoveProfile, ...]
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
        """Position counters (N, …), int64, at instants t (N,), none before the last command: the
        nearest counts.

        Of velocity moves they may have left the 28 bits: `read_counters` is what the host would
        read.
        """
        return np.rint(self.position(t)).astype(np.int64)

    def pulses(self, t: float) -> np.ndarray:
        """Pulses (…) fired until t in either direction, int64."""
        return np.asarray(self.fired + sum(move.pulses(t) for move in self.moves), np.int64)

    def current_move(self, t: float) -> MoveProfile:
        """The moves under way at t, lane by lane."""
        return current_move(self.moves, [t >= move.begin for move in self.moves])


def at_rest(counts: ArrayLike) -> CardState:
    """The card before its first command, its counters at `counts` (…)."""
    counts = np.atleast_1d(np.asarray(counts, np.int64))
    return CardState((standstill(counts),), freeze_array(np.zeros_like(counts)))


def send(
    card: Card, state: CardState, command: Command, t: float, due: np.ndarray | None = None
) -> CardState:
    """The card's state after a command sent at t (s), no earlier than the one before.

    Raises Refused, with reasons.

    due  (…) bool, the lanes that are sent it; the others go on as they were. None: all.
    """
    lanes = state.fired.shape
    every = np.broadcast_to(command.select_lanes(card, lanes), lanes)
    every = every if due is None else every & due
    queued = card.while_moving == "queue" and command.waits
    if queued:
        last = current_move(state.moves, [np.isfinite(move.begin) for move in state.moves])
        waiting = _hold_idle_lanes(
            state, tuple(old for old in state.moves if (old.end > t).any()), t
        )
        now = Channels(card, every, np.maximum(last.end, t), last.target, np.zeros(lanes), last)
    else:
        running = state.current_move(t)
        now = Channels(
            card,
            every,
            np.full(lanes, t),
            running.position(np.array([t]))[0],
            running.speed(t),
            running,
        )
        waiting = ()
    new = command.moves(now)
    if now.running.zero is not None:
        new = tuple(
            move if move.zero is not None else replace(move, zero=now.running.zero) for move in new
        )
    if card.soft_limits is not None and command.has_soft_limits:
        new = tuple(limit_move(now, move, command.joint) for move in new)
    fired, taken = state.pulses(t) - sum(move.pulses(t) for move in waiting), None
    if card.backlash is not None:
        taken = _compensation_pulses(state, state.moves, t) - _compensation_pulses(None, waiting, t)
        new = insert_compensation(
            card, new, taken + _compensation_pulses(None, waiting, np.inf), every, command.joint
        )
    moves = (*waiting, *new)
    if not every.all():
        moves, fired = (
            merge_sequences(moves, state.moves, every),
            np.where(every, fired, state.fired),
        )
        if taken is not None:
            taken = np.where(every, taken, 0.0 if state.taken is None else state.taken)
    return CardState(moves, freeze_array(fired), None if taken is None else freeze_array(taken))


def _hold_idle_lanes(
    state: CardState, waiting: tuple[MoveProfile, ...], t: float
) -> tuple[MoveProfile, ...]:
    """Moves that are kept of a state; a lane that has none in the first of them stands where what
    is left out ended.
    """
    if not waiting or np.isfinite(waiting[0].begin).all():
        return waiting
    first, stand = waiting[0], state.position(t)[0]
    has = np.isfinite(first.begin)
    held = replace(
        first, start=np.where(has, first.start, stand), target=np.where(has, first.target, stand)
    )
    return (held, *waiting[1:])


def read_counters(card: Card, state: CardState, t: ArrayLike) -> np.ndarray:
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
    """The output rates (…), pulses/s, that the host reads at t (s): `GetCurrentSpeed` of [Sahbaz
    2007, Appendix E].

    Assumed: it is the rate of the instant, zero where a move has come to its target, and not
    rounded to registers; whether it has a sign is an option of the card.
    """
    rate = state.current_move(t).speed(t)
    return np.abs(rate) if card.current_speed == "magnitude" else rate


def round_to_ticks(card: Card, t: Array) -> np.ndarray:
    """Ticks (pulses,) of the card's clock, int64, nearest to the instants t (pulses,) and strictly
    increasing.

    Where a channel is turned round within a tick of a pulse, the pulse back waits for the next free
    tick.
    """
    order = np.arange(len(t))
    ticks = np.rint(t * card.clock_hz).astype(np.int64) - order
    return np.asarray(np.maximum.accumulate(ticks) + order if len(t) else ticks)


def _compensation_pulses(state: CardState | None, moves: Sequence[MoveProfile], t: float) -> Array:
    base = 0.0 if state is None or state.taken is None else state.taken
    return np.asarray(base + sum(move.compensation_fired(t) for move in moves))
