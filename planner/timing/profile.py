"""A motion along one run, as the solvers return it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath
from planner.trajectory import Trajectory

# How often the instant at which a profile comes by a break is enclosed more narrowly.
HALVINGS = 60
# Least duration of an interval, as a share of an even one's: of one that rounding leaves nothing of.
LEAST = 1e-6


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

    @property
    def last_speed(self) -> float:
        """ṡ at its end."""
        return float(self.v[-1] + self.h[-1] * (self.a[-1] + self.h[-1] * self.j[-1] / 2))

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
        k, low = self._passing(inner)
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

    def cut(self, breaks: Array, first: int) -> "Profile":
        """Cut where it comes by the inner breaks (P+1,) of path pieces `first` …, each part on its own piece."""
        inner = breaks[1:-1]
        by, when = self._passing(inner)
        owner, tau = np.append(np.arange(len(self.h)), by), np.append(np.zeros(len(self.h)), when)
        order = np.lexsort((tau, owner))
        owner, tau = owner[order], tau[order]
        s, v, a, j = self.at(owner, tau)
        last = np.append(np.diff(owner) > 0, True)
        h = np.where(last, self.h[owner], np.append(tau[1:], 0.0)) - tau
        piece = first + np.searchsorted(inner, s + h * (v / 2 + h * (a / 8 + h * j / 48)), side="right")
        kept = h > 0
        return Profile(s[kept], v[kept], a[kept], j[kept], h[kept], piece[kept])

    def on(self, s: Array) -> Array:
        """(4, N) of ṡ, s̈, s⃛, h on a grid s (N+1,) over the same way, s⃛ averaged over each interval."""
        k, tau = self._passing(s[1:-1])
        t = np.concatenate([[0.0], np.concatenate([[0.0], np.cumsum(self.h)])[k] + tau, [self.duration]])
        _, v, a, _ = self.at(np.append(0, k), np.append(0.0, tau))
        h = np.maximum(np.diff(t), LEAST * self.duration / len(s))
        return np.stack([v, a, np.diff(a, append=0.0) / h, h])

    def _passing(self, s: Array) -> tuple[np.ndarray, Array]:
        """The pieces (K,) in which it comes by s (K,), and how long after their starts."""
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, None)
        low, high = np.zeros(len(s)), self.h[k]
        for _ in range(HALVINGS):
            tau = (low + high) / 2
            early = self.at(k, tau)[0] < s
            low, high = np.where(early, tau, low), np.where(early, high, tau)
        return k, low

    def columns(self) -> Array:
        """(4, M) of ṡ, s̈, s⃛, h: a start for another solve on the same grid."""
        return np.stack([self.v, self.a, self.j, self.h])
