"""All that shines from beyond the air at a place and a time, as an observer in vacuum would see it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skyscatter.celestial.frames import Sight
from skyscatter.celestial.lights import SkyLights
from skyscatter.celestial.moon import Moon, moon_at

Array = NDArray[np.float64]

#: Lights that are spread over the sky, and those that are points.
SPREAD, POINTS = ("starlight", "zodiacal", "airglow"), ("planets", "stars")


@dataclass(frozen=True)
class Heavens:
    """The lights of a sky, for an observer.

    Attributes
    ----------
    lights : SkyLights
    sight : Sight
        Place and moment.
    wavelengths : ndarray, shape (wavelength,)
        Vacuum wavelengths [nm], rising.
    """

    lights: SkyLights
    sight: Sight
    wavelengths: Array

    def shines(self, name: str) -> bool:
        """Whether a light is among those asked for."""
        return name in self.lights.shine

    @cached_property
    def moon(self) -> Moon:
        """The Moon."""
        return moon_at(self.sight)

    def radiance(self, name: str, directions: Array) -> Array:
        """Radiance of a light that is spread over the sky, outside the air.

        Parameters
        ----------
        name : str
            Of `SPREAD`.
        directions : ndarray, shape (..., 3)
            Unit vectors (east, north, up).

        Returns
        -------
        ndarray, shape (..., wavelength)
            [W m-2 sr-1 nm-1]
        """
        if name == "airglow":
            from skyscatter.celestial.airglow import airglow_radiance

            return airglow_radiance(
                directions[..., 2],
                self.wavelengths,
                observer_altitude_m=self.sight.altitude_m,
                solar_flux=self.lights.solar_flux,
            )
        if name == "zodiacal":
            from skyscatter.celestial.zodiacal import zodiacal_radiance

            sun = self.sight.ecliptic(self.sight.sun.direction)
            longitude = float(np.degrees(np.arctan2(sun[1], sun[0])))
            return zodiacal_radiance(self.sight.ecliptic(directions), longitude, self.wavelengths)
        from skyscatter.celestial.starlight import starlight_radiance

        return starlight_radiance(self.sight.galactic(directions), self.wavelengths)

    def points(self, name: str) -> tuple[Array, Array]:
        """Directions (point, 3) of planets or stars and their irradiances (point, wavelength) [W m-2 nm-1]."""
        if name == "planets":
            from skyscatter.celestial.planets import planets_at

            planets = planets_at(self.sight)
            light = [planet.irradiance(self.wavelengths) for planet in planets]
            return np.array([planet.direction for planet in planets]), np.array(light)
        from skyscatter.celestial.stars import stars_at

        stars = stars_at(self.sight, catalogue=self.lights.catalogue)
        return stars.directions, stars.irradiance(self.wavelengths)
