"""A motion along one run, as the solvers return it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath
from planner.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Profile:
    """Pieces of constant s⃛: s, ṡ, s̈ at each start, s⃛, duration h, all (M,), and the path piece of each."""

    s: Array
    v: Array
    a: Array
    j: Array
    h: Array
    piece: np.ndarray

    @classmethod
    def joined(cls, profiles: "Sequence[Profile]") -> "Profile":
        """One after the other."""
        return cls(*(np.concatenate([getattr(one, part.name) for one in profiles]) for part in fields(cls)))

    def along(self, path: ActuatorPath) -> Trajectory:
        knots = np.concatenate([[0.0], np.cumsum(self.h)])
        return Trajectory(path, knots, self.s, self.v, self.a, self.j, self.piece)

    @property
    def duration(self) -> float:
        return float(self.h.sum())

    def slowed(self, k: float) -> "Profile":
        """The same motion, k times as long: a quantity with sⁿ/tᵐ falls by kᵐ, so every limit on time falls."""
        return replace(self, v=self.v / k, a=self.a / k**2, j=self.j / k**3, h=self.h * k)

    def columns(self) -> Array:
        """(4, M) of ṡ, s̈, s⃛, h: a start for another solve on the same grid."""
        return np.stack([self.v, self.a, self.j, self.h])
