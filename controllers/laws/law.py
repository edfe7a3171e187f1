"""What a tracking law is: at each step of the host, the next command from the reference and the feedback."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from controllers.card import Move
from kinematics.array import Array, frozen


@dataclass(frozen=True, slots=True)
class Reference:
    """The planned motion as the host holds it: samples at k·dt of every axis, resting after the last.

    dt        s
    position  (N + 1, n) pulses, whole
    speed     (N + 1, n) pulses/s, signed
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

    def ang(self, k: int) -> Array:
        """Reference position (n,), pulses, at k·dt; the last one afterwards."""
        return np.asarray(self.position[min(k, self.steps)])

    def npuls(self, k: int) -> Array:
        """Reference speed (n,), pulses/s, at k·dt; zero after the end."""
        return np.asarray(self.speed[k] if k <= self.steps else np.zeros(self.speed.shape[1]))


@dataclass(frozen=True, slots=True)
class Feedback:
    """What the host reads from the card as step k begins, which is the end of step k − 1: pos(k − 1) (n,), pulses."""

    position: Array


class Law(Protocol):
    """A tracking law. All axes are commanded at once; a law keeps no state of its own."""

    @property
    def name(self) -> str:
        """The law and its gains, for tables."""

    def command(self, k: int, reference: Reference, feedback: Feedback) -> Move:
        """What to send at k·dt, in force until (k + 1)·dt."""
