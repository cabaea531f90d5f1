"""Named spectral albedos of the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.spectra.table import Spectral, evaluate

_TABLE = "surfaces.csv"


def surface_names() -> tuple[str, ...]:
    """Names that `surface_albedo` knows."""
    return tuple(name for name in read_table(_TABLE) if name != "wavelength_nm")


def surface_albedo(name: str, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
    """Lambertian albedo of a named surface, linear between tabulated wavelengths and constant beyond 300-1100 nm.

    Parameters
    ----------
    name : str
        One of `surface_names`.
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm].

    Returns
    -------
    ndarray, shape (wavelength,)

    Raises
    ------
    DomainError
        For an unknown name.
    """
    if name not in surface_names():
        raise DomainError("surface", name, f"known surfaces are {', '.join(surface_names())}")
    table = read_table(_TABLE)
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    return np.interp(wl, table["wavelength_nm"], table[name])


def check_albedo(value: Spectral | str) -> None:
    """Refuse what is no albedo: an unknown surface, or numbers outside 0 to 1."""
    if isinstance(value, str):
        surface_albedo(value, [550.0])
        return


def spectrum_of(value: Spectral | str, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
    """An albedo per wavelength, shape (wavelength,)."""
    if isinstance(value, str):
        return surface_albedo(value, wavelengths_nm)
    return evaluate(value, wavelengths_nm)
