"""Frames of a sequence: the picture that a render gives, exposures that follow, files that are there once and whole."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.cli.main import main
from skyscatter.cli.sequence import parse_angles, parse_times
from skyscatter.errors import DomainError
from skyscatter.solvers import sequence
from skyscatter.solvers.sequence import Frames, adapted, field_for, frame

WAVELENGTHS = [450, 550, 650]
WORDS = ["sky", "earth-simple", "--size", "32x16", "--wavelengths", "450,550,650", "--tolerance", "2%", "-q"]


def scenes(*elevations: float, model: str = "earth-simple", **more: Any) -> list[Any]:
    air = skyscatter.load_model(model)
    return [air.scene(sun_elevation_deg=e, sun_azimuth_deg=170 - e, **more) for e in elevations]


@pytest.mark.slow
def test_a_frame_agrees_with_a_render_of_its_own() -> None:
    """Two solutions, each within the tolerance of 0.5 %."""
    camera = skyscatter.Panorama(width=300, height=10, elevation_min_deg=0.0)
    found = scenes(-3, 20)
    field = field_for(found, camera, WAVELENGTHS)
    for scene in found:
        rendered = skyscatter.render(scene, camera, WAVELENGTHS)
        off = frame(field, scene, camera).radiance / rendered.radiance - 1
        assert np.abs(off).max() < 0.01
        assert np.abs(off).mean() < 0.002


def test_one_field_is_for_one_air() -> None:
    mixed = [*scenes(10), *scenes(10, model="mars")]
    with pytest.raises(DomainError, match="one field is for one air"):
        field_for(mixed, skyscatter.Panorama(width=8, height=4), WAVELENGTHS)


def test_exposures_follow_and_overexpose_nothing() -> None:
    rng = np.random.default_rng(3)
    for step in (0.1, 0.5):
        own = np.cumsum(rng.normal(size=200))
        found = adapted(own, step)
        assert np.abs(np.diff(found)).max() <= step + 1e-12
        assert np.all(found >= own), "a higher exposure value is a darker picture"
        assert np.all(np.isclose(found, own) | (found > own))
        slow = np.linspace(0, 1, 200)
        np.testing.assert_allclose(adapted(slow, step), slow, atol=1e-12)


def test_times_and_elevations() -> None:
    assert len(parse_times("2026-06-21T00:00:2026-06-21T23:45:15min")) == 96
    assert parse_times("2026-06-21/2026-06-22/12h")[1] == "2026-06-21T12:00:00"
    assert parse_times("2026-06-21T04:00:00+02:00:2026-06-21T04:00:30+02:00:10s")[-1] == "2026-06-21T04:00:30+02:00"
    assert parse_angles("40:-10:-25", "sun_elevations", 90.0) == (40.0, 15.0, -10.0)
    assert parse_angles("0.3:0:-0.1", "sun_elevations", 90.0) == pytest.approx((0.3, 0.2, 0.1, 0.0))
    assert parse_angles("5,1", "sun_elevations", 90.0) == (5.0, 1.0)
    backwards, mixed = "2026-06-22:2026-06-21:1h", "2026-06-21:2026-06-22T00:00Z:1h"
    for bad in ("2026-06-21T04:00", backwards, mixed, "2026-06-21:2026-06-22:0s", "a:b:c"):
        with pytest.raises(DomainError, match="times"):
            parse_times(bad)
    for bad in ("10:20:-1", "1:2:0", "95", "x", "1:2"):
        with pytest.raises(DomainError, match="sun_elevations"):
            parse_angles(bad, "sun_elevations", 90.0)


def test_numbered_files_and_going_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [*WORDS[:-1], "--json", "--progress", "none"]
    words += ["--sun-elevations", "20:-4:-8", "-o", str(tmp_path / "day.png")]
    assert main(words) == 0
    summary = json.loads(capsys.readouterr().out)
    files = [tmp_path / f"day-{k:04d}.png" for k in range(1, 5)]
    assert [Path(name) for name in summary["outputs"]] == files
    before = [file.read_bytes() for file in files]
    assert len(set(before)) == 4
    assert sorted(tmp_path.iterdir()) == files, "nothing else is left"
    for more in (["--workers", "1"], ["--threads", "1"]):
        assert main([*words, *more]) == 0
        assert [file.read_bytes() for file in files] == before


def test_an_interrupted_sequence_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = [*WORDS, "--sun-elevations", "20:-4:-8", "-o", str(tmp_path / "day.gif")]
    made: list[int] = []
    real = sequence.written

    def stopping(frames: Frames, number: int, *rest: Any) -> bytes:
        if number == 2 and 2 not in made:
            made.append(number)
            raise KeyboardInterrupt
        made.append(number)
        return real(frames, number, *rest)

    monkeypatch.setattr(sequence, "written", stopping)
    assert main([*words, "--threads", "1"]) == 130
    assert not (tmp_path / "day.gif").exists()
    first, made[:] = [k for k in made if k != 2], [2]
    assert main([*words, "--threads", "1"]) == 0
    assert sorted({*first, *made[1:]}) == [0, 1, 2, 3]
    assert not set(first[:-1]) & set(made[1:]), "what was there is not made again"
    assert (tmp_path / "day.gif").stat().st_size > 100
    assert [path.name for path in tmp_path.iterdir()] == ["day.gif"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # the reader leaves its pipes open
@pytest.mark.parametrize("suffix", [".mp4", pytest.param(".webm", marks=pytest.mark.slow)])
def test_films(suffix: str, tmp_path: Path) -> None:
    imageio = pytest.importorskip("imageio.v3")
    pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / f"day{suffix}"
    assert main([*WORDS, "--sun-elevations", "20:0:-5", "-o", str(path), "--frame-rate", "5"]) == 0
    film = np.stack(list(imageio.imiter(path)))
    assert film.shape == (5, 16, 32, 3)
    assert film[0].mean() > film[-1].mean() > 0


def test_models_are_frames_too(tmp_path: Path) -> None:
    words = ["sky", "earth-simple,mars", *WORDS[2:], "--solver", "single", "-o", str(tmp_path / "a.exr")]
    words.remove("--tolerance")
    words.remove("2%")
    assert main(words) == 0
    one, two = (skyscatter.SpectralImage.load(tmp_path / f"a-000{k}.exr") for k in (1, 2))
    assert one.radiance.shape == two.radiance.shape == (16, 32, 3)
    assert not np.array_equal(one.radiance, two.radiance)


@pytest.mark.parametrize(
    "words",
    [
        ["--sun-elevations", "10:0:-5"],  # no output
        ["--sun-elevations", "10:0:-5", "-o", "a.png", "-o", "b.png"],
        ["--sun-elevations", "10:0:-5", "--sun-elevation", "3", "-o", "a.png"],
        ["--times", "2026-06-21/2026-06-22/1h", "-o", "a.png"],
        ["--times", "2026-06-21/2026-06-22/1h", "--place", "48,11", "--time", "2026-06-21", "-o", "a.png"],
        ["--sun-elevations", "10:0:-5", "--stokes", "-o", "a.fits"],
        ["--sun-elevations", "10:0:-5", "--store", "x.zarr", "-o", "a.png"],
        ["--exposure-step", "0.2", "-o", "a.png"],
        ["-o", "a.mp4"],
    ],
)
def test_what_contradicts_itself_is_refused(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*WORDS, *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_turn_around_a_nebula(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["nebula", "reflection-nebula", "--solver", "single", "--size", "12x8", "--wavelengths", "450,550,650"]
    turn = ["--azimuths", "0:90:45", "-o", str(tmp_path / "turn.png")]
    assert main([*words, *turn, "--json", "--progress", "none"]) == 0
    summary = json.loads(capsys.readouterr().out)
    frames = [Path(name).read_bytes() for name in summary["outputs"]]
    assert summary["frames"] == len(frames) == 3
    assert len(set(frames)) > 1, "it is seen from several sides"
    alone = ["--azimuths", "0:90:45"]
    for bad in (["--azimuth", "3", *turn], alone, ["--frame-rate", "3"], [*turn, "--store", "x.zarr"]):
        assert main([*words, *bad]) == 2
        assert capsys.readouterr().err.count("\n") == 1
