"""A motion along one run, as the solvers return it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath
from planner.trajectory import Trajectory

# How often the instant at which a profile comes by a break is enclosed more narrowly.
HALVINGS = 60


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

    def at(self, k: np.ndarray, tau: Array) -> tuple[Array, Array, Array, Array]:
        """s, ṡ, s̈, s⃛ at tau (N,) after the start of pieces k (N,)."""
        v, a, j = self.v[k], self.a[k], self.j[k]
        return self.s[k] + tau * (v + tau * (a / 2 + tau * j / 6)), v + tau * (a + tau * j / 2), a + tau * j, j

    def over(self, breaks: Array, first: int, duration: float) -> "Profile":
        """A profile of unit length and duration, stretched over path pieces `first` … between breaks, and cut there."""
        inner = (breaks[1:-1] - breaks[0]) / (breaks[-1] - breaks[0])
        k = np.searchsorted(self.s, inner, side="right") - 1
        low, high = np.zeros(len(inner)), self.h[k]
        for _ in range(HALVINGS):
            tau = (low + high) / 2
            early = self.at(k, tau)[0] < inner
            low, high = np.where(early, tau, low), np.where(early, high, tau)
        begin = np.concatenate([[0.0], np.cumsum(self.h)])[:-1]
        starts = np.concatenate([begin, begin[k] + low])
        order = np.argsort(starts, kind="stable")
        owner, tau = np.concatenate([np.arange(len(self.h)), k])[order], np.concatenate([0 * begin, low])[order]
        h = np.diff(np.append(starts[order], self.duration))
        _, v, a, j = self.at(owner, tau)
        s = np.concatenate([self.s, inner])[order]
        length = breaks[-1] - breaks[0]
        piece = first + np.searchsorted(inner, s, side="right")
        v, a, j = v * length / duration, a * length / duration**2, j * length / duration**3
        return Profile(breaks[0] + length * s, v, a, j, h * duration, piece)

    def columns(self) -> Array:
        """(4, M) of ṡ, s̈, s⃛, h: a start for another solve on the same grid."""
        return np.stack([self.v, self.a, self.j, self.h])
