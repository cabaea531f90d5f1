"""The sky of Mars by place and time: its Sun, its moons and what stands in it."""

from __future__ import annotations

import numpy as np
import pytest

import skyscatter
from skyscatter.celestial.frames import AU, Sight
from skyscatter.celestial.marsmoons import mars_moons_at
from skyscatter.celestial.marssight import MarsSight
from skyscatter.celestial.planets import planets_at
from skyscatter.celestial.stars import stars_at
from skyscatter.cli.main import main
from skyscatter.errors import DomainError

JEZERO, GALE, MERIDIANI = (18.44, 77.45), (-4.6, 137.4), (-1.95, 354.47)


def angle(a, b):
    """Between unit vectors [degree]."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def test_the_worked_example_of_mars24() -> None:
    """Allison & McEwen 2000 (Planet. Space Sci. 48, 215) with the numbers that GISS prints for 2000-01-06 00:00 UTC.

    The Sun over 174.7296 degrees west and 25 south, 1.39358 au away.  From memory; their series are good to 0.01.
    """
    below = MarsSight(0.0, -174.7296, "2000-01-06T00:00Z")
    east, north, up = below.sun.direction
    # 0.01 degrees of theirs, and aberration and the time that light takes: 12 minutes are 0.05 degrees in season.
    assert np.degrees(np.arctan2(east, up)) == pytest.approx(0.0, abs=0.03)
    assert np.degrees(np.arcsin(north)) == pytest.approx(-25.0, abs=0.05)
    assert below.sun.distance / AU == pytest.approx(1.39358, abs=2e-4)


@pytest.mark.parametrize(
    ("place", "moon", "day"),
    [
        (JEZERO, "Phobos", "2022-04-02"),  # Perseverance, sol 397
        (GALE, "Phobos", "2013-08-17"),  # Curiosity, sol 369
        (GALE, "Deimos", "2019-03-17"),  # Curiosity, sol 2350
        (MERIDIANI, "Deimos", "2004-03-04"),  # Opportunity, sol 39
    ],
)
def test_transits_that_rovers_saw(place, moon, day) -> None:
    """On days on which a moon passed before the Sun it comes as near to it, by day.

    Phobos comes within half a degree on few days of a year: its places are good to 0.4 degrees, those of Deimos to 0.2.
    """
    start = MarsSight(*place, f"{day}T00:00Z")

    def aside(seconds):
        sight = start.later(seconds)
        (seen,) = (m for m in mars_moons_at(sight) if m.name == moon)
        return angle(seen.direction, sight.sun.direction) if sight.sun.direction[2] > 0.1 else 180.0

    near = min(range(0, 86400, 120), key=aside)
    assert min(aside(near + s) for s in range(-120, 121, 5)) < (0.4 if moon == "Phobos" else 0.2)


def test_phobos_rises_in_the_west_and_is_dark_in_the_shadow() -> None:
    night = [MarsSight(0.0, 0.0, "2025-11-29T00:00Z").later(300.0 * k) for k in range(96)]
    phobos = [mars_moons_at(sight)[0] for sight in night]
    up = [moon.direction[2] > 0 for moon in phobos]
    rises = [k for k in range(1, len(up)) if up[k] and not up[k - 1]]
    assert rises
    assert all(phobos[k].direction[0] < -0.9 for k in rises)  # in the west
    shade = {moon.sunlit for moon in phobos}
    assert 0.0 in shade
    assert 1.0 in shade
    dark = next(moon for moon in phobos if moon.sunlit == 0.0)
    assert np.all(dark.irradiance([550.0]) == 0)
    # Between 6000 and 9000 km away, 0.14 to 0.21 degrees across.
    near = min(phobos, key=lambda moon: moon.distance)
    assert 5.9e6 < near.distance < 6.3e6
    assert np.degrees(2 * near.angular_radius) == pytest.approx(0.21, abs=0.01)


def test_mars_and_the_earth_see_each_other() -> None:
    """The Earth from Mars stands opposite to where Mars stands from the Earth, but for aberration and parallax."""
    time = "2026-05-01T00:00Z"
    here, there = Sight(0.0, 0.0, time), MarsSight(0.0, 0.0, time)
    mars = next(p for p in planets_at(here) if p.name == "Mars")
    earth = next(p for p in planets_at(there) if p.name == "Earth")
    assert "Mars" not in {p.name for p in planets_at(there)}
    # 20 arcsec of aberration on either side, minutes of light, a planet's radius of parallax: 0.02 degrees.
    assert angle(here.icrs(mars.direction), -there.icrs(earth.direction)) < 0.03
    assert earth.distance == pytest.approx(mars.distance, rel=1e-3)
    assert -3.5 < earth.magnitude < 1.0


def test_stars_keep_their_angles() -> None:
    time = "2026-03-01T00:00Z"
    here, there = (stars_at(sight, limit=2.0) for sight in (Sight(0.0, 0.0, time), MarsSight(10.0, 50.0, time)))
    a, b = (s.directions @ s.directions.T for s in (here, there))
    np.testing.assert_allclose(a, b, atol=4e-4)  # aberration on both planets, 20 and 17 arcsec, of both stars


def test_axes_and_places() -> None:
    """The celestial pole of Mars is near Deneb, and as high as the latitude."""
    sight = MarsSight(40.0, 10.0, "2026-03-01T00:00Z")
    pole = sight.apparent(np.array([np.cos(np.radians(317.68)) * np.cos(np.radians(52.89)),
                                    np.sin(np.radians(317.68)) * np.cos(np.radians(52.89)),
                                    np.sin(np.radians(52.89))]))  # fmt: skip
    assert np.degrees(np.arcsin(pole[2])) == pytest.approx(40.0, abs=0.05)
    assert np.degrees(np.arctan2(pole[0], pole[1])) == pytest.approx(0.0, abs=0.05)
    ahead = sight.later(88775.244)  # a sol
    assert angle(ahead.sun.direction, sight.sun.direction) < 0.6  # what the season and the equation of time move
    with pytest.raises(DomainError, match="latitude"):
        MarsSight(91.0, 0.0, "2026-03-01T00:00Z")
    with pytest.raises(DomainError, match="longitude"):
        MarsSight(0.0, 361.0, "2026-03-01T00:00Z")


def test_a_scene_of_mars_has_its_sun_and_no_airglow() -> None:
    scene = skyscatter.sky_at(JEZERO, "2026-03-02T08:00Z", model="mars")
    assert scene.sun.site is not None
    assert scene.sun.site.body == "Mars"
    assert scene.sun.distance_au == pytest.approx(1.4, abs=0.15)
    assert scene.sun.elevation_deg < -18
    assert scene.lights is not None
    assert scene.lights.shine == ("sun", "moon", "planets", "stars", "starlight", "zodiacal")
    with pytest.raises(DomainError, match="airglow"):
        skyscatter.sky_at(JEZERO, "2026-03-02T08:00Z", model="mars", lights=["airglow"])
    with pytest.raises(DomainError, match="Titan"):
        skyscatter.sky_at(JEZERO, "2026-03-02T08:00Z", model="titan")


def test_a_night_on_mars_by_command(tmp_path, capsys) -> None:
    assert main(["sky", "titan", "--place", "1,2", "--time", "2026-03-02T08:00Z", "-o", "never.png"]) == 2
    assert "planet = Titan: a place and a time mean Earth or Mars" in capsys.readouterr().err.replace("'", "")
    words = ["sky", "mars", "--place", "18.44,77.45", "--time", "2026-03-02T08:00Z", "--view", "fisheye", "--size"]
    words += ["16x16", "--wavelengths", "450,550,650", "-o", str(tmp_path / "night.fits"), "--json", "-q"]
    assert main(words) == 0
    assert "zodiacal" in capsys.readouterr().out
    from astropy.io import fits

    header = fits.getheader(tmp_path / "night.fits")
    assert header["PLANET"] == "Mars"
    assert header["LON-OBS"] == 77.45
    assert "OBSGEO-L" not in header
    assert np.nanmax(skyscatter.SpectralImage.load(tmp_path / "night.fits").radiance) > 0
