"""Magnitudes of Johnson and Cousins: what a star of magnitude 0 sends, and magnitudes of spectra."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.datafiles import read_table

Array = NDArray[np.float64]

#: Irradiance [W m-2 nm-1] of a star of magnitude 0, averaged over the bands: Bessell, Castelli & Plez 1998 (A&A 333,
#: 231, table A2).  Vega itself has V = 0.03.
VEGA_ZERO = {"U": 4.175e-11, "B": 6.320e-11, "V": 3.631e-11, "R": 2.177e-11, "I": 1.126e-11}
#: Wavelengths [nm] on which spectra are averaged over the bands; all five are 0 outside.
BAND_NODES = np.arange(300.0, 921.0, 1.0)
BAND_NODES.flags.writeable = False


@lru_cache(maxsize=8)
def band_weights(name: str) -> Array:
    """Weights at `BAND_NODES` that average a spectrum over U, B, V, R or I (Bessell 1990, per energy); sum 1."""
    table = read_table("bessell_ubvri.csv")
    response = np.interp(BAND_NODES, table["wavelength_nm"], table[name], left=0.0, right=0.0)
    weights = response / response.sum()
    weights.flags.writeable = False
    return weights


def magnitude(irradiance: ArrayLike, name: str) -> Array:
    """Magnitude in a band of spectra given at `BAND_NODES`.

    Parameters
    ----------
    irradiance : array_like, shape (..., node)
        [W m-2 nm-1]
    name : {"U", "B", "V", "R", "I"}

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    The Sun from the Earth.

    >>> from skyscatter.spectra.solar import solar_irradiance
    >>> from skyscatter.spectra.vega import BAND_NODES, magnitude
    >>> sun = solar_irradiance(BAND_NODES)
    >>> round(float(magnitude(sun, "V")), 2), round(float(magnitude(sun, "B") - magnitude(sun, "V")), 2)
    (-26.76, 0.65)
    """
    mean = np.asarray(irradiance, dtype=float) @ band_weights(name)
    return np.asarray(-2.5 * np.log10(mean / VEGA_ZERO[name]))
