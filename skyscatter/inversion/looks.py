"""Which rays were measured, under which Sun and from where: for skies, for limbs, and for nebulae."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.inversion.observations import model_of
from skyscatter.inversion.parameters import Subject

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


def band_share(star: Any, wavelengths: Array, bandwidth: float) -> Array:
    """The Sun's irradiance through bands of a width [nm] over that in the cells of a grid, (wavelength,).

    Solvers give every wavelength the mean sunlight of its cell, which reaches half-way to its neighbours; light is
    proportional to it.  An instrument whose bands are narrower sees the Fraunhofer lines where they are.
    """
    from skyscatter.spectra.solar import solar_irradiance

    if star.spectrum != "astm-g173":
        return np.ones_like(wavelengths)
    return solar_irradiance(wavelengths, band=bandwidth) / solar_irradiance(wavelengths)


@dataclass(frozen=True)
class Look:
    """Rays under one Sun from one place, and which of their radiances were measured.

    Attributes
    ----------
    sun : mapping
        Fields of `skyscatter.Sun`.
    altitude : float
        Of the observer [m].
    directions : ndarray, shape (ray, 3)
    wavelengths : ndarray, shape (wavelength,)
        [nm]
    ray, band : ndarray of int, shape (datum,)
        What each datum is.
    rows : ndarray of int, shape (datum,)
        Where it stands among all data of the observation.
    response : ndarray, shape (band, wavelength), optional
        Bands as weighted sums of wavelengths; without it each wavelength is a band.
    bandwidth : float, optional
        Of the instrument [nm], where it is not that of the cells of the wavelengths; see `band_share`.
    share : ndarray, shape (wavelength,), optional
        Sunlight of the measurement over that in the cells of these wavelengths.
    """

    sun: Mapping[str, float]
    altitude: float
    directions: Array
    wavelengths: Array
    ray: Integers
    band: Integers
    rows: Integers
    response: Array | None = None
    bandwidth: float | None = None
    share: Array | None = None

    def scene(self, subject: Subject) -> Any:
        """The scene that is looked at."""
        sun = {**self.sun, **subject.sun}
        arguments = {f"sun_{name}": value for name, value in sun.items()}
        return model_of(subject, True, "of a sky").scene(**arguments, altitude=self.altitude)

    def rays(self, subject: Subject) -> tuple[Array, Array]:
        """Origins and directions, each (ray, 3)."""
        position = self.scene(subject).observer.position
        return np.broadcast_to(position, self.directions.shape), self.directions

    def sunlit(self, subject: Subject, values: Array) -> Array:
        """Radiances (..., wavelength) under the sunlight that the measurement had."""
        scaled = values if self.share is None else values * self.share
        if self.bandwidth is None:
            return scaled
        return np.asarray(scaled * band_share(subject.model.star, self.wavelengths, self.bandwidth))

    def pick(self, values: Array) -> Array:
        """From (..., ray, wavelength) to (..., datum)."""
        bands = values if self.response is None else values @ self.response.T
        return np.asarray(bands[..., self.ray, self.band])

    def pick_error(self, errors: Array) -> Array:
        """The same for standard errors, taken as fully correlated between the wavelengths of a band."""
        bands = errors if self.response is None else errors @ np.abs(self.response).T
        return np.asarray(bands[self.ray, self.band])


@dataclass(frozen=True)
class LimbLook(Look):
    """Rays from above the air that pass the planet at tangent heights.

    Attributes
    ----------
    tangent : ndarray, shape (ray, 2)
        Height of the tangent point above the ground [m], and azimuth of the line of sight [degree].
    """

    tangent: Array | None = None

    def rays(self, subject: Subject) -> tuple[Array, Array]:
        """Origins and directions: cos(depression) = (R + h_tangent) / (R + h_observer)."""
        observer = self.scene(subject).observer
        assert self.tangent is not None
        height, azimuth = self.tangent.T
        distance = observer.planet_radius + self.altitude
        if height.max() >= self.altitude:
            raise DomainError(
                "tangent_height_m", float(height.max()), f"lies below the observer at {self.altitude:g} m"
            )
        depression = np.degrees(np.arccos((observer.planet_radius + height) / distance))
        directions = direction_from_azimuth_elevation(azimuth, -depression)
        return np.broadcast_to(observer.position, directions.shape), directions


@dataclass(frozen=True)
class SpaceLook(Look):
    """Pixels of a telescope's picture of a nebula.

    Attributes
    ----------
    camera : Telescope
    pixels : ndarray of int, shape (ray, 2)
        Row and column.
    """

    camera: Any = None
    pixels: Integers | None = None

    def scene(self, subject: Subject) -> Any:
        """The nebula as its model turns it."""
        return model_of(subject, False, "of a nebula").scene()

    def rays(self, subject: Subject) -> tuple[Array, Array]:
        """Lines of sight through the middles of the pixels."""
        assert self.pixels is not None
        view = self.scene(subject).view
        directions = np.ascontiguousarray(self.camera.directions(view)[self.pixels[:, 0], self.pixels[:, 1]])
        return np.broadcast_to(view.position, directions.shape), directions
