"""A place on Mars and a moment: the sky as it is seen from there."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from datetime import timedelta
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from skyscatter.celestial.frames import AU, DAY, J2000, Array, SkyFrame, State, body_axes, local_axes
from skyscatter.celestial.planetorbits import planet_place
from skyscatter.constants import LIGHT
from skyscatter.errors import DomainError
from skyscatter.geometry.sun import as_utc, iso_utc, utc_julian_date

MARS_RADIUS = 3.3895e6  #: mean radius [m], IAU (Archinal et al. 2011)
#: Time over which the planet's way is taken for straight [days]: 2 m/s of velocity, 1e-3 arcsec of aberration.
_STEP = 0.05


@dataclass(frozen=True)
class MarsSight(SkyFrame):
    """A place on Mars and a moment, with what `skyscatter.celestial.frames.Sight` has for the Earth.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        Planetocentric latitude (north positive) and longitude (east positive) [degree].
    time : str, datetime or astropy Time
        On Earth's clocks: ISO 8601 text, no offset means UTC.
    altitude_m : float
        Height above the sphere of `MARS_RADIUS` [m].

    Raises
    ------
    DomainError
        For places that are not on Mars, unreadable times, and years outside 1900 to 2100.

    Notes
    -----
    The pole and the prime meridian are those of Archinal et al. 2011 (Celest. Mech. Dyn. Astr. 109, 101), without
    nutation (1.1 arcsec); Mars stands where `skyscatter.celestial.planetorbits.planet_place` has it.  The vertical is
    the radius: the true one leans from it by up to 0.3 degrees in middle latitudes.

    Examples
    --------
    The first morning of the rover Perseverance at Jezero crater.

    >>> import math
    >>> from skyscatter.celestial.marssight import MarsSight
    >>> jezero = MarsSight(18.44, 77.45, "2021-02-19T12:10Z")
    >>> round(math.degrees(math.asin(jezero.sun.direction[2])))
    5
    >>> round(jezero.sun.distance / 1.496e11, 2)
    1.57
    """

    body: ClassVar[str] = "Mars"

    latitude_deg: float
    longitude_deg: float
    time: Any
    altitude_m: float = 0.0

    def __post_init__(self) -> None:
        if not -90 <= self.latitude_deg <= 90:
            raise DomainError("latitude", self.latitude_deg, "between -90 and 90 degrees")
        if not -360 <= self.longitude_deg <= 360:
            raise DomainError("longitude", self.longitude_deg, "east positive, between -360 and 360 degrees")
        utc_julian_date(self.time)

    def later(self, seconds: float) -> MarsSight:
        """The same place, some seconds later (before, where negative); to the microsecond."""
        moment = as_utc(iso_utc(self.time)) + timedelta(seconds=seconds)
        return MarsSight(self.latitude_deg, self.longitude_deg, moment, self.altitude_m)

    @cached_property
    def state(self) -> State:
        """Where Mars and the observer are and how they move."""
        import erfa

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)  # as in Sight: leap seconds to come
            day, fraction = erfa.taitt(*erfa.utctai(*utc_julian_date(self.time)))
            heliocentric, barycentric = erfa.epv00(day, fraction)
        centre = planet_place(4, day, fraction)
        ahead, behind = (planet_place(4, day, fraction + step) for step in (_STEP, -_STEP))
        about_sun = (ahead - behind) / (2 * _STEP * DAY)
        velocity = about_sun + (barycentric["v"] - heliocentric["v"]) * AU / DAY
        axes = mars_axes(float(day), float(fraction))
        turn = local_axes(math.radians(self.longitude_deg), math.radians(self.latitude_deg)) @ axes
        place = (MARS_RADIUS + self.altitude_m) * turn[2]
        to_sun = -(centre + place)
        distance = float(np.linalg.norm(to_sun))
        return State(
            tt=(float(day), float(fraction)),
            velocity=velocity / LIGHT,
            centre=centre,
            centre_velocity=velocity,
            place=place,
            towards_sun=to_sun / distance,
            sun_distance=distance,
            turn=turn,
        )


def mars_axes(day: float, fraction: float) -> Array:
    """Rows: the prime meridian, 90 degrees east of it and the north pole of Mars in the axes of ICRS; (3, 3).

    Archinal et al. 2011, table 1; at a Julian date (TDB) in two parts.
    """
    days = (day - J2000) + fraction
    centuries = days / 36525.0
    return body_axes(317.68143 - 0.1061 * centuries, 52.88650 - 0.0609 * centuries, 176.630 + 350.89198226 * days)
