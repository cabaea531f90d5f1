"""Where the Sun stands for a place and a time.

The work is done by ERFA (the engine inside astropy, imported alone because it loads in a fraction of astropy's time),
from its analytic ephemeris of the Earth.  Nothing is read from a network or from a table that grows old.
"""

from __future__ import annotations

import math
import warnings
from datetime import UTC, datetime
from typing import Any, NamedTuple

from skyscatter.errors import DomainError

#: The Earth's ephemeris (ERFA's epv00) is fitted to these years.
FIRST_YEAR, LAST_YEAR = 1900, 2100


class SunPosition(NamedTuple):
    """Geometric (unrefracted) position of the Sun's centre."""

    elevation_deg: float  #: above the horizon
    azimuth_deg: float  #: from north through east, 0 to 360
    distance_au: float  #: from the observer


def sun_position(latitude_deg: float, longitude_deg: float, time: Any, altitude_m: float = 0.0) -> SunPosition:
    """Topocentric position of the Sun, without refraction.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        Geodetic latitude (north positive) and longitude (east positive) [degree] on the WGS84 ellipsoid.
    time : str, datetime or astropy Time
        ISO 8601 text such as ``2026-06-21T18:30Z`` or ``2003-10-17T12:30:30-07:00``; no offset means UTC.
    altitude_m : float
        Height above the ellipsoid [m].

    Returns
    -------
    SunPosition
        Elevation, azimuth [degree] and distance [au].

    Raises
    ------
    DomainError
        For places that are not on Earth, unreadable times, and years outside 1900 to 2100.

    Notes
    -----
    Earth from ERFA ``epv00`` (0.015 arcsec at 1 au), aberration, IAU 2006/2000A precession-nutation and parallax
    by ``apco13``, ``atciqz`` and ``atioq``.  UT1 is taken as UTC and the pole as unmoved: at most 0.9 s, or 13 arcsec,
    1/140 of the Sun's diameter, as long as UTC follows UT1 that closely.  Before 1960 there was no UTC: times count
    as UT1.
    """
    import erfa

    check_place(latitude_deg, longitude_deg, altitude_m)
    day, fraction = utc_julian_date(time)
    phi, elong = math.radians(latitude_deg), math.radians(longitude_deg)
    with warnings.catch_warnings():
        # "dubious year": no leap seconds are announced yet, or there was no UTC; the notes above say what that costs.
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        # UTC, UT1-UTC, place, polar motion (2), pressure (none: no refraction), temperature, humidity, wavelength
        astrom, _ = erfa.apco13(day, fraction, 0.0, elong, phi, altitude_m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.55)
        towards_sun = -astrom["eh"]
        cirs_ra, cirs_dec = erfa.atciqz(*erfa.c2s(towards_sun), astrom)
        azimuth, zenith_angle, *_ = erfa.atioq(cirs_ra, cirs_dec, astrom)
    return SunPosition(90.0 - math.degrees(zenith_angle), math.degrees(azimuth) % 360.0, float(astrom["em"]))


def iso_utc(time: Any) -> str:
    """A moment, as `sun_position` takes it, as ISO 8601 text in UTC to the microsecond: ``2026-06-21T18:30:00``."""
    if hasattr(time, "utc") and hasattr(time, "isot"):  # an astropy Time
        return str(time.utc.isot)
    return as_utc(time).replace(tzinfo=None).isoformat()


def check_place(latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
    """Refuse places that are not on the Earth; see `sun_position`."""
    if not -90.0 <= latitude_deg <= 90.0:
        raise DomainError("latitude", latitude_deg, "must lie between -90 and 90 degrees, north positive")
    if not -360.0 <= longitude_deg <= 360.0:
        raise DomainError("longitude", longitude_deg, "must lie between -360 and 360 degrees, east positive")
    if not (math.isfinite(altitude_m) and altitude_m > -12_000.0):
        raise DomainError("altitude", altitude_m, "must be a finite height above the ground in metres")


def utc_julian_date(time: Any) -> tuple[float, float]:
    """UTC as ERFA's two-part quasi Julian date."""
    import erfa

    if hasattr(time, "utc") and hasattr(time, "jd1"):  # an astropy Time
        if getattr(time, "shape", ()) != ():
            raise DomainError("time", str(time), "give one moment, not an array")
        day, fraction = float(time.utc.jd1), float(time.utc.jd2)
        if not math.isfinite(day + fraction):
            raise DomainError("time", str(time), "give a valid moment")
        _check_year(time, 2000.0 + (day + fraction - 2451545.0) / 365.25)
        return day, fraction
    moment = as_utc(time)
    _check_year(time, moment.year)
    seconds = moment.second + 1e-6 * moment.microsecond
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        day, fraction = erfa.dtf2d("UTC", moment.year, moment.month, moment.day, moment.hour, moment.minute, seconds)
    return float(day), float(fraction)


def as_utc(time: Any) -> datetime:
    """A moment given as text or datetime as a datetime in UTC; no offset means UTC."""
    if isinstance(time, str):
        try:
            time = datetime.fromisoformat(time.strip())
        except ValueError:
            raise DomainError(
                "time", time, "give an ISO 8601 date and time such as 2026-06-21T18:30Z (no offset means UTC)"
            ) from None
    if not isinstance(time, datetime):
        raise DomainError("time", time, "give ISO 8601 text, a datetime or an astropy Time")
    try:
        return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    except OverflowError:
        raise DomainError("time", str(time), f"the year must lie between {FIRST_YEAR} and {LAST_YEAR}") from None


def _check_year(time: Any, year: float) -> None:
    if not FIRST_YEAR <= year <= LAST_YEAR:
        raise DomainError("time", str(time), f"the year must lie between {FIRST_YEAR} and {LAST_YEAR}")
