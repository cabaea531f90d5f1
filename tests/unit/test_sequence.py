"""Frames of a sequence: the picture that a render gives, exposures that follow, files that are there once and whole."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
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

    def stopping(frames: Frames, number: int, *rest: Any) -> dict[str, bytes]:
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


def test_a_sequence_in_a_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is interrupted goes on, the solution too; other files of the same frames cost nothing; programs share."""
    run = tmp_path / "run.zarr"
    words = [*WORDS, "--sun-elevations", "20:-4:-8"]
    kept = [*words, "--store", str(run)]
    assert main([*words, "-o", str(tmp_path / "plain.png")]) == 0
    made: list[int] = []
    real = sequence.written

    def counted(frames: Frames, number: int, *rest: Any) -> dict[str, bytes]:
        made.append(number)
        if len(made) == 3:
            raise KeyboardInterrupt
        return real(frames, number, *rest)

    monkeypatch.setattr(sequence, "written", counted)
    assert main([*kept, "--threads", "1", "-o", str(tmp_path / "a.png")]) == 130
    monkeypatch.setattr("skyscatter.solvers.series.Series.first", lambda *_: pytest.fail("the field is solved twice"))
    with ThreadPoolExecutor(2) as pool:  # two programs
        assert list(pool.map(lambda name: main([*kept, "-o", str(tmp_path / name)]), ("a.png", "b.png"))) == [0, 0]
    assert len(made) == 5, "a frame is made once, but for the interrupted one"
    monkeypatch.setattr(sequence, "written", lambda *_: pytest.fail("all frames are there"))
    assert main([*kept, "-o", str(tmp_path / "c.gif")]) == 0
    assert main(["store", "export", str(run), "-o", str(tmp_path / "d.png")]) == 0
    for k in range(1, 5):
        wanted = (tmp_path / f"plain-{k:04d}.png").read_bytes()
        assert all((tmp_path / f"{name}-{k:04d}.png").read_bytes() == wanted for name in "abd")
    assert (tmp_path / "c.gif").stat().st_size > 100
    capsys.readouterr()
    assert main(["store", "list", str(run), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["finished"], summary["tasks"]) == (4, 4)
    assert main(["store", "list", str(run)]) == 0
    assert "4 of 4 frames" in capsys.readouterr().out
    frame_file = next(run.rglob("frame-000002.npz"))
    frame_file.write_bytes(frame_file.read_bytes()[:-30])
    assert main(["store", "verify", str(run), "--repair"]) == 0
    assert "part frame-000002" in capsys.readouterr().out
    monkeypatch.setattr(sequence, "written", real)
    assert main([*kept, "-o", str(tmp_path / "e.png")]) == 0
    assert (tmp_path / "e-0002.png").read_bytes() == (tmp_path / "plain-0002.png").read_bytes()
    assert main([*kept, "--exposure", "14", "-o", str(tmp_path / "f.png")]) == 2
    assert "other look" in capsys.readouterr().err


@pytest.mark.parametrize("solver", ["orders", "single"])
def test_domes_and_polarised_frames(solver: str, tmp_path: Path) -> None:
    """Frames without the Sun's disk have it as a lamp beside them; polarised ones have Q, U and V: as renders have."""
    words = ["sky", "earth-simple", "--size", "32x16", "--wavelengths", "450,550,650", "-q", "--solver", solver]
    words += ["--tolerance", "2%"] if solver == "orders" else []
    words += ["--sun-elevations", "20,10"]
    stokes = ["--stokes"] if solver == "orders" else []
    assert main([*words, "--no-sun", *stokes, "-o", str(tmp_path / "dome.exr")]) == 0
    assert main([*words, *stokes, "-o", str(tmp_path / "sun.fits"), "--view", "panorama"]) == 0
    domes = [tmp_path / f"dome-000{k}.exr" for k in (1, 2)]
    suns = [tmp_path / f"sun-000{k}.fits" for k in (1, 2)]
    lamps = [json.loads(path.with_suffix(".sun.json").read_text()) for path in domes]
    assert lamps[0] != lamps[1]
    alone = [*words[:-2], "--sun-elevation", "20", *stokes, "-o", str(tmp_path / "one.exr"), "--no-sun"]
    assert main(alone) == 0
    wanted = json.loads((tmp_path / "one.sun.json").read_text())
    assert lamps[0] == wanted
    dome, sun = (skyscatter.SpectralImage.load(paths[0]) for paths in (domes, suns))
    far = np.asarray(sun.radiance) < 100 * np.nanmedian(sun.radiance)
    assert (~far).any()
    np.testing.assert_allclose(np.asarray(dome.radiance)[far], np.asarray(sun.radiance)[far], rtol=1e-6)
    one = skyscatter.SpectralImage.load(tmp_path / "one.exr")
    # Two solutions, each to 2 %, and twice that where little light comes.
    np.testing.assert_allclose(dome.radiance, one.radiance, rtol=0.08 if stokes else 1e-6)
    if stokes:
        for name in ("Q", "U", "V"):
            scale = np.abs(one.radiance).mean()
            assert np.abs(np.asarray(sun.layers[name]) - one.layers[name]).max() < 0.05 * scale
        assert np.abs(sun.layers["Q"]).max() > 0.1 * np.nanmedian(sun.radiance)
        shown = [*words, "--show", "degree", "-o", str(tmp_path / "degree.png")]
        assert main(shown) == 0
        assert (tmp_path / "degree-0001.png").read_bytes() != (tmp_path / "degree-0002.png").read_bytes()


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
        ["--sun-elevations", "10:0:-5", "--resume", "x.zarr", "-o", "a.png"],
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


GLOBE = """
name = "globe"
view = { distance = "400 pc" }
stars = [{ name = "A", position = ["0.04 pc", "0 pc", "0.08 pc"], temperature = 15000, luminosity = 800 }]
[[components]]
name = "dust"
density = { kind = "sphere", radius = "0.1 pc" }
optics = { kind = "dust", hydrogen_density = 2e9 }
"""


def test_a_turn_around_a_nebula(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "globe.toml").write_text(GLOBE)
    words = ["nebula", str(tmp_path / "globe.toml"), "--solver", "single", "--size", "12x8"]
    words += ["--wavelengths", "450,550,650"]
    turn = ["--azimuths", "0:90:45", "-o", str(tmp_path / "turn.png")]
    assert main([*words, *turn, "--json", "--progress", "none"]) == 0
    summary = json.loads(capsys.readouterr().out)
    frames = [Path(name).read_bytes() for name in summary["outputs"]]
    assert summary["frames"] == len(frames) == 3
    assert len(set(frames)) > 1, "it is seen from several sides"
    alone = ["--azimuths", "0:90:45"]
    capsys.readouterr()
    uneven = [*turn, "--inclinations", "0,40"]
    for bad in (["--azimuth", "3", *turn], alone, uneven, ["--frame-rate", "3"], [*turn, "--psf", "1arcsec"]):
        assert main([*words, *bad]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_path_around_a_nebula(tmp_path: Path) -> None:
    """Both angles go frame by frame; each frame is what the command makes with its angles."""
    model, run = tmp_path / "globe.toml", tmp_path / "run.zarr"
    model.write_text(GLOBE)
    words = ["nebula", str(model), "--solver", "single", "--size", "12x8", "--wavelengths", "450,650", "-q"]
    words += ["--pixel-scale", "20arcsec"]
    path = ["--azimuths", "0,30,90", "--inclinations", "0:90:45", "--store", str(run)]
    for name in ("a", "b"):
        assert main([*words, *path, "-o", str(tmp_path / f"{name}.fits")]) == 0
    assert main([*words, "--azimuth", "30", "--inclination", "45", "-o", str(tmp_path / "one.fits")]) == 0
    one = skyscatter.SpectralImage.load(tmp_path / "one.fits").radiance
    frames = [skyscatter.SpectralImage.load(tmp_path / f"b-000{k}.fits").radiance for k in (1, 2, 3)]
    np.testing.assert_array_equal(frames[1], one)
    assert not np.array_equal(frames[0], frames[2])
