"""Two halves of walks and passes: their mean is the picture, they are independent, and they survive stores."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked
from nebulae import coarse

import skyscatter
from skyscatter.errors import DomainError
from skyscatter.solvers.render import picture_of

WL = [450.0, 550.0, 650.0]
HALVES = ("half_a", "half_b")


def sky() -> tuple[Any, Any]:
    scene = skyscatter.load_model("earth").scene(sun_elevation_deg=20.0)  # type: ignore[call-overload]
    return scene, skyscatter.Fisheye(width=8, height=8)


def nebula() -> tuple[Any, Any]:
    model = coarse("dark-globule", 24, 3)
    scene = model.scene()
    return scene, skyscatter.Telescope.from_length(8, 8, model.picture_width or 1e16, scene.view.distance)


def room() -> tuple[Any, Any]:
    model: Any = skyscatter.load_model("fog-room")
    return model.scene(), type(model.camera)(**{**model.camera.model_dump(), "width": 8, "height": 6})


CASES = [
    pytest.param(sky, "path", {"samples": 32}, id="sky"),
    pytest.param(sky, "path", {"noise": 0.2}, id="sky by noise"),
    pytest.param(sky, "path", {"samples": 6}, id="sky with few walks"),
    pytest.param(nebula, "path", {"samples": 32, "parts": True}, id="nebula"),
    pytest.param(room, "path", {"samples": 32}, id="room"),
    pytest.param(room, "path", {"samples": 64, "subpixels": 2}, id="parts of pixels"),
    pytest.param(room, "photons", {"samples": 4, "photons": 1000}, id="photons"),
    pytest.param(room, "photons", {"samples": 2, "photons": 1000, "subpixels": 2}, id="photons in parts of pixels"),
]


@pytest.mark.parametrize(("build", "solver", "options"), CASES)
def test_halves_make_the_picture(build: Any, solver: str, options: dict[str, Any]) -> None:
    scene, camera = build()
    plain = skyscatter.render(scene, camera, WL, **asked(solver, **options))
    image = skyscatter.render(scene, camera, WL, halves=True, **asked(solver, **options))
    np.testing.assert_array_equal(image.radiance, plain.radiance)
    np.testing.assert_array_equal(image.error, plain.error)
    assert set(image.layers) == {*plain.layers, *HALVES}
    assert image.recipe["halves"] is True
    a, b = (image.layers[name][image.inside] for name in HALVES)
    known = image.radiance[image.inside] - (a + b) / 2
    assert np.all(known >= -1e-9 * np.abs(image.radiance[image.inside]))  # rounding: what is not by chance is light
    assert np.any(a != b)
    # The difference of the halves is as wide as the error says: its mean square is that of many pixels.
    ratio = np.mean((a - b) ** 2, axis=0) / np.mean(4 * image.error[image.inside] ** 2, axis=0)
    assert np.all((ratio > 0.1) & (ratio < 6))  # some fifty pixels of skewed noise, few walks


def test_what_is_known_has_no_noise() -> None:
    """Light scattered once comes from an integral: it is in the picture, and not in the halves."""
    scene, camera = sky()
    image = skyscatter.render(scene, camera, WL, solver=skyscatter.Path(samples=16), halves=True, parts=True)
    mean = (image.layers["half_a"] + image.layers["half_b"])[image.inside] / 2
    np.testing.assert_allclose(mean, image.layers["multiple"][image.inside], rtol=1e-12)


def test_halves_are_independent() -> None:
    """Over a hundred seeds their errors in a pixel are uncorrelated."""
    scene, camera = room()
    camera = type(camera)(**{**camera.model_dump(), "width": 3, "height": 3})
    images = [
        skyscatter.render(scene, camera, WL, solver=skyscatter.Path(samples=16, seed=k), halves=True)
        for k in range(100)
    ]
    a, b = (np.array([image.layers[name][..., 1] for image in images]) for name in HALVES)
    lit = (a.std(axis=0) > 0) & (b.std(axis=0) > 0)
    assert lit.any()
    together = [np.corrcoef(a[:, j, i], b[:, j, i])[0, 1] for j, i in np.argwhere(lit)]
    assert abs(np.mean(together)) < 4 / np.sqrt(100 * len(together))  # four standard errors


@pytest.mark.parametrize(("build", "solver", "few", "many"), [(room, "path", 16, 48), (room, "photons", 2, 4)])
def test_stores_add_to_halves(build: Any, solver: str, few: int, many: int, tmp_path: Path) -> None:
    scene, camera = build()
    more = {"photons": 1000} if solver == "photons" else {}

    def picture(samples: int, **where: Any) -> skyscatter.SpectralImage:
        return skyscatter.render(scene, camera, WL, halves=True, **asked(solver, samples=samples, **more, **where))

    picture(few, store=tmp_path / "run.zarr")
    grown, whole = picture(many, store=tmp_path / "run.zarr"), picture(many)
    for name in HALVES:
        np.testing.assert_array_equal(grown.layers[name], whole.layers[name])
        np.testing.assert_array_equal(picture_of(tmp_path / "run.zarr").layers[name], whole.layers[name])
    with pytest.raises(DomainError, match="other"):
        skyscatter.render(scene, camera, WL, store=tmp_path / "run.zarr", **asked(solver, samples=many, **more))


def test_other_processes_know_halves() -> None:
    scene, camera = room()
    here, there = (
        skyscatter.render(scene, camera, WL, solver=skyscatter.Path(samples=16), halves=True, executor=executor)
        for executor in (None, 2)
    )
    for name in HALVES:
        np.testing.assert_array_equal(here.layers[name], there.layers[name])


@pytest.mark.parametrize(
    ("build", "solver", "options", "words"),
    [
        (sky, "orders", {}, "halves = True: has no noise"),
        (sky, "single", {}, "halves = True: has no noise"),
        (nebula, "single", {}, "halves = True: has no noise"),
        (sky, "path", {"stokes": True}, "stokes = True"),
        (sky, "path", {"sampling": "free-flight", "samples": 16}, "keeps no halves"),
        (sky, "path", {"samples": 5}, "an even number"),
        (room, "path", {"samples": 12, "subpixels": 2}, "an even number"),
        (room, "photons", {"samples": 3}, "an even number"),
    ],
)
def test_what_has_no_halves(build: Any, solver: str, options: dict[str, Any], words: str) -> None:
    scene, camera = build()
    with pytest.raises(DomainError, match=words):
        skyscatter.render(scene, camera, WL, halves=True, **asked(solver, **options))


@pytest.mark.slow
def test_a_real_sky_denoised() -> None:
    """A sky in 16 walks, beside 256: its error falls, and is what is stated."""
    scene, _ = sky()
    camera = skyscatter.Panorama(width=64, height=32)
    image = skyscatter.render(scene, camera, WL, solver=skyscatter.Path(samples=16), halves=True)
    truth = skyscatter.render(scene, camera, WL, solver=skyscatter.Path(samples=256, seed=1))
    clean = image.denoised()

    weight = image.layers["half_a"].mean(axis=(0, 1)) ** -2

    def squares(values: Any) -> float:
        return float(np.mean(((values - truth.radiance) ** 2 - truth.error**2) * weight))

    assert squares(clean.radiance) < 0.6 * squares(image.radiance)
    assert 0.5 < np.sqrt(np.mean(clean.error**2 * weight) / squares(clean.radiance)) < 1.6  # of two tiles alone
