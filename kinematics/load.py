"""What a machine moves: the masses of its parts, gravity, and what pushes on its platform."""

from dataclasses import dataclass, field

import numpy as np

from kinematics.array import Array, finite, frozen
from kinematics.body import Body, Leg

GRAVITY = (0.0, 0.0, -9.80665)
"""m/s², where the base stands upright."""


@dataclass(frozen=True, slots=True)
class Load:
    """Masses and outside forces of a machine; nothing by default.

    platform  what moves with the platform's (tool's) frame, in that frame
    legs      of machines with legs: one for each, or one for all; none: legs without mass
    gravity   (3,) m/s² in the base frame; that of a base that stands upright by default
    wrench    (6,) N and N·m that act on the platform from outside at its origin, in the base frame

    What an axis carries by itself (`friction`, `reflected`) is the axis' own.
    """

    platform: Body = field(default_factory=Body)
    legs: tuple[Leg, ...] = ()
    gravity: Array = field(default_factory=lambda: frozen(GRAVITY))
    wrench: Array = field(default_factory=lambda: frozen(np.zeros(6)))

    def __post_init__(self) -> None:
        legs = (self.legs,) if isinstance(self.legs, Leg) else tuple(self.legs)
        object.__setattr__(self, "legs", legs)
        for name, size, unit in (("gravity", 3, "m/s²"), ("wrench", 6, "N and N·m")):
            values = finite(getattr(self, name), f"load: {name}", (size,), unit=unit)
            object.__setattr__(self, name, frozen(values))
