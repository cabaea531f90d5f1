"""All that shines from beyond the air at a place and a time, as an observer in vacuum would see it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.celestial.frames import AU, Sight, SkyFrame
from skyscatter.celestial.lights import SkyLights
from skyscatter.celestial.marssight import MarsSight
from skyscatter.celestial.moon import Moon, moon_at

if TYPE_CHECKING:
    from skyscatter.celestial.marsmoons import MarsMoon

Array = NDArray[np.float64]

#: Lights that are spread over the sky, and those that are points.
SPREAD, POINTS = ("starlight", "zodiacal", "airglow"), ("planets", "stars")
#: Zodiacal light falls by this power of the distance from the Sun (Leinert et al. 1981, A&A 103, 177).
ZODIACAL_FALL = 2.3


def moons_of(sight: SkyFrame) -> list[tuple[str, Array]]:
    """Names and directions (east, north, up) of the moons of the planet on which an observer stands."""
    if isinstance(sight, Sight):
        return [("Moon", moon_at(sight).direction)]
    return [(moon.name, moon.direction) for moon in _moons_of_mars(sight)]


def _moons_of_mars(sight: SkyFrame) -> tuple[MarsMoon, ...]:
    from skyscatter.celestial.marsmoons import mars_moons_at

    assert isinstance(sight, MarsSight)
    return mars_moons_at(sight)


@dataclass(frozen=True)
class Heavens:
    """The lights of a sky, for an observer.

    Attributes
    ----------
    lights : SkyLights
    sight : SkyFrame
        Place and moment.
    wavelengths : ndarray, shape (wavelength,)
        Vacuum wavelengths [nm], rising.
    """

    lights: SkyLights
    sight: SkyFrame
    wavelengths: Array

    def shines(self, name: str) -> bool:
        """Whether a light is among those asked for."""
        return name in self.lights.shine

    @cached_property
    def moon(self) -> Moon | None:
        """The Moon, where it shines: a disk.  The moons of Mars are points."""
        return moon_at(self.sight) if isinstance(self.sight, Sight) and self.shines("moon") else None

    @property
    def points_names(self) -> tuple[str, ...]:
        """The lights that are points, in the order in which they are added up."""
        names = POINTS if isinstance(self.sight, Sight) else ("moon", *POINTS)
        return tuple(name for name in names if self.shines(name))

    @property
    def spread_names(self) -> tuple[str, ...]:
        """The lights that are spread over the sky."""
        return tuple(name for name in SPREAD if self.shines(name))

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

            assert isinstance(self.sight, Sight)
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
            fall = (self.sight.sun.distance / AU) ** -ZODIACAL_FALL if isinstance(self.sight, MarsSight) else 1.0
            return fall * zodiacal_radiance(self.sight.ecliptic(directions), longitude, self.wavelengths)
        from skyscatter.celestial.starlight import starlight_radiance

        return starlight_radiance(self.sight.galactic(directions), self.wavelengths)

    def points(self, name: str) -> tuple[Array, Array]:
        """Directions (point, 3) of planets, stars or small moons; irradiances (point, wavelength) [W m-2 nm-1]."""
        if name == "moon":
            moons = _moons_of_mars(self.sight)
            light = [moon.irradiance(self.wavelengths) for moon in moons]
            return np.array([moon.direction for moon in moons]), np.array(light)
        if name == "planets":
            from skyscatter.celestial.planets import planets_at

            planets = planets_at(self.sight)
            light = [planet.irradiance(self.wavelengths) for planet in planets]
            return np.array([planet.direction for planet in planets]), np.array(light)
        from skyscatter.celestial.stars import stars_at

        stars = stars_at(self.sight, catalogue=self.lights.catalogue)
        return stars.directions, stars.irradiance(self.wavelengths)
