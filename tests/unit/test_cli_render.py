"""``skyscatter render``: what it refuses, and what it hands to model, camera, solver and files (stand-ins here)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.cli import common
from skyscatter.cli.main import main
from skyscatter.image import SpectralImage
from skyscatter.image.png import read_png


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, Any]:
    """What a render function that only notes it was asked for."""
    notes: dict[str, Any] = {}

    def render(scene: Any, camera: Any, wavelengths: Any, **options: Any) -> SpectralImage:
        notes.update(options, scene=scene, camera=camera, wavelengths=wavelengths)
        options["progress"](1.0)
        cube = 1e-3 * np.random.default_rng(2).random((camera.height, camera.width, len(wavelengths)))
        return SpectralImage(cube, wavelengths, 0.02 * cube, recipe={"model": "room"})

    monkeypatch.setattr(skyscatter, "render", render, raising=False)
    monkeypatch.chdir(tmp_path)
    return notes


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--size", "512"], ["size", "512x256"]),
        (["--position", "1,2"], ["position", "'1,2'", "three lengths"]),
        (["--position", "1,2,3 miles"], ["position", "three lengths"]),
        (["--target", "3.75,0.35,1.45"], ["target", "where the observer stands"]),
        (["--up", "up"], ["up", "three numbers"]),
        (["--up", "0,0,0"], ["up", "must not be 0"]),
        (["--field-of-view", "60"], ["field_of_view", "unit"]),
        (["--field-of-view", "190deg"], ["fov_deg", "190"]),
        (["--solver", "orders"], ["solver", "path, photons"]),
        (["--solver", "path", "--photons", "1000"], ["photons", "--solver photons"]),
        (["--solver", "path", "--radius", "1cm"], ["radius", "--solver photons"]),
        (["--solver", "path", "--estimator", "paths"], ["estimator", "--solver photons"]),
        (["--solver", "photons", "--photons", "0"], ["photons = 0: a whole number, at least 1"]),
        (["--solver", "photons", "--radius", "wide"], ["radius", "'wide'"]),
        (["--subpixels", "0"], ["subpixels", "1 or more"]),
        (["--samples", "3", "--noise", "1%"], ["samples = 3: give samples or noise, not both"]),
        (["--sampling", "area", "--photons", "9"], ["photons = 9: no solver knows it beside --sampling; leave it out"]),
        (["--orders", "none"], ["orders", "1 or more"]),
        (["--tone", "loud"], ["tone", "filmic, linear"]),
        (["--bits", "12"], ["8 or 16"]),
        (["-o", "a.exr", "--tone", "linear"], ["tone", "PNG"]),
        (["-o", "a.jpg"], ["output", ".exr"]),
        (["--resume", "gone.npz"], ["gone.npz"]),
    ],
)
def test_wrong_input_is_refused_in_one_line(
    asked: dict[str, Any], capsys: pytest.CaptureFixture[str], arguments: list[str], words: list[str]
) -> None:
    named = arguments if "-o" in arguments else ["-o", "out.png", *arguments]
    assert main(["render", "fog-room", *named]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    for word in words:
        assert word in captured.err
    assert not asked


@pytest.mark.parametrize(
    ("command", "name", "words"),
    [
        ("sky", "fog-room", "a scene of surfaces; use skyscatter render"),
        ("nebula", "fog-room", "a scene of surfaces; use skyscatter render"),
        ("sky", "ring-nebula", "a nebula; use skyscatter nebula"),
        ("nebula", "earth", "a planet with its air; use skyscatter sky"),
    ],
)
def test_each_sort_of_model_has_its_command(
    asked: dict[str, Any], capsys: pytest.CaptureFixture[str], command: str, name: str, words: str
) -> None:
    assert main([command, name, "-o", "out.png"]) == 2
    assert f"model = '{name}': is {words}" in capsys.readouterr().err
    assert not asked


@pytest.mark.parametrize(("name", "option"), [("earth", "--sun-elevation"), ("ring-nebula", "--psf")])
def test_render_renders_whatever_the_model_is(capsys: pytest.CaptureFixture[str], name: str, option: str) -> None:
    """With the options of the command for it, wherever the name of the model stands; what it lacks is refused there."""
    command = skyscatter.load_model(name).command
    assert main(["render", "-o", "out.png", name, option, "x"]) == 2
    assert main([command, "-o", "out.png", name, option, "x"]) == 2
    by_render, by_command = capsys.readouterr().err.splitlines()
    assert by_render == by_command
    assert main(["render", name, "--position", "0,0,0"]) == 2
    assert f"see skyscatter {command} --help" in capsys.readouterr().err


def test_the_model_says_where_and_how_to_look(asked: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "fog-room", "--json", "-q", "--wavelengths", "500,600"]) == 0
    summary = json.loads(capsys.readouterr().out)
    model = skyscatter.load_model("fog-room")
    assert asked["scene"] == model.scene()
    assert asked["camera"] == model.camera
    assert asked["solver"] == skyscatter.Photons()  # there is fog
    assert not {"subpixels", "orders"} & set(asked)
    assert summary["size"] == [model.camera.width, model.camera.height]
    assert summary["seed"] == 0
    assert summary["noise"] == pytest.approx(0.02)
    assert summary["viewpoint"]["position_m"] == list(model.viewpoint.position)


def test_options_reach_camera_solver_and_files(asked: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    words = "--size 6x4 --position 1m,2m,30cm --target 0,0,0 --up 0,1,0 --field-of-view 40deg --solver photons"
    words += " --photons 1000 --radius 2cm --estimator paths --samples 8 --max-order 5 --orders 2 --subpixels 2"
    words += " --seed 7 --threads 1 --wavelengths 450,550,650 --exposure 3 --tone linear --bits 16 --json"
    assert main(["render", "fog-room", *words.split(), "-o", "a.png", "-o", "a.exr"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert asked["scene"].viewpoint.position == (1.0, 2.0, 0.3)
    assert asked["scene"].viewpoint.up == (0.0, 1.0, 0.0)
    assert (asked["camera"].width, asked["camera"].height, asked["camera"].fov_deg) == (6, 4, 40.0)
    given = {"photons": 1000, "radius": 0.02, "estimator": "paths", "samples": 8, "max_order": 5, "seed": 7}
    assert asked["solver"] == skyscatter.Photons(**given)
    assert (asked["orders"], asked["subpixels"], asked["threads"]) == (2, 2, 1)
    assert summary["exposure_ev"] == 3.0
    assert read_png("a.png").pixels.shape == (4, 6, 3)
    assert Path("a.exr").is_file()


def test_models_are_listed_shown_and_checked_by_sort(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models"]) == 0
    listed = capsys.readouterr().out
    surfaces = listed[listed.index("scenes of surfaces (skyscatter render):") :]
    assert "fog-room" in surfaces
    assert "star-in-dust" not in surfaces
    assert main(["models", "show", "milk-and-water"]) == 0
    shown = capsys.readouterr().out
    for words in (
        "milk: index 1.336",
        "311 um",
        "glass of water: turned, dielectric, glass inside",
        "10550 lumens, sun",
    ):
        assert words in shown
    assert main(["models", "check", "light-guide"]) == 0
    assert "good (2 media, 6 bodies, 4 lamps, 4 sources)" in capsys.readouterr().out
    assert main(["models", "show", "fog-room", "--plot", "a.png"]) == 2
    assert "make a picture: skyscatter render" in capsys.readouterr().err


def test_a_dark_scene_is_no_good_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "dark.toml"
    path.write_text('name = "dark"\n[viewpoint]\ntarget = [1, 0, 0]\n')
    assert main(["models", "check", str(path)]) == 2
    assert "nothing shines; add a lamp" in capsys.readouterr().err


def test_the_night_side_of_a_planet_does_not_tell_the_error_of_its_day() -> None:
    radiance = np.full((4, 4, 1), 1e-16)
    radiance[:1] = [[[1.0], [0.5], [0.1], [1e-4]]]  # a quarter has light
    error = np.where(radiance > 1e-9, 0.01, 70.0) * radiance
    image = SpectralImage(wavelengths=[550.0], radiance=radiance, standard_error=error)
    assert common.median_error(image) == pytest.approx(0.01)
    dark = SpectralImage(wavelengths=[550.0], radiance=np.zeros((4, 4, 1)), standard_error=np.zeros((4, 4, 1)))
    assert common.median_error(dark) is None
