"""What the simulation asks of axes of one kind of drive, in lanes: runs by axes (B, n)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array


@dataclass(frozen=True, slots=True)
class AxesResponse:
    """What axes did, (K, B, n) at the samples kept: true position of the output, the encoder's reading of it or of the
    motor, speed of the motor, and torque."""

    position: Array
    reading: Array
    speed: Array
    torque: Array

    def __post_init__(self) -> None:
        for name in AxesResponse.__slots__:  # as they are: made for this, and large
            getattr(self, name).setflags(write=False)


class Axes(Protocol):
    """Axes of one kind of drive; what becomes of them is passed from call to call as a state of the kind's own."""

    @property
    def sample(self) -> float:
        """s, period of the drives."""

    def standing(self, x: Array) -> Any:
        """The state at rest at positions x (B, n)."""

    def reading(self, state: Any) -> Array:
        """(B, n) what the host reads of the encoders."""

    def run(self, state: Any, command: Array, kept: np.ndarray) -> tuple[AxesResponse, Any]:
        """Over N samples of the position command (N, B, n); of these, those at the indices `kept` are told of."""

    def lost(self, state: Any) -> np.ndarray:
        """(B, n) int64 full steps lost until now."""


def read_encoder(encoder: Array, x: Array) -> Array:
    """The encoders' readings of positions x (…), in the coordinate: whole counts, within half a count of x."""
    return np.asarray(np.rint(x * encoder) / encoder)


def apply_play(output: Array, motor: Array, half_play: Array, part: Array) -> None:
    """The output behind its play, in place: it is pushed where the motor is half the play away. `part`: overwritten."""
    np.subtract(motor, half_play, out=part)
    np.maximum(output, part, out=output)
    np.add(motor, half_play, out=part)
    np.minimum(output, part, out=output)


def stack_values(name: str, drives: Any) -> Array:
    """One quantity of B rows of drives, (B, n)."""
    return freeze_array([[getattr(drive, name) for drive in row] for row in drives])
