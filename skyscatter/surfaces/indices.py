"""Refractive indices of clear substances, by name or by numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.record import nearest
from skyscatter.spectra.table import Spectral, evaluate

Array = NDArray[np.float64]


def _sellmeier(wavelengths_nm: Array, terms: tuple[tuple[float, float], ...]) -> Array:
    """The index n by n^2 - 1 = sum B L^2 / (L^2 - C), L the wavelength in micron."""
    square = (wavelengths_nm * 1e-3) ** 2
    return np.sqrt(1.0 + sum((b * square / (square - c) for b, c in terms), np.zeros_like(square)))


def _water(wavelengths_nm: Array) -> Array:
    table = read_table("water_refractive_index.csv")
    return np.interp(wavelengths_nm, table["wavelength_nm"], table["real"])


def _n_bk7(wavelengths_nm: Array) -> Array:
    # SCHOTT, Optical Glass data sheets: N-BK7, constants of the dispersion formula.
    terms = ((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653))
    return _sellmeier(wavelengths_nm, terms)


def _pmma(wavelengths_nm: Array) -> Array:
    # Sultanova, Kasarova & Nikolov (2009), Acta Physica Polonica A 116, 585: n^2 - 1 = 1.1819 L^2 / (L^2 - 0.011313).
    return _sellmeier(wavelengths_nm, ((1.1819, 0.011313),))


#: Name -> shortest and longest wavelength [nm] for which it holds, and the index.
INDICES: dict[str, tuple[float, float, Callable[[Array], Array]]] = {
    "water": (200.0, 2500.0, _water),
    "n-bk7": (300.0, 2500.0, _n_bk7),
    "pmma": (437.0, 1052.0, _pmma),
}
#: Formulae of glasses are continued so far beyond their ranges, as a factor: they stay smooth.
_BEYOND = 1.2


def check_index(index: Spectral | str) -> None:
    """Refuse names that are not known."""
    if isinstance(index, str) and index not in INDICES:
        raise DomainError("index", index, f"a number, a table over wavelength, or a name; {nearest(index, INDICES)}")


def refractive_index(index: Spectral | str, wavelengths_nm: ArrayLike) -> Array:
    """Refractive index at vacuum wavelengths [nm]; shape (wavelength,).

    Parameters
    ----------
    index : float or SpectralTable or {"water", "n-bk7", "pmma"}
        Water: Segelstein (1981); the glass N-BK7: SCHOTT's Sellmeier formula; PMMA (acrylic): Sultanova et al. (2009).
    wavelengths_nm : array_like, shape (wavelength,)

    Raises
    ------
    DomainError
        For an unknown name, or wavelengths for which it does not hold.
    """
    wl = np.atleast_1d(np.asarray(wavelengths_nm, float))
    if not isinstance(index, str):
        return evaluate(index, wl)
    check_index(index)
    low, high, formula = INDICES[index]
    beyond = 1.0 if index == "water" else _BEYOND
    if wl.size and not (low / beyond <= wl.min() and wl.max() <= high * beyond):
        raise DomainError("wavelength", (wl.min(), wl.max()), f"{index} is known from {low:g} to {high:g} nm")
    return formula(wl)
