"""Scene files beside domes: where they turn the picture, what the Sun is there, and what is refused."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skyscatter.cli.main import main
from skyscatter.geometry.vectors import direction_from_azimuth_elevation

SKY = ["sky", "earth-simple", "--solver", "single", "--wavelengths", "450,550,650", "--size", "16x8", "-q",
       "--sun-elevation", "30", "--sun-azimuth", "240"]  # fmt: skip


@pytest.mark.parametrize("middle", [0.0, 90.0, 237.0])
def test_mitsuba_turns_the_middle_to_its_azimuth(middle: float, tmp_path: Path) -> None:
    path = tmp_path / "dome.exr"
    assert main([*SKY, "--no-sun", "--view", f"panorama:{middle:g}", "--for", "mitsuba", "-o", str(path)]) == 0
    scene = ElementTree.parse(tmp_path / "dome.mitsuba.xml").getroot()
    matrix = scene.find("emitter[@type='envmap']/transform/matrix")
    assert matrix is not None
    turn = np.array(matrix.attrib["value"].split(), float).reshape(4, 4)[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) == pytest.approx(1)  # no mirror
    # Its +z is the middle of the picture, +y up and +x on the left.
    np.testing.assert_allclose(turn[:, 2], direction_from_azimuth_elevation(middle, 0), atol=1e-9)
    np.testing.assert_allclose(turn[:, 0], direction_from_azimuth_elevation(middle - 90, 0), atol=1e-9)
    sun = scene.find("emitter[@type='directional']/vector")
    assert sun is not None
    away = [float(sun.attrib[axis]) for axis in "xyz"]
    np.testing.assert_allclose(away, -direction_from_azimuth_elevation(240, 30), atol=1e-8)


def test_radiance_maps_directions_and_has_the_sun_in_watts(tmp_path: Path) -> None:
    path = tmp_path / "dome.hdr"
    scaled = ["--scale", "0.001"]
    view = ["--view", "panorama:90"]
    assert main([*SKY, *scaled, *view, "--no-sun", "--for", "radiance", "-o", str(path)]) == 0
    mapping = (tmp_path / "dome.cal").read_text()
    assert "/ (2*PI) + 0.25;" in mapping  # east, a quarter of the turn, is in the middle: 0.25 + 0.25 = 0.5
    words = (tmp_path / "dome.rad").read_text().split()
    glow = [float(x) for x in words[words.index("sky_glow") + 4 :][:3]]
    assert glow == pytest.approx([1000 / 179] * 3, rel=1e-6)
    light = [float(x) for x in words[words.index("sun_light") + 4 :][:3]]
    sun = json.loads((tmp_path / "dome.sun.json").read_text())["sun"]
    solid_angle = np.pi * np.radians(sun["angular_diameter_deg"] / 2) ** 2
    lux = 179 * solid_angle * np.array(light) @ [0.2126, 0.7152, 0.0722]
    assert lux == pytest.approx(sun["illuminance_lx"], rel=1e-3)  # weights of four digits


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--no-sun", "--for", "povray", "-o", "dome.exr"], "choose one of mitsuba, radiance"),
        (["--no-sun", "--for", "radiance", "-o", "dome.exr"], "takes .hdr: write -o dome.hdr"),
        (["--for", "mitsuba", "-o", "dome.exr"], "--no-sun"),
        (["--no-sun", "--for", "mitsuba", "-o", "dome.png"], "-o FILE.exr"),
        (["--no-sun", "--for", "mitsuba", "--view", "fisheye", "-o", "dome.exr"], "dome of the whole sphere"),
        (["--no-sun", "--for", "mitsuba", "--size", "16x9", "-o", "dome.exr"], "dome of the whole sphere"),
        (["--no-sun", "--for", "mitsuba", "--view", "panorama-upper", "-o", "dome.exr"], "dome of the whole sphere"),
    ],
)
def test_what_makes_no_scene_is_refused(
    words: list[str], said: str, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*SKY, *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


def test_scene_files_are_not_replaced(tmp_path: Path, capsys: Any) -> None:
    there = tmp_path / "dome.mitsuba.xml"
    there.write_text("mine")
    assert main([*SKY, "--no-sun", "--for", "mitsuba", "--no-clobber", "-o", str(tmp_path / "dome.exr")]) == 2
    assert "dome.mitsuba.xml" in capsys.readouterr().err
    assert there.read_text() == "mine"
