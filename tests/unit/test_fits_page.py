"""The page on FITS files: what it names is in the files, and its example runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

import skyscatter
from skyscatter.image.spectral import SpectralImage

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "files-fits.md").read_text(encoding="utf-8")
NAMED = [name for cell in re.findall(r"^\| (.*?) \|", PAGE, re.M) for name in re.findall(r"`(\S+?)`", cell)]
EXAMPLE = re.search(r"```python\n(.*?)```", PAGE, re.S)[1]
#: Sorts of pictures that have all of it between them.
COLOURS = np.array([450.0, 500.0, 550.0, 600.0, 650.0])


def of_a_sky(stokes: bool = False) -> SpectralImage:
    scene = skyscatter.load_model("earth-simple").scene_at(50, 8, "2026-06-21T12:00")
    camera = skyscatter.Fisheye(width=2, height=2)
    return skyscatter.render(scene, camera, COLOURS, solver=skyscatter.Path(samples=4), stokes=stokes)


def pictures(folder: Path) -> list[Path]:
    sky, cube = of_a_sky(stokes=True), np.ones((2, 2, 5))
    uneven = [450.0, 500.0, 550.0, 600.0, 700.0]
    nebula = SpectralImage(cube, uneven, cube, recipe={"solver": "orders"}, layers={"once": cube})
    nebula = nebula.placed(skyscatter.SkyFrame(ra_deg=1, dec_deg=2, pixel_scale_deg=0.1, distance="5 pc", name="x"))
    files = [folder / f"{name}.fits" for name in ("sky", "packed", "nebula", "filters", "denoised")]
    sky.save(files[0])
    sky.save(files[1], compress=True)
    nebula.save(files[2])
    nebula.save(files[3], filters="V", unit="ABmag/arcsec2")
    halves = {"half_a": cube, "half_b": cube}
    SpectralImage(cube, uneven, cube, recipe={"solver": "path"}, layers=halves).denoised("nlm").save(files[4])
    return files


def test_what_it_names_is_in_the_files(tmp_path: Path) -> None:
    found: set[str] = set()
    for path in pictures(tmp_path):
        with fits.open(path) as hdus:
            for hdu in hdus:
                names = hdu.columns.names if isinstance(hdu, fits.BinTableHDU) and hdu.columns else []
                found |= {hdu.name, *hdu.header, *names}
    assert len(NAMED) > 30
    assert sorted(set(NAMED) - found - {"LAYER2", "FILTER2"}) == []


def test_its_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(EXAMPLE, "files-fits.md", "exec"), {})
    assert re.match(r"mag arcsec-2 \(Vega\): \d+\.\d at elevation \d\d deg", capsys.readouterr().out)
