"""Electrons from line images and dust from extinction maps: round trips through skyscatter's own pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter import fields, inversion
from skyscatter.errors import DomainError, UnitsError
from skyscatter.inversion.matter import HELIUM, HYDROGEN_MASS
from skyscatter.optics.dust import MIXTURES
from skyscatter.units import PARSEC

SIZE = 36


def pictured(component: skyscatter.Component, distance: str, width: float, wavelengths: Any, **scene: Any) -> Any:
    """A small picture [W m-2 sr-1 nm-1] of one component, and its pixels' angle [arcsec]."""
    made = skyscatter.SpaceScene(
        medium=skyscatter.Medium(components=(component,)), view=skyscatter.View(distance=distance), **scene
    )
    camera = skyscatter.Telescope.from_length(SIZE, SIZE, width, made.view.distance)
    image = skyscatter.render(made, camera, wavelengths, solver="single")
    return np.asarray(image.radiance, float), camera.pixel_scale_deg * 3600


@pytest.fixture(scope="module")
def line() -> tuple[np.ndarray, float, Any]:
    shell = fields.GaussianShell(radius="0.3 pc", width="0.06 pc")
    optics = skyscatter.GasLines(electron_density=3e8)
    gas = skyscatter.Component(name="gas", density=shell, optics=optics)
    radiance, angle = pictured(gas, "1 kpc", 1.4 * PARSEC, [655.461, 656.461, 657.461])
    return radiance.sum(axis=2) * 1.0, angle, shell  # cells of 1 nm


def test_electron_density_of_a_shell(line: tuple[np.ndarray, float, Any]) -> None:
    image, angle, shell = line
    noise = 0.02 * image.max()
    data = image + noise * np.random.default_rng(1).standard_normal(image.shape)
    found = inversion.gas_from_line_image(data, angle, "1 kpc", noise, averaged=False)
    truth = 3e8 * np.sqrt(shell.profile(found.radius))
    bright = truth > 1.5e8
    # 36 pixels tell a shell of width 1.5 pixels; 2 % noise.
    assert np.abs(found.electron_density[bright] / truth[bright] - 1).max() < 0.1
    assert found.electron_density.max() == pytest.approx(3e8, rel=0.05)
    r = np.linspace(0, 0.7 * PARSEC, 5000)
    mass = HYDROGEN_MASS * HELIUM * np.trapezoid(4 * np.pi * r**2 * 3e8 * np.sqrt(shell.profile(r)), r)
    assert abs(found.mass - mass) < 3 * found.mass_error < 0.3 * mass
    power = skyscatter.GasLines(electron_density=3e8).line_emissivity("halpha")
    light = 4 * np.pi * power * np.trapezoid(4 * np.pi * r**2 * shell.profile(r), r)
    assert abs(found.luminosity - light) < 3 * found.luminosity_error < 0.1 * light
    assert np.hypot(*(np.array(found.inversion.centre) - 17.5)) < 0.1


def test_line_images_in_other_units(line: tuple[np.ndarray, float, Any]) -> None:
    from astropy import units as u

    image, angle, _ = line
    quantity = (image * u.Unit("W m-2 sr-1")).to("erg s-1 cm-2 arcsec-2")
    options: dict[str, Any] = {"averaged": False, "centre": (17.5, 17.5)}
    plain = inversion.gas_from_line_image(image, angle, "1 kpc", 0.01 * image.max(), **options)
    with_units = inversion.gas_from_line_image(
        quantity, (angle * u.arcsec).to(u.deg), 1 * u.kpc, 0.01 * quantity.max(), **options
    )
    np.testing.assert_allclose(with_units.electron_density, plain.electron_density, rtol=1e-3, atol=3e5)
    # Extinction of 2.5 mag in front: ten times the emissivity, sqrt(10) times the density; half filled: clumps of
    # sqrt(2) times the density in half the volume.
    seen = inversion.gas_from_line_image(
        0.1 * image, angle, "1 kpc", 1e-3 * image.max(), extinction=2.5, filling_factor=0.5, **options
    )
    np.testing.assert_allclose(seen.electron_density, np.sqrt(2) * plain.electron_density, rtol=2e-3, atol=1e6)
    assert seen.mass == pytest.approx(plain.mass / np.sqrt(2), rel=5e-3)
    with pytest.raises(UnitsError, match=r"^image = "):
        inversion.gas_from_line_image(image * u.m, angle, "1 kpc")


def test_distance_goes_into_errors(line: tuple[np.ndarray, float, Any]) -> None:
    image, angle, _ = line
    options: dict[str, Any] = {"averaged": False, "centre": (17.5, 17.5)}
    near = inversion.gas_from_line_image(image, angle, "1 kpc", 0.01 * image.max(), **options)
    far = inversion.gas_from_line_image(image, angle, "2 kpc", 0.01 * image.max(), distance_error="0.2 kpc", **options)
    assert far.mass == pytest.approx(2**2.5 * near.mass, rel=0.01)
    assert far.mass_error == pytest.approx(0.25 * far.mass, rel=0.1)


