"""Identities that hold in any sky: what is not absorbed passes through, and Sun and eye that change places."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plane_parallel import FLATNESS, THICKNESS

import skyscatter
from skyscatter import Component, Ground, Medium, Scene, Star, Sun
from skyscatter.media.fields import Exponential, Tent, Uniform
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic, Rayleigh

Array = Any
EARTH = 6371e3
#: Wavelength [nm]: all is grey.
GREY = [550.0]
#: Quick scenes, and the hundred.
COUNTS = [2, pytest.param(100, marks=pytest.mark.slow)]


def components(rng: np.random.Generator, white: bool) -> tuple[Component, ...]:
    """Air, and some layers that lie anywhere in the lowest ten kilometres, thin or thick, smooth or sharp."""
    found = [("air", Exponential(scale_height=8e3), Rayleigh())] if rng.random() < 0.8 else []
    for number in range(int(rng.integers(1, 4))):
        base, thickness = rng.uniform(0, 6e3), 10 ** rng.uniform(1, 3.5)
        density: Any = Uniform(base=base, top=base + thickness)
        if rng.random() < 0.5:
            density = Tent(base=base, peak=base + rng.uniform(0.2, 0.8) * thickness, top=base + thickness)
        phase = Isotropic() if rng.random() < 0.3 else HenyeyGreenstein(g=rng.uniform(-0.3, 0.85))
        found.append((f"layer-{number}", density, phase))
    return tuple(
        Component(
            name=name,
            density=density,
            optics=Particles(
                optical_depth=10 ** rng.uniform(-2, 0.3),
                single_scattering_albedo=1.0 if white else rng.uniform(0.5, 1.0),
                phase=phase,
            ),
        )
        for name, density, phase in found
    )


def sky(rng: np.random.Generator, radius: float, sun: tuple[float, float], white: bool, ground: float) -> Scene:
    return Scene(
        medium=Medium(planet_radius=radius, components=components(rng, white)),
        ground=Ground(albedo=ground),
        star=Star(spectrum=1.0, radius=0.0),
        sun=Sun(elevation_deg=sun[0], azimuth_deg=sun[1]),
    )


def toward(elevation_deg: float, azimuth_deg: float) -> Array:
    e, a = np.radians([elevation_deg, azimuth_deg])
    return np.array([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)])


@pytest.mark.parametrize("scenes", COUNTS)
def test_sun_and_eye_change_places(scenes: int) -> None:
    """Light that a flat world sends back, over the beam that falls on a level square metre of it (Helmholtz)."""
    deviation, stated = [], []
    for seed in range(scenes):
        ends = [(e, a) for e, a in np.random.default_rng([seed, 1]).uniform([5, -180], [85, 180], (2, 2))]
        reflected = []
        for sun, eye in (ends, ends[::-1]):
            there = sky(np.random.default_rng(seed), FLATNESS * THICKNESS, sun, False, 0.3)
            origin = [0.0, 0.0, FLATNESS * THICKNESS + 2e5]
            # From the eye the light goes on to where the Sun was: the Sun's azimuth stays, the sight is down.
            answer = skyscatter.radiance(there, origin, -toward(*eye), GREY)
            scale = np.sin(np.radians(sun[0]))
            reflected.append((answer.radiance[0] / scale, answer.standard_error[0] / scale))
        (forth, a), (back, b) = reflected
        deviation.append(forth / back - 1)
        stated.append((a + b) / back)
    print(np.round(deviation, 5), np.round(stated, 5))
    # As stated errors are meant: 95 % within, all within twice.
    off = np.abs(deviation) / np.array(stated)
    assert np.mean(off < 1) >= 0.95
    assert off.max() < 2
    assert np.median(np.abs(deviation)) < 2e-3  # the sharpness of the judge


@pytest.mark.parametrize("scenes", COUNTS)
def test_what_passes_through_a_white_flat_sky_is_the_same_at_every_height(scenes: int) -> None:
    heights = np.array([0.0, 300.0, 2e3, 7e3, 3e4])
    worst, shares = [], []
    for seed in range(scenes):
        rng = np.random.default_rng([seed, 2])
        sun, ground = rng.uniform(3, 85), float(rng.choice([0.0, 1.0, rng.uniform()]))
        there = sky(rng, FLATNESS * THICKNESS, (sun, 0.0), True, ground)
        field = skyscatter.solve(there, GREY, sun_elevations_deg=(sun, sun))
        flux = field.fluxes(np.minimum(heights, there.medium.top), sun_elevation_deg=sun)
        net, error = flux.net[:, 0], flux.net_error[:, 0]
        shares.append((np.abs(net - net[0]) / (error + error[0]))[1:])
        worst.append(np.abs(net - net[0]).max() / np.sin(np.radians(sun)))
    print(np.round(worst, 5))
    assert np.median(worst) < 2e-3
    assert_stated(np.array(shares))


def assert_stated(shares: Array) -> None:
    """Deviations over stated errors: 95 % of them below 1, as is promised, and none above 2."""
    print(np.round(np.sort(shares, axis=None)[-8:], 2))
    assert np.mean(shares < 1) >= 0.95
    assert shares.max() < 2


def suns_around(heights: Array) -> tuple[Array, Array]:
    """Sines of Suns all around a planet and their weights (height, sun): denser where the Sun sets at each height."""
    x, w = np.polynomial.legendre.leggauss(12)
    t, dt = (1 + x) / 2, w * (1 + x) / 2
    sets = -np.sqrt(1 - 1 / (1 + heights[:, None] / EARTH) ** 2)
    mu = np.concatenate([sets - (1 + sets) * t**2, sets + (1 - sets) * t**2], axis=1)
    return mu, np.concatenate([(1 + sets) * dt, (1 - sets) * dt], axis=1)


@pytest.mark.parametrize("scenes", [1, 24])
@pytest.mark.slow
def test_what_passes_through_a_white_round_sky_is_the_same_through_every_sphere(scenes: int) -> None:
    """Over the whole planet, night and day; of a beam of 1 half falls on a planet's cross-section."""
    shares = []
    for seed in range(scenes):
        rng = np.random.default_rng([seed, 3])
        ground = float(rng.choice([0.0, 1.0, rng.uniform()]))
        there = sky(rng, EARTH, (0.0, 0.0), True, ground)
        heights = np.minimum([0.0, 2e3, 2e4, 1e5], there.medium.top)
        mu, weight = suns_around(heights)
        field = skyscatter.solve(there, GREY, tolerance=0.01)
        flux = field.fluxes(heights[:, None], sun_elevation_deg=np.degrees(np.arcsin(mu)))
        size = (1 + heights / EARTH) ** 2
        power, error = (size * (values[..., 0] * weight).sum(axis=1) for values in (flux.net, flux.net_error))
        print(seed, np.round(power, 5), np.round(error, 5))
        shares.append((np.abs(power - power[0]) / (error + error[0]))[1:])
        assert np.all(error < 0.02)
    assert np.max(shares) < 1
