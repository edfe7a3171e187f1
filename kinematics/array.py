"""The array type of the house, how numbers from outside become arrays, and how arrays become values."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.errors import MotionError

Array = NDArray[np.float64]

LONGEST = 80
"""Characters of a wrong value that a message shows."""


def finite(values: object, what: str, *shapes: tuple[int, ...], unit: str = "") -> Array:
    """Finite float64 of one of the shapes (any, where none is given).

    Raises MotionError that says what was wanted: for text and other things that are no numbers, for ragged rows, for
    NaN and infinity, and for another shape, also one that numpy would stretch.
    """
    array = plain(values)
    if array is not None and np.isfinite(array).all() and (not shapes or array.shape in shapes):
        return array
    kind = "one finite number" if shapes == ((),) else "finite numbers"
    wanted = " or ".join("one" if shape == () else str(shape) for shape in dict.fromkeys(shapes) if shapes != ((),))
    text = " ".join(repr(values).split())
    raise MotionError(
        f"{what} must be {' '.join(filter(None, [kind, wanted, unit and f'in {unit}']))}, "
        f"not {text if len(text) <= LONGEST else f'{text[:LONGEST]} ...'}"
    )


def plain(values: object) -> Array | None:
    """float64 of what is numbers; None of text, ragged rows and whatever else is not."""
    try:
        array = np.asarray(values)
        return array.astype(float) if array.dtype.kind in "iuf" else None
    except (TypeError, ValueError):
        return None


def frozen(values: ArrayLike, dtype: type | None = None) -> NDArray[Any]:
    """A read-only, contiguous array: what a frozen dataclass may hold. Copies unless the data is read-only already."""
    array = np.asarray(values, dtype)
    if array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, order="C", copy=True)
        array.flags.writeable = False
    return array
