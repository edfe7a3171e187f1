"""What a motion costs the drives: torque, and time at its limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controllers.rig import Rig
from kinematics.array import Array, frozen

AT_LIMIT = 1 - 1e-9
"""Share of the limit from which a torque counts as being at it: rounding away from 1."""
BLOCK = 512
"""Samples looked at together: a few megabytes for a batch of a thousand runs."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Torque (or force) over its limit in one run: RMS and peak; saturation, the share of time at the limit; (n,)."""

    torque_rms: Array
    torque_peak: Array
    saturation: Array


def torque_limits(rigs: Sequence[Rig]) -> Array:
    """(B, n) N or N·m: of a servo its torque limit, of a stepper the largest of its curve, whatever its speed."""
    return np.array([[drive.torque_limit for drive in rig.drives] for rig in rigs])


def efforts(torque: Array, limit: Array) -> tuple[Effort, ...]:
    """Of B runs: torque (N, B, n) and its limit (B, n), N or N·m."""
    squares, at_limit, peak = np.zeros_like(limit), np.zeros_like(limit), np.zeros_like(limit)
    for start in range(0, len(torque), BLOCK):
        size = np.abs(torque[start : start + BLOCK])
        squares += np.einsum("tbn,tbn->bn", size, size)
        at_limit += np.count_nonzero(size >= AT_LIMIT * limit, axis=0)
        peak = np.maximum(peak, size.max(0))
    rms, peak, share = np.sqrt(squares / len(torque)) / limit, peak / limit, at_limit / len(torque)
    return tuple(Effort(*map(frozen, each)) for each in zip(rms, peak, share, strict=True))
