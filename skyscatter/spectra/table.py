"""A number that may depend on wavelength."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from skyscatter.record import Record


class SpectralTable(Record):
    """Values over vacuum wavelength [nm], linear between the nodes and constant beyond the ends."""

    wavelengths: tuple[float, ...]
    values: tuple[float, ...]

    @model_validator(mode="after")
    def _check(self) -> SpectralTable:
        if len(self.wavelengths) != len(self.values) or len(self.values) == 0:
            raise ValueError("wavelengths and values need the same length, at least 1")
        if np.any(np.diff(self.wavelengths) <= 0) or self.wavelengths[0] <= 0:
            raise ValueError("wavelengths must be positive and increase")
        return self


Spectral = float | SpectralTable


def evaluate(value: Any, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
    """Value of a number or a `SpectralTable` at each wavelength [nm]; shape (wavelength,)."""
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    if isinstance(value, SpectralTable):
        return np.interp(wl, value.wavelengths, value.values)
    return np.full(wl.shape, float(value))


def bounds(value: Any) -> tuple[float, float]:
    """Smallest and largest value that a number or a table takes."""
    if isinstance(value, SpectralTable):
        return min(value.values), max(value.values)
    return float(value), float(value)
