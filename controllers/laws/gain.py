"""Gains of a tracking law: a number, or one for each run of a batch."""

from collections.abc import Mapping

import numpy as np

from kinematics.array import Array, frozen
from kinematics.errors import MotionError

Gain = float | Array
"""A number, or an array (B, 1) with one value for each run of a batch."""

Grid = Mapping[str, tuple[float, ...]]
"""The values of each gain that reports sweep."""


def checked(law: str, name: str, value: Gain, advice: str) -> Gain:
    """The gain as a float or a read-only array. Raises MotionError unless finite, and a number or (B, 1)."""
    values = np.asarray(value, float)
    if values.ndim not in (0, 2) or (values.ndim == 2 and values.shape[1] != 1):
        raise MotionError(
            f"law {law}: {name} has shape {values.shape}; give a number, or an array (B, 1) of one value for each run"
        )
    wrong = values[~np.isfinite(values)]
    if wrong.size:
        raise MotionError(f"law {law}: {name} {wrong[0]} must be a finite number; {advice}")
    return frozen(values) if values.ndim else float(values)


def shown(value: Gain) -> str:
    """The gain in a name: "0.7", or "0.5…0.9" where runs differ."""
    low, high = np.min(value), np.max(value)
    return f"{low:g}" if low == high else f"{low:g}…{high:g}"
