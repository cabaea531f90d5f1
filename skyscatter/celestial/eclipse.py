"""Eclipses of the Sun: how much of it the Moon covers, here and at every point of the air, and when."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial.coverage import uncovered_area, uncovered_light
from skyscatter.celestial.frames import Array, Sight
from skyscatter.celestial.moon import MOON_RADIUS, moon_at
from skyscatter.errors import DomainError
from skyscatter.geometry.sun import as_utc, iso_utc

#: Radius of the Sun [m] that times of total eclipses tell, 959.95 arcsec at 1 au (Quaglia et al. 2021, Astrophys. J.
#: Suppl. 256, 36): 500 km more than the nominal one, a second of totality at either end.
SUN_RADIUS = 6.9622e8
#: How far from the observer points of the air are asked for at all [m].
REACH = 1e8
_STEP = 1800.0  # between the moments that a search starts from [s]
_HALF_DAY = 43200.0  # [s]


@dataclass(frozen=True)
class Eclipse:
    """Sun and Moon close together, as an observer sees them without refraction; `solar_eclipse` makes one.

    Whether the Sun is above the horizon is not asked here.

    Examples
    --------
    >>> from skyscatter.celestial.eclipse import solar_eclipse
    >>> from skyscatter.celestial.frames import Sight
    >>> eclipse = solar_eclipse(Sight(65.5, -24.53, "2026-08-12T17:45:37Z"))  # Látrabjarg, Iceland
    >>> eclipse.kind, round(eclipse.magnitude, 3), eclipse.obscuration
    ('total', 1.014, 1.0)
    """

    separation: float  #: of the apparent middles [rad]
    sun_radius: float  #: apparent [rad]
    moon_radius: float  #: apparent [rad]
    _sun: Array = field(repr=False)  # from the observer (east, north, up) [m]
    _moon: Array = field(repr=False)

    @property
    def magnitude(self) -> float:
        """Share of the Sun's diameter that is covered along the line of the middles; above 1 in totality, 0 beside."""
        covered = self.sun_radius + self.moon_radius - self.separation
        return max(0.0, covered / (2.0 * self.sun_radius))

    @property
    def sun_direction(self) -> Array:
        """Unit vector towards the Sun's middle (east, north, up)."""
        return np.asarray(self._sun / np.linalg.norm(self._sun))

    @property
    def vectors(self) -> tuple[Array, Array]:
        """From the observer to the middles of Sun and Moon (east, north, up) [m]."""
        return self._sun, self._moon

    @property
    def obscuration(self) -> float:
        """Share of the Sun's area that is covered."""
        return 1.0 - float(uncovered_area(self.separation / self.sun_radius, self.moon_radius / self.sun_radius))

    @property
    def kind(self) -> Literal["none", "partial", "annular", "total"]:
        """What the observer sees at this moment."""
        if self.separation >= self.sun_radius + self.moon_radius:
            return "none"
        if self.separation > abs(self.sun_radius - self.moon_radius):
            return "partial"
        return "total" if self.moon_radius >= self.sun_radius else "annular"

    def light(self, wavelengths: ArrayLike) -> Array:
        """Share of the Sun's light that reaches the observer, shape (wavelength,); see `light_at`."""
        return self.light_at(np.zeros(3), wavelengths)

    def light_at(self, offsets: ArrayLike, wavelengths: ArrayLike) -> Array:
        """Share of the Sun's light that passes the Moon, at points near the observer.

        Parameters
        ----------
        offsets : array_like, shape (..., 3)
            From the observer to the points, in the observer's axes (east, north, up) [m]; straight lines, so that
            places on the round Earth lie below the horizontal plane.
        wavelengths : array_like, shape (wavelength,)
            [nm]

        Returns
        -------
        ndarray, shape (..., wavelength)
            0 to 1.  The Sun is darkened towards its limb (`skyscatter.celestial.coverage.uncovered_light`), the Moon a
            smooth sphere of 1737.4 km; mountains and valleys of its limb are left out, and so is the corona, which
            sends some 1e-6 of the Sun's light.

        Examples
        --------
        On 21 August 2017 at Casper, Wyoming: no sunlight there, a little of it 300 km to the south.

        >>> from skyscatter.celestial.eclipse import solar_eclipse
        >>> from skyscatter.celestial.frames import Sight
        >>> eclipse = solar_eclipse(Sight(42.85, -106.32, "2017-08-21T17:43:50Z", 1600.0))
        >>> eclipse.kind, round(eclipse.magnitude, 3)
        ('total', 1.014)
        >>> eclipse.light_at([[0.0, 0.0, 0.0], [0.0, -300e3, 0.0]], [500.0]).round(2)
        array([[0.  ],
               [0.05]])
        """
        return uncovered_light(*self.disks(offsets), wavelengths)

    def reaches(self, centre: ArrayLike, radius: float) -> bool:
        """Whether some of the Sun may be covered anywhere in a ball.

        Parameters
        ----------
        centre : array_like, shape (3,)
            From the observer (east, north, up) [m].
        radius : float
            [m]

        Returns
        -------
        bool
            False where it is certain that the disks stand apart.
        """
        middle = np.asarray(centre, dtype=float)
        separation, moon = self.disks(middle)
        sun = math.asin(SUN_RADIUS / float(np.linalg.norm(self._sun - middle)))
        distance = float(np.linalg.norm(self._moon - middle))
        # The Moon is shifted before the Sun by its parallax, and larger where it is nearer; the Sun's own is 1/390.
        moved = 1.01 * math.asin(min(radius / distance, 1.0))
        return bool(separation * sun < sun + moon * sun * distance / max(distance - radius, 1.0) + moved)

    def disks(self, offsets: ArrayLike) -> tuple[Array, Array]:
        """Separation of the middles and radius of the Moon, in radii of the Sun, at points as `light_at` takes them."""
        here = np.asarray(offsets, dtype=float)
        to_sun, to_moon = self._sun - here, self._moon - here
        sun_distance, moon_distance = (np.linalg.norm(v, axis=-1) for v in (to_sun, to_moon))
        # The cross product keeps the digits of small angles.
        sine = np.linalg.norm(np.cross(to_sun, to_moon), axis=-1) / (sun_distance * moon_distance)
        cosine = np.einsum("...i,...i", to_sun, to_moon) / (sun_distance * moon_distance)
        separation = np.arctan2(sine, cosine)
        sun, moon = np.arcsin(SUN_RADIUS / sun_distance), np.arcsin(MOON_RADIUS / moon_distance)
        return separation / sun, moon / sun


