"""A tracking law with memory: what the drives come behind is summed up, leakily and within bounds, and sent ahead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.law import (
    Feedback,
    Gain,
    Grid,
    Memory,
    Reference,
    check_gain,
    format_gain,
    ramp,
)
from controllers.rig import Timer


@dataclass(frozen=True, slots=True)
class LeakyIntegral:
    """r + I from step to step: I ← clip((1 − dt/leak) I + gain dt e, ±most), e = r − the encoder's position.

    gain  1/s
    leak  s in which the sum fades to 1/e of itself
    most  pulses of I at most, so that a blocked axis does not wind it up
    """

    gain: Gain = 3.0
    leak: float = 1.0
    most: float = 500.0
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"gain": (0.0, 1.0, 3.0, 10.0)}

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "gain", check_gain("leaky-integral", "gain", self.gain, "below 1/delay")
        )

    @property
    def name(self) -> str:
        return f"leaky-integral gain={format_gain(self.gain)}"

    def begin(self, lanes: tuple[int, int]) -> Memory:
        return (np.zeros(lanes),)

    def step(
        self, k: int | np.ndarray, reference: Reference, feedback: Feedback, memory: Memory
    ) -> tuple[TAMove, Memory]:
        (before,), dt = memory, reference.dt
        error = reference.ang(k) - feedback.position
        after = np.clip(
            (1 - dt / self.leak) * before + self.gain * dt * error, -self.most, self.most
        )
        target = reference.ang(np.asarray(k) + 1) + after
        return ramp(
            target, reference.npuls(k), reference.npuls(np.asarray(k) + 1), feedback.counter, dt
        ), (after,)
