"""Ctrl-C keeps the finished tiles, and the run goes on from there to the same picture."""

from __future__ import annotations

import signal

import numpy as np
import pytest

from skyscatter.cli.main import main
from skyscatter.image import SpectralImage
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
    assert f"skyscatter {COMMAND} -o sky.fits -o sky.png --resume sky.fits.partial.npz" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "sky.fits.partial.npz", "sky.partial.fits", "sky.partial.png",
    ]  # fmt: skip
    part = SpectralImage.load("sky.partial.fits").radiance
    finished = np.isfinite(part).all(axis=-1)
    assert 0 < finished.sum() < finished.size

    capsys.readouterr()
    other = COMMAND.replace("--seed 3", "--seed 4").split()
    assert main([*other, "-o", "other.fits", "--resume", "sky.fits.partial.npz"]) == 2
    assert capsys.readouterr().err.startswith("skyscatter: error: ")

    assert main([*COMMAND.split(), "-o", "sky.fits", "-o", "sky.png", "--resume", "sky.fits.partial.npz"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sky.fits", "sky.png"]
    assert main([*COMMAND.split(), "-o", "whole.fits"]) == 0
    resumed, whole = SpectralImage.load("sky.fits"), SpectralImage.load("whole.fits")
    # same seed, same numbers: every bit
    np.testing.assert_array_equal(resumed.radiance, whole.radiance)
    np.testing.assert_array_equal(resumed.standard_error, whole.standard_error)
    np.testing.assert_array_equal(part[finished], whole.radiance[finished])


def test_a_file_that_is_no_checkpoint_is_refused(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.npz").write_text("this is not a checkpoint")
    assert main([*COMMAND.split(), "-o", "sky.fits", "--resume", "text.npz"]) == 2
    assert "text.npz" in capsys.readouterr().err


def test_a_truncated_checkpoint_is_refused(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "half.npz").write_bytes(b"PK\x03\x04" + bytes(2000))
    assert main([*COMMAND.split(), "-o", "sky.fits", "--resume", "half.npz"]) == 2
    assert "half.npz: not a checkpoint" in capsys.readouterr().err
