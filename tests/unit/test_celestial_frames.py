"""Frames of the observer against ERFA one by one and against astropy; offline."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from skyscatter.celestial.frames import Sight
from skyscatter.errors import DomainError
from skyscatter.geometry import sun_position
from skyscatter.geometry.vectors import direction_from_azimuth_elevation

ARCSEC = 206264.8
SIGHTS = [
    (48.86, 2.35, "2026-08-12T21:00Z", 300.0),
    (-33.9, 151.2, "1985-11-03T03:00Z", 0.0),
    (80.0, -40.0, "2060-01-15T10:00Z", 2500.0),
]


def directions(count: int, seed: int = 0) -> np.ndarray:
    drawn = np.random.default_rng(seed).normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def arcsec(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.linalg.norm(first - second, axis=-1).max()) * ARCSEC


@pytest.mark.parametrize("given", SIGHTS)
def test_apparent_place_is_that_of_erfa(given) -> None:
    import erfa

    sight = Sight(*given)
    towards = directions(500)
    with warnings.catch_warnings():
        # "dubious year": see sun_position
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        day, fraction = erfa.dtf2d("UTC", *(int(w) for w in given[2][:10].split("-")), int(given[2][11:13]), 0, 0.0)
        place = np.radians(given[1]), np.radians(given[0]), given[3]
        astrom, _ = erfa.apco13(day, fraction, 0.0, *place, 0.0, 0.0, 0.0, 0.0, 0.0, 0.55)
    azimuth, zenith, *_ = erfa.atioq(*erfa.atciqz(*erfa.c2s(towards), astrom), astrom)
    expected = direction_from_azimuth_elevation(np.degrees(azimuth), 90.0 - np.degrees(zenith))
    # the same formulas in another order: rounding only; the nearest direction is some degrees from the Sun
    assert arcsec(sight.horizontal(towards), expected) < 1e-5


@pytest.mark.parametrize("given", SIGHTS)
def test_inverse(given) -> None:
    sight = Sight(*given)
    towards = directions(2000)
    there = sight.horizontal(towards)
    assert arcsec(sight.icrs(there), towards) < 0.01  # as the docstring says
    near = sight.state.towards_sun + 0.02 * directions(200)  # a degree from the Sun
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    assert arcsec(sight.icrs(sight.horizontal(near)), near) < 0.1
    nothing = sight.icrs(np.full((2, 3), np.nan))
    assert np.isnan(nothing).all()


def test_against_astropy() -> None:
    import astropy.units as u
    from astropy.coordinates import ICRS, AltAz, EarthLocation, SkyCoord
    from astropy.time import Time
    from astropy.utils import iers

    towards = directions(50)
    coordinates = SkyCoord(ICRS(*(np.arctan2(towards[:, 1], towards[:, 0]) * u.rad, np.arcsin(towards[:, 2]) * u.rad)))
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        site = EarthLocation(lat=-24.6 * u.deg, lon=-70.4 * u.deg, height=2600 * u.m)
        judge = coordinates.transform_to(AltAz(obstime=Time("2024-03-10T05:00:00"), location=site))
    sight = Sight(-24.6, -70.4, "2024-03-10T05:00Z", 2600.0)
    expected = direction_from_azimuth_elevation(judge.az.deg, judge.alt.deg)
    # astropy knows UT1: its difference from UTC was 0.01 s that day, 0.15 arcsec, and the pole's 0.4 arcsec
    assert arcsec(sight.horizontal(towards), expected) < 0.6


def test_galactic_and_ecliptic_axes() -> None:
    from astropy.coordinates import BarycentricMeanEcliptic, CartesianRepresentation, Galactic, SkyCoord

    sight = Sight(48.86, 2.35, "2026-08-12T21:00Z")
    towards = directions(50)
    seen = sight.horizontal(towards)
    sky = SkyCoord(CartesianRepresentation(towards.T), frame="icrs")
    galactic = sky.transform_to(Galactic()).cartesian.xyz.value.T
    ecliptic = sky.transform_to(BarycentricMeanEcliptic(equinox="J2000")).cartesian.xyz.value.T
    assert arcsec(sight.galactic(seen), galactic) < 0.05  # ERFA's galactic matrix against FK5's: 0.02 arcsec
    assert arcsec(sight.ecliptic(seen), ecliptic) < 0.01  # the inverse itself


def test_sun_is_that_of_the_geometry() -> None:
    sight = Sight(48.86, 2.35, "2026-08-12T18:00Z", 300.0)
    sun = sun_position(48.86, 2.35, "2026-08-12T18:00Z", 300.0)
    expected = direction_from_azimuth_elevation(sun.azimuth_deg, sun.elevation_deg)
    assert arcsec(sight.sun.direction, expected) < 1e-5
    assert sight.sun.distance == pytest.approx(sun.distance_au * 149597870700.0, rel=1e-12)


def test_a_later_sight() -> None:
    sight = Sight(48.86, 2.35, "2026-08-12T18:00Z")
    assert sight.later(3600.0).sun.direction == pytest.approx(
        Sight(48.86, 2.35, "2026-08-12T19:00Z").sun.direction, abs=1e-12
    )


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((95.0, 0.0, "2026-08-12T18:00Z"), "latitude"),
        ((0.0, 0.0, "tomorrow"), "ISO 8601"),
        ((0.0, 0.0, "2150-01-01T00:00Z"), "1900"),
    ],
)
def test_bad_input_is_named_at_once(given, words) -> None:
    with pytest.raises(DomainError, match=words):
        Sight(*given)
