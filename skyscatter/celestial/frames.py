"""A place and a moment, and the frames in which the sky is catalogued, turned into that of the observer.

Directions of catalogues (ICRS) become those that an observer sees without air: bent by the Sun's gravity, shifted by
the observer's own motion (aberration), turned by precession, nutation and the Earth's rotation.  ERFA gives the state
of the Earth once for a sight; the directions are then turned as arrays.  Nothing is read from a network or from a table
that grows old.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from datetime import timedelta
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.constants import LIGHT
from skyscatter.geometry.sun import as_utc, check_place, iso_utc, utc_julian_date

Array = NDArray[np.float64]

AU = 149597870700.0  #: astronomical unit [m], exact (IAU 2012 resolution B2)
DAY = 86400.0  #: [s]
J2000 = 2451545.0  #: Julian date
#: Schwarzschild radius of the Sun [au], of which light is bent.
_BENDING = 1.97412574336e-8
#: Least 1 - cosine of the angle to the Sun's middle in the law of bending, which has no end there: 5', as in ERFA.
_NEAREST = 1e-6


class SunSeen(NamedTuple):
    """The Sun as an observer sees it."""

    direction: Array  #: apparent, unrefracted (east, north, up), shape (3,)
    distance: float  #: [m]


class State(NamedTuple):
    """The observer among the stars at a moment; vectors in the axes of ICRS."""

    tt: tuple[float, float]  #: terrestrial time as a Julian date in two parts; it stands for TDB too (2 ms)
    velocity: Array  #: of the observer relative to the Solar System's centre, in units of the speed of light
    centre: Array  #: from the Sun to the planet's centre [m]
    centre_velocity: Array  #: of the planet's centre relative to the Solar System's [m s-1]
    place: Array  #: from the planet's centre to the observer [m]
    towards_sun: Array  #: unit vector from the observer
    sun_distance: float  #: [m]
    turn: Array  #: rows east, north and up in the axes of ICRS, shape (3, 3)


class SkyFrame:
    """Turns directions of catalogues into those of an observer; what stands where gives the `state`."""

    #: The planet on which the observer stands.
    body: ClassVar[str]

    @property
    def state(self) -> State:
        """Where the planet and the observer are and how they move."""
        raise NotImplementedError

    @cached_property
    def sun(self) -> SunSeen:
        """The Sun's apparent direction and its distance."""
        return SunSeen(self.apparent(self.state.towards_sun), self.state.sun_distance)

    def horizontal(self, icrs: ArrayLike) -> Array:
        """Apparent directions (east, north, up) of things beyond the Solar System.

        Parameters
        ----------
        icrs : array_like, shape (..., 3)
            Unit vectors in ICRS, as from the Solar System's centre; NaN stays NaN.

        Returns
        -------
        ndarray, shape (..., 3)
            Unit vectors without refraction, also of what is below the horizon.
        """
        return self.apparent(self._bent(np.asarray(icrs, dtype=float)))

    def apparent(self, direction: ArrayLike) -> Array:
        """Apparent directions (east, north, up) of bodies near by, whose light passes no Sun.

        Parameters
        ----------
        direction : array_like, shape (..., 3)
            Unit vectors in the axes of ICRS from the observer to where the body was when its light left.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        return _shifted(np.asarray(direction, dtype=float), self.state.velocity) @ self.state.turn.T

    def icrs(self, enu: ArrayLike) -> Array:
        """Directions in ICRS of what is seen in directions (east, north, up): the inverse of `horizontal`.

        Parameters
        ----------
        enu : array_like, shape (..., 3)
            Unit vectors; NaN stays NaN.

        Returns
        -------
        ndarray, shape (..., 3)
            To 0.01 arcsec, but within the Sun's disk.
        """
        # An observer at rest sees as one does who moves the other way through the moving one's sky.
        still = _shifted(np.asarray(enu, dtype=float) @ self.state.turn, -self.state.velocity)
        # The bending is so small that what it does to the direction found first is what it did to the one sought.
        return _unit(still - (self._bent(still) - still))

    def galactic(self, enu: ArrayLike) -> Array:
        """As `icrs`, in galactic axes: x to the galactic centre, z to the northern galactic pole (IAU 1958)."""
        import erfa

        # The rows of ERFA's matrix are the galactic axes in ICRS.
        to_galactic = np.stack([erfa.s2c(*erfa.icrs2g(*erfa.c2s(axis))) for axis in np.eye(3)], axis=1)
        return self.icrs(enu) @ to_galactic.T

    def ecliptic(self, enu: ArrayLike) -> Array:
        """As `icrs`, in the axes of the mean ecliptic and equinox of J2000."""
        import erfa

        return self.icrs(enu) @ np.asarray(erfa.ecm06(J2000, 0.0)).T

    def _bent(self, directions: Array) -> Array:
        """Directions to distant things after the Sun has bent their light towards the observer."""
        sun = self.state.towards_sun
        cosine = (directions @ sun)[..., None]
        nearness = np.maximum(1.0 - cosine, _NEAREST)
        across = cosine * directions - sun
        return _unit(directions + _BENDING * AU / self.state.sun_distance * across / nearness)


@dataclass(frozen=True)
class Sight(SkyFrame):
    """A place on the Earth and a moment: where things of the sky are seen from there, without refraction.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        Geodetic latitude (north positive) and longitude (east positive) [degree] on the WGS84 ellipsoid.
    time : str, datetime or astropy Time
        As `skyscatter.geometry.sun_position` takes it: ISO 8601 text, no offset means UTC.
    altitude_m : float
        Height above the ellipsoid [m].

    Raises
    ------
    DomainError
        For places that are not on Earth, unreadable times, and years outside 1900 to 2100.

    Notes
    -----
    IAU 2006/2000A precession-nutation, the Earth's motion from ERFA's ``epv00``.  UT1 is taken as UTC and the pole as
    unmoved: at most 0.9 s, or 13 arcsec of rotation about the Earth's axis, as long as UTC follows UT1 that closely.

    Examples
    --------
    The northern celestial pole stands as high as the latitude, within the precession since 2000.

    >>> import numpy as np
    >>> from skyscatter.celestial.frames import Sight
    >>> sight = Sight(48.86, 2.35, "2026-08-12T21:00Z")
    >>> pole = sight.horizontal([0.0, 0.0, 1.0])
    >>> round(float(np.degrees(np.arcsin(pole[2]))))
    49
    >>> bool(np.allclose(sight.icrs(pole), [0, 0, 1], atol=1e-9))
    True
    """

    body: ClassVar[str] = "Earth"

    latitude_deg: float
    longitude_deg: float
    time: Any
    altitude_m: float = 0.0

    def __post_init__(self) -> None:
        check_place(self.latitude_deg, self.longitude_deg, self.altitude_m)
        utc_julian_date(self.time)

    def later(self, seconds: float) -> Sight:
        """The same place, some seconds later (before, where negative); to the microsecond."""
        moment = as_utc(iso_utc(self.time)) + timedelta(seconds=seconds)
        return Sight(self.latitude_deg, self.longitude_deg, moment, self.altitude_m)

    @cached_property
    def state(self) -> State:
        """Where the Earth and the observer are and how they move."""
        import erfa

        day, fraction = utc_julian_date(self.time)
        phi, longitude = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        with warnings.catch_warnings():
            # "dubious year": no leap seconds are announced yet, or there was no UTC; see sun_position.
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            # UTC, UT1-UTC, place, polar motion (2), pressure (none: no refraction), temperature, humidity, wavelength
            astrom, _ = erfa.apco13(day, fraction, 0.0, longitude, phi, self.altitude_m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.55)
            tt = erfa.taitt(*erfa.utctai(day, fraction))
            heliocentric, barycentric = erfa.epv00(*tt)
        return State(
            tt=(float(tt[0]), float(tt[1])),
            velocity=np.array(astrom["v"]),
            centre=heliocentric["p"] * AU,
            centre_velocity=barycentric["v"] * AU / DAY,
            place=(astrom["eb"] - barycentric["p"]) * AU,
            towards_sun=-np.array(astrom["eh"]),
            sun_distance=float(astrom["em"]) * AU,
            turn=local_axes(float(astrom["eral"]), phi) @ np.array(astrom["bpn"]),
        )


def local_axes(rotation: float, latitude: float) -> Array:
    """East, north and up in a frame whose third axis is the planet's pole; shape (3, 3).

    `rotation` is the angle from the first axis to the meridian of the place: on Earth, in the frame of the celestial
    intermediate pole and origin, the Earth's rotation angle plus the longitude [rad].
    """
    meridian = np.array([math.cos(rotation), math.sin(rotation), 0.0])
    east = np.array([-math.sin(rotation), math.cos(rotation), 0.0])
    pole = np.array([0.0, 0.0, 1.0])
    sine, cosine = math.sin(latitude), math.cos(latitude)
    return np.stack([east, cosine * pole - sine * meridian, cosine * meridian + sine * pole])


def body_axes(ra_deg: float, dec_deg: float, meridian_deg: float) -> Array:
    """Rows: prime meridian, 90 degrees east of it and pole of a body, from the angles by which the IAU gives them."""
    ra, dec, w = (math.radians(angle) for angle in (ra_deg, dec_deg, meridian_deg))
    pole = np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])
    node = np.array([-math.sin(ra), math.cos(ra), 0.0])  # where the equator rises through that of ICRS
    beyond = np.cross(pole, node)
    return np.stack([math.cos(w) * node + math.sin(w) * beyond, math.cos(w) * beyond - math.sin(w) * node, pole])


def _shifted(directions: Array, velocity: Array) -> Array:
    """Directions as an observer with a velocity [speed of light] sees them, by special relativity."""
    along = directions @ velocity
    root = math.sqrt(1.0 - float(velocity @ velocity))
    moved = root * directions + (1.0 + along / (1.0 + root))[..., None] * velocity
    return _unit(moved)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.sqrt(np.einsum("...i,...i", vectors, vectors))[..., None])


def light_time(distance_m: float) -> float:
    """Days that light takes over a distance."""
    return distance_m / LIGHT / DAY
