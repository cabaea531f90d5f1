"""Pictures that memory does not hold: the same numbers by way of a store, strip by strip."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked

import skyscatter
from skyscatter import memory
from skyscatter.cli.main import main
from skyscatter.errors import DomainError
from skyscatter.image import strips
from skyscatter.solvers.large import StoredPicture, render_stored

#: Of one process of this file each, so that kernels are compiled once.
WAVELENGTHS = [450.0, 650.0]
MODEL = "reflection-nebula"


def scene() -> Any:
    return skyscatter.load_model(MODEL).scene()


def camera(width: int = 24, height: int = 18) -> Any:
    return skyscatter.Telescope.from_length(width, height, "1 pc", scene().view.distance)


@pytest.fixture(autouse=True)
def few_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strips, "STRIP", 5 * 8 * 24 * 2)


@pytest.mark.parametrize(
    ("solver", "options"),
    [pytest.param("single", {"parts": True}, marks=pytest.mark.slow), ("path", {"samples": 16, "orders": 1})],
)
def test_the_same_numbers(solver: str, options: dict[str, Any], tmp_path: Path) -> None:
    wanted = skyscatter.render(scene(), camera(), WAVELENGTHS, **asked(solver, **options))
    picture = render_stored(scene(), camera(), WAVELENGTHS, tmp_path / "run.zarr", **asked(solver, **options))
    assert picture.filled
    assert picture.sky == wanted.sky
    for name in ("cube.fits", "cube.zarr"):
        picture.save(tmp_path / name)
        found = skyscatter.SpectralImage.load(tmp_path / name)
        np.testing.assert_array_equal(found.radiance, wanted.radiance)
        assert found.recipe == wanted.recipe
        for layer, values in wanted.layers.items():
            np.testing.assert_array_equal(found.layers[layer], values)
    np.testing.assert_array_equal(picture.rows(3, 7).error, wanted.standard_error[3:7])


def test_what_is_finished_is_not_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from skyscatter.solvers import volume_single

    made, solve = [0], volume_single.solve

    def stopping(*arguments: Any) -> Any:
        made[0] += 1
        if made[0] == 20:
            raise KeyboardInterrupt
        return solve(*arguments)

    monkeypatch.setattr(volume_single, "solve", stopping)
    for whole in (False, True):
        if whole:
            picture = render_stored(scene(), camera(), WAVELENGTHS, tmp_path / "run.zarr", "single", threads=1)
        else:
            with pytest.raises(KeyboardInterrupt):
                render_stored(scene(), camera(), WAVELENGTHS, tmp_path / "run.zarr", "single", threads=1)
            half = StoredPicture(tmp_path / "run.zarr")
            assert not half.filled
            assert np.isnan(half.rows(0, 18).radiance).any()
    assert made[0] == 20 + 72 - 19, "tiles of 6 rays, of which 19 were there"
    wanted = skyscatter.render(scene(), camera(), WAVELENGTHS, solver="single")
    np.testing.assert_array_equal(picture.rows(0, 18).radiance, wanted.radiance)


@pytest.mark.slow  # kernels of surfaces compile for half a minute
def test_of_surfaces(tmp_path: Path) -> None:
    model: Any = skyscatter.load_model("fog-room")
    seen = model.camera.model_copy(update={"width": 12, "height": 9})
    picture = render_stored(model.scene(), seen, [550.0], tmp_path / "run.zarr", solver=skyscatter.Path(samples=16))
    wanted = skyscatter.render(model.scene(), seen, [550.0], solver=skyscatter.Path(samples=16))
    np.testing.assert_array_equal(picture.rows(0, 9).radiance, wanted.radiance)


def test_what_cannot_be_made_in_parts_is_refused(tmp_path: Path) -> None:
    sky = skyscatter.load_model("earth-simple").scene()
    cases = (
        ("planet", sky, skyscatter.Panorama(width=8, height=4), "single", {}),
        ("solver", scene(), camera(), "photons", {"samples": 4}),
        ("whole picture", scene(), skyscatter.Fisheye(width=8, height=8), "single", {}),
    )
    for word, place, view, solver, options in cases:
        with pytest.raises(DomainError, match=word):
            render_stored(place, view, [550.0], tmp_path / "run.zarr", **asked(solver, **options))
    assert not list(tmp_path.iterdir())


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with room for parts of a picture of 24x18 pixels, but not for all of it."""
    monkeypatch.setattr(memory, "available_bytes", lambda: 100_000)


WORDS = ["nebula", MODEL, "--size", "24x18", "--field-of-view", "1pc", "--wavelengths", "450,650", "--solver", "single"]


def test_the_command(small: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number, more in enumerate(([], ["--store", str(tmp_path / "run.zarr")])):
        out = [str(tmp_path / f"{number}.{kind}") for kind in ("fits", "exr")]
        assert main([*WORDS, *more, "-q", "-o", out[0], "-o", out[1], "--json"]) == 0
        capsys.readouterr()
    assert main(["store", "export", str(tmp_path / "run.zarr"), "-o", str(tmp_path / "2.fits")]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["0.exr", "0.fits", "1.exr", "1.fits", "2.fits", "run.zarr"]
    found = [skyscatter.SpectralImage.load(tmp_path / f"{n}.fits") for n in range(3)]
    for image in found:
        np.testing.assert_array_equal(image.radiance, found[0].radiance)
    assert found[0].sky is not None
    assert found[0].sky.name


@pytest.mark.parametrize(
    ("more", "word"),
    [
        (["-o", "a.png"], "output"),
        (["-o", "a.fits", "--psf", "gaussian:2"], "psf"),
        (["-o", "a.fits", "--compress"], "compress"),
        (["-o", "a.fits", "--solver", "photons"], "solver"),
    ],
)
def test_the_command_refuses(
    more: list[str], word: str, small: None, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    words = [w for w in WORDS if w not in ("--solver", "single")] if "--solver" in more else WORDS
    assert main([*words, *more]) == 2
    error = capsys.readouterr().err
    assert error.startswith("skyscatter: error: size = '24x18': at 2 wavelengths it takes some ")
    assert word in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
