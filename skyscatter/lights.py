"""Lights of space: stars as points, parallel light from far away, and the mean light of the Galaxy's stars."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from skyscatter.constants import LIGHT, PLANCK, SOLAR_LUMINOSITY, STEFAN_BOLTZMANN
from skyscatter.errors import DomainError
from skyscatter.geometry.vectors import Directed
from skyscatter.optics.base import Array
from skyscatter.record import Record
from skyscatter.spectra.solar import blackbody_irradiance
from skyscatter.spectra.table import Irradiance, OptionalSpectral, SpectralTable, bounds, evaluate
from skyscatter.units import (
    Degrees,
    Elevation,
    Kelvin,
    Luminosity,
    Magnitude,
    OptionalNumber,
    OptionalTriple,
    Place,
    PositiveMetres,
    Share,
    Triple,
    default,
)

#: Irradiance of magnitude 0 in V at 550 nm [W m-2 nm-1]: Vega's, Bessell, Castelli & Plez (1998), A&A 333, 231.
VEGA_V = 3.631e-11
VISUAL_WAVELENGTH = 550.0  #: where magnitudes in V count [nm]

_AMOUNTS = ("luminosity", "radius", "magnitude_v", "spectrum")


def blackbody_exitance(wavelengths_nm: ArrayLike, temperature: float) -> Array:
    """Light that a black surface sends into its half space, pi B [W m-2 nm-1]; shape (wavelength,)."""
    return blackbody_irradiance(wavelengths_nm, temperature, 1.0, 1.0)


def visual_irradiance(magnitude: ArrayLike) -> Array:
    """Irradiance at 550 nm [W m-2 nm-1] of a star by its magnitude in V, with Vega at 0."""
    irradiance: Array = VEGA_V * 10 ** (-0.4 * np.asarray(magnitude, float))
    return irradiance


class PointStar(Record):
    """A star that is a point: a black body, or a spectrum of one's own.

    Give exactly one of `luminosity`, `radius`, `magnitude_v` and `spectrum`; `temperature` goes with the first three.

    Parameters
    ----------
    name : str
        How it is called.
    position : three lengths
        In the frame of the model [m]; inside or outside the gas.
    temperature : float, optional
        Effective temperature [K].
    luminosity : float, optional
        Bolometric luminosity [nominal solar luminosities, 3.828e26 W].
    radius : length, optional
        Of the black sphere that shines like the star [m]; the star stays a point.
    magnitude_v : float, optional
        Apparent magnitude in V at the distance of the observer, free of all dust, that of the model included.  Vega's
        zero point, 3.631e-11 W m-2 nm-1 (Bessell, Castelli & Plez 1998), counts at 550 nm.
    spectrum : SpectralTable, optional
        Luminosity per wavelength [W nm-1], into all directions together.

    Examples
    --------
    A hot star: its radius in units of the Sun's, and how many photons it has to ionise hydrogen.

    >>> import skyscatter
    >>> star = skyscatter.PointStar(temperature=40000, luminosity=1e5)
    >>> round(star.radius_m() / 6.957e8, 1)
    6.6
    >>> f"{star.ionising_photons():.0e} s-1"
    '5e+48 s-1'
    """

    name: str = "star"
    position: Place = default((0.0, 0.0, 0.0))
    temperature: OptionalNumber[Kelvin] = default(None)
    luminosity: OptionalNumber[Luminosity] = default(None)
    radius: OptionalNumber[PositiveMetres] = default(None)
    magnitude_v: OptionalNumber[Magnitude] = default(None)
    spectrum: SpectralTable | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = [name for name in _AMOUNTS if getattr(self, name) is not None]
        if len(given) != 1:
            raise DomainError(self.name, ", ".join(given), f"give exactly one of {', '.join(_AMOUNTS)}")
        if (self.temperature is None) != (self.spectrum is not None):
            raise DomainError("temperature", self.temperature, "goes with every star but one with a spectrum")
        if self.spectrum is not None and bounds(self.spectrum)[0] < 0:
            raise DomainError("spectrum", bounds(self.spectrum)[0], "a luminosity is never negative")
        return self

    def spectral_luminosity(self, wavelengths_nm: ArrayLike, distance_m: float | None = None) -> Array:
        """Light into all directions together [W nm-1]; shape (wavelength,).

        Parameters
        ----------
        wavelengths_nm : array_like, shape (wavelength,)
            Vacuum wavelengths [nm].
        distance_m : float, optional
            Of the observer [m]; needed for a star by its magnitude.
        """
        if self.spectrum is not None:
            return evaluate(self.spectrum, wavelengths_nm)
        area = 4 * np.pi * self.radius_m(distance_m) ** 2
        return area * blackbody_exitance(wavelengths_nm, self._black_temperature)

    def radius_m(self, distance_m: float | None = None) -> float:
        """Radius of the black sphere that shines like the star [m]; see `spectral_luminosity`."""
        temperature = self._black_temperature
        if self.radius is not None:
            return self.radius
        if self.luminosity is not None:
            power = self.luminosity * SOLAR_LUMINOSITY
            return float(np.sqrt(power / (4 * np.pi * STEFAN_BOLTZMANN * temperature**4)))
        if distance_m is None or not distance_m > 0:
            raise DomainError("distance", distance_m, f"{self.name} has a magnitude; give the observer's distance too")
        share = visual_irradiance(self.magnitude_v or 0.0) / blackbody_exitance([VISUAL_WAVELENGTH], temperature)[0]
        return float(distance_m * np.sqrt(share))

    def luminosity_W(self, distance_m: float | None = None) -> float:  # noqa: N802 - the unit is a watt
        """Bolometric luminosity [W] of a black body; see `spectral_luminosity`."""
        return 4 * np.pi * self.radius_m(distance_m) ** 2 * STEFAN_BOLTZMANN * self._black_temperature**4

    def ionising_photons(self, distance_m: float | None = None) -> float:
        """Photons that ionise hydrogen [s-1]; see `spectral_luminosity`.

        A table is integrated from its first node on and must begin at 91 nm or less.
        """
        from skyscatter.media.ionised import LYMAN_LIMIT, ionising_photons

        if self.spectrum is None:
            return ionising_photons(self._black_temperature, radius_m=self.radius_m(distance_m))
        wl = np.asarray(self.spectrum.wavelengths)
        if wl[0] > 91.0:
            raise DomainError("spectrum", float(wl[0]), "begins beyond 91 nm: it does not say what ionises hydrogen")
        nodes = np.append(wl[wl < LYMAN_LIMIT], LYMAN_LIMIT)
        power = evaluate(self.spectrum, nodes)
        # Photons are power times wavelength over h c; both linear in a cell, so Simpson's rule is exact.
        middle = 0.25 * (power[1:] + power[:-1]) * (nodes[1:] + nodes[:-1])
        cells = np.diff(nodes) / 6 * (power[1:] * nodes[1:] + 4 * middle + power[:-1] * nodes[:-1])
        return float(np.sum(cells) * 1e-9 / (PLANCK * LIGHT))

    @property
    def _black_temperature(self) -> float:
        if self.temperature is None:
            raise DomainError("spectrum", self.name, "a star with a spectrum of its own is no black body")
        return self.temperature


class ParallelLight(Directed, Record):
    """Light from one direction, as of a star far outside the model.

    Give either `direction` or `azimuth_deg` and `elevation_deg`, and either `irradiance` or `temperature` and
    `dilution`.

    Parameters
    ----------
    name : str
        How it is called.
    direction : three floats, optional
        Towards the light, of any length but zero, in the frame of the model.
    azimuth_deg, elevation_deg : float, optional
        The same as angles [degree]: azimuth in the x-y plane from +y towards +x, elevation above it towards +z.
    irradiance : float or SpectralTable, optional
        On a surface that faces the light [W m-2 nm-1].
    temperature : float, optional
        Of a black body [K] whose light is diluted: irradiance = dilution pi B(temperature).
    dilution : float, optional
        (radius / distance)^2 of the body.

    Examples
    --------
    A star like the Sun at one astronomical unit, in the east and 30 degrees above the x-y plane.

    >>> import skyscatter
    >>> light = skyscatter.ParallelLight(azimuth_deg=90, elevation_deg=30, temperature=5772, dilution=2.163e-5)
    >>> light.spectral_irradiance([450, 550, 650]).round(2)  # W m-2 nm-1
    array([1.73, 1.75, 1.54])
    >>> round(float(light.towards[2]), 3)  # the share that falls on that plane
    0.5
    """

    name: str = "light"
    direction: OptionalTriple[Triple] = default(None)
    azimuth_deg: OptionalNumber[Degrees] = default(None)
    elevation_deg: OptionalNumber[Elevation] = default(None)
    irradiance: OptionalSpectral[Irradiance] = default(None)
    temperature: OptionalNumber[Kelvin] = default(None)
    dilution: OptionalNumber[Share] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.check_direction()
        body = (self.temperature is not None, self.dilution is not None)
        if any(body) != all(body) or any(body) == (self.irradiance is not None):
            raise DomainError("irradiance", self.irradiance, "give either irradiance, or temperature and dilution")
        return self

    def spectral_irradiance(self, wavelengths_nm: ArrayLike) -> Array:
        """Irradiance of a surface that faces the light [W m-2 nm-1]; shape (wavelength,)."""
        if self.irradiance is not None:
            return evaluate(self.irradiance, wavelengths_nm)
        return (self.dilution or 0.0) * blackbody_exitance(wavelengths_nm, self.temperature or 0.0)


#: Old stars: dilution and temperature [K] of three black bodies, Draine (2011), table 12.1.
_OLD_STARS = ((7e-13, 3000.0), (1.65e-13, 4000.0), (1e-14, 7500.0))
#: Young stars: longest wavelength [micron], factor [erg cm-3] and exponent of lambda u_lambda, Draine (2011), eq. 12.7.
_YOUNG_STARS = ((0.110, 1.287e-9, 4.4172), (0.134, 6.825e-13, 1.0), (0.246, 2.373e-14, -0.6678))
_YOUNG_BEGIN = 0.0912


def interstellar_radiation(wavelengths_nm: ArrayLike) -> Array:
    """Mean radiance of starlight near the Sun, the same from all sides [W m-2 sr-1 nm-1].

    Mathis, Mezger & Panagia (1983), A&A 128, 212, with the dilutions of Draine (2011), Physics of the Interstellar and
    Intergalactic Medium, section 12.5: three black bodies beyond 246 nm, power laws from there to 91.2 nm, nothing
    below.  Starlight only: from about 5 micron on the glow of dust, left out here, is brighter.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm].

    Returns
    -------
    ndarray, shape (wavelength,)
    """
    wl = np.atleast_1d(np.asarray(wavelengths_nm, float))
    micron = wl * 1e-3
    begin = _YOUNG_BEGIN
    radiance = np.zeros_like(wl)
    for end, factor, exponent in _YOUNG_STARS:
        inside = (micron >= begin) & (micron < end)
        energy = 0.1 * factor * micron[inside] ** exponent  # lambda u_lambda [J m-3]
        radiance[inside] = LIGHT * energy / (4 * np.pi * wl[inside])
        begin = end
    old = micron >= begin
    for dilution, temperature in _OLD_STARS:
        radiance[old] += dilution * blackbody_exitance(wl[old], temperature) / np.pi
    return radiance
