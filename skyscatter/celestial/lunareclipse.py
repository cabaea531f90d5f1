"""Eclipses of the Moon: how deep it stands in the Earth's shadow, when, and how much sunlight is left on its face."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial.earthshadow import EARTH_RADIUS, shadow_share
from skyscatter.celestial.frames import Array, Sight
from skyscatter.celestial.lunarplace import MOON_RADIUS, Moon, moon_at
from skyscatter.geometry.sun import as_utc, iso_utc
from skyscatter.spectra.solar import SOLAR_RADIUS

#: Equatorial radius of the Earth [m], and the factor by which Danjon's rule widens its parallax: 1/85 for the air, less
#: 1/594 for the flattening, as in the published tables of Espenak & Meeus (NASA/TP-2009-214172, section 1.8).
EQUATOR, DANJON = 6.378137e6, 1.01
#: Apparent distances from the shadow's axis at which shares are kept, and the widest [rad].
NODES, WIDEST = 321, math.radians(1.75)
#: Rings and turns over the Moon's disk for its whole light.
RINGS, TURNS = 12, 36
_STEP, _HALF_DAY = 1800.0, 43200.0  # [s]


@dataclass(frozen=True)
class LunarEclipse:
    """Where the Moon stands beside the Earth's shadow, as tables of eclipses count it; `lunar_eclipse` makes one.

    Angles as from the Earth's centre.
    """

    separation: float  #: of the Moon's middle from the shadow's axis [rad]
    moon_radius: float  #: [rad]
    umbra: float  #: radius of the full shadow [rad]
    penumbra: float  #: radius of the half shadow [rad]

    @property
    def umbral_magnitude(self) -> float:
        """Share of the Moon's diameter in the umbra; negative outside."""
        return (self.umbra + self.moon_radius - self.separation) / (2.0 * self.moon_radius)

    @property
    def penumbral_magnitude(self) -> float:
        """Share of the Moon's diameter in the penumbra; negative outside."""
        return (self.penumbra + self.moon_radius - self.separation) / (2.0 * self.moon_radius)

    @property
    def kind(self) -> Literal["none", "penumbral", "partial", "total"]:
        """What is seen at this moment."""
        if self.penumbral_magnitude <= 0.0:
            return "none"
        if self.umbral_magnitude <= 0.0:
            return "penumbral"
        return "partial" if self.umbral_magnitude < 1.0 else "total"


class LunarContacts(NamedTuple):
    """When the Moon meets the shadow, UTC; `lunar_contacts` finds them."""

    p1: datetime  #: it enters the penumbra
    u1: datetime | None  #: it enters the umbra; None where it does not
    u2: datetime | None  #: all of it is in the umbra
    maximum: datetime
    u3: datetime | None
    u4: datetime | None
    p4: datetime
    eclipse: LunarEclipse  #: at the maximum


def lunar_eclipse(sight: Sight) -> LunarEclipse:
    """The Moon beside the Earth's shadow at a moment.

    Parameters
    ----------
    sight : Sight
        Its place does not matter, but for some meters.

    Returns
    -------
    LunarEclipse

    Notes
    -----
    The shadow of a sphere with the Earth's equatorial radius, widened by Danjon's rule for the air: so published times
    are counted.  The light itself (`sunlight_on_moon`) asks for no such rule: it follows the rays.

    Examples
    --------
    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.lunareclipse import lunar_eclipse
    >>> eclipse = lunar_eclipse(Sight(40.0, -100.0, "2025-03-14T06:58:45Z"))
    >>> eclipse.kind, round(eclipse.umbral_magnitude, 2)
    ('total', 1.18)
    """
    moon = moon_at(sight)
    to_earth, to_sun = moon.shadow_earth, moon.sun_distance * moon.sun_direction
    # From the Earth: the Moon at -to_earth, the axis away from the Sun at to_earth - to_sun.
    axis = to_earth - to_sun
    distance, sun_distance = float(np.linalg.norm(to_earth)), float(np.linalg.norm(axis))
    parallax, sun = math.asin(EQUATOR / distance), math.asin(SOLAR_RADIUS / sun_distance)
    wide, sun_parallax = DANJON * parallax, EQUATOR / sun_distance
    return LunarEclipse(
        separation=_angle(-to_earth, axis),
        moon_radius=math.asin(MOON_RADIUS / distance),
        umbra=wide + sun_parallax - sun,
        penumbra=wide + sun_parallax + sun,
    )


def lunar_contacts(sight: Sight) -> LunarContacts | None:
    """Times of the eclipse of the Moon nearest to a moment.

    Parameters
    ----------
    sight : Sight
        Eclipses within half a day of its time are found.

    Returns
    -------
    LunarContacts or None
        None if there is no eclipse then.

    Examples
    --------
    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.lunareclipse import lunar_contacts
    >>> found = lunar_contacts(Sight(40.0, -100.0, "2025-03-14T07:00Z"))
    >>> [moment.strftime("%H:%M") for moment in (found.u1, found.u2, found.u3, found.u4)]
    ['05:09', '06:26', '07:31', '08:47']
    """
    from scipy.optimize import brentq, minimize_scalar

    @lru_cache(maxsize=256)
    def at(seconds: float) -> LunarEclipse:
        return lunar_eclipse(sight.later(seconds))

    steps = np.arange(-_HALF_DAY, _HALF_DAY + 1.0, _STEP)
    nearest = float(steps[int(np.argmin([at(float(step)).separation for step in steps]))])
    found = minimize_scalar(
        lambda t: at(float(t)).separation, bounds=(nearest - _STEP, nearest + _STEP), method="bounded",
        options={"xatol": 0.1},
    )  # fmt: skip
    middle = float(found.x)
    eclipse = at(middle)
    if eclipse.kind == "none":
        return None
    start = as_utc(iso_utc(sight.time)).timestamp()

    def moment(seconds: float) -> datetime:
        return datetime.fromtimestamp(start + seconds, UTC)

    def pair(margin: Callable[[LunarEclipse], float]) -> tuple[datetime | None, datetime | None]:
        if margin(eclipse) <= 0.0:
            return None, None
        # No lunar eclipse takes more than six and a half hours.
        before, after = (
            float(brentq(lambda t: margin(at(float(t))), middle, middle + way * 14400.0, xtol=0.01))
            for way in (-1.0, 1.0)
        )
        return moment(before), moment(after)

    p1, p4 = pair(lambda e: e.penumbral_magnitude)
    u1, u4 = pair(lambda e: e.umbral_magnitude)
    u2, u3 = pair(lambda e: e.umbral_magnitude - 1.0)
    assert p1 is not None
    assert p4 is not None
    return LunarContacts(p1, u1, u2, moment(middle), u3, u4, p4, eclipse)


