"""Stops: decelerated, and at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.card.arc import bent
from controllers.card.channels import Channels, Command
from controllers.card.profile import Profile, standstill
from controllers.card.velocity import ramp


@dataclass(frozen=True, slots=True)
class DStop(Command):
    """Decelerated stop: the speed falls to zero linearly within `tdec`; what is queued is dropped.

    Sent to all channels it stops them simultaneously, an interpolation on its path: the speeds of all fall in
    proportion. Assumed: a channel that comes to the target of its move before stands there; otherwise it keeps its
    share of a pulse.

    tdec  s
    """

    tdec: float

    @property
    def waits(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[Profile, ...]:
        tdec = now.ramp("deceleration", self.tdec)
        old = now.running
        way, speed = old.along(now.begin.flat[0])  # of all lanes, since it waits in none
        stop = ramp(now.begin, now.position, speed, np.zeros_like(speed), tdec)
        # the way that is left to a target: along an arc the sum of its pieces
        left = old.target - now.position
        if old.arc is not None:
            whole = sum(old.way(i, np.where(np.isinf(length), 0.0, length)) for i, length in enumerate(old.lengths))
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
        return (bent(stop, np.stack((radius, phase + turn * way, turn)), early),)


@dataclass(frozen=True, slots=True)
class EStop(Command):
    """Emergency stop: no further pulse; what is queued is dropped. The share of a pulse is kept (assumed)."""

    @property
    def waits(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[Profile, ...]:
        return (replace(standstill(now.position), begin=now.begin),)


@dataclass(frozen=True, slots=True)
class Dwell(Command):
    """Waiting: the channel stands for some seconds, where a card that queues sends what follows behind it.

    On a card that replaces, it stops a running move dead (assumed).

    seconds  s
    """

    seconds: float

    def moves(self, now: Channels) -> tuple[Profile, ...]:
        seconds = now.ramp("dwell", self.seconds)
        none = np.zeros((1, *now.due.shape))
        registers = np.full((4, *now.due.shape), np.inf)
        return (Profile(now.begin, now.position, now.position, none + seconds, none, none, registers=registers),)
