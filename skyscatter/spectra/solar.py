"""Light of the Sun and of stars outside any atmosphere, and the darkening of the Sun towards its limb."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.constants import BOLTZMANN, LIGHT, PLANCK
from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.spectra.cells import cell_edges

Array = NDArray[np.float64]

SOLAR_RADIUS = 6.957e8  #: nominal radius of the Sun [m], IAU 2015 resolution B3
SOLAR_SPECTRA = {"astm-g173": "solar_astm_g173.csv"}


def solar_irradiance(wavelengths_nm: ArrayLike, name: str = "astm-g173", band: str | float = "cell") -> Array:
    """Spectral irradiance of the Sun at 1 au, outside the atmosphere, for a surface that faces it.

    The tabulated spectrum is full of Fraunhofer lines, so that point values on a coarse grid alias: at a spacing of
    10 nm they are off by up to some 15 % from the light between one grid wavelength and the next.  By default every
    value is therefore the mean over its cell, which reaches half-way to each neighbour (the two end cells reach as
    far outwards as inwards); sums over the grid then keep the energy.  A single wavelength gives the table's value.
    A cell mean depends on the whole grid: to compare single wavelengths with a grid, give a width for `band`.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm] in any order, all different if ``band="cell"``.
    name : str
        Name of the spectrum: ``"astm-g173"`` (ASTM G173-03, 280 to 4000 nm).
    band : {"cell", "point"} or float
        Mean over the cells of the grid, values of the table (linear between its rows), or the mean over bands of
        this width [nm] around each wavelength.  Bands are cut at the ends of the table.

    Returns
    -------
    ndarray, shape (wavelength,)
        Irradiance [W m-2 nm-1].

    Raises
    ------
    DomainError
        For an unknown name, a wavelength outside the table, or a width that is not positive.
    """
    if name not in SOLAR_SPECTRA:
        raise DomainError("name", name, f"known solar spectra are {', '.join(SOLAR_SPECTRA)}")
    table = read_table(SOLAR_SPECTRA[name])
    nodes, values = table["wavelength_nm"], table["irradiance"]
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    if wl.size and not (nodes[0] <= wl.min() and wl.max() <= nodes[-1]):
        raise DomainError("wavelength", (wl.min(), wl.max()), f"{name} covers {nodes[0]:g} to {nodes[-1]:g} nm")
    if band == "point" or (band == "cell" and wl.size < 2):
        return np.interp(wl, nodes, values)
    if band == "cell":
        low, high = cell_edges(wl)
    elif isinstance(band, (int, float)) and band > 0:
        low, high = wl - band / 2, wl + band / 2
    else:
        raise DomainError("band", band, "'cell', 'point' or a positive width in nm")
    low, high = np.maximum(low, nodes[0]), np.minimum(high, nodes[-1])
    return (_integral(high, nodes, values) - _integral(low, nodes, values)) / (high - low)


def _integral(x: Array, nodes: Array, values: Array) -> Array:
    """Exact integral from the first node to `x` of the function that is linear between the nodes."""
    steps = np.diff(nodes)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * steps)])
    i = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2)
    part = x - nodes[i]
    return total[i] + part * (values[i] + 0.5 * part * (values[i + 1] - values[i]) / steps[i])


def blackbody_irradiance(wavelengths_nm: ArrayLike, temperature_K: float, radius_m: float, distance_m: float) -> Array:
    """Spectral irradiance of a uniform black sphere, pi B(lambda, T) (radius / distance)^2 (Planck's law).

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm].
    temperature_K : float
        Effective temperature [K].
    radius_m, distance_m : float
        Radius of the star and distance of its centre [m]; the distance is at least the radius.

    Returns
    -------
    ndarray, shape (wavelength,)
        Irradiance [W m-2 nm-1] on a surface that faces the star.
    """
    for field, value in (("temperature_K", temperature_K), ("radius_m", radius_m)):
        if not value > 0:
            raise DomainError(field, value, "a positive number")
    if not distance_m >= radius_m:
        raise DomainError("distance_m", distance_m, f"at least the star's radius of {radius_m:g} m")
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float)) * 1e-9
    exponent = PLANCK * LIGHT / (wl * BOLTZMANN * temperature_K)
    # exp(-x) / (1 - exp(-x)) does not overflow far in the Wien tail.
    radiance = 2 * PLANCK * LIGHT**2 / wl**5 * np.exp(-exponent) / -np.expm1(-exponent)
    return np.pi * radiance * (radius_m / distance_m) ** 2 * 1e-9


def limb_darkening(mu: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
    """Continuum intensity of the Sun's disk relative to its centre, I(mu) / I(1).

    Fifth-order polynomials in mu of Neckel & Labs 1994 (Solar Physics 153, 91, table 1), linear in wavelength between
    their 30 wavelengths from 303 to 1099 nm and constant beyond.  The polynomials were fitted for mu >= 0.12; nearer
    to the limb they extrapolate.

    Parameters
    ----------
    mu : array_like, any shape
        Cosine between the line of sight and the normal of the solar surface, 0 at the limb to 1 at the centre:
        mu = sqrt(1 - (angular distance from the centre / angular radius)^2).
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm].

    Returns
    -------
    ndarray, shape ``mu.shape + (wavelength,)``
    """
    m = np.asarray(mu, dtype=float)
    if np.any((m < 0) | (m > 1)):
        raise DomainError("mu", (float(m.min()), float(m.max())), "cosines from 0 (limb) to 1 (centre)")
    coefficients = limb_coefficients(wavelengths_nm)
    result = np.zeros((*m.shape, coefficients.shape[1]))
    for row in coefficients[::-1]:
        result = result * m[..., None] + row
    return result


def disk_mean(wavelengths_nm: ArrayLike) -> Array:
    """Mean over the apparent disk of `limb_darkening`, 2 int I(mu)/I(1) mu dmu; shape (wavelength,).

    The radiance at the centre of the disk is the mean radiance divided by this.
    """
    weights = 2.0 / (np.arange(6) + 2.0)
    return weights @ limb_coefficients(wavelengths_nm)


def limb_coefficients(wavelengths_nm: ArrayLike) -> Array:
    """Coefficients of mu^0 to mu^5 of `limb_darkening`, shape (6, wavelength); they sum to 1."""
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    table = read_table("solar_limb_darkening.csv")
    rows = np.array([np.interp(wl, table["wavelength_nm"], table[f"a{k}"]) for k in range(6)])
    return rows / rows.sum(axis=0)
