"""``--preview``: what is finished is drawn in the terminal, nothing is changed by it, and it ends clean."""

from __future__ import annotations

import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rich.text import Text

import skyscatter
from skyscatter.cli.main import main
from skyscatter.cli.preview import HALF, Preview, ansi
from skyscatter.image import SpectralImage
from skyscatter.solvers.base import Answer
from skyscatter.solvers.state import RenderState

WL = np.array([450.0, 550.0, 650.0])
SKY = "sky earth-simple --sun-elevation 20 --wavelengths 450,550,650 --solver path --threads 1"


def state_of(rays: int) -> RenderState:
    return RenderState.empty({}, rays, WL.size)


def preview(state: RenderState | None, camera: object) -> Preview:
    scene = skyscatter.load_model("earth-simple").scene()
    return Preview(lambda: state, scene, camera, WL, "linear")


def answer(count: int, value: float) -> Answer:
    light = np.full((count, WL.size), value)
    return Answer(light, 0.1 * light, samples=np.ones(count, np.int64))


def test_finished_tiles_are_seen_and_the_rest_is_black() -> None:
    state = state_of(32 * 16)
    shown = preview(state, skyscatter.Panorama(width=32, height=16))
    assert shown.picture(32, 16) is None
    state.put(slice(0, 32 * 8), answer(32 * 8, 0.5))
    before = {name: np.copy(getattr(state, name)) for name in ("done", "radiance", "standard_error", "samples")}
    picture = shown.picture(32, 16)
    assert picture.shape == (16, 32, 3)
    assert picture[:8].min() > 0.1
    assert picture[8:].max() == 0.0
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(state, name), values)


def test_passes_are_seen_as_their_mean() -> None:
    state = state_of(32 * 16)
    state.total, state.passes = 10, 2
    state.sums = {"radiance": np.outer(np.linspace(0.5, 1.0, 32 * 16), np.ones(WL.size))}
    picture = preview(state, skyscatter.Panorama(width=32, height=16)).picture(80, 40)
    expected = SpectralImage(state.sums["radiance"].reshape(16, 32, 3) / 2, WL).picture(tone="linear")
    np.testing.assert_allclose(picture, expected, atol=1e-12)  # rounding


def test_a_large_picture_is_made_small_and_keeps_its_shape() -> None:
    state = state_of(400 * 200)
    values = np.zeros((200, 400, WL.size))
    values[:, 200:] = 1.0
    state.put(slice(0, 400 * 200), Answer(values.reshape(-1, WL.size), 0 * values.reshape(-1, WL.size),
                                          samples=np.ones(400 * 200, np.int64)))  # fmt: skip
    picture = preview(state, skyscatter.Panorama(width=400, height=200)).picture(40, 90)
    assert picture.shape == (20, 40, 3)
    assert picture[:, :20].max() == 0.0
    assert picture[:, 20:].min() > 0.1


def test_outside_of_a_fisheyes_field_it_is_black() -> None:
    camera = skyscatter.Fisheye(width=24, height=24)
    scene = skyscatter.load_model("earth-simple").scene()
    inside = np.isfinite(camera.directions(scene.observer)[..., 0])
    state = state_of(int(inside.sum()))
    state.put(slice(0, len(state.done)), answer(len(state.done), 0.5))
    picture = preview(state, camera).picture(24, 24)
    np.testing.assert_array_equal(picture.max(axis=-1) > 0.0, inside)


def test_characters_have_two_pixels_each_in_full_colour() -> None:
    picture = np.random.default_rng(1).random((6, 5, 3))
    text = Text.from_ansi(ansi(picture))
    assert text.plain == "\n".join([HALF * 5] * 3)
    found = re.findall(r"38;2;(\d+);(\d+);(\d+);48;2;(\d+);(\d+);(\d+)m", ansi(picture))
    pairs = np.array(found, int).reshape(3, 5, 2, 3)
    np.testing.assert_array_equal(pairs.transpose(0, 2, 1, 3).reshape(6, 5, 3), np.rint(255 * picture))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--store run.zarr", "store"),
        ("-q", "quiet"),
        ("--sun-elevations 20:10:-5", "preview"),
    ],
)
def test_refusals(words: str, message: str, monkeypatch, capsys, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    sky = SKY.replace("--sun-elevation 20 ", "") if "elevations" in words else SKY
    assert main([*sky.split(), *words.split(), "--size", "8x4", "--preview", "-o", "a.png"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_without_a_terminal_one_line_says_so(monkeypatch, capsys, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    words = [*SKY.split(), "--size", "16x8", "--samples", "2", "--progress", "none"]
    assert main([*words, "--preview", "-o", "a.nc"]) == 0
    error = capsys.readouterr().err
    assert error.count("--preview needs a terminal") == 1
    assert HALF not in error


def in_terminal(words: str, folder: Path, stop: bool = False) -> tuple[int, str]:
    """Exit status and what a terminal of 60 x 24 characters got of a command; ended by Ctrl-C once it shows pixels."""
    leader, follower = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLORTERM": "truecolor", "COLUMNS": "60", "LINES": "24"}
    command = [sys.executable, "-m", "skyscatter", *words.split()]
    run = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=follower)
    os.close(follower)
    seen, sent, until = b"", False, time.monotonic() + 240.0
    while time.monotonic() < until:
        try:
            seen += os.read(leader, 65536)
        except OSError:  # the command has closed its end
            break
        if stop and not sent and HALF.encode() in seen:
            run.send_signal(signal.SIGINT)
            sent = True
    os.close(leader)
    return run.wait(timeout=60), seen.decode()


def test_a_picture_grows_in_a_terminal_and_is_the_same(tmp_path: Path) -> None:
    words = f"{SKY} --size 48x24 --samples 16"
    status, seen = in_terminal(f"{words} --preview -o a.nc", tmp_path)
    assert status == 0
    assert HALF in seen
    assert "38;2;" in seen
    assert main([*words.split(), "-q", "-o", str(tmp_path / "b.nc")]) == 0
    first, second = (SpectralImage.load(tmp_path / name) for name in ("a.nc", "b.nc"))
    np.testing.assert_array_equal(first.radiance, second.radiance)
    np.testing.assert_array_equal(first.error, second.error)


def test_control_c_leaves_the_terminal_as_it_was(tmp_path: Path) -> None:
    status, seen = in_terminal(f"{SKY} --size 320x160 --samples 512 --preview -o a.nc", tmp_path, stop=True)
    assert status == 130
    assert "--resume a.nc.partial.zarr" in seen.replace("\r\n", "\n")
    assert seen.rfind("\x1b[?25h") > seen.rfind("\x1b[?25l")  # the cursor is back
    assert seen.rfind("\x1b[0m") > seen.rfind("\x1b[38;2;") or HALF not in seen[seen.rfind("\x1b[?25h") :]
