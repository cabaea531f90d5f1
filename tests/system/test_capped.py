"""Work larger than the memory it may take: a cube by a command, and a raster by workers."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from astropy.io import fits

import skyscatter
from skyscatter.cli.main import main
from skyscatter.solvers.large import StoredPicture

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is capped on Linux"),
]

MODEL = """
name = "globe"
[view]
distance = "400 pc"
[[stars]]
name = "A"
position = ["0 pc", "0 pc", "1 pc"]
temperature = 15000
luminosity = 800
[[components]]
name = "dust"
density = { kind = "sphere", radius = "0.1 pc" }
optics = { kind = "dust", hydrogen_density = 2e9 }
"""
#: Of address space [byte]: machine code, libraries and the stacks of threads are some 700 MB of it.
CAP = 1_000_000_000
SIZE, WAVELENGTHS = 1450, np.linspace(400.0, 720.0, 64)


def capped(words: list[str]) -> int:
    """Run a command in so much address space; its peak memory [byte]."""
    import resource

    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
    child = subprocess.Popen(
        words, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (CAP, CAP)), env=environment
    )
    peak = [0]

    def look() -> None:
        while child.poll() is None:
            lines = Path(f"/proc/{child.pid}/status").read_text().splitlines()
            peak[0] = max([peak[0], *(1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM"))])
            time.sleep(0.05)

    watch = threading.Thread(target=look, daemon=True)
    watch.start()
    assert child.wait(900) == 0
    watch.join()
    return peak[0]


def test_a_cube_larger_than_what_may_be_taken(tmp_path: Path) -> None:
    (tmp_path / "globe.toml").write_text(MODEL)
    words = [sys.executable, "-m", "skyscatter", "nebula", str(tmp_path / "globe.toml"), "--solver", "single", "-q"]
    words += ["--size", f"{SIZE}x{SIZE}", "--wavelengths", ",".join(f"{w:.12f}" for w in WAVELENGTHS)]
    words += ["--store", str(tmp_path / "run.zarr"), "-o", str(tmp_path / "cube.fits")]
    peak = capped(words)
    assert 8 * SIZE**2 * WAVELENGTHS.size > CAP > peak
    export = [sys.executable, "-m", "skyscatter", "store", "export", str(tmp_path / "run.zarr")]
    assert capped([*export, "-o", str(tmp_path / "cube.zarr")]) < CAP
    # Rows far from the star are the light along their rays and nothing else.
    scene = skyscatter.load_model(tmp_path / "globe.toml").scene()
    with fits.open(tmp_path / "cube.fits", memmap=True) as cube:
        wavelengths = cube["WCS-TABLE"].data["WAVELENGTH"].ravel().astype(float)
        camera = StoredPicture(tmp_path / "run.zarr").camera
        rows = [600, 601]
        directions = camera.through(np.arange(SIZE), np.array(rows)[:, None], scene.view)
        light = skyscatter.radiance(scene, scene.view.position, directions, wavelengths, solver="single").radiance
        written = np.stack([cube[0].data[:, SIZE - 1 - row].T for row in rows]).astype(float)
        assert light.max() > 0
        # Directions are made unit once more, which may move their last digit, and the length of a chord by the edge.
        np.testing.assert_allclose(written, light, rtol=1e-10)
    import xarray

    with xarray.open_zarr(tmp_path / "cube.zarr", chunks={}) as found:
        assert found["radiance"].shape == (SIZE, SIZE, WAVELENGTHS.size)
        np.testing.assert_array_equal(found["radiance"].isel(y=rows).values, written)


def test_a_raster_by_capped_workers(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    values = (0.08 + 0.3 * rng.random((3, 1500, 1400)) ** 2).astype(np.float32)
    path = tmp_path / "image.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=1400, height=1500, count=3, dtype="float32", crs="EPSG:32632",
        transform=Affine(30, 0, 5e5, 0, -30, 5e6),
    ) as file:  # fmt: skip
        file.write(values)
    words = ["dehaze", str(path), "--sensor", "landsat-8", "--bands", "B2,B3,B4", "--sun-zenith", "40", "--aod", "0.3"]
    words += ["--quantity", "reflectance", "-q", "--no-adjacency"]
    for name, more in {"a.tif": [], "b.tif": ["--workers", "2", "--worker-memory", "1GB"]}.items():
        assert main([*words, *more, "-o", str(tmp_path / name)]) == 0
    with rasterio.open(tmp_path / "a.tif") as one, rasterio.open(tmp_path / "b.tif") as two:
        np.testing.assert_array_equal(one.read(), two.read())
    # A window of this size and its copies do not fit beside what a worker takes when idle: one line, nothing written.
    short = ["--workers", "2", "--worker-memory", "350MB", "--window", "1400", "-o", str(tmp_path / "c.tif")]
    assert main([*words, *short]) == 2
    assert not (tmp_path / "c.tif").exists()
