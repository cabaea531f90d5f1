"""Light of all orders in thick media: harmonics against closed forms, cycles against the sum over the orders."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter import Component, Ground, Medium, Scene, Star, Sun
from skyscatter.errors import DomainError
from skyscatter.media.fields import Uniform
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.solvers import cycles, synthetic
from skyscatter.solvers.effort import check_effort
from skyscatter.solvers.run import Interrupted
from skyscatter.solvers.series import sum_orders
from skyscatter.solvers.sweeps import Sweeper, make_problem, moment_weights
from skyscatter.solvers.synthetic import Harmonics
from skyscatter.solvers.transfer import Light
from skyscatter.workers import Workers

TOP = 1e3
WAVELENGTHS = np.array([550.0])


def cloud(depth: float, albedo: float = 1.0, g: float = 0.86, ground: float = 0.0) -> Scene:
    optics = Particles(optical_depth=depth, single_scattering_albedo=albedo, phase=HenyeyGreenstein(g=g))
    layer = Component(name="cloud", density=Uniform(base=0.0, top=TOP), optics=optics)
    return Scene(
        medium=Medium(planet_radius=6.371e6, components=(layer,)), ground=Ground(albedo=ground),
        star=Star(spectrum=1.0, radius=0.0), sun=Sun(elevation_deg=50.0),
    )  # fmt: skip


def problem(scene: Scene, tolerance: float) -> Any:
    return make_problem(scene, WAVELENGTHS, (0.6, 0.75), tolerance)


@pytest.mark.parametrize("ground", [0.0, 0.5, 1.0])
def test_two_degrees_diffuse_as_the_closed_form_says(ground: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synthetic, "PAIRS", 1)
    # An even source q of a white slab: phi = q t (c + 3/2 s - 3/2 s^2 t_tr ...) solves phi'' = -3 q in transport depth.
    made = problem(cloud(20.0, ground=ground), 0.005)
    harmonics, light = Harmonics(made), made.diffuse
    scattering = float(4 * np.pi * light.greek[0, 0, 0, 0])
    forward = float(4 * np.pi / 3 * light.greek[0, 0, 1, 0])
    z = made.grid.altitudes
    suns = made.grid.sun_zenith.size
    # A sweep that changed the scalar irradiance by one everywhere, and the net one by nothing.
    flat = np.zeros((z.size, suns, made.moments.degree.size, 1))
    swept = flat.copy()
    swept[:, :, 0] = 1.0
    dark = np.zeros((z.size, 2, suns, 1))
    found = harmonics.corrected(Light(flat, dark), Light(swept, dark)).moments[:, 0, 0, 0] - 1.0
    source, conducts = scattering, 1 / (3 * (light.sigma_t[0, 0] - forward))
    # F = a + source z with F = phi / 2 at the top and F = -phi (1 - A) / (2 (1 + A)) at the ground.
    k = 0.5 * (1 - ground) / (1 + ground)
    below = (source * z[-1] * (1 + z[-1] / (4 * conducts))) / (k + 0.5 + k * z[-1] / (2 * conducts))
    right = below + (k * below * z - source * z**2 / 2) / conducts
    # Finite volumes: of second order in some 40 cells.
    np.testing.assert_allclose(found, right, rtol=3e-3)


def test_far_from_all_edges_every_moment_answers_for_itself() -> None:
    # Where nothing changes over height e_l (sigma_t - chi_l sigma_s) = chi_l sigma_s r_l, whatever the order.
    made = problem(cloud(60.0, albedo=0.7), 0.02)
    light, table = made.diffuse, made.moments
    scattering = 4 * np.pi / (2 * table.degree + 1) * light.greek[0, 0, table.degree, 0]
    shape = made.grid.altitudes.size, made.grid.sun_zenith.size
    dark = Light(np.zeros((*shape, table.degree.size, 1)), np.zeros((shape[0], 2, shape[1], 1)))
    swept = Light(np.ones_like(dark.moments), dark.flux)
    found = Harmonics(made).corrected(dark, swept).moments[np.argmin(np.abs(made.grid.altitudes - 0.5 * TOP)), 0, :, 0]
    expected = 1 + scattering / (light.sigma_t[0, 0] - scattering)
    known = (table.degree < table.order + 2 * synthetic.PAIRS) & (table.order <= 2)
    assert known.sum() >= 12
    # The edges are some twenty lengths of diffusion away.
    np.testing.assert_allclose(found[known], expected[known], rtol=1e-4)
    np.testing.assert_array_equal(found[table.degree >= table.order + 2 * synthetic.PAIRS], 1.0)


def test_what_a_white_ground_takes_it_gives_back() -> None:
    made = problem(cloud(8.0, ground=1.0), 0.02)
    shape = made.grid.altitudes.size, made.grid.sun_zenith.size
    dark = Light(np.zeros((*shape, made.moments.degree.size, 1)), np.zeros((shape[0], 2, shape[1], 1)))
    swept = Light(np.ones_like(dark.moments), np.full_like(dark.flux, 10.0))
    up, down = (Harmonics(made).corrected(dark, swept).flux - swept.flux)[0, :, 0, 0]
    assert up > 0
    # Between the lowest two nodes light of finite volumes has its value half-way.
    assert up == pytest.approx(down, rel=0.01)


@pytest.mark.parametrize(
    ("depth", "albedo", "ground"),
    [(3.0, 1.0, 0.3), (10.0, 1.0, 0.0), pytest.param(20.0, 0.98, 0.9, marks=pytest.mark.slow)],
)
def test_cycles_are_the_sum_of_all_orders_in_few_sweeps(depth: float, albedo: float, ground: float) -> None:
    tolerance = 0.01
    made = problem(cloud(depth, albedo, ground=ground), tolerance)
    found = cycles.all_orders(Sweeper(made, 1), tolerance)
    summed = sum_orders(Sweeper(made, 1), 0.1 * tolerance)
    assert found.orders <= 5 < 10 < summed.orders
    deviation = np.abs(found.moments[:, :, 0] / summed.moments[:, :, 0] - 1)
    # Light that is summed is interpolated order by order, which alone makes a difference of half the tolerance here.
    assert deviation.max() < tolerance
    # Every moment has settled, those too that the harmonics do not know: one sweep more changes little.
    sweeper = Sweeper(made, 1)
    with Workers(max_workers=1) as pool:
        swept = sweeper.first(pool)[0] + sweeper.next(pool, found.moments, found.flux)[0]
    changed = moment_weights(made)[:, None] * np.abs(swept - found.moments) / found.moments[:, :, :1]
    # Three tenths of the tolerance may be missing, and moments below a tenth of it are not swept at all.
    assert changed.max() < 0.5 * tolerance


def test_light_that_a_sweep_does_not_change_is_left_alone() -> None:
    made = problem(cloud(10.0), 0.02)
    rng = np.random.default_rng(1)
    shape = made.grid.altitudes.size, made.grid.sun_zenith.size
    light = Light(
        rng.uniform(1, 2, (*shape, made.moments.degree.size, 1)), rng.uniform(1, 2, (shape[0], 2, shape[1], 1))
    )
    found = Harmonics(made).corrected(light, light)
    np.testing.assert_array_equal(found.moments, light.moments)
    np.testing.assert_array_equal(found.flux, light.flux)


def test_cycles_that_were_stopped_go_on_to_the_same_digits(tmp_path: Path) -> None:
    scene, camera = cloud(10.0), skyscatter.Panorama(width=8, height=4)
    shares = []

    def stop(share: float) -> None:
        shares.append(share)
        if len(shares) > 4:  # between cycles of the finer solution
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as caught:
        skyscatter.render(scene, camera, WAVELENGTHS, progress=stop)
    assert 0.0 < shares[-1] < 0.9
    caught.value.state.save(tmp_path / "state.zarr")
    resumed = skyscatter.render(scene, camera, WAVELENGTHS, resume=tmp_path / "state.zarr")
    np.testing.assert_array_equal(resumed.radiance, skyscatter.render(scene, camera, WAVELENGTHS).radiance)


def test_what_no_grid_follows_is_refused_before_the_work() -> None:
    made = problem(cloud(1000.0), 0.005)
    with pytest.raises(DomainError, match="from node to node; use solver path"):
        check_effort(made, WAVELENGTHS, 0.005, None)
