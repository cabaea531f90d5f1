"""Eclipses of the Moon: published times, rays traced step by step, the balance of light, and measured brightness."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from skyscatter.celestial import earthshadow
from skyscatter.celestial.earthshadow import EARTH_RADIUS, Grazing, grazing, refraction, shadow_share
from skyscatter.celestial.frames import Sight
from skyscatter.celestial.lunareclipse import (
    left_of_moonlight,
    lunar_contacts,
    lunar_eclipse,
    near_shadow,
    sunlight_on_moon,
)
from skyscatter.celestial.lunarplace import MOON_RADIUS
from skyscatter.celestial.moon import moon_at, moon_irradiance, moon_radiance
from skyscatter.celestial.rolo import sunlit_irradiance
from skyscatter.errors import DomainError
from skyscatter.spectra.vega import BAND_NODES, magnitude

WL = np.array([450.0, 550.0, 650.0])
PLACE = (40.0, -100.0)


def at(time: str) -> Sight:
    return Sight(*PLACE, time)


#: NASA's catalogue and figures (Espenak & Meeus): day, U1 to U4 (UTC), umbral magnitude.
PUBLISHED = [
    ("2025-03-14", ("05:09:40", "06:26:06", "07:31:26", "08:47:52"), 1.178),
    ("2007-03-03", None, 1.233),
    ("1990-02-09", None, 1.075),
]


@pytest.mark.parametrize(("day", "times", "magnitude_there"), PUBLISHED)
def test_published_times_and_magnitudes(day, times, magnitude_there) -> None:
    found = lunar_contacts(at(f"{day}T12:00Z" if day[:4] != "2025" else f"{day}T07:00Z"))
    assert found is not None
    # printed to 0.001; their Moon is larger by 0.4 per mille and their ephemerides another one
    assert found.eclipse.umbral_magnitude == pytest.approx(magnitude_there, abs=0.002)
    assert found.eclipse.kind == "total"
    for moment, time in zip((found.u1, found.u2, found.u3, found.u4), times or (), strict=times is not None):
        assert moment is not None
        expected = datetime.fromisoformat(f"{day}T{time}").replace(tzinfo=UTC)
        # a second of arc in the radii of shadow and Moon is two to four seconds of time
        assert abs((moment - expected).total_seconds()) < 8.0
    assert found.p1 < found.maximum < found.p4


def test_kinds_of_eclipses() -> None:
    assert lunar_contacts(at("2025-06-11T07:00Z")) is None  # a full Moon beside the shadow
    # NASA: 2024 March 25, penumbral, of magnitude 0.956 in the penumbra; 2024 September 18, partial, 0.085
    faint = lunar_contacts(at("2024-03-25T07:00Z"))
    assert faint is not None
    assert faint.u1 is None
    assert faint.eclipse.kind == "penumbral"
    assert faint.eclipse.penumbral_magnitude == pytest.approx(0.956, abs=0.003)
    slight = lunar_contacts(at("2024-09-18T02:00Z"))
    assert slight is not None
    assert slight.u2 is None
    assert slight.eclipse.kind == "partial"
    assert slight.eclipse.umbral_magnitude == pytest.approx(0.085, abs=0.003)
    assert lunar_eclipse(at("2025-03-01T07:00Z")).kind == "none"


@pytest.mark.parametrize("height", [0.0, 8e3, 25e3])
def test_bending_against_a_ray_traced_step_by_step(height) -> None:
    """d(n t)/ds = grad n from the lowest point outwards, by an integrator that knows no formula of optics."""
    h = np.linspace(0.0, earthshadow.TOP, 3001)
    index = earthshadow._index(h)

    def refractivity(r: float) -> tuple[float, float]:
        n = float(np.interp(r - EARTH_RADIUS, h, index))
        low, high = np.interp([r - EARTH_RADIUS - 30.0, r - EARTH_RADIUS + 30.0], h, index)
        width = min(r - EARTH_RADIUS + 30.0, h[-1]) - max(r - EARTH_RADIUS - 30.0, 0.0)
        return 1.0 + n, float(high - low) / width

    def step(_s: float, state: np.ndarray) -> list[float]:
        x, y, u, v = state
        r = math.hypot(x, y)
        n, slope = refractivity(r)
        return [u / n, v / n, slope * x / r, slope * y / r]

    n0, _ = refractivity(EARTH_RADIUS + height)
    end = solve_ivp(step, (0.0, 1.3e6), [EARTH_RADIUS + height, 0.0, 0.0, n0], rtol=1e-9, atol=1e-12, max_step=3e3)
    half = math.atan2(-end.y[2, -1], end.y[3, -1])
    # differences over 60 m for the slope, and the tables between nodes
    assert float(refraction([height])[0]) == pytest.approx(2.0 * half, rel=5e-3)


def test_no_light_is_lost_or_won_by_bending(monkeypatch) -> None:
    """Through air that dims nothing as much light is missing behind the Earth as meets its ground."""
    rays = grazing([550.0])
    clear = Grazing(rays.impact, rays.bending, np.ones_like(rays.through))
    monkeypatch.setattr(earthshadow, "grazing", lambda _wl: clear)
    distance = 3.84e8
    angle = np.linspace(0.0, math.radians(1.6), 4001)
    share = shadow_share(angle, 0.00465, distance, [550.0])[:, 0]
    missing = 2.0 * math.pi * distance**2 * np.trapezoid((1.0 - share) * angle, angle)
    # 16 azimuths over arcs that end with roots, and steps of height
    assert missing == pytest.approx(math.pi * rays.impact[0] ** 2, rel=2e-3)
    # focused in the middle: a ring of air with all of the Sun's light would be brighter than the Sun itself
    assert share[0] > 0.01


def test_published_refraction() -> None:
    # Twice the mean refraction at the horizon, 34.5' at 10 degrees (Bennett 1982) times the density at 15 degrees
    assert math.degrees(float(refraction([0.0])[0])) * 60.0 == pytest.approx(2 * 34.5 * 283 / 288, rel=0.04)


#: Least brightness of the eclipsed Moon, reduced to standard distances (Hernitschek, Schmidt & Vollmer 2008, Appl. Opt.
#: 47, H62); the full Moon's is -12.73.
MEASURED = {"1990-02-09T19:11Z": -3.32, "2007-03-03T23:21Z": -1.7}


def test_measured_brightness() -> None:
    off = []
    for time, measured in MEASURED.items():
        moon = moon_at(at(time))
        some = np.arange(340.0, 760.0, 20.0)  # the shares are smooth; all of the bands' wavelengths take a minute
        left = np.exp(np.interp(BAND_NODES, some, np.log(left_of_moonlight(moon, some))))
        light = left * sunlit_irradiance(moon, BAND_NODES)
        full = sunlit_irradiance(moon, BAND_NODES)
        dimmed = magnitude(light, "V") - magnitude(full, "V")
        off.append(dimmed - (measured + 12.73))
        # redder by most of a magnitude in B - V, and by two from 450 to 650 nm
        assert magnitude(light, "B") - magnitude(light, "V") > 0.6 + magnitude(full, "B") - magnitude(full, "V")
        blue, red = left_of_moonlight(moon, [450.0, 650.0])
        assert red / blue > 5.0
        assert 8.5 < dimmed < 12.5
    # the two differ by 1.6 mag, most of it clouds and dust along the Earth's edge, of which nothing is known here
    assert np.abs(off).max() < 1.0
    assert abs(np.mean(off)) < 0.5


def test_the_face_in_an_eclipse() -> None:
    moon = moon_at(at("2025-03-14T06:58:45Z"))
    side = np.cross(moon.direction, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    up = np.cross(side, moon.direction)
    step = (np.arange(60) + 0.5) / 30 - 1.0
    a, b = (v.ravel() for v in np.meshgrid(step, step))
    offsets = math.sin(moon.angular_radius) * (a[:, None] * side + b[:, None] * up)
    rays = moon.direction + offsets
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    face = moon_radiance(moon, rays, WL)
    lit = face[:, 1] > 0.0
    area = (math.sin(moon.angular_radius) / 30) ** 2
    # squares along the limb, a per cent of the light; and 432 points in its stead
    assert face.sum(axis=0) * area == pytest.approx(moon_irradiance(moon, WL), rel=0.03)
    # the edge of the shadow is ten times as bright as what lies deep in it, and less red
    red = face[lit]
    assert red[:, 1].max() > 5.0 * red[:, 1].min()
    deep, rim = red[red[:, 1].argmin()], red[red[:, 1].argmax()]
    assert deep[2] / deep[0] > rim[2] / rim[0]


def test_away_from_the_shadow_nothing_changes() -> None:
    moon = moon_at(at("2025-03-13T00:00Z"))
    assert not near_shadow(moon)
    assert np.array_equal(moon_irradiance(moon, WL), sunlit_irradiance(moon, WL))
    # in the penumbra: between
    partly = moon_at(at("2025-03-14T04:40Z"))
    assert near_shadow(partly)
    left = left_of_moonlight(partly, WL)
    assert (left > 0.3).all()
    assert (left < 0.98).all()
    # the point that the Sun lights first is free of the shadow when its other side is not
    towards = partly.shadow_earth - (partly.shadow_earth @ partly.sun_direction) * partly.sun_direction
    towards /= np.linalg.norm(towards)
    near, far = sunlight_on_moon(partly, MOON_RADIUS * np.array([towards, -towards]), [550.0])
    assert near != far


def test_wavelengths_out_of_range() -> None:
    with pytest.raises(DomainError, match="rayleigh-air"):
        shadow_share([0.0], 0.00465, 3.84e8, [5000.0])
