"""The blind scenes themselves: landscapes that are what they say, and files that belong to their parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import dehaze_scenes
import numpy as np
import pytest
from dehaze_scenes import BANDS, COVERS, LANDSCAPES, MATERIALS, BlindScene, build, class_spectra, draw_landscape, render

SMALL = BlindScene(size=8, bands=(492.4, 864.7), walks=32, aod=0.1)


def test_spectra_are_albedos() -> None:
    assert all(len(values) == len(BANDS) for values in MATERIALS.values())
    spectra = np.array(class_spectra(BANDS))
    assert len(spectra) == 15 * len(COVERS)
    assert spectra.min() > 0
    assert spectra.max() < 0.8


@pytest.mark.parametrize("kind", LANDSCAPES)
def test_landscapes_are_textured_and_set_dark_beside_bright(kind: str) -> None:
    classes = draw_landscape(kind, 128, 3)
    np.testing.assert_array_equal(classes, draw_landscape(kind, 128, 3))
    assert np.any(classes != draw_landscape(kind, 128, 4))
    assert np.unique(classes // 15).size >= 3
    assert np.unique(classes).size >= 20
    red = np.array(class_spectra(BANDS))[classes][..., 3]
    assert red.max() > 3 * red.min()
    # Neighbours differ less than cells far apart: patches, not noise.
    near, far = (np.abs(red - np.roll(red, shift, axis=1)).mean() for shift in (1, 40))
    assert near < 0.8 * far


def test_scene_is_what_its_parameters_say() -> None:
    scene = build(SMALL)
    assert scene.sun.elevation_deg == 50.0
    depths = [c.optics.optical_depth for c in scene.medium.components[1:]]
    assert sum(depths) == pytest.approx(0.1)
    assert scene.ground.map.classes.array.shape == (16, 16)


@pytest.mark.slow
def test_files_belong_to_their_parameters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fresh = render(SMALL, tmp_path)
    assert fresh["reflectance"].shape == fresh["surface"].shape == (2, 8, 8)
    np.testing.assert_allclose(fresh["surroundings"][:, 4:12, 4:12], fresh["surface"], rtol=1e-12)
    monkeypatch.setattr(dehaze_scenes, "simulate", lambda *_, **__: pytest.fail("rendered again"))
    kept = render(SMALL, tmp_path)
    for name, value in fresh.items():
        np.testing.assert_array_equal(kept[name], value)
    assert replace(SMALL, aod=0.2).name != SMALL.name
    with pytest.raises(pytest.fail.Exception, match="rendered again"):
        render(replace(SMALL, seed=1), tmp_path)
