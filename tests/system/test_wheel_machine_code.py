"""A wheel with machine code: its first sky, nebula and room load no compiler, and have the compiler's bits.

One is built for the best level of the processor, or SKYSCATTER_WHEEL names one, all of whose levels are then tried
that the processor runs.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from skyscatter.kernels import ahead

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = {
    "sky": ["sky", "earth", "--size", "32x16"],
    "twilight": ["sky", "earth-hazy", "--size", "16x8", "--sun-elevation", "-4", "--stokes"],
    "walks": ["sky", "earth-maritime", "--size", "16x8", "--solver", "path", "--samples", "4"],
    "nebula": ["nebula", "ring-nebula", "--size", "16x16", "--samples", "4"],
    "dust": ["nebula", "reflection-nebula", "--size", "16x16", "--solver", "single"],
    "room": ["render", "fog-room", "--size", "16x12", "--samples", "2", "--solver", "path"],
    "photons": ["render", "fog-room", "--size", "16x12", "--samples", "2", "--solver", "photons", "--photons", "2000"],
}
RUN = """
import sys
from skyscatter.cli.main import main
status = main(sys.argv[1:])
print("scipy" in sys.modules, "numba" in sys.modules)
raise SystemExit(status)
"""
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which(os.environ.get("CC", "cc")) is None, reason="needs a C compiler"),
]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if "SKYSCATTER_WHEEL" in os.environ:
        return Path(os.environ["SKYSCATTER_WHEEL"]).resolve()
    folder = tmp_path_factory.mktemp("wheel")
    tree = folder / "tree"
    ignored = shutil.ignore_patterns("__pycache__", ".git", ".venv", "gallery", ".*_cache")
    shutil.copytree(ROOT, tree, ignore=ignored)
    environment = {**os.environ, "SKYSCATTER_COMPILE": ahead.levels()[0]}
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    done = subprocess.run(build, cwd=tree, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert not (tree / "skyscatter/kernels/machine").exists()
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps"]
    subprocess.run([*pip, "--target", str(target), str(wheel)], check=True)
    return target


def picture(installed: Path, folder: Path, name: str, **variables: str) -> tuple[bytes, str]:
    """The bytes of a command's picture, and what it said on stdout."""
    folder.mkdir(exist_ok=True)
    environment = {**os.environ, "PYTHONPATH": str(installed), "PYTHONSAFEPATH": "1", **variables}
    command = [sys.executable, "-c", RUN, *COMMANDS[name], "-q", "-o", f"{name}.exr", "-o", f"{name}.png"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return (folder / f"{name}.png").read_bytes(), done.stdout


def test_it_is_for_this_sort_of_machine_and_small(wheel: Path) -> None:
    assert platform.machine() in wheel.name
    assert wheel.stat().st_size < (20e6 if "SKYSCATTER_WHEEL" in os.environ else 15e6)  # two more levels may take 5 MB
    names = zipfile.ZipFile(wheel).namelist()
    assert "skyscatter/kernels/machine/list.json" in names
    assert f"skyscatter/kernels/machine/{ahead.levels()[0]}.so" in names


@pytest.mark.parametrize("name", COMMANDS)
def test_the_first_picture_needs_no_compiler_and_no_cache(installed: Path, tmp_path: Path, name: str) -> None:
    found, said = picture(installed, tmp_path / "a", name, HOME="/nonexistent", NUMBA_CACHE_DIR="")
    assert said.split()[-1] == "False", "numba was loaded"
    if name == "sky":
        assert said.split()[-2] == "False", "scipy was loaded, a seventh of a second for the default sky"
    expected, said = picture(installed, tmp_path / "b", name, SKYSCATTER_MACHINE_CODE="0")
    assert said.split()[-1] == "True"
    assert found == expected


@pytest.mark.parametrize("name", COMMANDS)
def test_every_level_has_the_bits_of_a_compiler_for_that_level(installed: Path, tmp_path: Path, name: str) -> None:
    machine = installed / "skyscatter" / "kernels" / "machine"
    said = json.loads((machine / ahead.LIST).read_text())
    lower = [level for level in ahead.levels()[1:] if level in said["levels"]]
    if not lower:
        pytest.skip("the wheel has no other level that this processor runs")
    for level in lower:
        alone = tmp_path / level
        alone.mkdir()
        (alone / f"{level}.so").symlink_to(machine / f"{level}.so")
        (alone / ahead.LIST).write_text(json.dumps({**said, "levels": [level]}))
        found, words = picture(installed, tmp_path / "other", name, SKYSCATTER_MACHINE_CODE=str(alone))
        assert words.split()[-1] == "False", f"{level} was not used"
        compiler = {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        expected, _ = picture(installed, tmp_path / "compiled", name, SKYSCATTER_MACHINE_CODE="0", **compiler)
        assert found == expected, level


def test_info_says_so(installed: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(installed), "PYTHONSAFEPATH": "1"}
    command = [sys.executable, str(installed / "bin" / "skyscatter")]
    said = subprocess.run([*command, "info"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert ", in use" in said.stdout
    said = subprocess.run([*command, "warm"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert "nothing to compile" in said.stdout
