"""The drives of a batch of rigs: axes of each kind of drive, run side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.drives.axes import Axes, Response
from controllers.drives.servo_axes import servo_axes
from controllers.drives.stepper_axes import stepper_axes
from controllers.servo import Servo
from controllers.stepper import Stepper
from kinematics.array import Array
from kinematics.errors import MotionError

KINDS: dict[type, Callable[[Any, float], Axes]] = {Servo: servo_axes, Stepper: stepper_axes}
"""What makes lanes of B rows of drives of a kind, and their sample time."""


@dataclass(frozen=True, slots=True)
class Bank:
    """Groups of axes of one kind of drive each, and their columns of the lanes; itself what `Axes` is."""

    sample: float
    groups: tuple[tuple[np.ndarray, Axes], ...]

    def standing(self, x: Array) -> tuple[Any, ...]:
        return tuple(axes.standing(x[:, columns]) for columns, axes in self.groups)

    def reading(self, state: tuple[Any, ...]) -> Array:
        return self._joined([axes.reading(own) for (_, axes), own in zip(self.groups, state, strict=True)])

    def run(self, state: tuple[Any, ...], command: Array, kept: np.ndarray) -> tuple[Response, tuple[Any, ...]]:
        if len(self.groups) == 1:
            response, own = self.groups[0][1].run(state[0], command, kept)
            return response, (own,)
        runs = [
            axes.run(own, command[:, :, columns], kept) for (columns, axes), own in zip(self.groups, state, strict=True)
        ]
        parts = (self._joined([getattr(response, name) for response, _ in runs]) for name in Response.__slots__)
        return Response(*parts), tuple(own for _, own in runs)

    def lost(self, state: tuple[Any, ...]) -> np.ndarray:
        return self._joined([axes.lost(own) for (_, axes), own in zip(self.groups, state, strict=True)])

    def _joined(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        order = np.argsort(np.concatenate([columns for columns, _ in self.groups]))
        return np.concatenate(parts, axis=-1)[..., order]


def bank(rigs: Sequence[Sequence[Servo | Stepper]]) -> Bank:
    """The drives of B rigs. Raises MotionError if sample times differ, or the kinds of drive behind an axis."""
    samples = sorted({drive.sample for drives in rigs for drive in drives})
    if len(samples) != 1:
        raise MotionError(f"drives: sample times {samples} s differ; the drives of one batch share one")
    kinds = [type(drive) for drive in rigs[0]]
    if any([type(drive) for drive in drives] != kinds for drives in rigs):
        raise MotionError("drives: the rigs of one batch differ in the kinds of their drives; run them one by one")
    groups = []
    for kind, lanes in KINDS.items():
        columns = np.array([n for n, own in enumerate(kinds) if own is kind], int)
        if len(columns):
            groups.append((columns, lanes([[drives[n] for n in columns] for drives in rigs], samples[0])))
    return Bank(samples[0], tuple(groups))
