"""Ctrl-C keeps the finished tiles, and the run goes on from there to the same picture."""

from __future__ import annotations

import signal

import numpy as np
import pytest

from skyscatter.cli.main import main
from skyscatter.image import SpectralImage
from skyscatter.image.png import read_png
from skyscatter.progress import Progress

# Large enough for several tiles, small enough for seconds.
COMMAND = "sky earth-simple --sun-elevation 20 --size 96x64 --wavelengths 450,550 --threads 1 -q"
COMMAND += " --solver path --samples 2 --seed 3"


@pytest.fixture
def interrupt_half_way(monkeypatch):
    """The signal of Ctrl-C, once, when a third of the picture is reported as done."""
    report = Progress.to
    sent = []

    def to(self, done):
        report(self, done)
        if done >= 0.33 and not sent:
            sent.append(done)
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Progress, "to", to)
    return sent


def test_an_interrupted_run_goes_on_to_the_same_picture(interrupt_half_way, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main([*COMMAND.split(), "-o", "sky.fits", "-o", "sky.png"]) == 130
    assert interrupt_half_way
    assert interrupt_half_way[0] < 1
    err = capsys.readouterr().err
    assert f"skyscatter {COMMAND} -o sky.fits -o sky.png --resume sky.fits.partial.zarr" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "sky.fits.partial.zarr", "sky.partial.fits", "sky.partial.png",
    ]  # fmt: skip
    part = SpectralImage.load("sky.partial.fits").radiance
    finished = np.isfinite(part).all(axis=-1)
    assert 0 < finished.sum() < finished.size

    capsys.readouterr()
    other = COMMAND.replace("--seed 3", "--seed 4").split()
    assert main([*other, "-o", "other.fits", "--resume", "sky.fits.partial.zarr"]) == 2
    assert capsys.readouterr().err.startswith("skyscatter: error: ")

    assert main([*COMMAND.split(), "-o", "sky.fits", "-o", "sky.png", "--resume", "sky.fits.partial.zarr"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sky.fits", "sky.png"]
    assert main([*COMMAND.split(), "-o", "whole.fits"]) == 0
    resumed, whole = SpectralImage.load("sky.fits"), SpectralImage.load("whole.fits")
    # same seed, same numbers: every bit
    np.testing.assert_array_equal(resumed.radiance, whole.radiance)
    np.testing.assert_array_equal(resumed.standard_error, whole.standard_error)
    np.testing.assert_array_equal(part[finished], whole.radiance[finished])


def test_an_interrupted_run_is_a_store(interrupt_half_way, capsys, monkeypatch, tmp_path):
    """It is listed, verified and exported as stores are; what is damaged of it is made again."""
    monkeypatch.chdir(tmp_path)
    assert main([*COMMAND.split(), "-o", "sky.fits"]) == 130
    capsys.readouterr()
    assert main(["store", "list", "sky.fits.partial.zarr"]) == 0
    assert "an interrupted run" in capsys.readouterr().out
    assert main(["store", "export", "sky.fits.partial.zarr", "-o", "part.fits"]) == 0
    part, seen = SpectralImage.load("part.fits").radiance, SpectralImage.load("sky.partial.fits").radiance
    np.testing.assert_array_equal(part, seen)
    assert main([*COMMAND.split(), "--store", "sky.fits.partial.zarr", "-o", "sky.fits"]) == 2
    assert "go on with --resume" in capsys.readouterr().err
    assert main(["store", "verify", "sky.fits.partial.zarr"]) == 0
    chunk = next(path for path in (tmp_path / "sky.fits.partial.zarr" / "values" / "c").rglob("*") if path.is_file())
    chunk.write_bytes(chunk.read_bytes()[:-9])
    assert main(["store", "verify", "sky.fits.partial.zarr"]) == 2
    assert main([*COMMAND.split(), "-o", "sky.fits", "--resume", "sky.fits.partial.zarr"]) == 0
    assert main([*COMMAND.split(), "-o", "whole.fits"]) == 0
    np.testing.assert_array_equal(SpectralImage.load("sky.fits").radiance, SpectralImage.load("whole.fits").radiance)


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_what_is_no_checkpoint_is_refused(kind, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    if kind == "file":
        (tmp_path / "mine").write_text("this is not a checkpoint")
    else:
        (tmp_path / "mine").mkdir()
    assert main([*COMMAND.split(), "-o", "sky.fits", "--resume", "mine"]) == 2
    err = capsys.readouterr().err
    assert "mine" in err
    assert err.count("\n") == 1


NOISY = {
    "tiles": "sky earth-simple --sun-elevation 20 --size 96x64 --solver path --samples 4 --denoise",
    "a nebula": "nebula dark-globule --size 64x64 --samples 4 --denoise",
    "a smooth picture": "nebula dark-globule --size 64x64 --samples 4 --smooth",
    "passes": "render fog-room --size 24x16 --solver photons --photons 1000 --samples 6 --denoise",
}


@pytest.mark.parametrize("words", NOISY.values(), ids=NOISY)
def test_noise_is_taken_off_as_if_nothing_had_been_interrupted(
    words, interrupt_half_way, capsys, monkeypatch, tmp_path
):
    """The halves of the walks that were finished are kept with them, and go on."""
    monkeypatch.chdir(tmp_path)
    command = [*words.split(), "--wavelengths", "450,550,650", "--threads", "1", "-q"]
    assert main([*command, "-o", "a.fits", "-o", "a.png"]) == 130
    assert 0 < interrupt_half_way[0] < 1
    assert "--resume a.fits.partial.zarr" in capsys.readouterr().err
    # nothing is denoised before it is whole, and the file does not say so
    assert not SpectralImage.load("a.partial.fits").is_denoised
    assert main([*command, "-o", "a.fits", "-o", "a.png", "--resume", "a.fits.partial.zarr"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.fits", "a.png"]
    assert main([*command, "-o", "whole.fits", "-o", "whole.png"]) == 0
    resumed, whole = SpectralImage.load("a.fits"), SpectralImage.load("whole.fits")
    assert resumed.is_denoised is ("--denoise" in words)
    assert list(resumed.layers) == list(whole.layers) == (["raw", "raw_error"] if "--denoise" in words else [])
    # same seed, same numbers: every bit
    np.testing.assert_array_equal(resumed.radiance, whole.radiance)
    np.testing.assert_array_equal(resumed.error, whole.error)
    for name, values in whole.layers.items():
        np.testing.assert_array_equal(resumed.layers[name], values)
    assert resumed.recipe.get("denoising") == whole.recipe.get("denoising")
    np.testing.assert_array_equal(read_png("a.png").pixels, read_png("whole.png").pixels)
