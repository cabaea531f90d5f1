"""Spherical and axisymmetric objects and shells, from images with noise, stars and an unknown centre."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from skyscatter import fields, inversion
from skyscatter.errors import DomainError
from skyscatter.inversion.pixels import checked_image, symmetric_centre
from skyscatter.space import View

Array = np.ndarray


def seen(field: Any, shape: tuple[int, int], centre: tuple[float, float], view: View | None = None) -> Array:
    """Columns of a field, in lengths of a pixel, averaged over 4x4 points of every pixel: skyscatter's own."""
    view = View() if view is None else view
    offsets = (np.arange(4) + 0.5) / 4 - 0.5
    x = (np.arange(shape[1])[:, None] + offsets).ravel() - centre[0]
    up = centre[1] - (np.arange(shape[0])[:, None] + offsets).ravel()
    points = x[None, :, None] * view.right + up[:, None, None] * view.up
    column = field.column(points - 200 * view.forward, points + 200 * view.forward)
    return column.reshape(shape[0], 4, shape[1], 4).mean(axis=(1, 3))


def profile(field: Any, radius: Array) -> Array:
    """Density of a round field along its x axis."""
    return field.density(np.stack([radius, 0 * radius, 0 * radius], axis=-1))


def noisy(image: Array, share: float, seed: int, background: float = 0.0) -> Array:
    """Image with noise of a share of its maximum, and a background."""
    return image + share * image.max() * np.random.default_rng(seed).standard_normal(image.shape) + background


GLOBE = fields.GaussianShell(radius=9.0, width=2.0)


@pytest.fixture(scope="module")
def globe() -> tuple[Array, Array, inversion.SphericalResult]:
    image = seen(GLOBE, (42, 46), (22.3, 19.8))
    data = noisy(image, 0.05, 1, 3.0)
    mask = np.zeros(image.shape, bool)
    mask[12:15, 30:33] = True
    data[mask] += 40 * image.max()  # a star
    return image, data, inversion.invert_spherical(data, mask=mask, pixel_size=2.0)


def test_spherical_centre_and_background(globe: tuple[Array, Array, inversion.SphericalResult]) -> None:
    image, _, found = globe
    miss = np.array(found.centre) - (22.3, 19.8)
    assert np.hypot(*miss) < 0.5  # the bar
    assert (np.abs(miss) < 4 * np.array(found.centre_error)).all()
    assert max(found.centre_error) < 0.1
    assert abs(found.background - 3.0) < 4 * found.background_error
    assert found.noise / image.max() == pytest.approx(0.05, rel=0.1)  # 1932 pixels: 1.6 %


def test_spherical_density(globe: tuple[Array, Array, inversion.SphericalResult]) -> None:
    _, data, found = globe
    truth = profile(GLOBE, found.radius / 2.0) / 2.0
    # An error of the amplitude of the noise in a profile that 1900 pixels make.
    assert np.sqrt(((found.density - truth) ** 2).mean()) < 0.06 * truth.max()
    assert (np.abs(found.density - truth) < 5 * found.standard_deviation + 0.01 * truth.max()).all()
    assert np.isnan(found.residual[13, 31])
    assert np.nanmax(np.abs(found.fitted_image + found.residual - data)) < 1e-12 * np.abs(data).max()


def test_spherical_centres_over_draws() -> None:
    image = seen(GLOBE, (36, 36), (17.1, 18.4))
    misses = []
    for seed in range(4):
        found = inversion.invert_spherical(noisy(image, 0.1, seed), samples=16)
        misses.append((np.array(found.centre) - (17.1, 18.4)) / found.centre_error)
    # Eight numbers of unit variance: chi squared lies in 1.0 to 24 with 99.7 %.
    assert 1.0 < np.sum(np.square(misses)) < 24.0


def test_spherical_of_known_centre_and_noise() -> None:
    image = seen(fields.Sphere(radius=10.0), (36, 36), (17.5, 17.5))
    data = noisy(image, 0.02, 3)
    found = inversion.invert_spherical(data, 0.02 * image.max(), centre=(17.5, 17.5), background=False, samples=64)
    assert found.centre_error == (0.0, 0.0)
    assert found.background == 0.0
    assert 0.9 < found.noise < 1.15
    inside = found.radius < 8.0
    assert np.abs(found.density[inside] - 1).mean() < 0.05


def bipolar(r: Array, z: Array) -> Array:
    """A barrel about z = 15 that is hollow inside."""
    return np.exp(-(r**2) / 50 - (z - 15) ** 2 / 100) - 0.8 * np.exp(-(r**2) / 18 - (z - 15) ** 2 / 60)


