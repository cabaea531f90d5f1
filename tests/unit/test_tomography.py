"""Densities from images: known truths, priors, the stopping rule, uncertainties, files and interruption."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked
from nebulae import GREY, dust

from skyscatter.errors import DomainError
from skyscatter.inversion import reconstruction, tomography
from skyscatter.inversion.priors import Entropy, Prior, Tikhonov, TotalVariation
from skyscatter.inversion.problem import Problem
from skyscatter.inversion.tomography import Interrupted, reconstruct, resampled
from skyscatter.inversion.uncertainty import degrees_of_freedom, posterior_samples
from skyscatter.inversion.views import ImageView, Stack
from skyscatter.inversion.voxelimage import VoxelModel
from skyscatter.inversion.voxelscene import VoxelFrame, VoxelLights, VoxelOptics
from skyscatter.lights import PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.space import SpaceScene, View

FRAME = VoxelFrame.cube(12, 1.0)


def truth(frame: VoxelFrame = FRAME) -> Any:
    """Two blobs."""
    m = frame.middles()
    one = np.exp(-np.sum((m - np.array([0.3, 0.1, 0.0])) ** 2, axis=-1) / 0.1)
    two = 0.6 * np.exp(-np.sum((m + np.array([0.2, 0.3, 0.2])) ** 2, axis=-1) / 0.06)
    return one + two


def looks(count: int = 4) -> list[tuple[Any, Any]]:
    """Directions to the observer and right in the image, spread over half a sphere."""
    found = []
    for k in range(count):
        tilt, turn = np.arccos(1 - (k + 0.5) / count), k * np.pi * (3 - np.sqrt(5))
        right = np.array([np.cos(turn), np.sin(turn), 0.0])
        towards = np.array([-np.sin(tilt) * np.sin(turn), np.sin(tilt) * np.cos(turn), np.cos(tilt)])
        found.append((towards, right))
    return found


def noisy(model: VoxelModel, density: Any, noise: float, pixels: int = 20, seed: int = 0, count: int = 6) -> list[Any]:
    """Own views of a density, with noise relative to the pixel, and to the mean one where it is dark."""
    rng, made = np.random.default_rng(seed), []
    for towards, right in looks(count):
        view = ImageView.parallel(np.zeros((pixels, pixels)), 1.0, towards, right, 1.2)
        rays = (view.origins.reshape(-1, 3), view.directions.reshape(-1, 3))
        image = model.image(density, *rays).reshape(view.data.shape)
        sigma = noise * np.maximum(image, image.mean())
        made.append(ImageView.make(image + sigma * rng.normal(size=image.shape), sigma, view.origins, view.directions))
    return made


def emitting(frame: VoxelFrame = FRAME) -> VoxelModel:
    return VoxelModel(frame, VoxelOptics.columns(), VoxelLights.none(1), np.zeros(1), step=1.0)


def absorbing(frame: VoxelFrame = FRAME) -> VoxelModel:
    return VoxelModel(frame, VoxelOptics.transmittances(1.0), VoxelLights.none(1), np.ones(1), step=1.0)


def scattering(frame: VoxelFrame = FRAME) -> VoxelModel:
    lights = VoxelLights.stars([[0.05, 0.02, 0.1]], [[1.0]])
    return VoxelModel(frame, VoxelOptics.make(0.6, 1.0, g=0.3), lights, np.zeros(1), step=1.0)


def error(found: Any, exact: Any) -> float:
    return float(np.linalg.norm(found.density[0] - exact) / np.linalg.norm(exact))


@pytest.mark.parametrize("prior", [Tikhonov(), TotalVariation(), TotalVariation(rounding=0.3), Entropy()])
def test_priors_against_finite_differences_and_their_samples(prior: Prior) -> None:
    frame, rng = VoxelFrame((5, 6, 4), (0, 0, 0), (1.0, 2.0, 1.5)), np.random.default_rng(0)
    x, v, h = rng.uniform(0.2, 1.0, frame.shape), rng.normal(size=frame.shape), 1e-5
    slope = prior.value(x, frame)[1]
    both = [prior.value(x + s * h * v, frame) for s in (1, -1)]
    assert (both[0][0] - both[1][0]) / (2 * h) == pytest.approx(np.sum(slope * v), rel=1e-7)
    bend = prior.curvature(x, v, frame)
    if not isinstance(prior, TotalVariation):  # whose curvature leaves out a part, on purpose
        np.testing.assert_allclose((both[0][1] - both[1][1]) / (2 * h), bend, rtol=1e-5, atol=1e-8)
    unit = np.zeros(frame.shape)
    unit[2, 3, 1] = 1.0
    assert prior.diagonal(x, frame)[2, 3, 1] == pytest.approx(prior.curvature(x, unit, frame)[2, 3, 1])
    draws = np.array([np.sum(prior.noise(x, rng, frame) * v) for _ in range(400)])
    # The variance of 400 draws is known to sqrt(2 / 400) = 7 %; four of these.
    assert np.mean(draws**2) == pytest.approx(np.sum(v * bend), rel=0.28)
    assert np.sum(bend * v) > 0


def test_the_priors_weigh_the_same_on_finer_cells() -> None:
    for prior, allowed in ((Tikhonov(), 0.1), (TotalVariation(1e-6), 0.1), (Entropy(), 0.03)):
        values = [prior.value(truth(f), f)[0] for f in (VoxelFrame.cube(16, 1.0), VoxelFrame.cube(32, 1.0))]
        assert values[0] == pytest.approx(values[1], rel=allowed)  # differences of first order in the cells


@pytest.mark.parametrize(
    ("make", "limit"),
    [*(pytest.param(*of, marks=pytest.mark.slow) for of in ((emitting, 0.12), (absorbing, 0.15))), (scattering, 0.25)],
)
def test_a_known_density_comes_back(make: Any, limit: float) -> None:
    model, exact = make(), truth()
    found = reconstruct(noisy(model, exact, 0.01), model, coarsest=6)
    # What six views with noise of 1 % tell: of transmittances, 1 % of the light is 5 % of the depth of a blob's middle.
    assert error(found, exact) < limit
    assert found.density.min() >= 0.0
    assert found.total() == pytest.approx(exact.sum() * FRAME.volume, rel=0.06)
    # chi^2 as it is aimed at, and its own chance.
    assert found.chi2 / found.count == pytest.approx(1.0, abs=0.04)
    assert [h["cells"][0] for h in found.history] == sorted(h["cells"][0] for h in found.history)


@pytest.mark.parametrize("prior", ["total-variation", "entropy"])
def test_other_priors_explain_the_data_too(prior: str) -> None:
    model, exact = emitting(), truth()
    found = reconstruct(noisy(model, exact, 0.01), model, prior=prior, coarsest=12)
    assert error(found, exact) < 0.2
    # Never worse explained than is aimed at; the weight is found to a factor.
    assert 0.8 < found.chi2 / found.count < 1.04


def test_more_noise_needs_a_stronger_prior() -> None:
    model, exact = emitting(), truth()
    weights = [reconstruct(noisy(model, exact, n), model, coarsest=6).prior_weight * n**2 for n in (0.003, 0.1)]
    # In units in which the weight of the data is the same.
    assert weights[1] > 10 * weights[0]


def test_a_given_weight_is_kept_and_masked_pixels_say_nothing() -> None:
    model, exact = emitting(), truth()
    views = noisy(model, exact, 0.01)
    spoilt = []
    for v in views:
        data = v.data.copy()
        data[3:5, 4:9] = np.nan
        spoilt.append(ImageView.make(data, v.sigma, v.origins, v.directions))
    found = reconstruct(spoilt, model, prior_weight=1.0, coarsest=6)
    assert found.prior_weight == 1.0
    assert found.count == 6 * (400 - 10)
    assert np.all(found.residuals[0][3:5, 4:9] == 0.0)
    assert error(found, exact) < 0.15


def test_rays_of_a_pixel_are_averaged() -> None:
    model, exact = scattering(), truth()
    v = noisy(model, exact, 0.01)[0]
    towards, right = looks(6)[0]
    coarse = ImageView.parallel(np.zeros((20, 20)), 1.0, towards, right, 1.2, rays=2)
    fine = ImageView.parallel(np.zeros((40, 40)), 1.0, towards, right, 1.2)
    images = [model.image(exact, a.origins.reshape(-1, 3), a.directions.reshape(-1, 3)) for a in (coarse, fine)]
    mean = images[1].reshape(20, 2, 20, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(images[0].reshape(20, 20, 4).mean(axis=2), mean, rtol=1e-12)
    stack = Stack([ImageView.make(v.data, v.sigma, coarse.origins, coarse.directions)])
    zero, one = np.zeros_like(stack.data), np.ones(1)
    problem = Problem(model, stack, zero, zero, Tikhonov(), np.array([True]), 0 * exact[None], one)
    change, h = np.random.default_rng(0).normal(size=exact.shape)[None], 1e-6
    both = [problem.misfit(exact[None] + s * h * change)[0] for s in (1, -1)]
    slope = problem.misfit(exact[None])[1]
    assert 0.5 * (both[0] - both[1]) / (2 * h) == pytest.approx(np.sum(slope * change), rel=1e-6)
    left = np.sum(problem.push(exact[None], change) * stack.data)
    assert left == pytest.approx(np.sum(problem.pull(exact[None], stack.data) * change), rel=1e-10)


def test_error_bars_cover_truths_that_the_prior_expects() -> None:
    """Truths drawn from the prior about a level, linear images: the posterior is Gaussian, its bars must be right."""
    frame = VoxelFrame.cube(6, 1.0)
    model, rng, prior = emitting(frame), np.random.default_rng(3), Tikhonov()
    size = int(np.prod(frame.shape))
    matrix = np.stack([prior.curvature(e, e, frame).ravel() for e in np.eye(size).reshape(-1, *frame.shape)])
    values, vectors = np.linalg.eigh(matrix)
    weight, hits, total = 40.0, 0, 0
    for draw in range(4):
        wave = np.where(values > 1e-9, rng.normal(size=size) / np.sqrt(weight * np.maximum(values, 1e-9)), 0.0)
        exact = 3.0 + (vectors @ wave).reshape(frame.shape)  # far from zero, where the bound would cut
        assert exact.min() > 0
        views = noisy(model, exact, 0.01, pixels=8, seed=draw, count=3)
        start = np.full(frame.shape, 3.0)
        found = reconstruct(
            views, model, prior_weight=weight, start=start, stop=1e-9, iterations=300, deviation=16, seed=draw
        )
        assert found.deviation is not None
        inside = np.abs(found.density[0] - exact) < found.deviation[0]
        hits, total = hits + int(inside.sum()), total + size
    # 864 voxels, correlated over some eight: the share is known to about 5 %; 68.3 % expected.
    assert 0.60 < hits / total < 0.76


@pytest.mark.slow
def test_samples_of_the_posterior_have_the_inverse_hessian_as_covariance() -> None:
    frame = VoxelFrame.cube(4, 1.0)
    model, exact = scattering(frame), 0.5 + np.zeros((1, 4, 4, 4))
    stack = Stack(noisy(model, exact[0], 0.02, pixels=8))
    zero = np.zeros_like(stack.data)
    problem = Problem(model, stack, zero, zero, Tikhonov(), np.array([True]), 0 * exact, np.ones(1))
    units = np.eye(64).reshape(64, *exact.shape)
    jacobian = np.stack([problem.push(exact, u).ravel() for u in units], axis=1)
    bend = np.stack([Tikhonov().curvature(u[0], u[0], frame).ravel() for u in units])
    weight = 50.0
    covariance = np.linalg.inv(jacobian.T @ (problem.weight.ravel()[:, None] * jacobian) + weight * bend)
    samples = posterior_samples(problem, exact, weight, np.ones_like(exact), 50, 5)
    spread = np.mean(np.square(samples), axis=0).ravel()
    # 50 samples tell a variance to 20 %; the largest of 64 deviates by about three of these, the mean by far less.
    np.testing.assert_allclose(spread / np.diag(covariance), 1.0, atol=0.7)
    assert np.mean(spread / np.diag(covariance)) == pytest.approx(1.0, abs=0.1)


def test_degrees_of_freedom_are_the_trace_of_what_maps_data_to_images() -> None:
    frame = VoxelFrame.cube(4, 1.0)
    model, exact, weight = scattering(frame), 0.5 + np.zeros((1, 4, 4, 4)), 50.0
    exact[0, 0] = 0.0  # at the bound: these follow nothing
    stack = Stack(noisy(model, exact[0], 0.02, pixels=8))
    zero = np.zeros_like(stack.data)
    problem = Problem(model, stack, zero, zero, Tikhonov(), np.array([True]), 0 * exact, np.ones(1))
    units = [u for u in np.eye(64).reshape(64, *exact.shape) if exact[u > 0][0] > 0]
    jacobian = np.stack([problem.push(exact, u).ravel() for u in units], axis=1)
    bend = np.array([[np.sum(u[0] * Tikhonov().curvature(v[0], v[0], frame)) for u in units] for v in units])
    data = jacobian.T @ (problem.weight.ravel()[:, None] * jacobian)
    share = data @ np.linalg.inv(data + weight * bend)
    trials = [degrees_of_freedom(problem, exact, weight, np.ones_like(exact), seed) for seed in range(30)]
    # The variance of a trial is at most twice the trace of the share's square.
    spread = np.sqrt(2 * np.trace(share @ share) / len(trials))
    assert np.mean(trials) == pytest.approx(np.trace(share), abs=3 * spread + 0.01 * np.trace(share))
    assert spread < 0.1 * np.trace(share)


@pytest.mark.slow
def test_counting_degrees_of_freedom_sharpens_what_is_small_and_bright() -> None:
    model, exact = emitting(), truth() ** 3
    views = noisy(model, exact, 0.01, count=5)
    plain, counted = (reconstruct(views, model, freedom=which) for which in (False, True))
    freedom = counted.diagnostics["freedom"]
    assert plain.diagnostics["freedom"] == 0.0
    # Most pixels are dark.  What is left over is near the number of data less those that the estimate follows.
    assert 0.02 * counted.count < freedom < 0.8 * counted.count
    assert counted.chi2 == pytest.approx(counted.count - freedom, rel=0.1)
    assert error(counted, exact) < 0.9 * error(plain, exact)


def dusty(density: Any, frame: VoxelFrame = FRAME) -> SpaceScene:
    part = Component(name="dust", density=frame.grid(density), optics=dust(1.0, 0.8))
    return SpaceScene(medium=Medium(components=(part,)), stars=(PointStar(spectrum=GREY),), view=View(distance=100.0))


@pytest.mark.slow
def test_multiple_scattering_is_taken_off_by_turns() -> None:
    from skyscatter.solvers.run import radiance

    exact = 1.2 * truth()
    views = noisy(scattering(), exact, 0.01, pixels=16)
    stack = Stack(views)

    def seen(solver: Any, **options: Any) -> list[ImageView]:
        data = radiance(dusty(exact), stack.origins, stack.directions, [550.0], **asked(solver, **options)).radiance
        parts = zip(stack.split(data), views, strict=True)
        return [ImageView.make(d, 0.03 * np.maximum(d, d.mean()), v.origins, v.directions) for d, v in parts]

    blank = dusty(np.ones(FRAME.shape))
    # What the reconstruction makes of light that was scattered once: some 10 % too little, for the prior smooths it.
    once = reconstruct(seen("single"), blank, [550.0], frame=FRAME, coarsest=6)
    views = seen("path", samples=256)
    single = reconstruct(views, blank, [550.0], frame=FRAME, coarsest=6)
    full = reconstruct(views, blank, [550.0], frame=FRAME, coarsest=6, multiple=2, samples=256)
    # Albedo 0.8 and columns above 1: what is scattered again passes for more dust.
    assert single.density.sum() > 1.15 * exact.sum()
    assert full.density.sum() == pytest.approx(once.density.sum(), rel=0.06)
    assert error(full, exact) < error(single, exact)
    again = reconstruct(views, blank, [550.0], frame=FRAME, coarsest=6, multiple=3, samples=256)
    assert again.density.sum() == pytest.approx(full.density.sum(), rel=0.01)  # one round more is no other answer
    assert all(np.all(m >= -1e-12) for m in full.multiple)


def test_fixed_components_stay_and_only_the_free_one_is_sought() -> None:
    exact = truth()
    other = 0.3 * np.exp(-np.sum(FRAME.middles() ** 2, axis=-1) / 0.3)
    gas = Component(name="gas", density=FRAME.grid(other), optics=dust(1.0, 0.0), emission=1.0)
    made = dusty(exact)
    scene = made.model_copy(update={"medium": Medium(components=(*made.medium.components, gas))})
    model = VoxelModel.from_scene(scene, [550.0], step=1.0)
    views = noisy(model, np.stack([exact, other]), 0.003)
    found = reconstruct(views, scene, [550.0], free=["dust"], coarsest=6)
    np.testing.assert_allclose(found.density[1], other, rtol=1e-6)
    assert error(found, exact) < 0.4
    assert found.names == ("dust", "gas")


def test_results_are_files_fields_and_masses(tmp_path: Path) -> None:
    model, exact = emitting(), truth()
    found = reconstruct(noisy(model, exact, 0.01), model, coarsest=6, deviation=4)
    found.save(tmp_path / "found.npz")
    back = reconstruction.Reconstruction.load(tmp_path / "found.npz")
    np.testing.assert_array_equal(back.density, found.density)
    np.testing.assert_array_equal(back.residuals[2], found.residuals[2])
    assert (back.frame, back.chi2, back.history) == (found.frame, found.chi2, found.history)
    field = found.field()
    points = FRAME.middles().reshape(-1, 3)[::50]
    np.testing.assert_allclose(field.density(points), found.density[0].ravel()[::50], rtol=1e-5, atol=1e-7)
    with pytest.raises(DomainError, match="component"):
        found.field("dust")
    (tmp_path / "bad.npz").write_bytes(b"nothing")
    with pytest.raises(DomainError, match="was not written by"):
        reconstruction.Reconstruction.load(tmp_path / "bad.npz")


def test_an_interruption_keeps_the_best_and_a_checkpoint_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, exact = emitting(), truth()
    views, calls = noisy(model, exact, 0.01), []
    misfit = Problem.misfit

    def stopped(self: Problem, x: Any) -> Any:
        calls.append(1)
        if len(calls) == 25:
            raise KeyboardInterrupt
        return misfit(self, x)

    monkeypatch.setattr(Problem, "misfit", stopped)
    kept = tmp_path / "kept.npz"
    with pytest.raises(Interrupted) as raised:
        reconstruct(views, model, coarsest=6, checkpoint=kept)
    monkeypatch.setattr(Problem, "misfit", misfit)
    assert raised.value.partial.diagnostics["reason"] == "interrupted"
    assert raised.value.partial.chi2 < 1e4 * raised.value.partial.count
    found = reconstruct(views, model, coarsest=6, resume=kept)
    whole = reconstruct(views, model, coarsest=6)
    np.testing.assert_array_equal(found.density, whole.density)
    assert (found.chi2, found.prior_weight, len(found.history)) == (whole.chi2, whole.prior_weight, len(whole.history))
    with pytest.raises(DomainError, match="begun with other data or options"):
        reconstruct(views, model, coarsest=6, resume=kept, stop=1e-2)
    assert error(found, exact) < 0.12
    assert found.chi2 / found.count == pytest.approx(1.0, abs=0.1)
    with pytest.raises(DomainError, match="another frame"):
        reconstruct(views, emitting(VoxelFrame.cube(12, 2.0)), resume=kept)


def test_threads_do_not_change_the_estimate() -> None:
    model, exact = emitting(), truth()
    views = noisy(model, exact, 0.01)
    both = [reconstruct(views, model, coarsest=6, threads=t).density for t in (1, 2)]
    np.testing.assert_array_equal(*both)


def test_cells_are_refined_without_loss_of_mass() -> None:
    fine = resampled(truth(), (24, 24, 24))
    assert fine.mean() == pytest.approx(truth().mean(), rel=1e-3)
    assert fine.min() >= 0
    assert tomography._shapes((64, 64, 64), 12) == [(16,) * 3, (32,) * 3, (64,) * 3]


def test_bad_input_is_named() -> None:
    model = emitting()
    views = noisy(model, truth(), 0.01)
    with pytest.raises(DomainError, match="prior = 'ridge'"):
        reconstruct(views, model, prior="ridge")
    with pytest.raises(DomainError, match="multiple"):
        reconstruct(views, model, multiple=True)
    with pytest.raises(DomainError, match="sigma"):
        ImageView.make(np.ones((2, 2)), 0.0, np.zeros(3), np.ones((2, 2, 3)))
    with pytest.raises(DomainError, match="views"):
        reconstruct([], model)
    with pytest.raises(DomainError, match="wavelengths"):
        reconstruct(views, dusty(truth()))
    with pytest.raises(DomainError, match="component"):
        reconstruct(views, dusty(truth()), [550.0], free=["gas"])


def test_stars_in_a_picture_are_no_matter() -> None:
    """Pixels around the stars of the scene say nothing; without the scene they are bright matter."""
    from skyscatter import Telescope

    medium = Medium(components=(Component(name="dust", density=FRAME.grid(truth()), optics=dust(0.5, 0.6)),))
    star = PointStar(spectrum=GREY, position=(0.2, 0.0, 0.0))
    scene = SpaceScene(medium=medium, stars=(star,), view=View(distance=100.0))
    camera = Telescope.from_field_of_view(24, 24, float(np.degrees(2.4 / 100)))
    data = np.ones((24, 24))
    plain, masked = (ImageView.from_camera(data, 0.1, camera, scene.view, scene=s) for s in (None, scene))
    assert np.isfinite(plain.sigma).all()
    hidden = ~np.isfinite(masked.sigma[..., 0])
    rows, columns = np.nonzero(hidden)
    assert 0 < hidden.sum() < 60
    assert abs(rows.mean() - 11.5) < 0.6  # 0.2 m west of the middle of 2.4 m: two pixels to the right
    assert abs(columns.mean() - 13.5) < 0.6
