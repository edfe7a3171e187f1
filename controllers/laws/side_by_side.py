"""Laws beside each other: a batch in which each run has a law of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from controllers.card import Command
from controllers.laws.law import Feedback, Law, Reference, Timer
from kinematics.foundation.errors import MotionError


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Run b of B is commanded by the b-th law. Their hosts keep time alike, and they send the same kind of command."""

    laws: tuple[Law, ...]

    def __post_init__(self) -> None:
        if len({law.host for law in self.laws}) != 1:
            raise MotionError(f"laws {self.name} are meant for hosts of different timing: run them apart")

    @property
    def host(self) -> Timer:
        return self.laws[0].host

    @property
    def name(self) -> str:
        return ", ".join(law.name for law in self.laws)

    @property
    def grid(self) -> dict[str, tuple[float, ...]]:
        return {}

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> Command:
        commands = [law.command(k, reference, feedback) for law in self.laws]
        kind: Any = type(commands[0])
        lanes = feedback.position.shape
        if any(type(command) is not kind for command in commands):
            raise MotionError(f"laws {self.name} send different commands: run them apart")
        own: Command = kind(
            *(self._own([getattr(command, of.name) for command in commands], lanes) for of in fields(kind))
        )
        return own

    def _own(self, values: Sequence[Any], lanes: tuple[int, ...]) -> Any:
        """Of one value of every law's command, each run's own."""
        if all(isinstance(value, float) for value in values):
            if len(set(values)) != 1:
                raise MotionError(f"laws {self.name} send ramps of different times: run them apart")
            return values[0]
        own = np.empty(lanes)
        for b, value in enumerate(values):
            own[b] = value[b] if value.ndim == len(lanes) else value
        return own
