"""What a tracking law is: at each step of the host, the next command from the reference and the feedback."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from controllers.card import Command
from kinematics.array import Array, frozen


@dataclass(frozen=True, slots=True)
class Reference:
    """The planned motion as the host holds it: samples at k·dt of every axis, resting after the last.

    dt        s
    position  (N + 1, n) pulses, whole; (N + 1, B, n) where B runs have references of their own
    speed     as position, pulses/s, signed
    """

    dt: float
    position: Array
    speed: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", frozen(self.position, np.float64))
        object.__setattr__(self, "speed", frozen(self.speed, np.float64))

    @property
    def steps(self) -> int:
        """N: the last sample is at N·dt."""
        return len(self.position) - 1

    def ang(self, k: int | np.ndarray) -> Array:
        """Reference position (n,), pulses, at k·dt; the last one afterwards. k (B,) for a step of each run: (B, n)."""
        return self._at(self.position, np.minimum(k, self.steps))

    def npuls(self, k: int | np.ndarray) -> Array:
        """Reference speed, pulses/s, at k·dt, shaped as `ang`; zero after the end."""
        speed = self._at(self.speed, np.minimum(k, self.steps))
        return np.where(np.reshape(k, np.shape(k) + (1,) * (speed.ndim - np.ndim(k))) <= self.steps, speed, 0.0)

    def _at(self, of: Array, k: np.ndarray) -> Array:
        own = of.ndim == 3 and np.ndim(k) == 1
        return np.asarray(of[k, np.arange(len(k))] if own else of[k])


@dataclass(frozen=True, slots=True)
class Feedback:
    """What the host reads as step k begins, which is the end of step k − 1; arrays (…) as the card's lanes.

    position  pos(k − 1), pulses: the encoders, latched
    speed     v(k − 1), pulses/s: the change of `position` over the step that ends here, divided by its time
    counter   the card's own position counter, pulses
    """

    position: Array
    speed: Array
    counter: Array


class Law(Protocol):
    """A tracking law. All axes, and all runs of a batch, are commanded at once; a law keeps no state of its own.

    Gains are numbers, or arrays (B, 1) with one value for each run of a batch.
    """

    @property
    def name(self) -> str:
        """The law and its gains, for tables."""

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> Command:
        """What to send at step k, in force until step k + 1 begins; k (B,) where runs are at steps of their own."""
