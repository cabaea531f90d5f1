"""The colours of the shipped models: facts that anyone can see in the sky (or that a lander saw), on a few rays.

Chromaticities are CIE 1931 x, y; daylight white (D65) is 0.313, 0.329, smaller x and y are bluer.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from asking import asked

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image.colour import cct, spectrum_to_xyz
from skyscatter.spectra.solar import solar_irradiance

# The chromaticity of a smooth spectrum changes by less than 0.003 from a step of 20 nm to one of 5 nm.
WAVELENGTHS = np.arange(380.0, 781.0, 20.0)


def look(scene: skyscatter.Scene, *views: tuple[float, float], solver: str = "path", **options: Any) -> np.ndarray:
    """XYZ [cd m-2] of the sky towards (azimuth, elevation) [degree], shape (view, 3)."""
    directions = np.array([direction_from_azimuth_elevation(*view) for view in views])
    origins = np.repeat(scene.observer.position[None, :], len(views), axis=0)
    answer = skyscatter.radiance(scene, origins, directions, WAVELENGTHS, **asked(solver, **options))
    return spectrum_to_xyz(answer.radiance, WAVELENGTHS)


def chromaticity(xyz: np.ndarray) -> np.ndarray:
    return xyz[..., :2] / xyz.sum(axis=-1, keepdims=True)


def direct_sun(name: str, elevation: float) -> np.ndarray:
    """XYZ of the light of the Sun's disk that is left at the ground, on a scale of its own."""
    scene = skyscatter.load_model(name).scene(sun_elevation_deg=elevation)
    start = scene.observer.position
    # 3000 km end above the atmosphere of every planet here.
    left = skyscatter.transmittance(scene, start, start + 3e6 * scene.sun.direction, WAVELENGTHS)
    return spectrum_to_xyz(left * solar_irradiance(WAVELENGTHS), WAVELENGTHS)


def without_ozone(scene: skyscatter.Scene) -> skyscatter.Scene:
    return scene.model_copy(update={"medium": scene.medium.without("ozone")})


@pytest.mark.parametrize("name", ["earth", "earth-simple", "earth-maritime"])
def test_the_noon_zenith_is_blue_and_darker_than_the_horizon(name: str) -> None:
    scene = skyscatter.load_model(name).scene(sun_elevation_deg=60)
    zenith, horizon = look(scene, (0, 90), (0, 2), samples=256)
    # Clear zeniths far from the Sun have 10 000 K and more; 30 degrees from it, with aerosol, they may come close to
    # 8000 K (a noise of 1 % in the radiance is about 300 K).
    assert cct(zenith) > 8000
    assert chromaticity(zenith)[0] < 0.295
    assert horizon[1] > 1.2 * zenith[1]  # noise 2 to 4 %, the ratio is 1.5 to 2.7
    assert chromaticity(horizon)[1] > chromaticity(look(scene, (0, 30), samples=256)[0])[1] + 0.015


def test_the_brightness_of_the_noon_zenith_is_right() -> None:
    zenith = look(skyscatter.load_model("earth").scene(sun_elevation_deg=60), (0, 90), samples=256)[0]
    # Measured clear zeniths with the Sun at 60 degrees spread from 2500 to 6000 cd m-2 with the aerosol.
    assert 2500 < zenith[1] < 6000


def test_the_low_sun_is_orange_and_the_high_sun_white() -> None:
    temperatures = [float(cct(direct_sun("earth", elevation))) for elevation in (60, 10, 5, 2)]
    assert temperatures == sorted(temperatures, reverse=True)
    assert 5000 < temperatures[0] < 5900  # direct sunlight in the middle of the day is 5300 to 5700 K
    assert temperatures[-1] < 2500  # orange; deterministic, no noise
    low = chromaticity(direct_sun("earth", 2.0))
    assert low[0] > 0.48
    assert low[1] > 0.40  # orange, not purple


def test_the_sky_around_the_low_sun_is_warm_and_the_zenith_blue() -> None:
    zenith, glow = chromaticity(
        look(skyscatter.load_model("earth").scene(sun_elevation_deg=1), (180, 90), (180, 3), samples=512)
    )
    # By 1.9 % noise in the radiance x is uncertain by about 0.003.
    assert glow[0] > 0.38
    assert zenith[0] < 0.28


