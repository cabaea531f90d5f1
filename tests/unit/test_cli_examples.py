"""Every command's help ends with two examples, and each of them is understood to the last word."""

from __future__ import annotations

import shlex
from importlib import import_module
from pathlib import Path

import pytest
import typer.main

import skyscatter
from skyscatter.cli.examples import EXAMPLES
from skyscatter.cli.main import app, main

ROOT = typer.main.get_command(app)


def commands(group, before=()):
    for name, command in group.commands.items():
        words = (*before, name)
        yield " ".join(words)
        if hasattr(command, "commands"):
            yield from commands(command, words)


def test_every_command_has_two_examples():
    assert set(commands(ROOT)) == set(EXAMPLES)
    assert all(len(lines) >= 2 for lines in EXAMPLES.values())


@pytest.mark.parametrize("name", list(EXAMPLES))
def test_help_shows_them_as_they_are_typed(name, capsys):
    assert main([*name.split(), "--help"]) == 0
    shown = capsys.readouterr().out
    for line in EXAMPLES[name]:
        assert line in shown


@pytest.mark.parametrize(("name", "line"), [(name, line) for name, lines in EXAMPLES.items() for line in lines])
def test_examples_are_understood(name, line, capsys, monkeypatch, tmp_path):
    """All but the work itself: files that are read are there, and the run only says that it would begin."""
    monkeypatch.chdir(tmp_path)
    begun = []
    for file in ("hazy.png", "image.tif", "sky.csv"):
        Path(file).touch()
    module = import_module(f"skyscatter.cli.{name.split()[0]}")
    if name.startswith("models check"):
        Path("mine.toml").write_text((Path(__file__).parents[2] / "models" / "mars.toml").read_text())
    if name.startswith("store"):
        scene = skyscatter.load_model("earth-simple").scene()
        camera = skyscatter.Panorama(width=8, height=4)
        skyscatter.render(scene, camera, [450, 550, 650], solver="single", store="run.zarr")
        begun.append(camera)
    if hasattr(module, "run"):
        monkeypatch.setattr(module, "run", lambda request, *more: begun.append(request) or 0)
    elif hasattr(module, "plot_model"):
        monkeypatch.setattr(module, "plot_model", lambda model, path: begun.append(path))
    words = shlex.split(line.partition(">")[0])
    assert words[0] == "skyscatter"
    assert main(words[1:]) == 0, capsys.readouterr().err
    assert begun or not hasattr(module, "run")