def barrel(shape: tuple[int, int], axis: float) -> Array:
    """Its projection, pixel values at their middles."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    wide = 5 * np.exp(-((x - axis) ** 2) / 50 - (y - 15) ** 2 / 100)
    return np.sqrt(2 * np.pi) * (wide - 0.8 * 3 * np.exp(-((x - axis) ** 2) / 18 - (y - 15) ** 2 / 60))


@pytest.mark.parametrize("axis", ["y", "x"])
def test_axisymmetric(axis: str) -> None:
    image = barrel((30, 40), 19.3)
    sigma = image.max() * np.where(np.arange(30) > 20, 0.06, 0.02)[:, None] * np.ones(40)
    data = image + sigma * np.random.default_rng(2).standard_normal(image.shape) + 1.0
    data[5:8, 20:23] = np.nan
    turn = (lambda a: a.T) if axis == "x" else (lambda a: a)
    found = inversion.invert_axisymmetric(turn(data), turn(sigma), axis=axis, averaged=False)  # type: ignore[arg-type]
    assert abs(found.axis_position - 19.3) < min(0.5, 4 * found.axis_error)
    truth = bipolar(found.radius[None, :], found.along[:, None])
    assert np.sqrt(((found.density - truth) ** 2).mean()) < 0.04 * truth.max()
    assert (found.density >= 0).all()
    assert abs(found.background - 1.0) < 4 * found.background_error + 0.02
    assert 0.9 < found.noise < 1.1
    assert found.residual.shape == turn(data).shape


def test_axisymmetric_coverage() -> None:
    image = barrel((30, 40), 19.3)
    shares = []
    for seed in range(3):
        found = inversion.invert_axisymmetric(noisy(image, 0.03, seed), axis_position=19.3, averaged=False)
        truth = bipolar(found.radius[None, :], found.along[:, None])
        shares.append(((truth >= found.lower) & (truth <= found.upper)).mean())
    # Some 50 independent errors a draw: 0.68 with a standard deviation of 4 %, and what zeros add.
    assert 0.56 < np.mean(shares) < 0.85


VIEW = View(inclination_deg=55.0, position_angle_deg=30.0, azimuth_deg=10.0)
STRETCH = 1.4
PROLATE = float(np.hypot(np.cos(np.radians(55)), STRETCH * np.sin(np.radians(55))))
TRUTH = {
    "x": 21.3, "y": 18.2, "major": 10 * PROLATE, "minor": 10.0, "position_angle_deg": 30.0, "thickness": 0.2,
    "brightness": 10 * STRETCH / PROLATE, "background": 0.0,
}  # fmt: skip


@pytest.mark.parametrize("kind", ["uniform", "gaussian"])
def test_shell_images_equal_columns_of_fields(kind: Any) -> None:
    uniform = fields.Shell(inner=8.0, outer=10.0, axes=(1, 1, STRETCH))
    field = uniform if kind == "uniform" else fields.GaussianShell(radius=10.0, width=2.0, axes=(1, 1, STRETCH))
    x, y = np.meshgrid(np.arange(43.0), np.arange(38.0))
    points = (x - 21.3)[..., None] * VIEW.right + (18.2 - y)[..., None] * VIEW.up
    expected = field.column(points - 200 * VIEW.forward, points + 200 * VIEW.forward)
    got = inversion.shell_image((38, 43), TRUTH, kind, averaged=False)
    # Uniform: rounding.  Gaussian: linear interpolation of 600 places, (step / width)^2 / 8.
    assert np.abs(got - expected).max() < (1e-10 if kind == "uniform" else 2e-4) * expected.max()


@pytest.mark.parametrize("kind", ["uniform", "gaussian"])
def test_shell_fit(kind: Any) -> None:
    image = inversion.shell_image((38, 43), TRUTH, kind)
    found = inversion.fit_shell(noisy(image, 0.1, 4, 2.0), profile=kind, pixel_size=1.0)
    truth = {**TRUTH, "background": 2.0}
    pulls = {name: (found.parameters[name] - truth[name]) / found.errors[name] for name in truth}
    assert max(np.abs(list(pulls.values()))) < 4, pulls
    assert max(found.errors["x"], found.errors["y"]) < 0.2
    assert found.noise == pytest.approx(0.1 * image.max(), rel=0.1)
    # A spheroid's ratio follows once its inclination is known, and is open without.
    known = inversion.deproject(found, "prolate", inclination_deg=55.0)
    assert abs(known.axis_ratio[0] - STRETCH) < 4 * known.axis_ratio[1] < 0.5
    free = inversion.deproject(found, "prolate")
    assert free.axis_ratio[1] > 5 * known.axis_ratio[1]
    assert free.inclination_range[1] - free.inclination_range[0] > 40
    assert free.correlation < -0.5
    assert free.axis_position_angle_deg == pytest.approx(30, abs=5)


def test_shell_of_a_gradient_in_other_units() -> None:
    values = {**TRUTH, "gradient_x": 0.02, "gradient_y": -0.03}
    image = noisy(inversion.shell_image((38, 43), values), 0.03, 1)
    found = inversion.fit_shell(image, 0.03 * image.max(), gradient=True, pixel_size=5.0)
    assert abs(found.parameters["gradient_x"] - 0.004) < 4 * found.errors["gradient_x"] < 0.004
    assert abs(found.parameters["gradient_y"] + 0.006) < 4 * found.errors["gradient_y"]
    assert abs(found.parameters["major"] - 5 * TRUTH["major"]) < 4 * found.errors["major"]


def test_shell_fit_in_spite_of_stars() -> None:
    image = noisy(inversion.shell_image((38, 43), TRUTH), 0.03, 1)
    image[3:5, 4:6] += 10 * image.max()
    image[30, 9] += 10 * image.max()
    found = inversion.fit_shell(image, 0.03 * 4.0, robust=True, centre=(20, 18))
    assert abs(found.parameters["major"] - TRUTH["major"]) < 0.2
    assert np.hypot(found.parameters["x"] - 21.3, found.parameters["y"] - 18.2) < 0.2


def test_a_round_shell_has_no_singular_fit() -> None:
    values = {**TRUTH, "major": 10.0, "minor": 10.0}
    found = inversion.fit_shell(noisy(inversion.shell_image((38, 43), values), 0.05, 2))
    assert np.isfinite(list(found.errors.values())).all()
    assert found.ratio[0] == pytest.approx(1.0, abs=0.02)


def test_oblate_spheroids_that_cannot_be() -> None:
    found = inversion.fit_shell(noisy(inversion.shell_image((38, 43), TRUTH), 0.05, 2))
    with pytest.raises(DomainError, match="axis_ratio"):
        inversion.deproject(found, "oblate", axis_ratio=0.95)  # seen flatter than it is


def test_symmetric_centre() -> None:
    image = seen(GLOBE, (42, 46), (22.3, 19.8))
    assert np.hypot(*(np.array(symmetric_centre(checked_image(image + 5))) - (22.3, 19.8))) < 0.5


IMAGE = np.ones((20, 20)) + np.eye(20)


@pytest.mark.parametrize(
    ("function", "change", "named"),
    [
        (inversion.invert_spherical, {"image": np.ones(20)}, "image"),
        (inversion.invert_spherical, {"image": np.full((20, 20), np.nan)}, "mask"),
        (inversion.invert_spherical, {"image": np.where(IMAGE > 1, np.inf, 1.0)}, "image"),
        (inversion.invert_spherical, {"sigma": 0.0}, "sigma"),
        (inversion.invert_spherical, {"sigma": np.ones((3, 3))}, "sigma"),
        (inversion.invert_spherical, {"mask": np.zeros((20, 20))}, "mask"),
        (inversion.invert_spherical, {"mask": np.ones((20, 20), bool)}, "mask"),
        (inversion.invert_spherical, {"centre": (50.0, 3.0)}, "centre"),
        (inversion.invert_spherical, {"pixel_size": -1.0}, "pixel_size"),
        (inversion.invert_spherical, {"centre": (2.0, 2.0)}, "centre"),
        (inversion.invert_axisymmetric, {"axis": "z"}, "axis"),
        (inversion.invert_axisymmetric, {"axis_position": 40.0}, "axis_position"),
        (inversion.invert_axisymmetric, {"pixel_size": np.nan}, "pixel_size"),
        (inversion.fit_shell, {"profile": "square"}, "profile"),
        (inversion.fit_shell, {"image": np.ones((20, 20))}, "image"),
        (inversion.fit_shell, {"psf": -1.0}, "psf"),
    ],
)
def test_bad_input(function: Any, change: dict[str, Any], named: str) -> None:
    with pytest.raises(DomainError, match=f"^{named} = "):
        function(**{"image": IMAGE, **change})


@pytest.mark.parametrize("width", [0.05, 0.35])
def test_gaussian_shell_columns_against_quadrature(width: float) -> None:
    from scipy.integrate import quad

    for q in (0.0, 0.4, 1.0, 1.1):
        end, ridge = np.sqrt((1 + 6.07 * width) ** 2 - q**2), np.sqrt(max(1 - q**2, 0.0))
        integral, _ = quad(
            lambda x, q=q: np.exp(-0.5 * ((np.hypot(x, q) - 1) / width) ** 2), 0, end, points=[ridge], limit=200
        )
        # Linear interpolation of 600 places errs by (step / width)^2 / 8 of the ridge, 2.4e-4 for the thinner one.
        ridge_column = float(inversion.shell_column(1.0, width, "gaussian"))
        assert abs(inversion.shell_column(q, width, "gaussian") - 2 * integral) < 3e-4 * ridge_column
