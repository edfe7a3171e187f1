"""The array type of the house, how numbers from outside become arrays, and how arrays become
values.

How large and how small quantities may be: far beyond any machine, and well within what arithmetic
can hold.
"""

from collections.abc import Callable
from math import isfinite, pi
from sys import float_info
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.foundation.errors import MotionError

Array = NDArray[np.float64]

MAX_SHOWN_CHARS = 80
"""Characters of a wrong value that a message shows."""
MAX_FLOAT = float_info.max
LEAST_POSITIVE = float_info.min
"""The least number above 0 that is as precise as others."""


def finite_array(
    values: object,
    what: str,
    *shapes: tuple[int | None, ...],
    unit: str = "",
    least: float = -MAX_FLOAT,
    most: float = MAX_FLOAT,
) -> Array:
    """Finite float64 from least to most, of one of the shapes (None: of any length; any shape,
    where none is given).

    Raises MotionError that says what was wanted: for text and other things that are no numbers, for
    ragged rows, for NaN and infinity, and for another shape, also one that numpy would stretch.
    """
    array = numeric_array(values)
    fits = array is not None and (
        not shapes
        or any(
            len(shape) == array.ndim
            and all(n in (None, own) for n, own in zip(shape, array.shape, strict=True))
            for shape in shapes
        )
    )
    if array is not None and fits and ((array >= least) & (array <= most)).all():
        return array
    kind = "one finite number" if shapes == ((),) else "finite numbers"
    wanted = " or ".join(
        "one" if shape == () else str(shape) for shape in dict.fromkeys(shapes) if shapes != ((),)
    )
    low = (
        "above 0"
        if least == LEAST_POSITIVE
        else f"not below {least:g}"
        if least > -MAX_FLOAT
        else ""
    )
    bounds = " and ".join(filter(None, [low, f"at most {most:.6g}" if most < MAX_FLOAT else ""]))
    text = " ".join(repr(values).split())
    raise MotionError(
        f"{what} must be {' '.join(filter(None, [kind, wanted.replace('None', 'N'), unit and f'in {unit}', bounds]))}, "
        f"not {'' if array is None or fits else f'of shape {array.shape}: '}"
        f"{text if len(text) <= MAX_SHOWN_CHARS else f'{text[:MAX_SHOWN_CHARS]} ...'}"
    )


def numeric_array(values: object) -> Array | None:
    """float64 of what is numbers; None of text, ragged rows and whatever else is not."""
    try:
        array = np.asarray(values)
        return array.astype(float) if array.dtype.kind in "iuf" else None
    except (TypeError, ValueError):
        return None


def unit_vectors(values: object, what: str, *shapes: tuple[int | None, ...]) -> Array:
    """The same of directions (…, 3), none of them zero, brought to length one."""
    vectors = finite_array(values, what, *shapes)
    largest = np.abs(vectors).max(-1, keepdims=True)
    if (largest < LEAST_POSITIVE).any():
        kind = "a direction" if vectors.ndim == 1 else "directions"
        raise MotionError(f"{what} {vectors.tolist()} must be {kind}, not zero")
    vectors /= largest  # so that squares neither overflow nor vanish
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def freeze_array(values: ArrayLike, dtype: type | None = None) -> NDArray[Any]:
    """A read-only, contiguous array: what a frozen dataclass may hold.

    Copies unless the data is read-only already.
    """
    array = np.asarray(values, dtype)
    if array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, order="C", copy=True)
        array.flags.writeable = False
    return array


def freeze_fields(value: object, *names: str, dtype: type | None = None) -> None:
    """Make fields of a frozen dataclass read-only arrays, but for those that are None."""
    for name in names:
        given = getattr(value, name)
        if given is not None:
            object.__setattr__(value, name, freeze_array(given, dtype))


def merge_rising(*runs: NDArray[Any]) -> NDArray[Any]:
    """The values of rising runs (…,), each once, rising: fifty times as fast for whole numbers as
    `numpy.unique`.
    """
    values = np.sort(np.concatenate(runs), kind="stable")  # which finds the runs and merges them
    return values[np.append(True, values[1:] != values[:-1])] if len(values) else values


MAX_DISTANCE, MAX_TURNS, MAX_TIME, MAX_MAGNITUDE = 1e5, 10_000, 1e9, 1e15
"""m, turns, s, and any other SI unit: the largest magnitude that a file or a program may state."""
MIN_MAGNITUDE = 1e-15
"""The smallest of what must be above zero, SI: a motion of a proton's size."""
_MAX_BY_UNIT = {"m": MAX_DISTANCE, "rad": 2 * pi * MAX_TURNS, "s": MAX_TIME}


def most(unit: str) -> float:
    """The largest magnitude in an SI unit ("m", "rad", "s", "m/s", …)."""
    return _MAX_BY_UNIT.get(unit, MAX_MAGNITUDE)


def is_within_limit(value: float, unit: str) -> bool:
    """Whether a number is finite and no larger than its unit allows."""
    return isfinite(value) and abs(value) <= most(unit)


def largest_in_rows(values: Array) -> Array:
    """(N,) of (N, m): as `max(1)`, which numpy takes ten times as long for where m is small."""
    return np.asarray(np.ascontiguousarray(values.T).max(0))


def bisect(
    fits: Callable[[Any], Any],
    low: Array | float,
    high: Array | float,
    halvings: int = 60,
) -> Array:
    """Return about the largest values that fit, between some that do (low) and some that do not.

    fits  returns for each value whether it fits; 60 halvings reach rounding
    """
    for _ in range(halvings):
        middle = (low + high) / 2
        is_fit = fits(middle)
        low = np.where(is_fit, middle, low)
        high = np.where(is_fit, high, middle)
    return np.asarray(low)
