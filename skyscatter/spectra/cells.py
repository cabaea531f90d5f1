"""Cells of a wavelength grid: what stretch of the spectrum each of its wavelengths stands for."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

Array = NDArray[np.float64]

WIDE_CELL = 20.0  #: width from which on a cell is worth a word [nm]
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


def wide_cells(wavelengths_nm: ArrayLike) -> str:
    """What to say of a grid whose cells are so wide that a wavelength may be taken for what it is not; else nothing."""
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    low, high = cell_edges(wl)
    if wl.size == 1 or (high - low).max() < WIDE_CELL:
        return ""
    k = int(np.argmax(high - low))
    return f"{wl[k]:g} nm is the mean of sunlight from {low[k]:g} to {high[k]:g} nm: cells reach half-way to neighbours"


def cell_means(nodes: Array, values: Array, wavelengths_nm: ArrayLike) -> Array:
    """Means over the cells of a grid of what is linear between nodes and zero outside; energy is kept.

    Parameters
    ----------
    nodes, values : ndarray, shape (node,)
        Rising wavelengths [nm], and values per nm.
    wavelengths_nm : array_like, shape (wavelength,)
        No two alike; a single one gives the value there.

    Returns
    -------
    ndarray, shape (wavelength,)
    """
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    if wl.size < 2:
        return np.interp(wl, nodes, values, left=0.0, right=0.0)
    low, high = (np.clip(edge, nodes[0], nodes[-1]) for edge in cell_edges(wl))
    width = np.subtract(*cell_edges(wl)[::-1])
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(nodes))])

    def integral(x: Array) -> Array:
        i = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2)
        part = x - nodes[i]
        slope = (values[i + 1] - values[i]) / (nodes[i + 1] - nodes[i])
        return np.asarray(total[i] + part * (values[i] + 0.5 * part * slope))

    return (integral(high) - integral(low)) / width