class Contacts(NamedTuple):
    """When the disks touch, UTC; `contacts` finds them."""

    first: datetime  #: the Moon's limb comes upon the Sun's
    second: datetime | None  #: totality, or the ring, begins; None where neither is seen
    maximum: datetime  #: the middles are closest
    third: datetime | None  #: totality, or the ring, ends
    fourth: datetime  #: the Moon leaves the Sun
    eclipse: Eclipse  #: at the maximum


def solar_eclipse(sight: Sight, reach: float = 0.0) -> Eclipse | None:
    """The eclipse of the Sun that is seen from a place at a moment, if any.

    Parameters
    ----------
    sight : Sight
    reach : float
        Give an eclipse also where only points this far from the observer [m] may see it, up to 100 000 km: the air
        above them is what makes the observer's sky dim.

    Returns
    -------
    Eclipse or None
        None if the disks do not overlap, or cannot within reach.

    Raises
    ------
    DomainError
        For a reach outside 0 to 1e8 m.

    Examples
    --------
    >>> from skyscatter.celestial.eclipse import solar_eclipse
    >>> from skyscatter.celestial.frames import Sight
    >>> solar_eclipse(Sight(48.86, 2.35, "2026-08-13T18:00Z")) is None
    True
    >>> round(solar_eclipse(Sight(48.86, 2.35, "2026-08-12T18:14Z")).obscuration, 2)
    0.89
    """
    if not 0.0 <= reach <= REACH:
        raise DomainError("reach", reach, f"a distance from 0 to {REACH:g} m")
    eclipse = _at(sight)
    return eclipse if eclipse.reaches(np.zeros(3), reach) else None


