"""The Moon's place, turn and light against other programs' numbers; offline."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from skyscatter.celestial.frames import AU, Sight
from skyscatter.celestial.moon import earthshine, moon_at, moon_irradiance, moon_radiance, moon_reflectance
from skyscatter.celestial.rolo import lommel_seeliger, sunlit_irradiance
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.spectra.solar import solar_irradiance
from skyscatter.spectra.vega import BAND_NODES, magnitude

ARCSEC = 206264.8
PARANAL = (-24.6, -70.4)

# Computed with CSPICE from JPL's DE421 and its integrated lunar rotation (MOON_ME), for observers 500 m above the
# ellipsoid with UT1 = UTC: astrometric right ascension and declination [degree], distance [km], selenographic longitude
# and latitude of the observer and of the Sun, phase angle [degree].
SPICE = [
    (51.5, -0.1, "2003-05-04T21:00:00", 78.96674, 24.33132, 400681.2, -5.367, -1.78, 138.579, -0.4634, 143.881),
    (-33.9, 18.4, "2012-11-20T03:00:00", 322.45634, -8.4938, 384735.3, 7.5571, -7.5102, 103.3945, 0.0679, 95.7961),
    (34.1, -118.3, "2019-01-21T05:12:00", 123.4628, 20.07278, 352887.7, -0.8677, -0.3106, -1.4544, -0.1101, 0.62),
    (-23.0, -67.8, "2024-09-09T18:30:00", 237.63212, -24.30202, 392944.9, -5.638, 5.336, 100.8114, 0.5623, 106.3208),
    (40.0, -3.7, "2026-08-12T18:20:00", 141.99241, 14.97867, 365963.9, 3.5769, -0.2842, -176.2984, 0.2473, 179.87),
]  # fmt: skip
# `rimopy` 0.4.2, elref.get_reflectance: phase angle, longitude and latitude of the observer, longitude of the Sun
# [degree]; reflectance at BANDS.
BANDS = [350.0, 440.0, 500.0, 550.0, 675.0, 870.0, 1640.0]
RIMO = [
    ((7, 0, 0, 7), [0.06250120, 0.08190706, 0.09182112, 0.09951753, 0.11624786, 0.13274595, 0.20420822]),
    ((30, 5, -4, 35), [0.03241397, 0.04421797, 0.05056430, 0.05560426, 0.06701173, 0.07890003, 0.13201222]),
    ((60, -6, 6, -66), [0.01325216, 0.01865098, 0.02156460, 0.02408856, 0.02927341, 0.03485607, 0.06111731]),
    ((95, 2, 3, -93), [0.00424523, 0.00617131, 0.00718619, 0.00809149, 0.00987461, 0.01193148, 0.02180656]),
]  # fmt: skip


def turned(degrees: float) -> float:
    return (degrees + 180.0) % 360.0 - 180.0


@pytest.mark.parametrize("row", SPICE)
def test_place_and_libration_against_the_integrated_moon(row) -> None:
    latitude, longitude, time, ra, dec, km, *angles = row
    sight = Sight(latitude, longitude, time, 500.0)
    moon = moon_at(sight)
    a, d = math.radians(ra), math.radians(dec)
    expected = sight.apparent([math.cos(a) * math.cos(d), math.sin(a) * math.cos(d), math.sin(d)])
    # what the series states against DE421: 0.8 and 0.45 arcsec, 0.7 km; the printed place is good to 0.02 arcsec
    assert np.linalg.norm(moon.direction - expected) * ARCSEC < 0.95
    assert abs(moon.distance / 1e3 - km) < 0.8
    ours = (
        moon.observer_longitude_deg, moon.observer_latitude_deg, moon.sun_longitude_deg, moon.sun_latitude_deg,
        moon.phase_angle_deg,
    )  # fmt: skip
    # The series of the rotation leaves out what moves the ground by up to 150 m, 0.005 degrees; the place adds its own.
    assert max(abs(turned(x - y)) for x, y in zip(ours, angles, strict=True)) < 0.006


@pytest.mark.parametrize("time", ["1995-02-03T10:00:00", "2026-06-28T22:00:00", "2008-10-11T04:00:00"])
def test_place_against_astropy(time) -> None:
    import astropy.units as u
    from astropy.coordinates import AltAz, EarthLocation, get_body
    from astropy.time import Time
    from astropy.utils import iers

    # Tables that came with astropy age; a second of UT1 is within the tolerance.
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        moment = Time(time)
        site = EarthLocation(lat=PARANAL[0] * u.deg, lon=PARANAL[1] * u.deg, height=2600 * u.m)
        judge = get_body("moon", moment, site).transform_to(AltAz(obstime=moment, location=site))
    moon = moon_at(Sight(*PARANAL, time, 2600.0))
    expected = direction_from_azimuth_elevation(judge.az.deg, judge.alt.deg)
    # UT1 and the pole as for the Sun, 14 arcsec, and the series that astropy takes, up to 18 from the integrated Moon
    assert np.linalg.norm(moon.direction - expected) * ARCSEC < 20
    assert moon.distance == pytest.approx(judge.distance.to_value(u.m), rel=5e-5)


@pytest.mark.parametrize(("given", "expected"), RIMO)
def test_reflectance_is_that_of_another_program(given, expected) -> None:
    phase, longitude, latitude, sun = given
    moon = SimpleNamespace(
        phase_angle_deg=phase, observer_longitude_deg=longitude, observer_latitude_deg=latitude, sun_longitude_deg=sun
    )
    # the same formula and coefficients: rounding of the printed digits
    assert moon_reflectance(moon, BANDS) == pytest.approx(expected, abs=6e-9)


def test_irradiance_follows_from_reflectance() -> None:
    """Kieffer & Stone 2005, equation 8, at the mean distances of Sun and Moon."""
    moon = SimpleNamespace(
        phase_angle_deg=7.0, observer_longitude_deg=0.0, observer_latitude_deg=0.0, sun_longitude_deg=7.0,
        distance=3.844e8, sun_distance=AU,
    )  # fmt: skip
    light = sunlit_irradiance(moon, BANDS)
    # eight decimals of the table
    assert light == pytest.approx(np.array(RIMO[0][1]) * 6.4177e-5 / np.pi * solar_irradiance(BANDS), rel=1e-6)


def test_light_falls_without_a_jump_where_the_model_ends() -> None:
    angles = np.arange(0.0, 180.01, 0.25)
    moons = [
        SimpleNamespace(phase_angle_deg=g, observer_longitude_deg=0.0, observer_latitude_deg=0.0, sun_longitude_deg=g)
        for g in angles
    ]
    light = np.array([moon_reflectance(moon, [350.0, 550.0, 1000.0]) for moon in moons])
    assert np.all(np.diff(light, axis=0) < 0.0)
    slopes = np.diff(-2.5 * np.log10(light[:-1]), axis=0) / 0.25
    within = angles[:-3] < 170.0  # beyond, the light ends
    # The slope, 0.03 to 0.13 mag a degree, may have a kink where one law follows another, but no jump: that of the
    # light would be a slope of 0.04 for each per cent.
    assert np.all(np.abs(np.diff(slopes, axis=0)[within]) < 0.02)
    assert light[-1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("phase", [7.0, 30.0, 60.0, 90.0, 120.0])
def test_magnitude_and_colour_of_the_moon(phase) -> None:
    """V = -12.73 + 0.026 g + 4e-9 g^4 (Allen 1976, by Krisciunas & Schaefer 1991), B - V = 0.92, mean distances."""
    moon = SimpleNamespace(
        phase_angle_deg=phase, observer_longitude_deg=0.0, observer_latitude_deg=0.0, sun_longitude_deg=phase,
        distance=3.844e8, sun_distance=AU,
    )  # fmt: skip
    light = sunlit_irradiance(moon, BAND_NODES)
    # the scales of the two are known to 5 % or so; a mean law
    assert magnitude(light, "V") == pytest.approx(-12.73 + 0.026 * phase + 4e-9 * phase**4, abs=0.1)
    assert magnitude(light, "B") - magnitude(light, "V") == pytest.approx(0.92, abs=0.08)


def test_law_of_the_smooth_sphere() -> None:
    """Integral over the lit face from afar: 2 / pi of the integral of cos i cos e / (cos i + cos e) over longitudes."""
    nodes, weights = np.polynomial.legendre.leggauss(100)
    for phase in (10.0, 90.0, 150.0, 178.5):
        g = math.radians(phase)
        half = (math.pi - g) / 2
        longitude = g / 2 + half * nodes
        e, i = np.cos(longitude), np.cos(longitude - g)
        # latitudes give 4 / 3 for every longitude; at full phase the integral over longitudes is 1
        whole = half * weights @ (i * e / np.maximum(i + e, 1e-300))
        assert lommel_seeliger(phase) == pytest.approx(whole, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize(
    ("time", "phase"), [("2026-04-02T02:00Z", 2.4), ("2026-04-10T06:00Z", 91.2), ("2026-04-14T06:00Z", 138.1)]
)
def test_face_holds_all_the_light(time, phase) -> None:
    moon = moon_at(Sight(*PARANAL, time))
    assert moon.phase_angle_deg == pytest.approx(phase, abs=0.05)  # the printed digit
    count = 700
    axes = np.linalg.svd(moon.direction[None])[2][1:]
    across = math.sin(moon.angular_radius) * ((np.arange(count) + 0.5) / count * 2 - 1)
    x, y = np.meshgrid(across, across)
    z = np.sqrt(1.0 - x**2 - y**2)
    grid = x[..., None] * axes[0] + y[..., None] * axes[1] + z[..., None] * moon.direction
    radiance = moon_radiance(moon, grid, [550.0])
    dark = earthshine(moon, [550.0])
    lit = np.where(radiance == dark, 0.0, radiance)[..., 0]
    total = (lit / z).sum() * (across[1] - across[0]) ** 2
    # squares cut the limb: an error of a few 1e-4 for 700 across on a crescent, 1e-5 on a full disk
    assert total == pytest.approx(moon_irradiance(moon, [550.0])[0], rel=1e-3)
    assert radiance[0, 0, 0] == 0.0  # the corner is outside


def test_bright_limb_faces_the_sun() -> None:
    moon = moon_at(Sight(*PARANAL, "2026-04-12T06:00Z"))
    aside = moon.sun_direction - (moon.sun_direction @ moon.direction) * moon.direction
    aside /= np.linalg.norm(aside)
    offset = math.sin(moon.angular_radius) * 0.98 * aside
    lit, dark = (moon.direction + sign * offset for sign in (1, -1))
    face = moon_radiance(moon, np.stack([lit, dark]), [450.0, 650.0])
    shine = earthshine(moon, [450.0, 650.0])
    assert np.array_equal(face[1], shine)
    assert np.all(face[0] > 1000.0 * shine)
    # the Earth's light is bluer than the Sun's
    assert shine[0] / shine[1] > 1.1 * face[0, 0] / face[0, 1]


def test_nothing_is_seen_where_a_camera_sees_nothing() -> None:
    moon = moon_at(Sight(*PARANAL, "2026-04-12T06:00Z"))
    assert np.array_equal(moon_radiance(moon, np.full((2, 2, 3), np.nan), [550.0]), np.zeros((2, 2, 1)))
