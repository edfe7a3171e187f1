"""The change of a move's target on the fly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.card.channels import Channels, Command, lanewise
from controllers.card.lanes import registers_of
from controllers.card.model import Refused
from controllers.card.profile import Profile
from controllers.card.steer import steerable, steered
from kinematics.array import Array


@dataclass(frozen=True, slots=True)
class PChange(Command):
    """A new target for the trapezoidal move under way, on the fly; on the 8164 alone [Sahbaz 2007, Appendix A].

    Assumed: top speed, start speed and the rates of both ramps stay those of the move; a channel that ramps down
    already speeds up again; one that would pass the new target at the rate of its ramp down, or runs away from it,
    ramps down to its start speed, and returns from there. Drops what is queued. Refused where no such move is under
    way.

    position  (…) pulses, absolute; rounded to whole ones
    """

    position: Array

    def __post_init__(self) -> None:
        lanewise(self, "position")

    @property
    def waits(self) -> bool:
        return False

    def moves(self, now: Channels) -> tuple[Profile, ...]:
        if not now.card.moves_target:
            raise Refused(f"{now.card.name} cannot change a position on the fly; send a new move, or use a PCI-8164")
        now.forbid(~steerable(now), "no trapezoidal move is under way whose position could change; send a new move")
        target = now.target(np.rint(self.position))
        return (steered(now, target, registers_of(now.running), overshoots=True),)