def contacts(sight: Sight) -> Contacts | None:
    """Times of the eclipse of the Sun nearest to a moment, for a place.

    Parameters
    ----------
    sight : Sight
        Its time says about when: eclipses within half a day of it are found.

    Returns
    -------
    Contacts or None
        None if the place sees no eclipse then.  Whether the Sun is up is not asked.

    Notes
    -----
    Of smooth disks (the Sun's radius 696 220 km, the Moon's 1737.4 km).  Mountains at the Moon's limb change second and
    third contacts by a second or two; published times take radii of their own, and those that were computed years
    before the event a rotation of the Earth that is seconds off.  Here UT1 is UTC: 0.4 s of time at most.

    Examples
    --------
    >>> from skyscatter.celestial.eclipse import contacts
    >>> from skyscatter.celestial.frames import Sight
    >>> found = contacts(Sight(42.85, -106.32, "2017-08-21T18:00Z", 1600.0))
    >>> [moment.strftime("%H:%M") for moment in found[:5]]
    ['16:22', '17:42', '17:43', '17:45', '19:09']
    """
    steps = np.arange(-_HALF_DAY, _HALF_DAY + 1.0, _STEP)
    separations = [_at(sight.later(float(step))).separation for step in steps]
    at = int(np.argmin(separations))
    middle = _least(lambda t: _at(sight.later(t)).separation, float(steps[at]) - _STEP, float(steps[at]) + _STEP)
    eclipse = _at(sight.later(middle))
    if eclipse.kind == "none":
        return None

    def outer(t: float) -> float:
        now = _at(sight.later(t))
        return now.separation - now.sun_radius - now.moon_radius

    def inner(t: float) -> float:
        now = _at(sight.later(t))
        return now.separation - abs(now.sun_radius - now.moon_radius)

    # No local eclipse lasts four hours; its total or annular part at most 13 minutes.
    times = [_root(outer, middle, middle - 7200.0), _root(outer, middle, middle + 7200.0)]
    central: list[float | None] = [None, None]
    if eclipse.kind != "partial":
        central = [_root(inner, middle, middle - 1200.0), _root(inner, middle, middle + 1200.0)]
    start = as_utc(iso_utc(sight.time))

    def moment(seconds: float) -> datetime:
        return datetime.fromtimestamp(start.timestamp() + seconds, UTC)

    second, third = (None if t is None else moment(t) for t in central)
    return Contacts(moment(times[0]), second, moment(middle), third, moment(times[1]), eclipse)


def _at(sight: Sight) -> Eclipse:
    """Sun and Moon at a moment, whether or not they are near each other."""
    sun, moon = sight.sun, moon_at(sight)
    sine = float(np.linalg.norm(np.cross(sun.direction, moon.direction)))
    return Eclipse(
        separation=math.atan2(sine, float(sun.direction @ moon.direction)),
        sun_radius=math.asin(SUN_RADIUS / sun.distance),
        moon_radius=moon.angular_radius,
        _sun=sun.distance * sun.direction,
        _moon=moon.distance * moon.direction,
    )


def _least(of: Callable[[float], float], low: float, high: float) -> float:
    """Where a function with one minimum is least [s], by sections of the golden ratio."""
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    left, right = high - ratio * (high - low), low + ratio * (high - low)
    at_left, at_right = of(left), of(right)
    while high - low > 0.01:
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - ratio * (high - low)
            at_left = of(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + ratio * (high - low)
            at_right = of(right)
    return 0.5 * (low + high)


def _root(of: Callable[[float], float], inside: float, outside: float) -> float:
    """Where a function changes its sign between a place where it is negative and one where it is positive [s]."""
    from scipy.optimize import brentq

    return float(brentq(of, inside, outside, xtol=1e-3))
