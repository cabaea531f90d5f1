"""Names and lines over pictures of the sky: they stand where the stars stand, and only where they are asked for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.celestial.constellations import constellation_lines
from skyscatter.celestial.frames import Sight
from skyscatter.celestial.stars import stars_at
from skyscatter.cli.main import main
from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.image.chart import courses, marked, named
from skyscatter.image.horizon import sky_view
from skyscatter.image.png import read_png

PLACE, TIME = (48.86, 2.35), "2026-01-12T22:00:00"
SIGHT = Sight(*PLACE, TIME)
CAMERAS = [
    skyscatter.Fisheye(width=200, height=200),
    skyscatter.Panorama(width=240, height=120),
    skyscatter.Panorama(
        width=200, height=80, elevation_min_deg=-8, elevation_max_deg=37, centre_azimuth_deg=170, fov_deg=120
    ),
    skyscatter.Perspective(width=160, height=120, azimuth_deg=160, elevation_deg=40, fov_deg=60),
]  # fmt: skip


def image_of(camera: Any, **more: Any) -> Any:
    scene = skyscatter.sky_at(PLACE, TIME, **more)
    recipe = {"scene": scene.model_dump(mode="json", exclude_none=True), "camera": camera.model_dump(mode="json")}
    return skyscatter.SpectralImage(np.zeros((camera.height, camera.width, 1)), [550], recipe=recipe)


def view_of(camera: Any, **more: Any) -> Any:
    view = sky_view(image_of(camera, **more))
    assert view is not None
    return view


def test_lines_join_stars_of_one_constellation() -> None:
    table = read_table("constellation_lines.csv")
    pairs = {tuple(sorted(pair)) for pair in zip(table["from_hip"], table["to_hip"], strict=True)}
    # Orion's belt, the handle of the Plough, the Square of Pegasus and the long bar of the Southern Cross.
    for pair in [(26311, 26727), (25930, 26311), (62956, 65378), (677, 113881), (60718, 61084)]:
        assert pair in pairs
    ends = constellation_lines(SIGHT)
    length = np.degrees(np.arccos(np.clip(np.sum(ends[:, 0] * ends[:, 1], axis=-1), -1, 1)))
    assert np.all(length > 0.05)
    # Hydra's and Eridanus' longest are some 20 degrees.
    assert np.all(length < 30)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: f"{camera.kind}-{camera.width}")
def test_marks_stand_where_the_stars_stand(camera: Any) -> None:
    view = view_of(camera)
    found = {name: (x, y) for name, x, y in named(view, SIGHT)}
    stars = stars_at(SIGHT, limit=3.0)
    for name, towards in zip(stars.names, stars.directions, strict=True):
        x, y = camera.pixel(towards, view.scene.observer)
        if name and np.isfinite(x) and towards[2] > 0.01:
            assert found[name] == pytest.approx((float(x), float(y)))
        if towards[2] < -0.01:
            assert name not in found
    assert {"Rigel", "Sirius"} & set(found) or camera.kind == "perspective"
    assert "Neptune" not in found, "nobody sees it"
    pieces = courses(view, SIGHT)
    assert pieces
    for piece in pieces:
        assert np.all((piece > -0.5 - 1e-9) & (piece < [camera.width - 0.5 + 1e-9, camera.height - 0.5 + 1e-9]))
        # Nothing runs across the picture from one side to the other.
        assert np.abs(np.diff(piece[:, 0])).max() <= 0.5 * camera.width


def test_lines_are_parts_of_great_circles() -> None:
    """A pinhole shows them straight."""
    for piece in courses(view_of(CAMERAS[3]), SIGHT):
        along, off = np.linalg.svd(piece - piece.mean(axis=0))[1][:2] if len(piece) > 2 else (1.0, 0.0)
        assert off < 1e-6 * max(along, 1.0)


def test_higher_observers_see_farther_down() -> None:
    camera = CAMERAS[1]
    low, high = (len(named(view_of(camera, altitude=h), Sight(*PLACE, TIME, h))) for h in (0.0, 2e5))
    assert high > low


def test_marks_only_where_asked() -> None:
    image, grey = image_of(CAMERAS[0]), np.full((200, 200, 3), 0.2)
    assert np.array_equal(marked(image, grey, False, False), grey)
    lines, names = marked(image, grey, False, True), marked(image, grey, True, False)
    for drawn in (lines, names):
        changed = np.any(drawn != grey, axis=-1).mean()
        assert 0.01 < changed < 0.4
        assert drawn.min() >= 0
        assert drawn.max() <= 1
    assert not np.array_equal(lines, names)
    plain = skyscatter.SpectralImage(np.zeros((2, 2, 1)), [550])
    with pytest.raises(DomainError, match="place and a time"):
        marked(plain, np.zeros((2, 2, 3)), True, False)


def test_by_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    where = ["earth-simple", "--place", "48.86,2.35", "--time", TIME, "--lights", "stars"]
    words = ["sky", *where, "--size", "96x96", "--view", "fisheye", "--wavelengths", "450,550,650", "-q"]
    assert main([*words, "-o", "a.png"]) == 0
    assert main([*words, "--label", "--lines", "-o", "b.png"]) == 0
    a, b = read_png(Path("a.png")), read_png(Path("b.png"))
    assert json.loads(b.texts["skyscatter-picture"])["labels"] is True
    assert a.texts["skyscatter-recipe"] == b.texts["skyscatter-recipe"]
    assert 0.02 < np.any(a.pixels != b.pixels, axis=-1).mean() < 0.5
    for wrong, word in [
        (["sky", "--label", "-o", "c.png"], "needs --place and --time"),
        ([*words, "--lines", "--show", "degree", "-o", "c.png"], "means nothing to --show degree"),
        ([*words, "--lines", "-o", "c.exr"], "is for PNG files"),
    ]:
        assert main(wrong) == 2
        assert word in capsys.readouterr().err
