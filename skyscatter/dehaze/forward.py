"""What a satellite sees of a pixel: the terms of one atmosphere, averaged over the bands of a sensor.

    rho_toa = T_gas [rho_path + T_down (t_dir rho + t_dif rho_env) / (1 - S rho_env)]

(Vermote et al. 1997, IEEE Trans. Geosci. Remote Sens. 35, 675, eqs. 1 and 21, for gases that absorb above the
scattering): t_dir brings the pixel's own light to the sensor, t_dif that of its surroundings.  All terms but T_gas come
from the polarised solution in spherical shells of `skyscatter.CorrectionTerms`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from skyscatter.dehaze.passband import Band
from skyscatter.errors import DomainError
from skyscatter.media.fields import UsStandard1976
from skyscatter.media.medium import Component, Medium
from skyscatter.optics.rayleigh import RayleighAir
from skyscatter.record import Record
from skyscatter.scene import Scene
from skyscatter.units import Metres, default

Array = NDArray[np.float64]

STANDARD_PRESSURE = 1013.25  #: of the air column of the US Standard Atmosphere 1976 [hPa]
#: Order of the terms in the last axis of every array of them.
PATH, DIRECT, DIFFUSE, BACK = range(4)
#: Bands broader than this share of their wavelength need two wavelengths: beyond it, the path reflectance at the mean
#: wavelength is 0.1 % off for a law lambda^-4 (10 s^2, with the relative spread s = 0.29 width / wavelength).
NARROW = 0.035
#: Wavelength from which light is solved for as unpolarised [nm]: the air's optical depth is below 0.01 there, and what
#: polarisation changes in the path reflectance 0.0001 at the most (soot, AOD 1).
UNPOLARISED = 1000.0
#: Degree of the kept phase functions: one for all amounts of haze, so that terms change smoothly between them.
DEGREE = 8
#: The sums over the orders, which stop after a whole number of them, are taken this much finer for the same reason.
ORDERS_SHARE = 0.2


class Atmosphere(Record):
    """What stands between ground and satellite, but for the amount of haze.

    Parameters
    ----------
    aerosol : str
        Name of an aerosol model, or ``"none"``.
    pressure_hpa : float
        At the ground [hPa].
    planet_radius : length
        At the ground [m].

    Raises
    ------
    DomainError
        For a pressure out of range, or an unknown aerosol.

    Examples
    --------
    On a plateau with three quarters of the air above it, under maritime haze of the optical depth 0.3 at 550 nm:

    >>> from skyscatter.dehaze import Atmosphere
    >>> medium = Atmosphere(aerosol="maritime", pressure_hpa=760).medium(0.3)
    >>> [part.name for part in medium.components]
    ['air', 'water-soluble', 'oceanic']
    >>> round(medium.components[0].weight, 2)
    0.75
    """

    aerosol: str = "continental"
    pressure_hpa: float = STANDARD_PRESSURE
    planet_radius: Metres = default(6371e3)

    @model_validator(mode="after")
    def _check(self) -> Atmosphere:
        if not 50 <= self.pressure_hpa <= 1200:
            raise DomainError("pressure", self.pressure_hpa, "at the ground, between 50 and 1200 hPa")
        if self.aerosol != "none":
            from skyscatter.dehaze.aerosols import aerosol_names, check_aerosol

            check_aerosol(self.aerosol, ("none", *aerosol_names()))
        return self

    def medium(self, aod: float) -> Medium:
        """Air and haze of that optical depth at 550 nm."""
        air = Component(
            name="air", density=UsStandard1976(), optics=RayleighAir(), weight=self.pressure_hpa / STANDARD_PRESSURE
        )
        haze: tuple[Component, ...] = ()
        if aod > 0 and self.aerosol != "none":
            from skyscatter.dehaze.aerosols import aerosol_components

            haze = aerosol_components(self.aerosol, aod)
        return Medium(components=(air, *haze), planet_radius=self.planet_radius)


def pressure_at(height: float) -> float:
    """Pressure of the US Standard Atmosphere 1976 [hPa] at a height above the sea [m], -500 to 10000."""
    if not -500 <= height <= 10000:
        raise DomainError("ground_height", height, "between -500 and 10000 m above the sea")
    # Troposphere: US Standard Atmosphere 1976, eq. 33a, with geopotential height.
    geopotential = 6356766.0 * height / (6356766.0 + height)
    return STANDARD_PRESSURE * (1 - 0.0065 * geopotential / 288.15) ** 5.255876


class BandAverage:
    """Wavelengths that stand for bands, and how terms at those become terms of the bands.

    Parameters
    ----------
    bands : sequence of Band
    """

    def __init__(self, bands: Sequence[Band]) -> None:
        rules = [b.nodes(1 if b.width_nm < NARROW * b.centre_nm else 2) for b in bands]
        every = np.concatenate([wl for wl, _ in rules])
        self.wavelengths, back = np.unique(every, return_inverse=True)
        self.weights = np.zeros((len(bands), self.wavelengths.size))
        start = 0
        for row, (wl, weights) in zip(self.weights, rules, strict=True):
            np.add.at(row, back[start : start + wl.size], weights)
            start += wl.size

    def __call__(self, terms: Array) -> Array:
        """Terms of bands (..., band, term) from those at wavelengths (..., wavelength, term).

        The terms are products along the way, T_down t_dir and so on, so that their averages are those of the light;
        S is weighted by the light that it sends back once more.
        """
        out = np.einsum("bw,...wt->...bt", self.weights, terms)
        light = terms[..., DIRECT] + terms[..., DIFFUSE]
        out[..., BACK] = np.einsum("bw,...w->...b", self.weights, light * terms[..., BACK])
        out[..., BACK] /= out[..., DIRECT] + out[..., DIFFUSE]
        return out


class SolvedAir:
    """The solution for one atmosphere and amount of haze, asked for the terms of bands at any angles.

    Parameters
    ----------
    atmosphere : Atmosphere
    aod : float
        Aerosol optical depth at 550 nm.
    average : BandAverage
    sun_zenith_deg : (float, float)
        Range that will be asked for [degree].
    tolerance : float
        Of the solution, relative.
    stokes : bool
        Solve for polarised light below `UNPOLARISED`; without, the blue is up to some 7 % wrong.
    like : SolvedAir, optional
        Solve on the grid of this, made for a thicker haze and the same Sun: the terms then change smoothly between the
        amounts of haze, where grids of their own would let them jump by some tenths of the tolerance.
    """

    def __init__(
        self,
        atmosphere: Atmosphere,
        aod: float,
        average: BandAverage,
        sun_zenith_deg: tuple[float, float],
        *,
        tolerance: float = 0.01,
        stokes: bool = True,
        like: SolvedAir | None = None,
        threads: int | None = None,
    ) -> None:
        from skyscatter.solvers.terms import CorrectionTerms

        low, high = sun_zenith_deg
        self.average = average
        scene = Scene(medium=atmosphere.medium(aod))
        # Each part of the wavelengths with the light that it needs.
        faint = average.wavelengths >= UNPOLARISED if stokes else np.ones(average.wavelengths.size, bool)
        self.solved: dict[bool, CorrectionTerms] = {}
        for polarised, here in ((True, ~faint), (False, faint)):
            if here.any():
                self.solved[polarised] = CorrectionTerms(
                    scene, average.wavelengths[here], tolerance=tolerance, stokes=polarised,
                    sun_elevations_deg=(90.0 - high, 90.0 - low), degree=DEGREE,
                    orders_tolerance=ORDERS_SHARE * tolerance, threads=threads,
                    like=None if like is None else like.solved[polarised],
                )  # fmt: skip

    def terms(self, sun_zenith_deg: ArrayLike, view_zenith_deg: ArrayLike, relative_azimuth_deg: ArrayLike) -> Array:
        """Terms (..., band, term) for angles [degree] of any broadcast shape (...)."""
        return self.average(self.monochromatic(sun_zenith_deg, view_zenith_deg, relative_azimuth_deg))

    def monochromatic(
        self, sun_zenith_deg: ArrayLike, view_zenith_deg: ArrayLike, relative_azimuth_deg: ArrayLike
    ) -> Array:
        """As `terms`, at the wavelengths of the average: (..., wavelength, term)."""
        elevation = 90.0 - np.asarray(sun_zenith_deg, float)
        parts = []
        for solved in self.solved.values():  # the polarised ones are the shorter wavelengths
            found = solved.at(elevation, view_zenith_deg, relative_azimuth_deg)
            down, up, direct = found.transmittance_down, found.transmittance_up, found.direct_up
            each = (found.path_reflectance, down * direct, down * (up - direct), found.spherical_albedo)
            parts.append(np.stack(each, axis=-1))
        return np.concatenate(parts, axis=-2)


def reflectance_above(terms: Array, surface: ArrayLike, environment: ArrayLike | None = None) -> Array:
    """Reflectance above the scattering air, from terms (..., term) and surface reflectances (...).

    Parameters
    ----------
    terms : array, shape (..., 4)
    surface : array_like
        Of the pixel.
    environment : array_like, optional
        Of its surroundings; the pixel's own when not given.
    """
    rho = np.asarray(surface, float)
    around = rho if environment is None else np.asarray(environment, float)
    lit = terms[..., DIRECT] * rho + terms[..., DIFFUSE] * around
    above: Array = terms[..., PATH] + lit / (1 - terms[..., BACK] * around)
    return above


def surface_reflectance(terms: Array, above: ArrayLike, environment: ArrayLike | None = None) -> Array:
    """The inverse of `reflectance_above`: surface reflectances (...) from those above the scattering air.

    Parameters
    ----------
    terms : array, shape (..., 4)
    above : array_like
        T_gas is divided out.
    environment : array_like, optional
        Reflectance of the surroundings; the pixel's own when not given.
    """
    net = np.asarray(above, float) - terms[..., PATH]
    through = terms[..., DIRECT] + terms[..., DIFFUSE]
    rho: Array
    if environment is None:
        rho = net / (through + terms[..., BACK] * net)
        return rho
    around = np.asarray(environment, float)
    rho = (net * (1 - terms[..., BACK] * around) - terms[..., DIFFUSE] * around) / terms[..., DIRECT]
    return rho
