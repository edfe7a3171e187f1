"""The array type of the house, how numbers from outside become arrays, and how arrays become values."""

from sys import float_info
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.errors import MotionError

Array = NDArray[np.float64]

LONGEST = 80
"""Characters of a wrong value that a message shows."""
LARGEST = float_info.max
POSITIVE = float_info.min
"""The least number above 0 that is as precise as others."""


def finite(
    values: object,
    what: str,
    *shapes: tuple[int | None, ...],
    unit: str = "",
    least: float = -LARGEST,
    most: float = LARGEST,
) -> Array:
    """Finite float64 from least to most, of one of the shapes (None: of any length; any shape, where none is given).

    Raises MotionError that says what was wanted: for text and other things that are no numbers, for ragged rows, for
    NaN and infinity, and for another shape, also one that numpy would stretch.
    """
    array = plain(values)
    fits = array is not None and (not shapes or any(_fits(array.shape, shape) for shape in shapes))
    if array is not None and fits and ((array >= least) & (array <= most)).all():
        return array
    kind = "one finite number" if shapes == ((),) else "finite numbers"
    wanted = " or ".join("one" if shape == () else str(shape) for shape in dict.fromkeys(shapes) if shapes != ((),))
    low = "above 0" if least == POSITIVE else f"not below {least:g}" if least > -LARGEST else ""
    bounds = " and ".join(filter(None, [low, f"at most {most:.6g}" if most < LARGEST else ""]))
    text = " ".join(repr(values).split())
    raise MotionError(
        f"{what} must be {' '.join(filter(None, [kind, wanted.replace('None', 'N'), unit and f'in {unit}', bounds]))}, "
        f"not {'' if array is None or fits else f'of shape {array.shape}: '}"
        f"{text if len(text) <= LONGEST else f'{text[:LONGEST]} ...'}"
    )


def plain(values: object) -> Array | None:
    """float64 of what is numbers; None of text, ragged rows and whatever else is not."""
    try:
        array = np.asarray(values)
        return array.astype(float) if array.dtype.kind in "iuf" else None
    except (TypeError, ValueError):
        return None


def unit_vectors(values: object, what: str, *shapes: tuple[int | None, ...]) -> Array:
    """The same of directions (…, 3), none of them zero, brought to length one."""
    vectors = finite(values, what, *shapes)
    largest = np.abs(vectors).max(-1, keepdims=True)
    if (largest < POSITIVE).any():
        raise MotionError(f"{what} {vectors.tolist()} must be directions, not zero")
    vectors /= largest  # so that squares neither overflow nor vanish
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(w in (None, n) for n, w in zip(shape, wanted, strict=True))


def frozen(values: ArrayLike, dtype: type | None = None) -> NDArray[Any]:
    """A read-only, contiguous array: what a frozen dataclass may hold. Copies unless the data is read-only already."""
    array = np.asarray(values, dtype)
    if array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, order="C", copy=True)
        array.flags.writeable = False
    return array


def distinct(*runs: NDArray[Any]) -> NDArray[Any]:
    """The values of rising runs (…,), each once, rising: fifty times as fast for whole numbers as `numpy.unique`."""
    values = np.sort(np.concatenate(runs), kind="stable")  # which finds the runs and merges them
    return values[np.append(True, values[1:] != values[:-1])] if len(values) else values
