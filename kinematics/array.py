"""The array type of the house, and how arrays become values."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def frozen(values: ArrayLike, dtype: type | None = None) -> NDArray[Any]:
    """A read-only, contiguous array: what a frozen dataclass may hold. Copies unless the data is read-only already."""
    array = np.asarray(values, dtype)
    if array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, order="C", copy=True)
        array.flags.writeable = False
    return array
