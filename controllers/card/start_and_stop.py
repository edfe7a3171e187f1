"""Commands armed one after another and started together; and stops, decelerated or at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.card.channels import Channels, Command
from controllers.card.interpolation import bend_along_arc
from controllers.card.model import Card, Refused
from controllers.card.profile import MoveProfile, merge_sequences, standstill
from controllers.card.trapezoid import ramp


@dataclass(frozen=True, slots=True)
class Together(Command):
    """Simultaneous start: each group of channels with its own command, all of them at one instant.

    The host arms the channels one after another, and one signal starts them, which is when this is
    sent (relative moves count from then); where the card queues, that is when the last of the
    channels is ready. The simultaneous stop is a `DStop` or `EStop` sent to all of them.

    members  (channels counted from 0, command) each; no channel twice; a command has values for all
             channels, of which those of the others are not looked at
    """

    members: tuple[tuple[tuple[int, ...], Command], ...]

    @property
    def waits(self) -> bool:
        return all(command.waits for _, command in self.members)

    @property
    def joint(self) -> bool:
        return any(command.joint for _, command in self.members)

    @property
    def has_soft_limits(self) -> bool:
        return all(command.has_soft_limits for _, command in self.members)

    def select_lanes(self, card: Card, lanes: tuple[int, ...]) -> np.ndarray:
        named = [axis for axes, _ in self.members for axis in axes]
        if (
            not named
            or len(set(named)) < len(named)
            or not 0 <= min(named) <= max(named) < lanes[-1]
        ):
            raise Refused(
                f"{card.name}: channels {', '.join(str(axis + 1) for axis in named)} of {lanes[-1]} cannot be started "
                "together: name each once"
            )
        return np.isin(np.arange(lanes[-1]), named)

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        ready = np.where(now.due, now.begin, -np.inf).max(-1, keepdims=True)
        begin = np.where(now.due, ready, now.begin)
        found: tuple[MoveProfile, ...] = ()
        for axes, command in self.members:
            lanes = np.isin(np.arange(now.due.shape[-1]), axes) & command.select_lanes(
                now.card, now.due.shape
            )
            own = command.moves(replace(now, begin=begin, due=now.due & lanes))
            found = (
                merge_sequences(own, found, np.broadcast_to(lanes, now.due.shape)) if found else own
            )
        return found


@dataclass(frozen=True, slots=True)
class DStop(Command):
    """Decelerated stop: the speed falls to zero linearly within `tdec`; what is queued is dropped.

    Sent to all channels it stops them simultaneously, an interpolation on its path: the speeds of
    all fall in proportion. Assumed: a channel that comes to the target of its move before stands
    there; otherwise it keeps its share of a pulse.

    tdec  s
    """

    tdec: float

    @property
    def waits(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        tdec = now.ramp("deceleration", self.tdec)
        old = now.running
        way, speed = old.way_and_speed(now.begin.flat[0])  # of all lanes, since it waits in none
        stop = ramp(now.begin, now.position, speed, np.zeros_like(speed), tdec)
        # the way that is left to a target: along an arc the sum of its pieces
        left = old.target - now.position
        if old.arc is not None:
            whole = sum(
                old.way(i, np.where(np.isinf(length), 0.0, length))
                for i, length in enumerate(old.lengths)
            )
            left = np.where(old.arc[0] > 0, whole - way, left)
        bound = np.zeros(left.shape, bool) if old.registers is None else ~np.isnan(old.registers[0])
        early = bound & (left * speed > 0) & (np.abs(speed) * tdec / 2 > np.abs(left))
        if early.any():
            # v τ (1 − τ/(2 tdec)) = left
            share = np.where(early, left / np.where(early, speed * tdec / 2, 1.0), 0.0)
            lengths = np.array(stop.lengths)
            lengths[0] = np.where(early, tdec * share / (1 + np.sqrt(1 - share)), lengths[0])
            stop = replace(stop, lengths=lengths, target=np.where(early, old.target, stop.target))
        if old.arc is None:
            return (stop,)
        radius, phase, turn = old.arc
        return (bend_along_arc(stop, np.stack((radius, phase + turn * way, turn)), early),)


@dataclass(frozen=True, slots=True)
class EStop(Command):
    """Emergency stop: no further pulse; what is queued is dropped.

    The share of a pulse is kept (assumed).
    """

    @property
    def waits(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        return (replace(standstill(now.position), begin=now.begin),)


@dataclass(frozen=True, slots=True)
class DwellMove(Command):
    """Waiting: the channel stands for some seconds, where a card that queues sends what follows
    behind it.

    On a card that replaces, it stops a running move dead (assumed).

    seconds  s
    """

    seconds: float

    def moves(self, now: Channels) -> tuple[MoveProfile, ...]:
        seconds = now.ramp("dwell", self.seconds)
        none = np.zeros((1, *now.due.shape))
        registers = np.full((4, *now.due.shape), np.inf)
        return (
            MoveProfile(
                now.begin,
                now.position,
                now.position,
                none + seconds,
                none,
                none,
                registers=registers,
            ),
        )
