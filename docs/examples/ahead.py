"""A tracking law: the open-loop reference, sent as far ahead of its time as the drives come behind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.law import Feedback, Gain, Grid, Reference, check_gain, format_gain, ramp
from controllers.rig import Timer


@dataclass(frozen=True, slots=True)
class Ahead:
    """r(t + lead), from step to step.

    A drive with a position gain of K (1/s) is 1/K late, which lead = 1/K (s) makes up.
    """

    lead: Gain = 0.033
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"lead": (0.0, 0.01, 0.02, 0.03, 0.04)}

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "lead", check_gain("ahead", "lead", self.lead, "about 1/position gain")
        )

    @property
    def name(self) -> str:
        return f"ahead lead={format_gain(self.lead)}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        t = np.asarray(k)[..., None] * reference.dt + self.lead + 0 * feedback.counter
        _, start, _ = reference.between(t)
        target, end, _ = reference.between(t + reference.dt, before=True)
        return ramp(target, start, end, feedback.counter, reference.dt)
