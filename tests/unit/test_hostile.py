"""Hostile input ends in one line that says what is wrong, never in a traceback."""

from __future__ import annotations

import errno
import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fuzz
import numpy as np
import pytest

import skyscatter
from skyscatter.cli.main import main
from skyscatter.errors import MissingDataError, ModelFileError
from skyscatter.fields import VoxelGrid
from skyscatter.optics.mie import LogNormalMode, MieAerosol
from skyscatter.surfaces import Mesh

MIE: dict[str, Any] = {"refractive_index_real": 1.5, "refractive_index_imag": 0.0, "optical_depth": 0.1}


@pytest.mark.parametrize("number", range(20))
def test_fuzzed_command_lines_and_models_end_in_one_line(number: int) -> None:
    with fuzz.nothing_is_rendered():
        _, finding = fuzz.run(number, main, sorts=("commands", "skies"))
    assert finding is None


@pytest.mark.parametrize(
    ("radius", "changed", "said"),
    [(2e-7, {"refractive_index_real": 1e6}, "refractive_index"), ("0.2 km", {}, "radii"), (1e-3, {}, "radii")],
)
def test_spheres_that_would_take_hours_are_refused(radius: Any, changed: dict[str, Any], said: str) -> None:
    narrow = 1.0 if radius == 1e-3 else 1.6  # a single size needs angles without end
    mode = LogNormalMode(median_radius=radius, geometric_standard_deviation=narrow)
    with pytest.raises(ValueError, match=said):
        MieAerosol(modes=(mode,), **(MIE | changed)).optical_properties([550.0])


def test_what_is_no_mode_is_refused() -> None:
    with pytest.raises(ValueError, match="modes"):
        MieAerosol(modes=("sand",), **MIE)


def test_long_values_and_names_are_cut(tmp_path: Path) -> None:
    long = tmp_path / "long.toml"
    long.write_text(f'name = "{"x" * 3000}"\n{"y" * 3000} = 1\n[planet]\nradius = "{"z" * 3000}"\n')
    with pytest.raises(ModelFileError) as refused:
        skyscatter.load_model(str(long))
    lines = str(refused.value).splitlines()
    assert len(lines) > 1
    assert all(len(line) < 1000 for line in lines)


def test_brackets_without_end_and_names_that_no_file_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nested = tmp_path / "nested.toml"
    nested.write_text("x = " + "[" * 2000 + "]" * 2000)
    for name, said in (
        (str(nested), "nested"),
        ("a\0b", "no such model"),
        ("a\0b.toml", "null"),
        ("x" * 300, "no such"),
    ):
        with pytest.raises(ModelFileError, match=said):
            skyscatter.load_model(name)
    for arguments in (["sky", "earth", "-o", "x" * 300 + ".png"], ["sky", "earth", "--resume", "x" * 300 + ".npz"]):
        assert main(arguments) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    for name in ("a\0.obj", "x" * 300 + ".obj"):
        with pytest.raises(MissingDataError):
            _ = Mesh(file=name).triangles


def _obj(path: Path) -> None:
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n")


def _ply(path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    path.write_text(f"{head}element face 2\nproperty list uchar int vertex_indices\nend_header\n"
                    "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")  # fmt: skip


@pytest.mark.parametrize(("name", "make", "said"), [("a.obj", _obj, "from 1"), ("a.ply", _ply, "cut short")])
def test_damaged_meshes_are_refused(tmp_path: Path, name: str, make: Callable[[Path], None], said: str) -> None:
    make(tmp_path / name)
    with pytest.raises(MissingDataError, match=said):
        _ = Mesh(file=str(tmp_path / name)).triangles


@pytest.mark.parametrize("name", ["cube.fits", "cube.npy", "cube.npz"])
def test_damaged_grids_are_refused(tmp_path: Path, name: str) -> None:
    from astropy.io import fits

    path = tmp_path / name
    if name.endswith(".fits"):
        fits.writeto(path, np.ones((2, 2, 2)))
        path.write_bytes(
            path.read_bytes().replace(b"BITPIX  =                  -64", b"BITPIX  =                  -6x")
        )
    else:
        np.save(path, np.ones((2, 2, 2))) if name.endswith("y") else np.savez(path, values=np.ones((2, 2, 2)))
        path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(MissingDataError):
        VoxelGrid(file=str(path), spacing="1 pc").terms()


def test_full_disk_behind_stdout_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Full(io.StringIO):
        def flush(self) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sys, "stdout", Full())
    assert main(["--version"]) == 2
    assert "disk is full" in capsys.readouterr().err


def test_kernels_compile_without_a_folder_to_keep_them(tmp_path: Path) -> None:
    code = (
        "from numba.core import caching\n"
        "caching.CacheImpl._locator_classes = []\n"
        "from skyscatter.kernels.jit import entry\n"
        "twice, thrice = entry(lambda x: 2 * x), entry(lambda x: 3 * x)\n"
        "assert (twice(2), thrice(2)) == (4, 6)\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert result.stderr.count("cannot be kept") == 1
