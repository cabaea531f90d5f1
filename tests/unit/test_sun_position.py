"""The Sun's position against published and independent values; offline."""

from __future__ import annotations

import socket
import subprocess
import sys
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from skyscatter.errors import DomainError
from skyscatter.geometry import sun_position

GOLDEN = (39.742476, -105.1786)
GOLDEN_ALTITUDE = 1830.14


def angle_between(first, second):
    """Great circle [arcsec] between two (elevation, azimuth) pairs [degree]."""
    (e1, a1), (e2, a2) = np.radians(first), np.radians(second)
    half = np.sin((e1 - e2) / 2) ** 2 + np.cos(e1) * np.cos(e2) * np.sin((a1 - a2) / 2) ** 2
    return np.degrees(2 * np.arcsin(np.sqrt(half))) * 3600


def test_worked_example_of_reda_and_andreas():
    """Reda & Andreas (2004, revised 2008), NREL/TP-560-34302, appendix A.5: topocentric elevation before refraction.

    The report gives e0 = 39.872046 degrees, refraction 0.016332, zenith angle 50.111622 and azimuth 194.340241; its
    distance R = 0.996542 au is geocentric.
    """
    sun = sun_position(*GOLDEN, "2003-10-17T12:30:30-07:00", GOLDEN_ALTITUDE)
    published = 90 - 50.111622 - 0.016332
    assert published == pytest.approx(39.872046)
    # the report claims 0.0003 degrees, 1.1 arcsec, for its own algorithm
    assert angle_between(sun[:2], (39.872046, 194.340241)) < 1.1
    # the observer is nearer by up to one radius of the Earth, 4.3e-5 au
    assert abs(sun.distance_au - 0.996542) < 4.3e-5


@pytest.mark.parametrize(
    ("place", "time"),
    [
        ((0.0, 0.0), "2026-03-20T12:00:00"),
        ((48.86, 2.35), "2026-06-21T18:30:00"),
        ((-33.9, 151.2), "2026-12-21T20:00:00"),
        ((69.65, 18.96), "2010-01-15T10:00:00"),
        ((-89.9, 40.0), "1985-11-03T03:00:00"),
        ((21.3, -157.9), "2026-11-02T02:00:00"),
    ],
)
def test_against_astropy(place, time):
    import astropy.units as u
    from astropy.coordinates import AltAz, EarthLocation, get_body
    from astropy.time import Time
    from astropy.utils import iers

    # Tables that came with astropy age; a second of UT1 is within the tolerance.
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        moment = Time(time)
        site = EarthLocation(lat=place[0] * u.deg, lon=place[1] * u.deg, height=100 * u.m)
        judge = get_body("sun", moment, site).transform_to(AltAz(obstime=moment, location=site))
        expected, distance = (judge.alt.deg, judge.az.deg), judge.distance.au
    sun = sun_position(*place, time, 100.0)
    # UT1 differs from UTC by up to 0.9 s (13.5 arcsec of the Earth's turning); polar motion adds up to 0.5 arcsec
    assert angle_between(sun[:2], expected) < 14
    # light time: the Sun moves about the barycentre by 7 km meanwhile, 5e-8 au; the ephemeris is good to 11 km
    assert abs(sun.distance_au - distance) < 2e-7


def test_against_pvlib():
    pandas = pytest.importorskip("pandas")
    solarposition = pytest.importorskip("pvlib.solarposition")
    times = pandas.date_range("2024-01-01T03:00Z", "2024-12-31T03:00Z", periods=25)
    judge = solarposition.spa_python(times, -23.5, 46.7, altitude=1300, delta_t=69.2)
    for time, elevation, azimuth in zip(times, judge["elevation"], judge["azimuth"], strict=True):
        sun = sun_position(-23.5, 46.7, time.to_pydatetime(), 1300.0)
        # both take UT1 = UTC; 0.0003 degrees is the stated uncertainty of pvlib's algorithm
        assert angle_between(sun[:2], (elevation, azimuth)) < 1.1


