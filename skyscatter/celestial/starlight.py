"""Starlight that is not drawn star by star: the Milky Way and all stars fainter than V = 7, outside the air.

The map holds brightness at 550 nm and B - V of cells of 0.5 and 2 degrees, in galactic coordinates.  It comes from a
map of catalogued stars by SkyMapMod; `tools/make_starlight.py` says what was found in that and done with it.  Stars
brighter than V = 7 are not in it, clusters mostly lost; dark parts of the sky are smoothed over 3 degrees, the Milky
Way over 0.7.  Means over latitude agree with star counts within 20 %.  Colours are rough: B - V to 0.2.

Dust scatters some of this light towards us, the diffuse galactic light, which no catalogue of stars has.  It is 20 to
30 % of the Milky Way's whole light (Leinert et al. 1998, section 11, from memory), and is put on as a share of 25 % of
the sum everywhere, with the colour of the stars; it is in truth bluer and wider.  The light of other galaxies, of one
star of tenth magnitude per square degree or so, is left out.

The spectrum of every place is a mixture of two black bodies, 4000 and 7000 K, that has the B - V of the map.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.celestial.grids import bilinear, unit_vectors
from skyscatter.constants import BOLTZMANN, LIGHT, PLANCK
from skyscatter.datafiles import data_path
from skyscatter.errors import DomainError

Array = NDArray[np.float64]

LIMIT = 7.0  #: stars brighter than this in V are not in the map
DIFFUSE = 0.25  #: share of the whole that dust has scattered
TEMPERATURES = 4000.0, 7000.0  #: of the two black bodies [K]
#: Radiance at 550 nm of one star of V = 10 per square degree [W m-2 sr-1 nm-1], with the flux of V = 0 by Bessell,
#: Castelli & Plez (1998, A&A 333, 231).
S10_STARS = 3.631e-15 * (180.0 / np.pi) ** 2
RANGE = 280.0, 2500.0  #: wavelengths for which black bodies stand for stars [nm]
_MIDDLE = 550.0  # [nm]
_STEP, _COLOUR_STEP = 200.0, 200.0  # of ln(brightness) and of B - V in the file
_SOUTH, _WEST, _CELL = -90.05, -179.95, 0.5  # edges of the map in the file, and the side of its cells [degree]
_BANDS = 440.0, 550.0  # where black bodies have the ratio of fluxes that B - V says [nm]
_BAND_RATIO = 6.320 / 3.631  # of fluxes in B and V of a star of magnitude 0 in both


def starlight_radiance(galactic: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
    """Spectral radiance of stars fainter than V = 7, and of the dust that they light, outside the air.

    It is `starlight_parts` times `starlight_spectra`, which cost less memory where one can go on with them.

    Parameters
    ----------
    galactic : array_like, shape (..., 3)
        Directions: vectors in the galactic frame, x to the galactic centre, z to the north pole.
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], 280 to 2500.

    Returns
    -------
    ndarray, shape (..., wavelength)
        Radiance [W m-2 sr-1 nm-1]; NaN where the direction is NaN.

    Raises
    ------
    DomainError
        For vectors without length and wavelengths out of range.

    Examples
    --------
    The great cloud in Sagittarius and the north pole, in stars of tenth magnitude per square degree:

    >>> import numpy as np
    >>> from skyscatter.celestial.starlight import S10_STARS, starlight_radiance
    >>> cloud = [np.cos(np.radians(3)), 0.03, -np.sin(np.radians(3))]
    >>> (starlight_radiance([cloud, [0, 0, 1]], [550.0]) / S10_STARS).round(-1).tolist()
    [[980.0], [30.0]]
    """
    return np.asarray(starlight_parts(galactic) @ starlight_spectra(wavelengths_nm))


def starlight_parts(galactic: ArrayLike) -> Array:
    """Radiance at 550 nm [W m-2 sr-1 nm-1], divided between the spectra of `starlight_spectra`.

    Parameters
    ----------
    galactic : array_like, shape (..., 3)
        As for `starlight_radiance`.

    Returns
    -------
    ndarray, shape (..., 2)
        Of the cool and of the warm black body; neither is negative.

    Examples
    --------
    >>> from skyscatter.celestial.starlight import starlight_parts
    >>> cool, warm = starlight_parts([-1, 0, 0])  # away from the centre it is less red than towards it
    >>> centre = starlight_parts([1, 0, 0])
    >>> bool(warm / cool > centre[1] / centre[0])
    True
    """
    x, y, z = np.moveaxis(unit_vectors("galactic", galactic), -1, 0)
    latitude = np.degrees(np.arctan2(z, np.hypot(x, y)))
    longitude = np.degrees(np.arctan2(y, x))
    table = _map()
    # Middles of cells of half the size; before the first row it stands again.
    row = (latitude - _SOUTH) * (2.0 / _CELL) + 0.5
    column = ((longitude - _WEST) * (2.0 / _CELL) - 0.5) % (table.shape[1] - 1)
    return bilinear(table, row.ravel(), column.ravel()).reshape(*latitude.shape, 2)


def starlight_spectra(wavelengths_nm: ArrayLike) -> Array:
    """Spectra of the two black bodies, 1 at 550 nm.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], 280 to 2500.

    Returns
    -------
    ndarray, shape (2, wavelength)

    Raises
    ------
    DomainError
        For wavelengths out of range.

    Examples
    --------
    >>> from skyscatter.celestial.starlight import starlight_spectra
    >>> starlight_spectra([450.0, 550.0, 650.0]).round(2).tolist()
    [[0.64, 1.0, 1.19], [1.17, 1.0, 0.79]]
    """
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    if wl.size and not (RANGE[0] <= wl.min() and wl.max() <= RANGE[1]):
        raise DomainError("wavelength", (float(wl.min()), float(wl.max())), "starlight is known from 280 to 2500 nm")
    return _black_bodies(wl)


def _black_bodies(wl: Array) -> Array:
    unit = PLANCK * LIGHT / (BOLTZMANN * 1e-9) / np.array(TEMPERATURES)[:, None]
    return np.asarray((_MIDDLE / wl) ** 5 * np.expm1(unit / _MIDDLE) / np.expm1(unit / wl))


@lru_cache(maxsize=1)
def _map() -> NDArray[np.float32]:
    """Radiance of both parts at 550 nm every 0.25 degrees, with a row beyond each end; the last column is the first."""
    with np.load(data_path("starlight.npz")) as file:
        brightness = np.exp(file["brightness"].astype(np.float32) * np.float32(1.0 / _STEP))
        colour = file["colour"].astype(np.float32) * np.float32(1.0 / _COLOUR_STEP)
    brightness *= np.float32(S10_STARS / (1.0 - DIFFUSE))
    for _ in range(2):
        colour = _halved(colour)
    warm = _warm_share(colour) * brightness
    parts = _halved(np.stack([brightness - warm, warm], axis=-1))
    parts[[0, -1]] = parts[[0, -1]].mean(axis=1, keepdims=True)  # within 0.2 degrees of the poles
    parts = np.concatenate([parts[:1], parts, parts[-1:]])
    return np.concatenate([parts, parts[:, :1]], axis=1)


def _halved(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Cells divided by four, as control points of the same quadratic spline (Chaikin 1974).

    Longitudes go round; beyond the outermost latitudes the same values stand again.
    """
    south, north = np.concatenate([values[:1], values[:-1]]), np.concatenate([values[1:], values[-1:]])
    rows = np.stack([0.25 * south + 0.75 * values, 0.75 * values + 0.25 * north], axis=1)
    values = rows.reshape(2 * values.shape[0], *values.shape[1:])
    west, east = np.roll(values, 1, axis=1), np.roll(values, -1, axis=1)
    columns = np.stack([0.25 * west + 0.75 * values, 0.75 * values + 0.25 * east], axis=2)
    return columns.reshape(values.shape[0], 2 * values.shape[1], *values.shape[2:])


def _warm_share(colour: NDArray[np.float32]) -> NDArray[np.float32]:
    """Share of the warm black body at 550 nm for a B - V."""
    ratio = np.float32(_BAND_RATIO) * np.power(np.float32(10.0), np.float32(-0.4) * colour)  # of fluxes in B and V
    (cool, _), (warm, _) = _black_bodies(np.array(_BANDS))
    return np.clip((ratio - np.float32(cool)) / np.float32(warm - cool), 0.0, 1.0)
