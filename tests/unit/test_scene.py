"""Scenes and media: what they compute, and what they refuse in one line with field, value and remedy."""

from __future__ import annotations

import numpy as np
import pytest
from asking import asked
from bases import complaint
from pydantic import ValidationError

from skyscatter import Component, Ground, Medium, Scene, SpectralTable, Star, Sun, load_model, radiance
from skyscatter.media.fields import Exponential, Tent
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.scene import AU

AIR = Component(name="air", density=Exponential(scale_height=8e3), optics=RayleighPowerLaw(coefficient=1e-5))
OZONE = Component(name="ozone", density=Tent(base=1e4, peak=2e4, top=3e5), optics=RayleighPowerLaw(coefficient=0.0))
MEDIUM = Medium(planet_radius="6371 km", components=(AIR, OZONE))


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Ground(albedo=1.2), ["albedo = 1.2", "between 0 and 1"]),
        (lambda: Ground(albedo=-0.1), ["albedo = -0.1", "between 0 and 1"]),
        (lambda: Ground(albedo=SpectralTable(wavelengths=(400, 500), values=(0.5, 1.5))), ["albedo = 1.5"]),
        (lambda: Ground(albedo="cheese"), ["cheese", "snow"]),
        (lambda: Sun(elevation_deg=91), ["elevation_deg = 91", "-90 and 90"]),
        (lambda: Sun(distance_au=0), ["distance_au = 0", "positive"]),
        (lambda: Star(radius=-1), ["radius = -1", "never negative"]),
        (lambda: Star(radius=0.7), ["radius = 0.7", "metres", "Rsun"]),
        (lambda: Star(radius=2e11), ["distance", "exceed"]),
        (lambda: Star(temperature=0), ["temperature = 0", "positive"]),
        (lambda: Star(spectrum=-1.0), ["spectrum = -1.0", "never negative"]),
        (lambda: Star(spectrum="candle"), ["candle"]),
        (lambda: Scene(medium=MEDIUM, altitude=-1), ["altitude = -1", "never negative"]),
        (lambda: Scene(medium=MEDIUM, altitude="8 furlong"), ["altitude", "furlong", "km"]),
        (lambda: Scene(medium=MEDIUM, background=-1.0), ["background = -1.0", "never negative"]),
        (lambda: Scene(medium=MEDIUM, moon=3), ["moon = 3", "no such field"]),
        (lambda: Scene(), ["medium is missing"]),
        (lambda: Medium(planet_radius=0, components=(AIR,)), ["planet_radius = 0", "positive length"]),
        (lambda: Medium(planet_radius=1e6, components=()), ["components = 0", "at least one"]),
        (lambda: Medium(planet_radius=1e6, components=(AIR, AIR)), ["'air'", "rename one"]),
        (lambda: MEDIUM.component("gold"), ["component = 'gold'", "air, ozone"]),
        (
            lambda: Component(name="a", density=AIR.density, optics=AIR.optics, weight=-2),
            ["weight = -2", "never negative"],
        ),
        (lambda: SpectralTable(wavelengths=(500, 400), values=(1, 2)), ["increase"]),
        (lambda: SpectralTable(wavelengths=(500,), values=(1, 2)), ["same length"]),
        (lambda: Scene(medium=MEDIUM, altitude=True), ["altitude", "True"]),
    ],
)
def test_refuses(build, words) -> None:
    message = complaint(build)
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"origins": [0, 0, 1e6]}, ["origins", "inside the planet"]),
        ({"directions": [0, 0, 2.0]}, ["directions = 2.0", "unit vectors"]),
        ({"directions": [0, 0, np.nan]}, ["directions", "finite"]),
        ({"directions": [1.0, 0]}, ["directions", "(..., 3)"]),
        ({"wavelengths": []}, ["wavelengths", "positive"]),
        ({"wavelengths": [500, 400]}, ["wavelengths", "increase"]),
        ({"wavelengths": [[500, 400]]}, ["wavelengths"]),
        ({"solver": "magic"}, ["solver = 'magic'", "path", "single"]),
        ({"tolerance": 0.5}, ["tolerance = 0.5", "0.1"]),
        ({"orders": 2}, ["orders = 2", "means nothing to the solver single"]),
        ({"solver": "path", "seed": -1}, ["seed = -1"]),
        ({"threads": 0}, ["threads = 0", "at least 1"]),
    ],
)
def test_radiance_refuses(arguments, words) -> None:
    given = {
        "origins": [0, 0, 6371e3],
        "directions": [0, 0, 1.0],
        "wavelengths": [500.0],
        "solver": "single",
    } | arguments
    message = complaint(lambda: radiance(Scene(medium=MEDIUM), **asked(**given)))
    assert all(word in message for word in words), message


def test_records_are_frozen_and_shared_safely() -> None:
    scene = Scene(medium=MEDIUM)
    with pytest.raises(ValidationError):
        scene.altitude = 5.0
    assert hash(scene) == hash(Scene(medium=MEDIUM))


def test_medium_knows_its_top_and_its_components() -> None:
    assert MEDIUM.top == 3e5
    assert MEDIUM.planet_radius == 6371e3
    assert MEDIUM.component("air") is AIR
    rest = MEDIUM.without("ozone")
    assert [c.name for c in rest.components] == ["air"]
    assert rest.top == 128e3
    assert len(MEDIUM.components) == 2, "the medium itself is unchanged"


def test_sun_direction_follows_the_frame() -> None:
    """x east, y north, z up; azimuth from north through east."""
    for azimuth, elevation, direction in (
        (0, 0, (0, 1, 0)),
        (90, 0, (1, 0, 0)),
        (180, 0, (0, -1, 0)),
        (12, 90, (0, 0, 1)),
    ):
        np.testing.assert_allclose(Sun(azimuth_deg=azimuth, elevation_deg=elevation).direction, direction, atol=1e-15)


def test_irradiance_falls_with_the_square_of_the_distance() -> None:
    for star in (Star(), Star(spectrum="blackbody"), Star(spectrum=2.0)):
        near, far = star.irradiance([500.0], AU), star.irradiance([500.0], 2 * AU)
        assert far[0] == pytest.approx(near[0] / 4, rel=1e-12)  # rounding
    assert Star(spectrum=2.0).irradiance([500.0], AU)[0] == pytest.approx(2.0)


def test_observer_stands_on_the_z_axis() -> None:
    observer = Scene(medium=MEDIUM, altitude="400 km").observer
    np.testing.assert_allclose(observer.position, [0, 0, 6771e3])
    assert observer.atmosphere_top == 3e5


def test_a_night_with_the_sun_alone_is_told() -> None:
    """Midnight and an hour of twilight in the Alps; whoever names the lights is not warned."""
    model = load_model("earth-simple")
    with pytest.warns(UserWarning, match="the scene has the Sun alone"):
        assert model.scene_at(47.0, 11.0, "2026-08-12T23:00Z").lights is None
    assert model.scene_at(47.0, 11.0, "2026-08-12T23:00Z", lights=("sun",)).lights is not None
    with pytest.warns(UserWarning, match="that of stars and zodiacal light;") as told:
        load_model("mars").scene_at(0.0, 0.0, "2026-01-01T00:00Z")
    assert "airglow" not in str(told[0].message)
    assert -10 < model.scene_at(47.0, 11.0, "2026-08-12T19:05Z").sun.elevation_deg < 0
