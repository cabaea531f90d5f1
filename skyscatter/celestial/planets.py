"""The planets as an observer sees them: places, magnitudes, sizes and light."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial import magnitudes
from skyscatter.celestial.frames import AU, J2000, Array, SkyFrame, light_time
from skyscatter.celestial.planetorbits import planet_place
from skyscatter.spectra.solar import solar_irradiance
from skyscatter.spectra.vega import BAND_NODES, band_weights, magnitude


class _Body(NamedTuple):
    number: int  #: in ERFA's plan94
    radius: float  #: at the equator [m], IAU (Archinal et al. 2018)
    #: Geometric albedos in U, B, V, R_C, R, I_C and I (Mallama et al. 2017, Icarus 282, 19); their ratios count.
    albedos: tuple[float, float, float, float, float, float, float]
    #: North pole, right ascension and declination [degree]; where brightness depends on it
    pole: tuple[float, float] | None = None
    polar_radius: float | None = None  #: [m]; where latitudes are planetographic


_BAND_CENTRES = (360.0, 436.0, 549.0, 641.0, 700.0, 798.0, 900.0)  # [nm]
#: Which of these are bands of Bessell.
_BANDS = {0: "U", 1: "B", 2: "V", 3: "R", 5: "I"}
_BODIES = {
    "Mercury": _Body(1, 2.4405e6, (0.087, 0.105, 0.142, 0.158, 0.172, 0.180, 0.208)),
    "Venus": _Body(2, 6.0518e6, (0.348, 0.658, 0.689, 0.658, 0.708, 0.640, 0.584)),
    "Earth": _Body(3, 6.3781e6, (0.688, 0.512, 0.434, 0.392, 0.386, 0.396, 0.431)),
    "Mars": _Body(4, 3.39619e6, (0.060, 0.088, 0.170, 0.250, 0.288, 0.285, 0.330)),
    "Jupiter": _Body(5, 7.1492e7, (0.358, 0.443, 0.538, 0.513, 0.495, 0.389, 0.321)),
    "Saturn": _Body(6, 6.0268e7, (0.203, 0.339, 0.499, 0.646, 0.568, 0.543, 0.423), (40.589, 83.537)),
    "Uranus": _Body(7, 2.5559e7, (0.502, 0.561, 0.488, 0.264, 0.202, 0.089, 0.079), (257.311, -15.175), 2.4973e7),
    "Neptune": _Body(8, 2.4764e7, (0.578, 0.562, 0.442, 0.226, 0.181, 0.072, 0.067)),
}


@dataclass(frozen=True)
class Planet:
    """A planet as an observer sees it; `planets_at` makes them.

    Examples
    --------
    Mars at its nearest in 60 000 years.

    >>> import math
    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.planets import planets_at
    >>> mars = planets_at(Sight(0.0, 0.0, "2003-08-27T10:00Z"))[2]
    >>> mars.name, round(mars.magnitude, 1), round(3600 * math.degrees(mars.angular_diameter), 1)
    ('Mars', -2.9, 25.1)
    """

    name: str
    direction: Array  #: apparent, topocentric, unrefracted (east, north, up), shape (3,)
    distance: float  #: from the observer [m]
    sun_distance: float  #: [m]
    phase_angle_deg: float  #: between the Sun and the observer as seen from the planet; 0 is full
    magnitude: float  #: in V, outside the air
    angular_diameter: float  #: of the equator [rad], without rings

    @property
    def illuminated(self) -> float:
        """Share of the disk that the Sun lights."""
        return 0.5 * (1.0 + math.cos(math.radians(self.phase_angle_deg)))

    def irradiance(self, wavelengths: ArrayLike) -> Array:
        """Light on a surface that faces the planet, outside the atmosphere.

        Parameters
        ----------
        wavelengths : array_like, shape (wavelength,)
            Vacuum wavelengths [nm]; sunlight is averaged over their cells.

        Returns
        -------
        ndarray, shape (wavelength,)
            [W m-2 nm-1]: sunlight times a reflectance that is linear between seven wavelengths from 360 to 900 nm and
            constant beyond, such that its averages over U, B, V, R and I go as the planet's albedos there, with the
            planet's magnitude in V.
        """
        wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
        colour = np.interp(wl, _BAND_CENTRES, _reflectance(self.name))
        return np.asarray(solar_irradiance(wl) * colour * 10 ** (-0.4 * (self.magnitude - _unit_magnitude(self.name))))


def planets_at(sight: SkyFrame) -> tuple[Planet, ...]:
    """Mercury to Neptune for a place and a moment, without the observer's own planet.

    Parameters
    ----------
    sight : SkyFrame
        A `skyscatter.celestial.frames.Sight`, or one from Mars.

    Returns
    -------
    tuple of Planet
        In the order of their distances from the Sun; above and below the horizon.

    Notes
    -----
    Heliocentric places from `skyscatter.celestial.planetorbits.planet_place`, within some arc seconds; light time,
    parallax and aberration are applied, the bending of light by the Sun and refraction are not, and the Sun's own
    motion of 15 m/s is left out of the light time.

    Magnitudes by Mallama & Hilton 2018; those of Mars without the 0.1 that its features and seasons add, of
    Saturn with the rings.

    Examples
    --------
    Venus, a month before its greatest elongation.

    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.planets import planets_at
    >>> planets = {p.name: p for p in planets_at(Sight(48.86, 2.35, "2026-07-15T20:30Z"))}
    >>> round(planets["Venus"].magnitude, 1), round(planets["Venus"].illuminated, 2)
    (-4.2, 0.63)
    """
    return tuple(_planet(sight, name, body) for name, body in _BODIES.items() if name != sight.body)


def _planet(sight: SkyFrame, name: str, body: _Body) -> Planet:
    state = sight.state
    day, fraction = state.tt
    from_sun = planet_place(body.number, day, fraction)
    for _ in range(3):
        seen = from_sun - state.centre - state.place
        late = light_time(float(np.linalg.norm(seen)))
        from_sun = planet_place(body.number, day, fraction - late)
    distance, sun_distance = float(np.linalg.norm(seen)), float(np.linalg.norm(from_sun))
    cosine = float(np.clip(from_sun @ seen / (distance * sun_distance), -1.0, 1.0))
    phase = math.degrees(math.acos(cosine))
    absolute = _absolute(name, body, phase, from_sun / sun_distance, seen / distance, day + fraction)
    return Planet(
        name=name,
        direction=sight.apparent(seen / distance),
        distance=distance,
        sun_distance=sun_distance,
        phase_angle_deg=phase,
        magnitude=absolute + 5.0 * math.log10(distance * sun_distance / AU**2),
        angular_diameter=2.0 * math.asin(body.radius / distance),
    )


def _absolute(name: str, body: _Body, phase: float, from_sun: Array, seen: Array, date: float) -> float:
    """Magnitude at 1 au from Sun and observer; unit vectors from the Sun and from the observer to the planet."""
    if name in magnitudes.PLAIN:
        return magnitudes.PLAIN[name](phase)
    if body.pole is None:
        return magnitudes.neptune(phase, 2000.0 + (date - J2000) / 365.25)
    ra, dec = (math.radians(angle) for angle in body.pole)
    pole = np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])
    sun, observer = (math.asin(float(np.clip(-pole @ towards, -1.0, 1.0))) for towards in (from_sun, seen))
    if name == "Saturn":
        return magnitudes.saturn(phase, math.degrees(sun), math.degrees(observer))
    assert body.polar_radius is not None
    steeper = (body.radius / body.polar_radius) ** 2  # planetographic: of the vertical, not of the centre
    sun, observer = (math.atan(steeper * math.tan(latitude)) for latitude in (sun, observer))
    return magnitudes.uranus(phase, math.degrees(sun), math.degrees(observer))


@lru_cache(maxsize=16)
def _reflectance(name: str) -> tuple[float, ...]:
    """Reflectance at `_BAND_CENTRES` whose averages over the bands of Bessell are the albedos."""
    wanted = np.array(_BODIES[name].albedos)
    found, sun = wanted.copy(), solar_irradiance(BAND_NODES)
    for _ in range(30):
        light = sun * np.interp(BAND_NODES, _BAND_CENTRES, found)
        for place, band in _BANDS.items():
            weights = band_weights(band)
            found[place] *= wanted[place] * (sun @ weights) / (light @ weights)
    return tuple(float(value) for value in found)


@lru_cache(maxsize=16)
def _unit_magnitude(name: str) -> float:
    """Magnitude in V of sunlight at 1 au times the planet's reflectance."""
    colour = np.interp(BAND_NODES, _BAND_CENTRES, _reflectance(name))
    return float(magnitude(solar_irradiance(BAND_NODES) * colour, "V"))
