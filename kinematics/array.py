"""The array type of the house, how arrays become values, and the one way in for numbers that callers give."""

from sys import float_info
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.errors import MotionError

Array = NDArray[np.float64]
LARGEST = float_info.max
POSITIVE = float_info.min
"""The least number above 0 that is as precise as others."""


def frozen(values: ArrayLike, dtype: type | None = None) -> NDArray[Any]:
    """A read-only, contiguous array: what a frozen dataclass may hold. Copies unless the data is read-only already."""
    array = np.asarray(values, dtype)
    if array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, order="C", copy=True)
        array.flags.writeable = False
    return array


def real(what: str, values: object, *shapes: tuple[int | None, ...]) -> Array:
    """The real numbers that a caller gives, as a read-only array of one of the shapes, or any (None: any length).

    what: the message up to what was given instead, as in "machine m: base must be six points (6, 3) in m". Raises
    MotionError for all else: another shape, text, complex numbers, truth values.
    """
    try:
        array = np.asarray(values)
    except (TypeError, ValueError):  # rows of different lengths, and what only looks like a sequence
        array = np.empty((), object)
    if array.dtype.kind in "iuf" and (not shapes or any(_fits(array.shape, shape) for shape in shapes)):
        return frozen(array, np.float64)
    raise MotionError(f"{what}, not {_outline(values, array)}")


def finite(
    what: str, values: object, *shapes: tuple[int | None, ...], least: float = -LARGEST, most: float = LARGEST
) -> Array:
    """The same of finite numbers from `least` to `most`; infinity is let in by an infinite end."""
    array = real(what, values, *shapes)
    if not ((array >= least) & (array <= most)).all():
        raise MotionError(f"{what}, not {_outline(values, array)}")
    return array


def quantities(values: object, what: str, *shapes: tuple[int, ...], unit: str = "") -> Array:
    """Finite numbers of one of the shapes, or of any; the message names `what`, the shapes and the unit."""
    kind = "one finite number" if shapes == ((),) else "finite numbers"
    wanted = " or ".join("one" if shape == () else str(shape) for shape in dict.fromkeys(shapes) if shapes != ((),))
    return finite(f"{what} must be {' '.join(filter(None, [kind, wanted, unit and f'in {unit}']))}", values, *shapes)


def number(what: str, value: object, least: float = -LARGEST, most: float = LARGEST) -> float:
    """The same of one number."""
    return float(finite(what, value, (), least=least, most=most))


def unit_vectors(what: str, values: object, *shapes: tuple[int | None, ...]) -> Array:
    """The unit vectors of the finite ones (…, 3) that a caller gives, none zero."""
    vectors = finite(what, values, *shapes)
    largest = np.abs(vectors).max(-1, keepdims=True)
    if (largest < POSITIVE).any():
        raise MotionError(f"{what}, not {vectors.tolist()}")
    vectors = vectors / largest  # so that squares neither overflow nor vanish
    return frozen(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(w in (None, n) for n, w in zip(shape, wanted, strict=True))


def _outline(values: object, array: NDArray[Any]) -> str:
    """What was given instead: the shape of an array, and what is in it where that is little."""
    if not array.ndim or array.dtype.kind == "O":
        return f"{values!r:.200}"
    return f"shape {array.shape}{f': {array.tolist()}' if array.size <= 18 else ''}"