@pytest.mark.parametrize(("elevation", "options"), [(-6.0, {"solver": "single"}), (-4.0, {"samples": 2048})])
def test_ozone_makes_the_twilight_zenith_blue(elevation: float, options: dict[str, Any]) -> None:
    scene = skyscatter.load_model("earth").scene(sun_elevation_deg=elevation)
    zenith = (180.0, 90.0)
    blue = chromaticity(look(scene, zenith, **options)[0])
    white = chromaticity(look(without_ozone(scene), zenith, **options)[0])
    # 0.24 against 0.31 (all orders, -4 degrees) and 0.24 against 0.32 (one order, -6); noise of x: 0.003.
    assert blue[0] < 0.26
    assert white[0] > 0.29
    assert white[1] - blue[1] > 0.05


def test_twilight_falls_by_the_measured_brightness() -> None:
    model = skyscatter.load_model("earth")
    luminance = [look(model.scene(sun_elevation_deg=s), (180.0, 90.0), samples=2048)[0, 1] for s in (-4.0, -6.0)]
    # Clear zeniths: some 4 cd m-2 at -4 degrees, 0.4 at -6; published courses differ by a factor of 2, noise is 4 %.
    assert 2.0 < luminance[0] < 8.0
    assert 0.2 < luminance[1] < 0.9


def test_the_belt_of_venus_stands_above_the_shadow_of_the_earth() -> None:
    scene = skyscatter.load_model("earth").scene(sun_elevation_deg=-2)
    shadow, belt, above = look(scene, (0, 2), (0, 8), (0, 30), samples=1024)
    # All Y with 2 to 4 % noise: 41, 81 and 88 cd m-2.
    assert belt[1] > 1.5 * shadow[1]
    x = chromaticity(np.array([shadow, belt, above]))[:, 0]
    assert x[1] > x[0] + 0.02  # pinkish between two blues: 0.264, 0.315, 0.273
    assert x[1] > x[2] + 0.02


def test_haze_pales_the_sky_and_brightens_it_around_the_sun() -> None:
    views = ((180.0, 43.0), (180.0, 80.0))
    clear, hazy = (
        look(skyscatter.load_model(name).scene(sun_elevation_deg=40), *views, samples=256)
        for name in ("earth", "earth-hazy")
    )
    assert hazy[0, 1] > 3 * clear[0, 1]  # 60 000 against 9900 cd m-2
    assert np.all(chromaticity(hazy)[:, 0] > chromaticity(clear)[:, 0] + 0.015)


def test_the_setting_sun_on_mars_is_blue_in_a_butterscotch_sky() -> None:
    scene = skyscatter.load_model("mars").scene(sun_elevation_deg=4)
    near, wide = look(scene, (180, 6), (180, 34), samples=4096)
    # x 0.283 and 0.367, noise 0.003; D65 lies between.
    assert chromaticity(near)[0] < 0.30
    assert chromaticity(wide)[0] > 0.345
    assert near[1] > 10 * wide[1]
    assert chromaticity(direct_sun("mars", 2.0))[0] < chromaticity(direct_sun("mars", 60.0))[0]


def test_the_sky_of_mars_at_noon_is_butterscotch() -> None:
    far = look(skyscatter.load_model("mars").scene(sun_elevation_deg=50), (90, 20), (0, 30), samples=1024)
    assert np.all(chromaticity(far)[:, 0] > 0.37)  # 0.392 and 0.403
    assert np.all(chromaticity(far)[:, 1] > 0.36)  # yellowish brown, not pink


@pytest.mark.slow
def test_the_sky_of_titan_is_orange_and_hides_the_sun() -> None:
    scene = skyscatter.load_model("titan").scene(sun_elevation_deg=40)
    # The mean over many directions: a single one is still noisy after thousands of walks.
    views = [(azimuth, 45.0) for azimuth in np.linspace(60, 300, 16)]
    x, y = chromaticity(look(scene, *views, samples=1024).mean(axis=0))
    # About 0.51, 0.43 with a noise of 0.02.
    assert x > 0.44
    assert 0.36 < y < 0.48
    start = scene.observer.position
    left = skyscatter.transmittance(scene, start, start + 3e6 * scene.sun.direction, [550.0])[0]
    assert left < np.exp(-9.0)  # a vertical optical depth of 9.2, on a slant path
