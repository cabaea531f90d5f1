"""Every script in examples/ runs from an empty directory, checks its own number and leaves the files it names."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import skyscatter

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
WRITES = {
    "air_mass.py": (),
    "clear_ground.py": (),
    "eclipse_crescents.py": ("eclipse_crescents.png",),
    "first_sky.py": ("first_sky.png",),
    "moonlit_snow.py": ("moonlit_snow.png",),
    "neutral_points.py": ("neutral_points.png",),
    "night_strip.py": ("night_strip.png",),
    "own_nebula.py": ("own_nebula.png", "own_nebula.fits"),
    "own_planet.py": ("my-planet.toml", "my-planet.png"),
    "reflection_nebula.py": ("reflection_nebula.png", "reflection_nebula.fits"),
    "twilight_ozone.py": ("twilight_ozone.png",),
    "twilight_sequence.py": ("twilight_sequence.png",),
    "zenith_and_horizon.py": ("zenith_and_horizon.png",),
}


def test_every_example_is_tested_and_listed() -> None:
    # Those with numbers are notebooks: test_notebooks.py.
    scripts = {path.name for path in EXAMPLES.glob("[!0-9]*.py")}
    assert scripts == set(WRITES)
    text = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert [name for name in sorted(scripts) if f"`{name}`" not in text] == []


#: Several seconds to a quarter of a minute and more each; what they show is tested elsewhere.
LONG = {
    "air_mass.py", "clear_ground.py", "eclipse_crescents.py", "moonlit_snow.py", "neutral_points.py", "night_strip.py",
    "reflection_nebula.py", "twilight_ozone.py", "twilight_sequence.py", "zenith_and_horizon.py",
}  # fmt: skip


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in sorted(WRITES)])
def test_example_runs_and_its_number_is_right(name: str, tmp_path: Path) -> None:
    source = EXAMPLES / name
    # The package under test, wherever it comes from: another copy would compile its own kernels.  32 pixels keep each
    # script to a few seconds.
    path = os.pathsep.join([str(Path(skyscatter.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]).rstrip(
        os.pathsep
    )
    environment = {**os.environ, "SKYSCATTER_EXAMPLE_SIZE": "32", "PYTHONPATH": path}
    done = subprocess.run(
        [sys.executable, str(source)], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(WRITES[name])
    for written in WRITES[name]:
        assert (tmp_path / written).stat().st_size > 100, written
    assert len(source.read_text(encoding="utf-8").splitlines()) <= 60