def test_dust_of_a_globule() -> None:
    ball = fields.BonnorEbert(radius="0.1 pc")
    dust = skyscatter.Dust(visual_extinction=4.0, mixture="milky-way-5.5")
    globule = skyscatter.Component(name="dust", density=ball, optics=dust)
    radiance, angle = pictured(globule, "150 pc", 0.3 * PARSEC, [550.0, 700.0], background=1e-6)
    sigma = 0.01e-6
    red = radiance[..., 1] + sigma * np.random.default_rng(3).standard_normal((SIZE, SIZE))
    visual, error = inversion.extinction_map(red, 1e-6, sigma, wavelength_nm=700.0, mixture="milky-way-5.5")
    exact, none = inversion.extinction_map(radiance[..., 0], 1e-6)
    column = ball.column([0, 0, -PARSEC], [0, 0, PARSEC])
    # Half a pixel off the middle, the column is 0.2 % less; A_V is that through the middle.
    assert none is None
    assert exact.max() == pytest.approx(4.0, rel=0.02)
    found = inversion.dust_from_extinction(visual, angle, "150 pc", error, mixture="milky-way-5.5", averaged=False)
    per_volume = dust.hydrogen_per_volume(float(column))
    r = np.linspace(0, 0.1 * PARSEC, 4000)
    hydrogen = np.trapezoid(4 * np.pi * r**2 * per_volume * ball.profile(r), r)
    mass = hydrogen * MIXTURES["milky-way-5.5"].per_hydrogen
    assert abs(found.dust_mass - mass) < 3 * found.dust_mass_error < 0.1 * mass
    assert abs(found.map_dust_mass - mass) < 3 * found.map_dust_mass_error < 0.2 * mass
    assert found.gas_mass == pytest.approx(105.1 * found.dust_mass)
    truth = per_volume * ball.profile(found.radius)
    assert np.sqrt(((found.hydrogen_density - truth) ** 2).mean()) < 0.05 * per_volume
    assert found.hydrogen_column.max() == pytest.approx(per_volume * float(column), rel=0.1)


def test_what_is_too_dark_has_no_extinction() -> None:
    visual, error = inversion.extinction_map(np.array([[1.0, 0.1], [0.0, -0.1]]), 1.0)
    assert visual[0] == pytest.approx([0.0, 2.5], abs=1e-12)
    assert np.isnan(visual[1]).all()
    assert error is None


def test_extinction_is_not_biased_by_noise() -> None:
    noise = 0.02 * np.random.default_rng(5).standard_normal((60, 60))
    visual, error = inversion.extinction_map(0.1 + noise, 1.0, 0.02)
    plain, _ = inversion.extinction_map(0.1 + noise, 1.0)
    assert error is not None
    # The mean of 3600 pixels has an error of 0.2 * 1.0857 / 60 = 0.0036; the next term of the logarithm's series is
    # 3 / 4 0.2^4 = 0.0012.
    assert abs(visual.mean() - 2.5) < 0.013 < plain.mean() - 2.5
    assert error == pytest.approx(1.0857 * 0.2, rel=0.3)  # means of 25 pixels


def test_foreground_is_taken_off() -> None:
    visual, _ = inversion.extinction_map(np.array([[0.28]]), 1.0, foreground=0.2)
    assert visual[0, 0] == pytest.approx(2.5)


def test_electrons_from_emissivity() -> None:
    optics = skyscatter.GasLines(electron_density=1e9, temperature=8000)
    for name in ("halpha", "hbeta"):
        got = inversion.electrons_from_emissivity(optics.line_emissivity(name), name, temperature=8000)
        assert got == pytest.approx(1e9, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"distance": -1.0}, "distance"),
        ({"pixel_angle": 0.0}, "pixel_angle"),
        ({"extinction": -1.0}, "extinction"),
        ({"filling_factor": 0.0}, "filling_factor"),
        ({"line": "lyman"}, "line"),
        ({"temperature": 100.0}, "temperature"),
        ({"distance_error": -1.0}, "distance_error"),
    ],
)
def test_bad_input(change: dict[str, Any], named: str) -> None:
    arguments = {"image": np.ones((12, 12)) + np.eye(12), "pixel_angle": 1.0, "distance": "1 kpc", **change}
    with pytest.raises(DomainError, match=f"^{named} = "):
        inversion.gas_from_line_image(**arguments)


def test_bad_background() -> None:
    with pytest.raises(DomainError, match=r"^background = "):
        inversion.extinction_map(np.ones((9, 9)), 0.0)
    with pytest.raises(DomainError, match=r"^emissivity = "):
        inversion.electrons_from_emissivity(-1.0)


def test_pixels_that_are_too_dark_are_counted() -> None:
    y, x = np.mgrid[:32, :32]
    visual = np.maximum(6 - 0.5 * np.hypot(x - 15.5, y - 15.5), 0.0)
    visual[14:17, 15] = np.nan
    found = inversion.dust_from_extinction(visual, 10.0, "150 pc", 0.05, centre=(15.5, 15.5))
    assert found.opaque_pixels == 3
    hidden = np.isnan(visual)
    assert inversion.dust_from_extinction(visual, 10.0, "150 pc", 0.05, hidden, centre=(15.5, 15.5)).opaque_pixels == 0


@pytest.mark.parametrize(
    ("name", "more"),
    [("distance", {"distance": 800}), ("edge", {"edge": "1 pc"}), ("centre", {"image": np.zeros((32, 32))})],
)
def test_slips_of_units_are_noticed(name: str, more: dict[str, Any]) -> None:
    y, x = np.mgrid[:32, :32]
    given: dict[str, Any] = {"image": np.maximum(100 - (x - 15.5) ** 2 - (y - 15.5) ** 2, 0), "distance": "150 pc"}
    image, distance = (given | {k: v for k, v in more.items() if k != "edge"}).values()
    with pytest.raises(DomainError, match=f"^{name} = "):
        inversion.gas_from_line_image(1e-9 * image, 10.0, distance, edge=more.get("edge"))
