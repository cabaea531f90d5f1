"""Airglow: the light of the upper air by night, in layers of a sphere around the observer.

A layer of column I (rayleighs towards the zenith) at the distance r_h from the planet's centre is seen by an observer
below it, at the distance r, along a line of sight with the sine of elevation s, with the intensity

    I / sqrt(1 - (r / r_h)^2 (1 - s^2))

(van Rhijn 1921): brighter towards the horizon, the more so the lower the layer.  One who stands in the layer or above
looks through both its sides where the planet is not in the way; there the layer has a profile, or else the limb would
be endlessly bright: a normal curve over the height, as wide at half of its maximum as is measured (OH 8.6 km: Baker &
Stair 1988, Phys. Scr. 37, 611).  Scattering and absorption on the way are left to whoever solves the air.

One rayleigh is 1e10 / (4 pi) photons m-2 s-1 sr-1 (Hunten, Roach & Chamberlain 1956).  Strengths are annual means over
a low-latitude site (Cerro Paranal; the tables in data/ name their sources) at a solar radio flux of 100 sfu, and follow
the flux linearly.  From night to night and within nights the lines change by a factor of two and more.  Left out: what
has no layer (hydrogen's lines from the geocorona, 2 to 4 R) and the O2 band at 762 nm, which the air below swallows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.constants import LIGHT, PLANCK
from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.spectra.cells import cell_edges, cell_means

Array = NDArray[np.float64]

RAYLEIGH = 1e10 / (4.0 * np.pi)  #: photons m-2 s-1 sr-1
RANGE = 300.0, 1000.0  #: wavelengths for which airglow is tabulated [nm]
FLUXES = 50.0, 400.0  #: solar radio fluxes at 10.7 cm that the linear law is allowed for [sfu]; fitted at 67 to 166
_MEAN_FLUX = 100.0  # to which the tables belong [sfu]
_ENDS = 4.5  # of a layer's profile, in standard deviations
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_CONTINUA = {"ho2": 1, "feo": 3, "o2": 5}  # columns of the table of continua, and their classes


class Layers(NamedTuple):
    """Layers of airglow, each of one class of emission; every column of shape (layer,)."""

    height_m: Array  #: of the middle above the ground [m]
    thickness_m: Array  #: full width at half maximum [m]
    solar_slope: Array  #: relative change of the intensity per sfu


def airglow_radiance(
    sine_elevation: ArrayLike,
    wavelengths_nm: ArrayLike,
    observer_altitude_m: float = 0.0,
    solar_flux: float = 100.0,
    planet_radius_m: float = 6371e3,
) -> Array:
    """Spectral radiance of the airglow, before the air scatters and absorbs any of it.

    It is `airglow_paths` times `airglow_spectra`, which cost less memory where one can go on with them.

    Parameters
    ----------
    sine_elevation : array_like, shape (...)
        Sine of the elevation of the line of sight, -1 to 1.
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], 300 to 1000, no two alike; each stands for its cell.
    observer_altitude_m : float
        Above the ground [m].
    solar_flux : float
        Solar radio flux at 10.7 cm, the mean of a month [sfu]: some 70 in the minimum of the Sun's cycle, 150 to 200 in
        the maximum.
    planet_radius_m : float
        [m]

    Returns
    -------
    ndarray, shape (..., wavelength)
        Radiance [W m-2 sr-1 nm-1]; NaN where the sine is NaN.

    Raises
    ------
    DomainError
        For a value out of range.

    Examples
    --------
    The green line in a cell of 2 nm, towards the zenith and at an elevation of 10 degrees, in rayleighs per nm:

    >>> import numpy as np
    >>> from skyscatter.celestial.airglow import airglow_radiance, photon_radiance
    >>> light = airglow_radiance(np.sin(np.radians([90, 10])), [556.0, 558.0, 560.0])
    >>> (light / photon_radiance([556.0, 558.0, 560.0])).round(1).tolist()
    [[5.7, 86.1, 6.5], [24.0, 354.9, 27.3]]
    """
    paths = airglow_paths(sine_elevation, observer_altitude_m, planet_radius_m)
    return np.asarray(paths @ airglow_spectra(wavelengths_nm, solar_flux))


def airglow_layers() -> Layers:
    """The layers, in the order in which `airglow_paths` and `airglow_spectra` have them.

    Returns
    -------
    Layers

    Examples
    --------
    >>> from skyscatter.celestial.airglow import airglow_layers
    >>> airglow_layers().height_m.tolist()
    [81000.0, 87000.0, 88000.0, 92000.0, 94000.0, 94000.0, 97000.0, 250000.0]
    """
    table = read_table("airglow_classes.csv")
    return Layers(1e3 * table["height_km"], 1e3 * table["thickness_km"], 0.01 * table["solar"])


def airglow_paths(
    sine_elevation: ArrayLike, observer_altitude_m: float = 0.0, planet_radius_m: float = 6371e3
) -> Array:
    """How much brighter each layer is along a line of sight than it is towards the zenith from below.

    Parameters
    ----------
    sine_elevation : array_like, shape (...)
        Sine of the elevation of the line of sight, -1 to 1.
    observer_altitude_m : float
        Above the ground [m], 0 at least.
    planet_radius_m : float
        [m]

    Returns
    -------
    ndarray, shape (..., layer)
        1 towards the zenith from below, 0 where the layer is not in sight.

    Raises
    ------
    DomainError
        For a value out of range.

    Examples
    --------
    From the ground towards the horizon, and from a spacecraft at 400 km straight down, for the red and the green line:

    >>> from skyscatter.celestial.airglow import airglow_paths
    >>> airglow_paths(0.0)[-2:].round(2).tolist(), airglow_paths(-1.0, 400e3)[-2:].round(2).tolist()
    ([5.8, 3.67], [1.0, 1.0])
    """
    sine = np.asarray(sine_elevation, dtype=float)
    if np.any(np.abs(sine) > 1.0 + 1e-12):
        raise DomainError("sine_elevation", float(np.nanmax(np.abs(sine))), "lies between -1 and 1")
    if not (np.isfinite(observer_altitude_m) and observer_altitude_m >= 0.0):
        raise DomainError("observer_altitude_m", observer_altitude_m, "is 0 or more [m]")
    if not (np.isfinite(planet_radius_m) and planet_radius_m > 0.0):
        raise DomainError("planet_radius_m", planet_radius_m, "must be positive [m]")
    layers, radius = airglow_layers(), planet_radius_m + observer_altitude_m
    sine = np.clip(sine, -1.0, 1.0)
    seen = []
    for height, thickness in zip(layers.height_m, layers.thickness_m, strict=True):
        shell = planet_radius_m + height
        # The thickness comes in over one thickness below the layer, so that nothing jumps as an observer rises into it.
        share = float(np.clip((observer_altitude_m - height) / thickness + 1.5, 0.0, 1.0))
        thin = _from_below(sine, radius, planet_radius_m, shell) if share < 1.0 else 0.0
        thick = _through(sine, radius, planet_radius_m, shell, thickness) if share > 0.0 else 0.0
        seen.append((1.0 - share) * thin + share * thick)
    return np.stack(seen, axis=-1)


def _from_below(sine: Array, radius: float, ground: float, shell: float) -> Array:
    """Van Rhijn's factor, 0 where the ground is in the way."""
    flat = 1.0 - sine * sine
    factor = 1.0 / np.sqrt(1.0 - (radius / shell) ** 2 * flat)
    return np.where((sine < 0.0) & (radius * np.sqrt(flat) < ground), 0.0, factor)


