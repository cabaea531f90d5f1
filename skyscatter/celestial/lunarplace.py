"""Where the Moon stands, which side of it faces the observer, and from where it is lit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skyscatter.celestial.frames import DAY, J2000, Array, Sight, body_axes, light_time
from skyscatter.celestial.lunarorbit import moon_place

MOON_RADIUS = 1.7374e6  #: mean radius [m], IAU working group on cartographic coordinates (Archinal et al. 2011)

#: Arguments E1 to E13 of the Moon's rotation: value at J2000 and change per day [degree]; Archinal et al. 2011,
#: Celest. Mech. Dyn. Astr. 109, 101, table 2.
_ARGUMENTS = np.array(
    [
        (125.045, -0.0529921), (250.089, -0.1059842), (260.008, 13.0120009), (176.625, 13.3407154),
        (357.529, 0.9856003), (311.589, 26.4057084), (134.963, 13.0649930), (276.617, 0.3287146),
        (34.226, 1.7484877), (15.134, -0.1589763), (119.743, 0.0036096), (239.961, 0.1643573), (25.053, 12.9590088),
    ]
)  # fmt: skip
#: Amplitudes [degree] of their sines in the right ascension of the pole, of their cosines in its declination, and of
#: their sines in the angle of the prime meridian.
_POLE_RA = np.array([-3.8787, -0.1204, 0.0700, -0.0172, 0, 0.0072, 0, 0, 0, -0.0052, 0, 0, 0.0043])
_POLE_DEC = np.array([1.5419, 0.0239, -0.0278, 0.0068, 0, -0.0029, 0.0009, 0, 0, 0.0008, 0, 0, -0.0009])
_MERIDIAN = np.array(
    [3.5610, 0.1208, -0.0642, 0.0158, 0.0252, -0.0066, -0.0047, -0.0046, 0.0028, 0.0052, 0.0040, 0.0019, -0.0044]
)


@dataclass(frozen=True)
class Moon:
    """The Moon as an observer sees it; `moon_at` makes one.

    Longitudes and latitudes are selenographic (mean Earth and rotation axis, east towards Mare Crisium).

    Examples
    --------
    Its bright limb faces the Sun: at first quarter the point below which the Sun stands is some 90 degrees east.

    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.moon import moon_at
    >>> moon = moon_at(Sight(51.48, 0.0, "2026-08-20T04:00Z"))
    >>> round(moon.phase_angle_deg), round(moon.sun_longitude_deg), round(moon.observer_longitude_deg, 1)
    (89, 93, 3.7)
    """

    direction: Array  #: apparent, topocentric, unrefracted (east, north, up), shape (3,)
    distance: float  #: of its centre from the observer [m]
    phase_angle_deg: float  #: between the Sun and the observer as seen from the Moon; 0 is full
    illuminated: float  #: share of the disk that the Sun lights
    angular_radius: float  #: [rad]
    observer_longitude_deg: float  #: of the point that faces the observer: topocentric libration
    observer_latitude_deg: float
    sun_longitude_deg: float  #: of the point that faces the Sun
    sun_latitude_deg: float
    sun_direction: Array  #: from the Moon to the Sun (east, north, up at the observer), shape (3,)
    sun_distance: float  #: of the Moon from the Sun [m]
    earth_direction: Array  #: from the Moon to the Earth's centre (east, north, up at the observer), shape (3,)
    earth_distance: float  #: of the Moon from the Earth's centre [m]
    shadow_earth: Array  #: the Earth's centre from the Moon's [m] when the light passed it, (east, north, up)
    axes: Array  #: rows: prime meridian, 90 degrees east and north pole of the Moon (east, north, up); shape (3, 3)


def moon_at(sight: Sight) -> Moon:
    """The Moon for a place and a moment.

    Parameters
    ----------
    sight : Sight

    Returns
    -------
    Moon

    Notes
    -----
    Geocentric place from `skyscatter.celestial.lunarorbit.moon_place`; light time, parallax and aberration are applied,
    refraction is not.  The Moon's rotation is the series of Archinal et al. 2011, up to 0.005 degrees (150 m on its
    ground) from the integrated one.

    Examples
    --------
    The Moon at its first quarter over Greenwich.

    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.moon import moon_at
    >>> moon = moon_at(Sight(51.48, 0.0, "2026-08-20T18:00Z"))
    >>> round(moon.illuminated, 2), round(moon.distance / 1e6)  # share, thousand km
    (0.56, 402)
    """
    state = sight.state
    day, fraction = state.tt
    seen = moon_place(day, fraction) - state.place
    for _ in range(2):
        late = light_time(float(np.linalg.norm(seen)))
        geocentric = moon_place(day, fraction - late)
        # The Earth has moved on while the light was under way.
        seen = geocentric - state.centre_velocity * late * DAY - state.place
    distance = float(np.linalg.norm(seen))
    to_sun = -(state.centre - state.centre_velocity * late * DAY + geocentric)
    towards_sun = to_sun / np.linalg.norm(to_sun)
    cosine = float(np.clip(-seen @ towards_sun / distance, -1.0, 1.0))
    axes = lunar_axes(day, fraction - late)
    observer, sun = (_longitude_latitude(axes @ vector) for vector in (-seen, to_sun))
    return Moon(
        direction=sight.apparent(seen / distance),
        distance=distance,
        phase_angle_deg=math.degrees(math.acos(cosine)),
        illuminated=0.5 * (1.0 + cosine),
        angular_radius=math.asin(MOON_RADIUS / distance),
        observer_longitude_deg=observer[0],
        observer_latitude_deg=observer[1],
        sun_longitude_deg=sun[0],
        sun_latitude_deg=sun[1],
        sun_direction=state.turn @ towards_sun,
        sun_distance=float(np.linalg.norm(to_sun)),
        earth_direction=-state.turn @ geocentric / np.linalg.norm(geocentric),
        earth_distance=float(np.linalg.norm(geocentric)),
        # The Earth moves on while light goes from it to the Moon: 20 arcsec, 40 s of an eclipse.
        shadow_earth=-state.turn @ (geocentric + state.centre_velocity * light_time(distance) * DAY),
        axes=axes @ state.turn.T,
    )


def lunar_axes(day: float, fraction: float) -> Array:
    """Rows: the Moon's prime meridian, 90 degrees east and north pole in the axes of ICRS; at a Julian date (TDB)."""
    days = (day - J2000) + fraction
    centuries = days / 36525.0
    angles = np.radians(_ARGUMENTS[:, 0] + _ARGUMENTS[:, 1] * days)
    ra = 269.9949 + 0.0031 * centuries + float(_POLE_RA @ np.sin(angles))
    dec = 66.5392 + 0.0130 * centuries + float(_POLE_DEC @ np.cos(angles))
    meridian = 38.3213 + 13.17635815 * days - 1.4e-12 * days**2 + float(_MERIDIAN @ np.sin(angles))
    return body_axes(ra, dec, meridian)


def _longitude_latitude(vector: Array) -> tuple[float, float]:
    """Of a vector in the Moon's axes [degree]."""
    x, y, z = (float(v) for v in vector)
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))
