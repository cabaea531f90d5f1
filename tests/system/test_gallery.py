"""The gallery: its pictures are those of the commands in their captions, and the commands make pictures."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from skyscatter.cli import common
from skyscatter.cli.main import main
from skyscatter.image.png import read_png

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "gallery"
PAGE = (FOLDER / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^    skyscatter ((?:sky|nebula|render) .*)$", PAGE, re.MULTILINE)
#: Largest file, in bytes.
LARGEST = 1_500_000


def output(words: list[str]) -> Path:
    return FOLDER / words[words.index("-o") + 1]


def without(words: list[str], *options: str) -> list[str]:
    """The words but for these options and their values."""
    return [word for k, word in enumerate(words) if word not in options and (k == 0 or words[k - 1] not in options)]


@pytest.fixture
def recipe_of(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Scene, camera, wavelengths and solver that a command would render, without rendering it."""
    asked: list[dict[str, Any]] = []

    def note(request: Any, scene: Any, camera: Any, *_: Any, **__: Any) -> None:
        asked.append(
            {
                "scene": scene.model_dump(mode="json", exclude_none=True),
                "camera": camera.model_dump(mode="json"),
                "wavelengths_nm": request.wavelengths.tolist(),
                "solver": request.solver,
            }
        )
        raise KeyboardInterrupt  # as if it had been stopped at once

    monkeypatch.setattr(common, "render_request", note)
    monkeypatch.chdir(tmp_path)

    def ask(words: list[str]) -> Any:
        assert main(words) == 130
        return json.loads(json.dumps(asked.pop()))

    return ask


PICTURES = [
    words
    for words in map(shlex.split, COMMANDS)
    if (words[0] == "sky" and "--sun-elevations" not in words) or {"--smooth", "--denoise"} & set(words)
]


@pytest.mark.parametrize("words", PICTURES, ids=lambda words: output(words).name)
def test_a_picture_is_that_of_its_caption(words: list[str], recipe_of: Any) -> None:
    made = json.loads(read_png(output(words)).texts["skyscatter-recipe"])
    asked = recipe_of(words)
    assert {name: made[name] for name in asked} == asked
    if words[0] != "sky":
        assert made["options"]["samples"] == int(words[words.index("--samples") + 1])
    if "--smooth" in words:
        assert {"smoothed", "seeing_pixels"} <= set(made)
    if "--denoise" in words:
        assert made["denoising"]["error"] < made["denoising"]["raw_error"]


def test_the_readme_opens_with_the_picture_of_its_command(recipe_of: Any) -> None:
    for page in (ROOT / "README.md", ROOT / "docs" / "index.md"):
        text = page.read_text(encoding="utf-8")
        call = re.search(r"skyscatter (sky --place [^`\n]*)", text)
        assert call is not None
        assert "gallery/readme.png" in text
        made = json.loads(read_png(FOLDER / "readme.png").texts["skyscatter-recipe"])
        asked = recipe_of(shlex.split(call[1]))
        assert {name: made[name] for name in asked} == asked


def test_files_are_small_and_shown() -> None:
    shown = set(re.findall(r"!\[[^\]]*\]\(([^)]+)\)", PAGE)) | {"readme.png"}
    there = {path.relative_to(FOLDER).as_posix() for path in FOLDER.rglob("*.png")}
    assert shown - there == set()
    for name in there:
        assert (FOLDER / name).stat().st_size < LARGEST, name


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_its_command_makes_it(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small and coarse; the rest of the caption as it stands."""
    monkeypatch.chdir(tmp_path)
    words = without(shlex.split(command), "--size", "--samples", "--photons", "--noise")
    words += ["--size", "24x12", "-q"]
    if words[0] == "sky":
        words = [*without(words, "--wavelengths", "--tolerance"), "--wavelengths", "450,550,650", "--tolerance", "5%"]
    else:
        words += ["--samples", "2"]
    if "--solver" not in words and "--photons" in command:
        words += ["--photons", "2000"]
    assert main(words) == 0
    made = [path for path in tmp_path.glob("*.png") if not path.name.startswith(".")]
    assert made
    for path in made:
        pixels = read_png(path).pixels
        assert pixels.shape[:2] == (12, 24)
        assert pixels[..., :3].max() > 0
