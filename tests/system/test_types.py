"""What a type checker says of a user's file: every public name is known, none is merely anything."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest
from conftest import ROOT

import skyscatter
from skyscatter.models import files as model

PUBLIC = (
    "skyscatter", "skyscatter.dehaze", "skyscatter.fields", "skyscatter.inversion", "skyscatter.surfaces",
    "skyscatter.window",
)  # fmt: skip

USE = """
from pathlib import Path
from skyscatter.dehaze import Band

planet: skyscatter.Model = skyscatter.load_model("earth")
scene: skyscatter.Scene = planet.scene(sun_elevation_deg=10.0, altitude="2 km")
nebula: skyscatter.SpaceScene = skyscatter.load_model("reflection-nebula").scene()
room: skyscatter.SurfaceScene = skyscatter.load_model("fog-room").scene()
any_of_them = skyscatter.load_model(Path("mine.toml"))
name: str = any_of_them.name
if isinstance(any_of_them, skyscatter.NebulaModel):
    field = any_of_them.view.distance
image: skyscatter.SpectralImage = skyscatter.render(scene, skyscatter.Panorama(width=8, height=4), [450.0, 550.0])
image.save("sky.png")
clear: skyscatter.dehaze.DehazeResult = skyscatter.dehaze("image.tif", aod=0.1)
sensor: skyscatter.dehaze.Sensor = skyscatter.dehaze.load_sensor("landsat-8")
bands: list[Band] = list(sensor.bands)
"""
MISUSE = ("skyscatter.no_such_name", "skyscatter.dehaze.no_such_name", "planet.scene(sun_elevation=3.0)", "nebula.sun")


def test_every_shipped_name_has_the_type_of_its_model() -> None:
    kinds = {"sky": model.SkyName, "nebula": model.NebulaName, "render": model.SurfaceName}
    for command, names in kinds.items():
        of_command = [name for name in skyscatter.model_names() if skyscatter.load_model(name).command == command]
        assert sorted(get_args(names)) == of_command


@pytest.mark.slow
def test_mypy_strict_accepts_every_public_name_and_knows_it(tmp_path: Path) -> None:
    names = [f"{package}.{name}" for package in PUBLIC for name in import_module(package).__all__]
    lines = [*(f"import {package}" for package in PUBLIC), *USE.splitlines()]
    good = len(lines) + len(names)
    lines += [f"reveal_type({name})" for name in names] + list(MISUSE)
    user = tmp_path / "user.py"
    user.write_text("\n".join(lines))
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--config-file=", "--no-pretty"]
    environment = os.environ | {"MYPYPATH": str(ROOT)}
    result = subprocess.run([*command, user.name], cwd=tmp_path, env=environment, capture_output=True, text=True)
    wrong = [int(line) for line in re.findall(r"user\.py:(\d+): error", result.stdout)]
    assert sorted(set(wrong)) == list(range(good + 1, good + 1 + len(MISUSE))), result.stdout
    revealed = re.findall(r'Revealed type is "(.*)"', result.stdout)
    assert len(revealed) == len(names)
    assert "Any" not in revealed, [name for name, kind in zip(names, revealed, strict=True) if kind == "Any"]
