"""Windows of an image are the same whatever works on them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine

import skyscatter
from skyscatter.cli.main import main
from skyscatter.dehaze import Atmosphere, Band, build_table
from skyscatter.dehaze.table import Angles


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """A hazy image of a sensor and a geometry, larger than a window."""
    rng = np.random.default_rng(5)
    values = (0.08 + 0.3 * rng.random((3, 300, 280)) ** 2).astype(np.float32)
    path = tmp_path / "image.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=280, height=300, count=3, dtype="float32", crs="EPSG:32632",
        transform=Affine(30, 0, 5e5, 0, -30, 5e6),
    ) as file:  # fmt: skip
        file.write(values)
    return path


OPTIONS: dict[str, Any] = {
    "sensor": "landsat-8", "bands": ("B2", "B3", "B4"), "quantity": "reflectance", "sun_zenith_deg": 40.0,
    "view_zenith_deg": 0.0, "aod": 0.3, "window": 128,
}  # fmt: skip


@pytest.mark.slow
def test_processes_and_threads_agree(image: Path) -> None:
    wanted = skyscatter.dehaze(image, threads=2, **OPTIONS)
    with ThreadPoolExecutor(2) as pool:
        for executor in (2, pool):
            found = skyscatter.dehaze(image, executor=executor, **OPTIONS)
            np.testing.assert_array_equal(found.reflectance, wanted.reflectance)
            np.testing.assert_array_equal(found.mask, wanted.mask)
            assert found.diagnostics == wanted.diagnostics


def test_plain_pictures(tmp_path: Path) -> None:
    picture = 0.7 - 0.3 * np.random.default_rng(1).random((3, 200, 220)).astype(np.float32)
    options: dict[str, Any] = {"quantity": "display", "bands": ("red", "green", "blue"), "window": 64}
    wanted = skyscatter.dehaze(picture, **options)
    np.testing.assert_array_equal(skyscatter.dehaze(picture, executor=1, **options).reflectance, wanted.reflectance)


@pytest.mark.slow
def test_command(image: Path, tmp_path: Path) -> None:
    words = ["dehaze", str(image), "--sensor", "landsat-8", "--bands", "B2,B3,B4", "--sun-zenith", "40", "--aod", "0.3"]
    words += ["--quantity", "reflectance", "--window", "128", "-q"]
    for name, more in {"a.tif": [], "b.tif": ["--workers", "2"]}.items():
        assert main([*words, *more, "-o", str(tmp_path / name)]) == 0
    with rasterio.open(tmp_path / "a.tif") as one, rasterio.open(tmp_path / "b.tif") as two:
        np.testing.assert_array_equal(one.read(), two.read())
    assert main([*words, "--workers", "2", "--scheduler", "tcp://localhost:1", "-o", str(tmp_path / "c.tif")]) == 2


@pytest.mark.slow
def test_tables_are_the_same() -> None:
    atmosphere, red = Atmosphere(aerosol="maritime"), Band.from_shape("red", 665, 15)
    angles = Angles(sun_zenith=(40.0, 40.0), view_zenith=(0.0, 5.0), relative_azimuth=(90.0, 90.0))
    here, there = (
        build_table(atmosphere, [red], angles, aod=0.3, stokes=False, keep=False, executor=executor)
        for executor in (None, 2)
    )
    for name in ("aod", "sun_zenith", "view_zenith", "relative_azimuth", "values", "error"):
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name))
