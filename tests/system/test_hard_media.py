"""Media in which a walk that is right on average can still go wrong: thick, layered, half empty."""

from __future__ import annotations

import numpy as np
import pytest
from asking import asked
from significance import assert_agrees

import skyscatter
from skyscatter.media.fields import Exponential, Uniform
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic
from skyscatter.spectra.table import SpectralTable

AIR = Exponential(scale_height="8 km")


def scene(density, optical_depth, phase, albedo=0.0):
    haze = skyscatter.Component(
        name="haze", density=density, optics=Particles(optical_depth=optical_depth, phase=phase)
    )
    return skyscatter.Scene(
        medium=skyscatter.Medium(components=(haze,), planet_radius="6371 km"),
        star=skyscatter.Star(spectrum=1.0, radius=0.0),
        sun=skyscatter.Sun(elevation_deg=40.0),
        ground=skyscatter.Ground(albedo=albedo),
    )


def directions(n):
    rng = np.random.default_rng(3)
    z, azimuth = rng.random(n), rng.random(n) * 2 * np.pi
    side = np.sqrt(1 - z * z)
    return np.stack([side * np.cos(azimuth), side * np.sin(azimuth), z], axis=1)


def mean(scene, samples, **options):
    """Mean radiance over eight directions and its standard error."""
    up = scene.observer.position
    answer = skyscatter.radiance(scene, up, directions(8), [550.0], **asked("path", samples=samples, **options))
    return answer.radiance.mean(axis=0), np.sqrt(np.mean(answer.standard_error**2, axis=0) / 8)


@pytest.mark.filterwarnings("ignore:sampling = 'free-flight'")  # enough walks for the light to be found: 16 384
@pytest.mark.parametrize(
    ("density", "optical_depth", "phase", "albedo", "walks"),
    [
        (AIR, 3.0, Isotropic(), 0.0, 1024),
        pytest.param(AIR, 10.0, Isotropic(), 0.0, 4096, marks=pytest.mark.slow),
        pytest.param(AIR, 10.0, HenyeyGreenstein(g=0.7), 0.0, 4096, marks=pytest.mark.slow),
        (Uniform(base=5300.0, top=6000.0), 0.5, Isotropic(), 0.0, 4096),
        (Uniform(base=5400.0, top=6000.0), 0.5, Isotropic(), 0.8, 4096),
    ],
)
def test_march_agrees_with_free_flight(density, optical_depth, phase, albedo, walks):
    it = scene(density, optical_depth, phase, albedo)
    march, march_error = mean(it, walks, seed=1)
    flight, flight_error = mean(it, 4 * walks, seed=2, sampling="free-flight")
    assert_agrees(march, flight, np.hypot(march_error, flight_error))
    # a comparison that only wide error bars make agree shows nothing
    assert np.all(np.hypot(march_error, flight_error) < 0.05 * flight)


def test_a_wavelength_without_extinction_does_no_harm():
    optics = Particles(
        optical_depth=SpectralTable(wavelengths=(450.0, 550.0, 650.0), values=(0.5, 0.0, 0.5)), phase=Isotropic()
    )
    dense = scene(Exponential(scale_height="8 km"), 0.5, Isotropic())
    holed = dense.model_copy(
        update={
            "medium": skyscatter.Medium(
                components=(
                    skyscatter.Component(name="haze", density=Exponential(scale_height="8 km"), optics=optics),
                ),
                planet_radius="6371 km",
            )
        }
    )
    up = dense.observer.position
    expected = skyscatter.radiance(dense, up, [0, 0, 1], [450.0], solver=skyscatter.Path(samples=4096))
    found = skyscatter.radiance(holed, up, [0, 0, 1], [450.0, 550.0, 650.0], solver=skyscatter.Path(samples=4096))
    assert found.radiance[1] == 0
    error = np.hypot(expected.standard_error[0], found.standard_error[[0, 2]])
    assert_agrees(found.radiance[[0, 2]], np.full(2, expected.radiance[0]), error)


def test_the_ground_at_the_observers_feet_sees_the_sky():
    it = skyscatter.load_model("earth").scene(sun_elevation_deg=5.0)
    rng = np.random.default_rng(1)
    down = directions(64) * [1, 1, -1]
    down[:, :2] *= rng.choice([-1, 1], (64, 2))
    answer = skyscatter.radiance(
        it, it.observer.position, down, [450.0], solver=skyscatter.Path(samples=256), parts=True
    )
    # a Lambertian ground looks the same from everywhere
    light = answer.layers["multiple"][:, 0]
    assert np.all(light > 0)
    assert_agrees(light, np.full(64, light.mean()), answer.standard_error[:, 0])
