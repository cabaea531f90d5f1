"""``--denoise`` from the command to the files, and what it has no meaning for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import skyscatter
from skyscatter.cli.main import main

WL = ["--wavelengths", "450,550,650"]


@pytest.mark.parametrize(
    "words",
    [
        "nebula dark-globule --size 40x40 --samples 16",
        "render fog-room --size 24x16 --solver photons --photons 1000 --samples 2 --subpixels 2",
        "sky earth --view fisheye --size 16x16 --solver path --samples 16",
    ],
)
def test_picture_files_and_summary(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    plain = [*words.split(), *WL, "--json", "-q"]
    assert main([*plain, "-o", "raw.nc"]) == 0
    before = json.loads(capsys.readouterr().out)
    assert main([*plain, "--denoise", "-o", "a.nc", "-o", "a.fits", "-o", "a.png"]) == 0
    after = json.loads(capsys.readouterr().out)
    raw, clean = skyscatter.SpectralImage.load("raw.nc"), skyscatter.SpectralImage.load("a.nc")
    assert before["denoising"] is None
    assert before["noise"] == after["noise"]  # that of what was computed
    assert after["denoising"] == clean.recipe["denoising"]
    assert after["denoising"]["error"] < after["denoising"]["raw_error"]
    np.testing.assert_array_equal(clean.undenoised.radiance, raw.radiance)
    np.testing.assert_array_equal(clean.undenoised.error, raw.error)
    assert not np.array_equal(clean.radiance, raw.radiance)
    assert "half_a" not in clean.layers
    assert Path("a.png").is_file()


def test_stars_of_a_nebula_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pixels with stars stand out of those around by what the stars add, which has no noise."""
    monkeypatch.chdir(tmp_path)
    assert (
        main(["nebula", "dark-globule", "--size", "40x40", "--samples", "16", *WL, "--denoise", "-q", "-o", "a.nc"])
        == 0
    )
    clean = skyscatter.SpectralImage.load("a.nc")
    raw = clean.undenoised
    stars = raw.radiance > 100 * raw.error.max()
    assert stars.sum() > 100
    change = np.abs(clean.radiance - raw.radiance)[stars]
    assert change.max() < 10 * raw.error.max()  # noise alone goes


def test_for_people(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    words = "nebula dark-globule --size 40x40 --samples 16 --denoise --progress none -o a.png"
    assert main([*words.split(), *WL]) == 0
    said = capsys.readouterr().err
    assert "; denoised by " in said
    assert "in place of" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("sky earth --denoise", "add --solver path"),
        ("nebula dark-globule --solver single --denoise", "add --solver path"),
        ("sky earth --solver path --stokes --samples 16 --size 8x4 --denoise", "done for I alone"),
        ("sky earth --solver path --samples 5 --size 8x4 --denoise", "an even number"),
        ("sky earth --solver path --sun-elevations 30:20:-5 --size 8x4 --denoise", "denoise"),
        ("nebula dark-globule --azimuths 0:90:45 --size 8x8 --denoise", "denoise"),
    ],
)
def test_refusals(
    words: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*words.split(), *WL, "-q", "-o", "a.png"]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not list(tmp_path.glob("a*"))
