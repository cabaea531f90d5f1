"""Light of faint stars: where the Milky Way's clouds are, how much there is by latitude, colours, no edges."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.celestial.grids import bilinear
from skyscatter.celestial.starlight import (
    DIFFUSE,
    S10_STARS,
    _halved,
    _map,
    starlight_parts,
    starlight_radiance,
    starlight_spectra,
)
from skyscatter.datafiles import data_path
from skyscatter.errors import DomainError
from skyscatter.image.filters import filter_curve
from skyscatter.image.photometry import VEGA_ZERO

WIDE = np.arange(300.0, 951.0, 2.0)


def direction(longitude, latitude):
    lon, lat = np.broadcast_arrays(np.radians(longitude), np.radians(latitude))
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


def brightness(longitude, latitude):
    """At 550 nm, in stars of V = 10 per square degree."""
    return starlight_parts(direction(longitude, latitude)).sum(axis=-1) / S10_STARS


def colour(radiance, one, other):
    blue, red = (filter_curve(band).weights(WIDE)[0] @ radiance / VEGA_ZERO[band] for band in (one, other))
    return -2.5 * np.log10(blue / red)


def test_clouds_are_where_they_are() -> None:
    """Galactic coordinates of the Magellanic Clouds, the great cloud in Sagittarius and the Coalsack."""
    lon, lat = np.arange(0.0, 360.0, 0.25), np.arange(-89.0, 89.1, 0.25)
    sky = brightness(lon, lat[:, None])

    def brightest(longitudes, latitudes):
        part = np.where((np.abs(lon - longitudes) < 6) & (np.abs(lat - latitudes) < 5)[:, None], sky, 0.0)
        i, j = np.unravel_index(np.argmax(part), part.shape)
        return lon[j], lat[i]

    # The bar of the Large Cloud is 2 degrees long; the Small Cloud's middle is at 302.8, -44.3.
    assert brightest(280.5, -32.9) == pytest.approx((280.0, -33.3), abs=1.2)
    assert brightest(302.8, -44.3) == pytest.approx((302.8, -44.3), abs=0.8)
    i, j = np.unravel_index(np.argmax(sky), sky.shape)
    assert (lon[j], lat[i]) == pytest.approx((2.0, -3.0), abs=1.5)
    # The Coalsack (303, 0) is darker than the Milky Way on both sides, by less than to the eye: bright stars that are
    # spread over 8 degrees fill it.  The rift in Aquila is darker than what is below it.
    sack, west, east = (brightness(middle + np.array([-1.5, 0.0, 1.5]), 0.5).mean() for middle in (302.5, 295.0, 309.0))
    assert sack < 0.85 * min(west, east)
    assert brightness(26.0, 5.0) < 0.6 * brightness(26.0, -5.0)


def test_light_by_latitude_against_star_counts() -> None:
    """Stars of tenth magnitude per square degree, mean over longitude, of all stars: Roach & Megill (1961, ApJ 133,
    228) and Allen (1973, paragraph 117), from memory and good to 20 % among authors.  Ours lack what is brighter than V
    = 7, which Hipparcos has: 48, 30, 27, 17, 18, 16 at these latitudes; the scattered light is taken off."""
    longitude = np.arange(0.5, 360.0)
    counted = {0.0: 270.0, 10.0: 170.0, 20.0: 110.0, 35.0: 70.0, 50.0: 50.0, 80.0: 36.0}
    bright = (48.0, 30.0, 27.0, 17.0, 18.0, 16.0)
    for (latitude, number), more in zip(counted.items(), bright, strict=True):
        faint = brightness(longitude, [[latitude], [-latitude]]).mean() * (1.0 - DIFFUSE)
        assert faint + more == pytest.approx(number, rel=0.25)


def test_light_is_kept_by_the_splines() -> None:
    with np.load(data_path("starlight.npz")) as file:
        cells = np.exp(file["brightness"] / 200.0)
    latitude = np.radians(-89.8 + 0.5 * np.arange(360))
    mean = np.average(cells, axis=0, weights=np.cos(latitude)).mean() / (1.0 - DIFFUSE)
    # A quadrature of 0.3 degrees, and the step of 0.5 % in the file.
    lat = np.arange(-89.95, 90.0, 0.3)
    ours = np.average(brightness(np.arange(0.05, 360.0, 0.3), lat[:, None]), axis=0, weights=np.cos(np.radians(lat)))
    assert ours.mean() == pytest.approx(mean, rel=2e-3)


def test_it_has_no_edges() -> None:
    """Across 180 degrees of longitude, where the map ends, and at the poles; and pixels do not show: slopes change
    little from one to the next."""
    lat = np.linspace(-80.0, 80.0, 33)
    assert brightness(179.9999, lat) == pytest.approx(brightness(-179.9999, lat), rel=1e-3)
    for pole in (90.0, -90.0):
        around = brightness(np.arange(0.0, 360.0, 30.0), pole * 0.99999)
        assert around == pytest.approx(brightness(0.0, pole), rel=1e-3)
    # In the brightest cloud, through cells of 0.5 degrees: the second difference over 0.05 degrees, of a mean of 700,
    # is that of a curve (some 700 * (0.05 / 0.7)^2 = 4) and not of a step.
    line = brightness(2.0 + np.arange(-3.0, 3.0, 0.05), -3.0)
    assert np.abs(np.diff(line, 2)).max() < 15.0


def test_map_is_positive_and_small() -> None:
    assert data_path("starlight.npz").stat().st_size < 700_000
    assert _map().min() >= 0.0
    assert _map().sum(axis=-1).min() / S10_STARS > 15.0
    assert _map().dtype == np.float32


def test_colours() -> None:
    """The two black bodies reproduce the map's B - V through the filters to 0.02; the centre is redder than the
    anticentre; V - R of mixtures lies within 0.12 of the Sun-like stars with that B - V (0.42 at 0.75)."""
    with np.load(data_path("starlight.npz")) as file:
        table = file["colour"] / 200.0
    pole = starlight_radiance([0.0, 0.0, 1.0], WIDE)
    assert colour(pole, "B", "V") == pytest.approx(table[-1].mean(), abs=0.03)
    anticentre, centre = starlight_radiance(direction([180.0, 2.0], [0.0, -3.0]), WIDE)
    assert colour(anticentre, "B", "V") < 0.8 < 1.0 < colour(centre, "B", "V") < 1.2
    assert colour(pole, "V", "R") == pytest.approx(0.42, abs=0.12)


def test_shapes_and_missing_directions() -> None:
    light = starlight_radiance(np.stack([direction(10.0, [1.0, 50.0]), np.full((2, 3), np.nan)]), [450.0, 550.0])
    assert light.shape == (2, 2, 2)
    assert np.all(light[0] > 0)
    assert np.isnan(light[1]).all()
    parts = starlight_parts(direction(10.0, 1.0)) @ starlight_spectra([450.0, 550.0])
    assert light[0, 0] == pytest.approx(parts, rel=1e-12)


def test_bad_input_is_named() -> None:
    with pytest.raises(DomainError, match=r"galactic.*3 entries"):
        starlight_parts([[1.0, 0.0]])
    with pytest.raises(DomainError, match="280 to 2500"):
        starlight_spectra([200.0])


def test_division_of_cells_and_look_up() -> None:
    """Cells divided by four keep their mean, ramps stay ramps, and the look-up is exact for what is linear."""
    rows = np.arange(5.0, dtype=np.float32)[:, None] * np.ones((1, 8), np.float32)
    fine = _halved(rows)
    assert fine.shape == (10, 16)
    assert fine.mean() == pytest.approx(rows.mean(), rel=1e-6)
    assert fine[2:8, 0] == pytest.approx(np.arange(0.75, 3.5, 0.5))
    table = np.add.outer(np.arange(4.0), 10.0 * np.arange(6.0))
    row, column = np.array([0.0, 1.25, 3.0, 7.0]), np.array([0.5, 4.75, 5.0, -1.0])
    assert bilinear(table, row, column) == pytest.approx(np.clip(row, 0, 3) + 10 * np.clip(column, 0, 5))
