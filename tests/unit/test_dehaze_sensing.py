"""Bands, radiance, cirrus and the size of pixels: what is sorted out before anything is corrected."""

from __future__ import annotations

from datetime import datetime
from types import SimpleNamespace

import numpy as np
import pytest

from skyscatter.dehaze import DehazeOptions, SourceOptions, load_sensor
from skyscatter.dehaze.flags import Flag
from skyscatter.dehaze.masks import BandRoles, clouds
from skyscatter.dehaze.physical import CIRRUS_NONE, CIRRUS_SEEN, above_atmosphere
from skyscatter.dehaze.rasters.arrays import ArraySource
from skyscatter.dehaze.sensing import gases, sense, sun_distance
from skyscatter.errors import DomainError

NAMES = ("B02", "B03", "B04", "B8A", "B10", "B11")


def source(image: np.ndarray, names: tuple[str, ...] = NAMES, **options: object) -> ArraySource:
    reading = {"sensor": "sentinel-2a", "sun_zenith_deg": 40.0, "quantity": "reflectance", **options}
    return ArraySource(image.astype(np.float32), SourceOptions(**reading), names=names)


def test_the_cirrus_band_shows_no_ground_and_the_others_do() -> None:
    found = sense(source(np.full((6, 8, 8), 0.2)))
    assert [band.name for band in found.bands] == ["B02", "B03", "B04", "B8A", "B11"]
    assert found.places == (0, 1, 2, 3, 5)
    assert found.cirrus == 4
    assert any("B10" in note for note in found.notes)


def test_thin_cirrus_comes_off_all_bands_and_thick_cirrus_is_cloud() -> None:
    image = np.full((6, 4, 4), 0.2)
    image[4] = 0.001
    image[4, 0], image[4, 1] = CIRRUS_NONE + 0.017, 0.3
    found, flags = sense(source(image)), np.zeros((4, 4), np.uint8)
    roles = BandRoles(found.bands)
    toa = above_atmosphere(
        found, lambda r, c: np.ones((4, 4)), roles, np.zeros(5, np.float32), 0, 0, image.astype(np.float32), flags
    )
    np.testing.assert_allclose(toa[:, 0], 0.2 - 0.017 / CIRRUS_SEEN, rtol=1e-5)
    np.testing.assert_allclose(toa[:, 2:], 0.2, rtol=1e-6)
    assert np.all(flags[0] == Flag.CIRRUS)
    assert np.all(flags[1] & np.uint8(Flag.CLOUD))
    assert not flags[2:].any()


def test_radiance_becomes_reflectance_by_the_sun_in_the_band() -> None:
    band = load_sensor("sentinel-2a").band("B03")
    rho, zenith = 0.3, 40.0
    radiance = rho * 1e3 * band.solar_irradiance * np.cos(np.radians(zenith)) / np.pi
    made = source(np.full((1, 4, 4), radiance), ("B03",), quantity="radiance")
    found, flags = sense(made), np.zeros((4, 4), np.uint8)
    toa = above_atmosphere(
        found, made.geometry.secant_of_sun, BandRoles(found.bands), np.zeros(1, np.float32), 0, 0,
        made.read(0, 4, 0, 4), flags,
    )  # fmt: skip
    np.testing.assert_allclose(toa, rho, rtol=1e-5)
    assert any("date is unknown" in note for note in found.notes)


def test_the_suns_distance_over_the_year() -> None:
    # Perihelion and aphelion of 2026: 0.98330 and 1.01666 au (U.S. Naval Observatory).
    for day, expected in ((datetime(2026, 1, 3), 0.98330), (datetime(2026, 7, 6), 1.01666)):
        made = SimpleNamespace(sun_distance_au=None, acquired=day)
        assert sun_distance(made, []) == pytest.approx(expected, abs=3e-4)
    assert sun_distance(SimpleNamespace(sun_distance_au=1.01, acquired=None), []) == 1.01


def test_bands_that_nobody_knows_are_refused_with_the_remedy() -> None:
    with pytest.raises(DomainError, match="name the bands"):
        sense(source(np.full((1, 4, 4), 0.1), ("thermal",)))
    with pytest.raises(DomainError, match="sensor"):
        sense(source(np.full((1, 4, 4), 0.1), ("layer",), sensor=None))
    with pytest.raises(DomainError, match="in none of them"):
        sense(source(np.full((1, 4, 4), 0.1), ("B10",)))


def test_gases_are_wrong_by_more_where_their_columns_are_guesses() -> None:
    bands = [load_sensor("sentinel-2a").band(name) for name in ("B03", "B09")]
    sun, view = np.array([40.0]), np.array([0.0])
    guessed, known = gases(bands, sun, view, 1013.25), gases(bands, sun, view, 1013.25, 344.0, 1.42)
    np.testing.assert_allclose(guessed.above, known.above)
    assert np.all(guessed.relative > 2 * known.relative)
    assert guessed.relative[1] > 0.1 > guessed.relative[0]
    assert np.all(known.water <= known.half)


def test_bright_white_pixels_are_cloud_and_snow_soil_and_haze_are_not() -> None:
    bands = [load_sensor("sentinel-2a").band(name) for name in ("B02", "B03", "B04", "B8A", "B11")]
    air = np.array([0.06, 0.035, 0.018, 0.006, 0.0005], np.float32)
    spectra = {
        "cloud": ((0.62, 0.60, 0.60, 0.62, 0.45), True),
        "snow": ((0.80, 0.80, 0.80, 0.75, 0.10), False),
        "bright soil": ((0.22, 0.28, 0.36, 0.42, 0.50), False),
        "haze over leaves": ((0.24, 0.20, 0.15, 0.35, 0.16), False),
    }
    image = np.array([s for s, _ in spectra.values()], np.float32).T[:, :, None]
    found = clouds(image, air, BandRoles(bands))
    assert [bool(f) for f in found[:, 0]] == [cloudy for _, cloudy in spectra.values()]


def test_options_of_columns_and_pressure_are_checked() -> None:
    for name, value in (("ozone_du", -1), ("water_vapour_g_cm2", 99), ("pressure_hpa", 20), ("pixel_size_m", 0)):
        with pytest.raises(ValueError, match=name):
            DehazeOptions(**{name: value})
