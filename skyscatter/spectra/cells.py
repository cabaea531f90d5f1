"""Cells of a wavelength grid: what stretch of the spectrum each of its wavelengths stands for."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

Array = NDArray[np.float64]

SINGLE_CELL = 1.0  #: width of the cell of a grid of one wavelength [nm]


def cell_edges(wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
    """Lower and upper edges of the cells of a grid, half-way to the neighbours.

    The two end cells reach as far outwards as inwards; a grid of one wavelength has one cell of 1 nm.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm] in any order, no two alike.

    Returns
    -------
    low, high : ndarray, shape (wavelength,)
        Edges [nm] in the order of the wavelengths.

    Raises
    ------
    DomainError
        If a wavelength occurs twice.
    """
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    order = np.argsort(wl)
    gaps = np.diff(wl[order]) if wl.size > 1 else np.array([SINGLE_CELL])
    if np.any(gaps <= 0):
        raise DomainError("wavelengths", wl.tolist(), "no wavelength twice")
    if wl.size > 1:
        gaps = np.concatenate([gaps[:1], gaps, gaps[-1:]])
    else:
        gaps = np.repeat(gaps, 2)
    low, high = np.empty_like(wl), np.empty_like(wl)
    low[order], high[order] = wl[order] - 0.5 * gaps[:-1], wl[order] + 0.5 * gaps[1:]
    return low, high
