"""The point-spread function of the air: against quadrature, transmittances, published fits; and the environment."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from bases import complaint
from significance import assert_agrees

import skyscatter
from skyscatter import Component, Medium, Scene
from skyscatter.dehaze.adjacency import SpreadFunction, environment, spread_function, spread_weights
from skyscatter.media.fields import Exponential
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.optics.rayleigh import RayleighPowerLaw

RADIUS = 6371e3
WAVELENGTHS = np.array([443.0, 560.0, 842.0, 1610.0])


def air(depth: float) -> Component:
    optics = RayleighPowerLaw(coefficient=depth / 8e3, wavelength=550.0)
    return Component(name="air", density=Exponential(scale_height=8e3, top=100e3), optics=optics)


def haze(depth: float) -> Component:
    """Absorbing particles with the scale height of the continental aerosol in 6S."""
    optics = Particles(optical_depth=depth, single_scattering_albedo=0.89, phase=HenyeyGreenstein(g=0.64))
    return Component(name="haze", density=Exponential(scale_height=2e3, top=40e3), optics=optics)


def medium(*components: Component) -> Medium:
    return Medium(planet_radius=RADIUS, components=components)


@cache
def hazy(view_zenith_deg: float, stokes: bool = False) -> SpreadFunction:
    return spread_function(medium(air(0.0973), haze(0.3)), WAVELENGTHS, view_zenith_deg, stokes=stokes)


@pytest.mark.parametrize("stokes", [False, True])
@pytest.mark.slow
def test_direct_and_diffuse_transmittance_are_those_of_the_field(stokes: bool) -> None:
    there = Scene(medium=medium(air(0.0973), haze(0.3)))
    terms = skyscatter.CorrectionTerms(
        there, WAVELENGTHS, sun_elevations_deg=(50.0, 50.0), tolerance=2e-3, stokes=stokes
    )
    for view_zenith_deg in (0.0, 60.0):
        up = terms.at(50.0, view_zenith_deg).transmittance_up
        spread = hazy(view_zenith_deg, stokes)
        tilt = np.radians(view_zenith_deg)
        target = np.array([0.0, 0.0, RADIUS])
        far = target + 2e6 * np.array([np.sin(tilt), 0.0, np.cos(tilt)])
        # The kernel reads columns from a table; see `bases.DensityFieldBase.table_error`.
        np.testing.assert_allclose(spread.direct, skyscatter.transmittance(there, target, far, WAVELENGTHS), rtol=1e-4)
        # The tolerance is the relative accuracy that the field aims at.
        assert_agrees(spread.direct + spread.diffuse, up, spread.diffuse_error, slack=2e-3)


@pytest.mark.slow
def test_light_scattered_once_in_thin_air_comes_from_where_quadrature_says() -> None:
    """Nadir view of thin Rayleigh air over a round ground of radiance 1, by quadrature over the scattering's height.

    From a height h the ground within a distance r fills the directions whose cosine to the nadir exceeds that of its
    rim, so the light from there is the integral of the phase function 3/8 (1 + c^2) over c.
    """
    depth = 1e-3
    spread = spread_function(medium(air(depth)), [550.0], walks=1 << 18)
    r = np.array([100.0, 300.0, 1e3, 3e3, 1e4, 3e4, 1e5, 9e5])
    u, w = np.polynomial.legendre.leggauss(4000)
    h = -8e3 * np.log(0.5 * (u + 1))[:, None]
    seen = np.minimum(r, np.sqrt(2 * RADIUS**2 * h / (RADIUS + h)))  # as far as the horizon; all are chords
    drop = seen**2 / (2 * RADIUS)
    cosine = (h + drop) / np.sqrt((h + drop) ** 2 + seen**2 - drop**2)
    part = 3 / 8 * ((1 - cosine) + (1 - cosine**3) / 3)
    light = depth * (0.5 * w[:, None] * part).sum(axis=0)
    error = [np.interp(x, spread.distance, spread.share_error[:, 0]) for x in r]
    # The light is dimmed on its way by the depth times the air mass, of which all directions have much the same but
    # those along the horizon: its few parts in a thousand depend on r by less than 1e-3; `within` is linear in bins.
    assert_agrees(spread.within(r)[:, 0], light / light[-1], error, slack=2e-3)
    # Dimmed by up to 1 + the mean air mass 2 of slanted ways, times the depth.
    assert_agrees(spread.diffuse[0], light[-1], spread.diffuse_error[0], slack=3 * depth)


def test_shape_is_near_the_fits_of_6s() -> None:
    """Vermote et al. (1997), IEEE Trans. Geosci. Remote Sens. 35, 675: fits to Monte Carlo runs for the nadir.

    Rayleigh's fit has a single length and is below the truth beyond 10 km, where the air's scale height shows.  That of
    the aerosol belongs to another phase function with a narrower forward peak: nearer to the target by some 0.08.
    """
    r = np.array([0.1, 0.3, 1.0, 3.0, 10.0])
    rayleigh = 1 - (0.930 * np.exp(-0.08 * r) + 0.070 * np.exp(-1.10 * r))
    aerosol = 1 - (0.448 * np.exp(-0.27 * r) + 0.552 * np.exp(-2.83 * r))
    np.testing.assert_allclose(spread_function(medium(air(0.0973)), [550.0]).within(r * 1e3)[:, 0], rayleigh, atol=0.03)
    np.testing.assert_allclose(spread_function(medium(haze(0.3)), [550.0]).within(r * 1e3)[:, 0], aerosol, atol=0.10)


def test_share_rises_from_nought_to_one_and_repeats() -> None:
    spread = hazy(0.0)
    assert np.all(spread.share[0] == 0)
    assert np.all(np.diff(spread.share, axis=0) >= 0)
    assert np.all(np.abs(spread.share[-1] - 1) < 1e-3)
    assert np.all(spread.share_error < 0.01)
    again = spread_function(medium(air(0.0973), haze(0.3)), WAVELENGTHS)
    np.testing.assert_array_equal(spread.share, again.share)


def test_weights_of_cells_sum_to_the_share_within() -> None:
    spread = hazy(0.0)
    for cell in (60.0, 500.0):
        weights = spread_weights(spread, cell, (60, 40))
        y, x = np.arange(-60, 61)[:, None] * cell, np.arange(-40, 41)[None, :] * cell
        for reach in (5, 10, 39):
            inside = np.hypot(y, x) < reach * cell
            same_area = np.sqrt(inside.sum() / np.pi) * cell
            # A disk of whole cells is no circle: near the target that makes a thousandth.
            np.testing.assert_allclose(weights[:, inside].sum(axis=1), spread.within(same_area), atol=1.5e-3)
        np.testing.assert_allclose(weights, weights[:, ::-1, ::-1], rtol=1e-12)


def test_environment_is_the_weighted_sum() -> None:
    """Against loops over all pairs of cells."""
    spread = hazy(0.0)
    rng = np.random.default_rng(3)
    image = rng.uniform(0.0, 0.6, (4, 7, 9))
    image[:, 2, 3] = np.nan
    result = environment(image, 200.0, spread)
    weights = spread_weights(spread, 200.0, (6, 8))
    for band in range(4):
        known = np.isfinite(image[band])
        mean = image[band][known].mean()
        for y in range(7):
            for x in range(9):
                w = weights[band, 6 - y : 13 - y, 8 - x : 17 - x]
                near = (w[known] * image[band][known]).sum() / w[known].sum()
                expected = w.sum() * near + (1 - w.sum()) * mean
                assert result[band, y, x] == pytest.approx(expected, abs=1e-12)


def test_environment_of_a_uniform_scene_is_the_scene() -> None:
    image = np.full((4, 20, 30), 0.3, np.float32)
    image[:, :, 25:] = np.nan
    image[3] = np.nan
    result = environment(image, 120.0, hazy(0.0))
    np.testing.assert_allclose(result[:3], 0.3, rtol=1e-6)
    assert np.isnan(result[3]).all()
    # A dark spot darkens its own cell most, by the share that left the ground within it.
    image = np.full((4, 41, 41), 0.3)
    image[:, 20, 20] = 0.0
    dip = 0.3 - environment(image, 120.0, hazy(0.0))[:, 20, 20]
    assert np.all(dip > 0.3 * hazy(0.0).within(60.0))
    assert np.all(dip < 0.3 * hazy(0.0).within(90.0))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: spread_function(medium(air(0.1)), [550.0], 90.0), ["view_zenith_deg = 90.0", "0 and 90"]),
        (lambda: spread_function(medium(air(0.1)), [550.0], altitude=0.0), ["altitude = 0.0", "above the ground"]),
        (lambda: spread_function(medium(air(0.1)), [550.0], walks=3), ["walks = 3", "at least 16"]),
        (lambda: environment(np.zeros((3, 3)), 60.0, hazy(0.0)), ["reflectance", "(band, y, x)"]),
        (lambda: environment(np.zeros((3, 3, 3)), 60.0, hazy(0.0)), ["3 bands", "4"]),
        (lambda: environment(np.zeros((4, 3, 3)), 0.0, hazy(0.0)), ["cell_size_m = 0.0", "positive"]),
    ],
)
def test_refuses(call: Any, words: list[str]) -> None:
    message = complaint(call)
    assert all(word in message for word in words), message