def test_solstices_and_equinox():
    # Sun overhead at the tropic: the obliquity of 2026 is 23.4358 degrees; apparent noon at 0 E on 21 June is 12:01:50
    noon = max(sun_position(23.4358, 0.0, f"2026-06-21T12:0{minute}Z").elevation_deg for minute in range(5))
    assert noon > 89.8  # within half a minute of noon the Sun moves 0.125 degrees
    # polar night and day, 10 degrees from the poles, at the June solstice
    assert sun_position(80, 0, "2026-06-21T00:00Z").elevation_deg == pytest.approx(13.44, abs=0.02)  # to 1 arcmin
    assert sun_position(-80, 0, "2026-06-21T12:00Z").elevation_deg == pytest.approx(-13.44, abs=0.02)
    # sunrise in the east at the equinox: the declination is below 0.3 degrees on that day
    sun = sun_position(0, 0, "2026-03-20T06:07Z")
    assert abs(sun.azimuth_deg - 90) < 0.3
    assert abs(sun.elevation_deg) < 0.5  # half a degree is two minutes of time


def test_distance_at_perihelion_and_aphelion():
    # a (1 - e) and a (1 + e) with e = 0.0167; the Moon and the Earth's radius move these by less than 1e-4
    assert sun_position(0, 0, "2026-01-03T17:00Z").distance_au == pytest.approx(0.9833, abs=2e-4)
    assert sun_position(0, 0, "2026-07-06T17:00Z").distance_au == pytest.approx(1.0167, abs=2e-4)


def test_all_ways_of_telling_a_time_agree():
    from astropy.time import Time

    text = sun_position(*GOLDEN, "2003-10-17T19:30:30")
    assert sun_position(*GOLDEN, "2003-10-17T19:30:30Z") == text
    assert sun_position(*GOLDEN, "2003-10-17 12:30:30-07:00") == text
    assert sun_position(*GOLDEN, datetime(2003, 10, 17, 19, 30, 30)) == text
    assert sun_position(*GOLDEN, datetime(2003, 10, 17, 12, 30, 30, tzinfo=timezone(timedelta(hours=-7)))) == text
    assert sun_position(*GOLDEN, datetime(2003, 10, 17, 19, 30, 30, tzinfo=UTC)) == text
    # two splittings of the same Julian date: rounding of a day
    assert sun_position(*GOLDEN, Time("2003-10-17T19:30:30")) == pytest.approx(text, abs=1e-9)


@pytest.mark.parametrize("year", [1900, 1950, 2032, 2100])
def test_far_years_give_no_warning(year):
    sun = sun_position(0, 0, f"{year}-06-01T12:00Z")  # warnings are errors here
    assert sun.elevation_deg == pytest.approx(68, abs=0.5)  # declination near 22 degrees on every 1 June


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((91, 0, "2026-01-01"), "latitude"),
        ((float("nan"), 0, "2026-01-01"), "latitude"),
        ((0, 400, "2026-01-01"), "longitude"),
        ((0, 0, "yesterday"), "time"),
        ((0, 0, ""), "time"),
        ((0, 0, 5), "time"),
        ((0, 0, "1899-12-31T23:00Z"), "1900 and 2100"),
        ((0, 0, "2101-01-01"), "1900 and 2100"),
        ((0, 0, "9999-12-31T23:59-05:00"), "1900 and 2100"),
        ((0, 0, "2026-01-01", float("inf")), "altitude"),
    ],
)
def test_refusals(arguments, word):
    with pytest.raises(DomainError, match=word):
        sun_position(*arguments)


def test_network_is_blocked_in_tests():
    with pytest.raises(RuntimeError, match="nothing here may use the network"):
        socket.create_connection(("192.0.2.1", 80), timeout=1)


def test_neither_network_nor_astropy_is_needed():
    code = (
        "import socket, sys\n"
        "def refuse(*a, **k): raise SystemExit('network')\n"
        "socket.socket.connect = refuse; socket.getaddrinfo = refuse\n"
        "from skyscatter.geometry.sun import sun_position\n"
        "sun_position(0, 0, '2026-01-01T12:00Z')\n"
        "raise SystemExit('astropy' if 'astropy' in sys.modules else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
