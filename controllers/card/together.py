"""Commands armed one after another, and started together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.card.channels import Channels, Command
from controllers.card.lanes import chained
from controllers.card.model import Card, Refused
from controllers.card.profile import Profile


@dataclass(frozen=True, slots=True)
class Together(Command):
    """Simultaneous start: each group of channels with its own command, all of them at one instant.

    The host arms the channels one after another, and one signal starts them, which is when this is sent (relative moves
    count from then); where the card queues, that is when the last of the channels is ready. The simultaneous stop is a
    `DStop` or `EStop` sent to all of them.

    members  (channels counted from 0, command) each; no channel twice; a command has values for all channels, of which
             those of the others are not looked at
    """

    members: tuple[tuple[tuple[int, ...], Command], ...]

    @property
    def waits(self) -> bool:
        return all(command.waits for _, command in self.members)

    @property
    def joint(self) -> bool:
        return any(command.joint for _, command in self.members)

    @property
    def limited(self) -> bool:
        return all(command.limited for _, command in self.members)

    def addressed(self, card: Card, lanes: tuple[int, ...]) -> np.ndarray:
        named = [axis for axes, _ in self.members for axis in axes]
        if not named or len(set(named)) < len(named) or not 0 <= min(named) <= max(named) < lanes[-1]:
            raise Refused(
                f"{card.name}: channels {', '.join(str(axis + 1) for axis in named)} of {lanes[-1]} cannot be started "
                "together: name each once"
            )
        return np.isin(np.arange(lanes[-1]), named)

    def moves(self, now: Channels) -> tuple[Profile, ...]:
        ready = np.where(now.due, now.begin, -np.inf).max(-1, keepdims=True)
        begin = np.where(now.due, ready, now.begin)
        found: tuple[Profile, ...] = ()
        for axes, command in self.members:
            lanes = np.isin(np.arange(now.due.shape[-1]), axes) & command.addressed(now.card, now.due.shape)
            own = command.moves(replace(now, begin=begin, due=now.due & lanes))
            found = chained(own, found, np.broadcast_to(lanes, now.due.shape)) if found else own
        return found
