"""The largest and the least of a few channels of many colours.

Along an axis of three, `max` and `min` of arrays are ten times as slow as the comparison of whole channels.
"""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def largest(colours: Array) -> Array:
    """The largest channel of colours (..., channel), as ``max(axis=-1, keepdims=True)``: NaN where one is."""
    return _of_all(np.maximum, colours)


def least(colours: Array) -> Array:
    """The least channel of colours (..., channel), as ``min(axis=-1, keepdims=True)``: NaN where one is."""
    return _of_all(np.minimum, colours)


def _of_all(choose: np.ufunc, colours: Array) -> Array:
    return np.asarray(reduce(choose, np.moveaxis(colours, -1, 0)))[..., None]