def _through(sine: Array, radius: float, ground: float, shell: float, thickness: float) -> Array:
    """Integral of a layer's profile along the line of sight, over that along the vertical."""
    impact = radius * np.sqrt(1.0 - sine * sine)
    deviation = thickness / np.sqrt(8.0 * np.log(2.0))
    low, high = shell - _ENDS * deviation, shell + _ENDS * deviation
    down, lowest = sine < 0.0, np.maximum(impact, ground)
    before = np.where(down, _leg(impact, lowest, min(high, radius), low, shell, deviation), 0.0)
    beyond = _leg(impact, np.where(down, impact, radius), high, low, shell, deviation)
    return np.where(np.isnan(sine), np.nan, before + np.where(down & (impact < ground), 0.0, beyond))


def _leg(impact: Array, begin: Array, end: float, low: float, shell: float, deviation: float) -> Array:
    """The same from one distance to another from the planet's centre, on a line that passes it at `impact`.

    At the distance r = b + w^2, b being the impact, it is 2 r / sqrt(r + b) dw long: smooth, also at the limb.
    """
    first = np.sqrt(np.maximum(np.maximum(begin, low) - impact, 0.0))
    half = 0.5 * np.maximum(np.sqrt(np.maximum(end - impact, 0.0)) - first, 0.0)
    out, crossed = np.zeros_like(impact), half > 0.0
    impact, first, half = impact[crossed], first[crossed], half[crossed]
    total = np.zeros_like(impact)
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        distance = impact + (first + half * (1.0 + node)) ** 2
        profile = np.exp(-0.5 * ((distance - shell) / deviation) ** 2)
        total += weight * profile * distance / np.sqrt(impact + distance)
    out[crossed] = np.sqrt(2.0 / np.pi) / deviation * half * total
    return out


