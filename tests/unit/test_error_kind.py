"""What sort of error an answer, an image and a file say they hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.image.spectral import SpectralImage


def image(solver: str | None) -> SpectralImage:
    values = np.full((2, 3, 2), 1.0)
    recipe: dict[str, Any] = {} if solver is None else {"solver": solver}
    return SpectralImage(values, [500.0, 600.0], 0.1 * values, recipe=recipe)


@pytest.mark.parametrize(
    ("solver", "kind"), [("orders", "estimated"), ("path", "standard"), ("photons", "standard"), (None, "standard")]
)
@pytest.mark.parametrize("suffix", [".nc", ".fits", ".exr"])
def test_files_say_what_sort_of_error_they_hold(tmp_path: Path, solver: str | None, kind: str, suffix: str) -> None:
    made = image(solver)
    path = tmp_path / f"sky{suffix}"
    made.save(path)
    back = SpectralImage.load(path)
    assert (made.error_kind, back.error_kind) == (kind, kind)
    np.testing.assert_allclose(back.error, 0.1, rtol=1e-7)  # OpenEXR keeps single precision
    assert (back.estimated_error is None) == (kind != "estimated")
    assert f"radiance_{kind}_error" in made.dataset


def test_files_of_older_versions_are_read(tmp_path: Path) -> None:
    """They call the error of every solver a standard error."""
    from skyscatter.image.netcdf import from_dataset

    old = image("orders").dataset.rename({"radiance_estimated_error": "radiance_standard_error"})
    assert from_dataset(old).error_kind == "estimated"
    np.testing.assert_array_equal(from_dataset(old).error, image("orders").error)


def test_answers_say_what_sort_of_error_they_hold() -> None:
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=40.0)
    up = scene.observer.position, [0.0, 0.0, 1.0]
    for solver, kind in (("single", "none"), ("path", "standard")):
        answer = skyscatter.radiance(scene, *up, [550.0], solver)
        assert answer.error_kind == kind
        assert answer.error is answer.standard_error
        assert answer.estimated_error is None
