"""Phobos and Deimos as they are seen from Mars."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial.frames import AU, J2000, Array, body_axes, light_time
from skyscatter.celestial.marssight import MARS_RADIUS, MarsSight
from skyscatter.spectra.solar import SOLAR_RADIUS, solar_irradiance

#: Fall of brightness with the phase angle [mag degree-1] of dark, dusty ground: Phobos, Deimos (Thomas et al. 1996,
#: Icarus 123, 536: 0.033 and 0.030 from 10 to 60 degrees).
_PHASE = {"Phobos": 0.033, "Deimos": 0.030}


class _Orbit(NamedTuple):
    radius: float  #: mean, of the moon [m]
    axis: float  #: semi-major axis [m]
    eccentricity: float
    albedo: float  #: geometric, in V


#: Archinal et al. 2011; orbits after Jacobson 2010 (Astron. J. 139, 668); albedos after Thomas et al. 1996.
_MOONS = {"Phobos": _Orbit(11.08e3, 9.3750e6, 0.01511, 0.071), "Deimos": _Orbit(6.2e3, 2.34571e7, 0.00027, 0.068)}


@dataclass(frozen=True)
class MarsMoon:
    """A moon of Mars as an observer there sees it; `mars_moons_at` makes them.

    Examples
    --------
    On 2 April 2022 the rover Perseverance watched Phobos pass before the Sun.

    >>> import numpy as np
    >>> from skyscatter.celestial.marsmoons import mars_moons_at
    >>> from skyscatter.celestial.marssight import MarsSight
    >>> jezero = [MarsSight(18.44, 77.45, f"2022-04-02T{h:02d}:{m:02d}Z") for h in range(24) for m in range(60)]
    >>> aside = [np.degrees(np.arccos(mars_moons_at(s)[0].direction @ s.sun.direction)) for s in jezero]
    >>> bool(min(aside) < 0.5)
    True
    """

    name: str
    direction: Array  #: topocentric, unrefracted (east, north, up), shape (3,)
    distance: float  #: from the observer [m]
    angular_radius: float  #: of a sphere with its mean radius [rad]
    phase_angle_deg: float  #: between the Sun and the observer as seen from the moon; 0 is full
    sunlit: float  #: share of the Sun that Mars leaves free, 0 in its shadow
    sun_distance: float  #: [m]

    def irradiance(self, wavelengths: ArrayLike) -> Array:
        """Light on a surface that faces the moon, outside the air, shape (wavelength,) [W m-2 nm-1].

        A sphere as grey as the moon is in V: its ground is a little redder than sunlight.
        """
        orbit = _MOONS[self.name]
        size = (orbit.radius / self.distance) ** 2 * (AU / self.sun_distance) ** 2
        share = self.sunlit * orbit.albedo * size * 10 ** (-0.4 * _PHASE[self.name] * self.phase_angle_deg)
        return np.asarray(solar_irradiance(wavelengths) * share)


def mars_moons_at(sight: MarsSight) -> tuple[MarsMoon, ...]:
    """Phobos and Deimos for a place on Mars and a moment.

    Parameters
    ----------
    sight : MarsSight

    Returns
    -------
    tuple of MarsMoon
        Above and below the horizon.

    Notes
    -----
    Both moons keep one side to Mars, so that the IAU's prime meridians (Archinal et al. 2011) tell where they stand in
    their orbits; the equation of the centre is added.  Places agree with transits that rovers saw to some 0.3 degrees.
    """
    return tuple(_seen(sight, name, orbit) for name, orbit in _MOONS.items())


def _seen(sight: MarsSight, name: str, orbit: _Orbit) -> MarsMoon:
    state = sight.state
    day, fraction = state.tt
    place = moon_place(name, day, fraction)
    distance = float(np.linalg.norm(place - state.place))
    place = moon_place(name, day, fraction - light_time(distance))
    seen = place - state.place
    distance = float(np.linalg.norm(seen))
    to_sun = -(state.centre + place)
    sun_distance = float(np.linalg.norm(to_sun))
    cosine = float(np.clip(-seen @ to_sun / (distance * sun_distance), -1.0, 1.0))
    return MarsMoon(
        name=name,
        # So near, moon and observer move together: no aberration by the planet's own way about the Sun.
        direction=state.turn @ (seen / distance),
        distance=distance,
        angular_radius=math.asin(orbit.radius / distance),
        phase_angle_deg=math.degrees(math.acos(cosine)),
        sunlit=_sunlit(place, to_sun / sun_distance, sun_distance),
        sun_distance=sun_distance,
    )


def moon_place(name: str, day: float, fraction: float) -> Array:
    """From the centre of Mars to one of its moons at a Julian date (TDB) in two parts, in the axes of ICRS [m]."""
    days, orbit = (day - J2000) + fraction, _MOONS[name]
    t = days / 36525.0
    if name == "Phobos":
        node, anomaly = math.radians(169.51 - 0.4357640 * days), 192.93 + 1128.4096700 * days + 8.864 * t * t
        ra, dec = 317.68 - 0.108 * t + 1.79 * math.sin(node), 52.90 - 0.061 * t - 1.08 * math.cos(node)
        meridian = 35.06 + 1128.8445850 * days + 8.864 * t * t - 1.42 * math.sin(node)
    else:
        node, anomaly = math.radians(53.47 - 0.0181510 * days), 0.0
        ra, dec = 316.65 - 0.108 * t + 2.98 * math.sin(node), 53.52 - 0.061 * t - 1.78 * math.cos(node)
        meridian = 79.41 + 285.1618970 * days - 0.520 * t * t - 2.58 * math.sin(node) + 0.19 * math.cos(node)
    mean = math.radians(anomaly % 360.0)
    centre = 2 * orbit.eccentricity * math.sin(mean)
    prime, east, _ = body_axes(ra, dec, meridian)
    along = math.cos(centre) * prime + math.sin(centre) * east
    # The prime meridian looks at Mars.
    return np.asarray(-orbit.axis * (1 - orbit.eccentricity * math.cos(mean)) * along)


def _sunlit(place: Array, towards_sun: Array, sun_distance: float) -> float:
    """Share of the Sun's disk, evenly bright, that Mars leaves free at a place."""
    from skyscatter.celestial.coverage import uncovered_area

    away = float(np.linalg.norm(place))
    sun, mars = math.asin(SOLAR_RADIUS / sun_distance), math.asin(MARS_RADIUS / away)
    apart = math.acos(float(np.clip(-place @ towards_sun / away, -1.0, 1.0)))
    return float(uncovered_area(apart / sun, mars / sun))