def airglow_spectra(wavelengths_nm: ArrayLike, solar_flux: float = 100.0) -> Array:
    """Spectra of the layers towards the zenith, averaged over the cells of the wavelengths.

    The light of a line is spread over the cell that it falls into: sums over cells keep it, whatever the grid.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], 300 to 1000, no two alike; a single one has a cell of 1 nm.
    solar_flux : float
        Solar radio flux at 10.7 cm, the mean of a month [sfu].

    Returns
    -------
    ndarray, shape (layer, wavelength)
        Radiance [W m-2 sr-1 nm-1].

    Raises
    ------
    DomainError
        For a value out of range, or a wavelength that occurs twice.

    Examples
    --------
    >>> from skyscatter.celestial.airglow import airglow_spectra
    >>> spectra = airglow_spectra([400.0, 480.0, 560.0, 640.0, 720.0])
    >>> spectra.argmax(axis=0).tolist()  # the brightest layers: O2, O2, FeO, FeO, OH
    [4, 4, 2, 2, 1]
    """
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    if wl.size == 0 or not (RANGE[0] <= wl.min() and wl.max() <= RANGE[1]):
        raise DomainError("wavelength", wl.tolist(), "airglow is tabulated from 300 to 1000 nm")
    if not FLUXES[0] <= solar_flux <= FLUXES[1]:
        raise DomainError("solar_flux", solar_flux, "lies between 50 and 400 sfu")
    layers, lines, continua = airglow_layers(), read_table("airglow_lines.csv"), read_table("airglow_continuum.csv")
    spectra = np.zeros((len(layers.height_m), wl.size))
    nodes = continua["wavelength_nm"]
    for column, number in _CONTINUA.items():
        spectra[number - 1] += cell_means(nodes, continua[column] * photon_radiance(nodes), wl)
    low, high = cell_edges(wl)
    order = np.argsort(wl)
    place = np.searchsorted(low[order], lines["wavelength_nm"], side="right") - 1
    cell = order[np.maximum(place, 0)]
    inside = (place >= 0) & (lines["wavelength_nm"] < high[cell])
    light = lines["rayleigh"] * photon_radiance(lines["wavelength_nm"]) / (high - low)[cell]
    np.add.at(spectra, (lines["class"][inside].astype(np.intp) - 1, cell[inside]), light[inside])
    return spectra * (1.0 + layers.solar_slope * (solar_flux - _MEAN_FLUX))[:, None]


def photon_radiance(wavelengths_nm: ArrayLike) -> Array:
    """Radiance [W m-2 sr-1] of one rayleigh at wavelengths.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (...)
        Vacuum wavelengths [nm].

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> from skyscatter.celestial.airglow import photon_radiance
    >>> print(f"{photon_radiance(557.9):.3g}")
    2.83e-10
    """
    return np.asarray(RAYLEIGH * PLANCK * LIGHT / (np.asarray(wavelengths_nm, dtype=float) * 1e-9))