def sunlight_on_moon(moon: Moon, points: ArrayLike, wavelengths: ArrayLike) -> Array:
    """Share of sunlight that the Earth leaves to points of the Moon's face.

    Parameters
    ----------
    moon : Moon
    points : array_like, shape (..., 3)
        From the Moon's middle, in the axes of its observer (east, north, up) [m].
    wavelengths : array_like, shape (wavelength,)
        [nm]

    Returns
    -------
    ndarray, shape (..., wavelength)
        1 where no Earth is before the Sun.  How much comes through the lower air depends on clouds and dust along the
        Earth's edge: the middle of the shadow may be three times as bright, or as dark, and after eruptions darker by
        a factor of a hundred.  `skyscatter.celestial.earthshadow` says what is followed.

    Examples
    --------
    In the middle of the eclipse of March 2025, red and blue light in the middle of the Moon.

    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.lunareclipse import sunlight_on_moon
    >>> from skyscatter.celestial.moon import moon_at
    >>> moon = moon_at(Sight(40.0, -100.0, "2025-03-14T06:58:45Z"))
    >>> blue, red = sunlight_on_moon(moon, [0.0, 0.0, 0.0], [450.0, 650.0])
    >>> bool(1e-6 < blue < 1e-4), bool(1e-5 < red < 1e-3), bool(red > 3.0 * blue)
    (True, True, True)
    """
    at = np.asarray(points, dtype=float)
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    to_earth, to_sun = moon.shadow_earth - at, moon.sun_distance * moon.sun_direction - at
    sine = np.linalg.norm(np.cross(to_earth, to_sun), axis=-1)
    angle = np.arctan2(sine, np.einsum("...i,...i", to_earth, to_sun))
    distance = float(np.linalg.norm(moon.shadow_earth))
    nodes, logarithms = _shares(round(distance, -3), round(moon.sun_distance, -7), tuple(float(w) for w in wl))
    # Nearer points have a larger Earth before the Sun.
    angle = angle * np.linalg.norm(to_earth, axis=-1) / distance
    share = np.stack([np.exp(np.interp(angle, nodes, column)) for column in logarithms.T], axis=-1)
    return np.asarray(share)


def left_of_moonlight(moon: Moon, wavelengths: ArrayLike) -> Array:
    """Share of the whole Moon's light that an eclipse leaves, (wavelength,).

    Means over the disk that faces the Sun, which the full Moon lights evenly.

    Examples
    --------
    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.lunareclipse import left_of_moonlight
    >>> from skyscatter.celestial.moon import moon_at
    >>> left_of_moonlight(moon_at(Sight(40.0, -100.0, "2025-03-13T06:58:45Z")), [550.0])
    array([1.])
    """
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    if not near_shadow(moon):
        return np.ones(wl.size)
    towards = moon.sun_direction
    side = np.cross(towards, np.eye(3)[int(np.argmin(np.abs(towards)))])
    side /= np.linalg.norm(side)
    up = np.cross(towards, side)
    r = np.sqrt((np.arange(RINGS) + 0.5) / RINGS)[:, None]
    turn = 2.0 * np.pi * (np.arange(TURNS) + 0.5 * (np.arange(RINGS) % 2)[:, None]) / TURNS
    across = (r * np.cos(turn))[..., None] * side + (r * np.sin(turn))[..., None] * up
    points = MOON_RADIUS * (across + np.sqrt(1.0 - r**2)[..., None] * towards)
    return np.asarray(sunlight_on_moon(moon, points.reshape(-1, 3), wl).mean(axis=0))


def near_shadow(moon: Moon) -> bool:
    """Whether any of the Moon may be in the penumbra."""
    distance = float(np.linalg.norm(moon.shadow_earth))
    reach = (EARTH_RADIUS + 1e5 + MOON_RADIUS) / distance + SOLAR_RADIUS / moon.sun_distance
    return _angle(moon.shadow_earth, moon.sun_distance * moon.sun_direction) < reach


@lru_cache(maxsize=8)
def _shares(distance: float, sun_distance: float, wavelengths: tuple[float, ...]) -> tuple[Array, Array]:
    """Angles from the shadow's axis (node,) [rad], and logarithms of the shares there (node, wavelength)."""
    nodes = np.linspace(0.0, WIDEST, NODES)
    share = shadow_share(nodes, math.asin(SOLAR_RADIUS / sun_distance), distance, wavelengths, sun_distance)
    return nodes, np.log(np.clip(share, 1e-12, 1.0))


def _angle(one: Array, other: Array) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))
