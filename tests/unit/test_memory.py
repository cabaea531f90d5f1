"""Pictures that memory does not hold are refused before any work, in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skyscatter import memory
from skyscatter.cli.main import main
from skyscatter.errors import DomainError


@pytest.mark.parametrize(
    "command",
    [
        ["sky", "earth-simple", "--size", "65536x65536"],
        ["sky", "earth-simple", "--size", "65536x65536", "--solver", "path", "--view", "fisheye"],
        ["nebula", "reflection-nebula", "--size", "65536x65536"],
        ["render", "fog-room", "--size", "65536x65536", "--subpixels", "4"],
    ],
)
def test_pictures_that_do_not_fit_are_refused(command, capsys, tmp_path):
    assert main([*command, "-o", str(tmp_path / "a.exr")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("skyscatter: error: size = '65536x65536': at 41 wavelengths it takes some ")
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_is_free_counts(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 10**9)
    assert memory.check_picture(100, 100, 41) < 10**9
    with pytest.raises(DomainError, match=r"some 4\d* GB of memory, and 1 GB are free"):
        memory.check_picture(20000, 10000, 41)
    monkeypatch.setattr(memory, "available_bytes", lambda: None)
    memory.check_picture(20000, 10000, 41)


def test_a_limit_of_the_process_counts():
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_AS)
    free = memory.available_bytes()
    assert free is None or free > 0
    pages = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (pages + 2**28, before[1]))
    try:
        assert 0 < memory.available_bytes() <= 2**28
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def test_layers_and_wavelengths_cost():
    plain, more = memory.picture_bytes(10, 10, 40), memory.picture_bytes(10, 10, 40, layers=6)
    assert more - plain == 2 * 6 * 8 * 40 * 100
    # the picture itself, and its state, at least
    assert plain > 4 * np.zeros((10, 10, 40)).nbytes


@pytest.mark.parametrize(("count", "text"), [(3.2e9, "3.2 GB"), (4.56e12, "4.56 TB"), (5e6, "5 MB")])
def test_bytes_as_words(count, text):
    assert memory.format_bytes(count) == text


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["sky", "earth-simple"], "wavelengths = 41: a solution by orders to 0.005 takes some "),
        (["flux", "earth-simple"], "wavelengths = 15: a solution by orders to 0.005 takes some "),
        (["render", "fog-room", "--solver=photons", "--threads=2"], "wavelengths = 41: 2 threads with their photons "),
    ],
)
def test_what_solvers_take_is_refused_before_they_begin(command, words, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 10**6)
    suffix = "a.csv" if command[0] == "flux" else "a.exr"
    size = [] if command[0] == "flux" else ["--size", "8x4"]
    assert main([*command, *size, "-o", str(tmp_path / suffix)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"skyscatter: error: {words}")
    assert " of memory, and 1 MB are free; give fewer wavelengths" in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_data_that_do_not_fit_are_refused(capsys, tmp_path, monkeypatch):
    lines = ["azimuth_deg,elevation_deg,wavelength_nm,radiance,sigma,sun_elevation_deg"]
    lines += [f"90,{e},{w},0.1,0.002,40" for e in range(10, 50) for w in range(400, 700)]
    (tmp_path / "sky.csv").write_text("\n".join(lines) + "\n")
    monkeypatch.setattr(memory, "available_bytes", lambda: 10**6)
    command = ["invert", "earth-hazy", "--data", str(tmp_path / "sky.csv"), "--free", "haze.optical_depth"]
    assert main([*command, "-o", str(tmp_path / "fit.json")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("skyscatter: error: data = '12000 values': with 1 free parameter they take some 4 MB ")
    assert error.count("\n") == 1


def test_more_of_anything_takes_more():
    of_field = {"nodes": 30, "suns": 10, "moments": 40, "wavelengths": 41, "rows": 90}
    of_photons = {"rays": 500, "points": 1000, "wavelengths": 41, "layers": 3, "threads": 4}
    for count, given in ((memory.field_bytes, of_field), (memory.photon_bytes, of_photons)):
        for name in given:
            assert count(**given | {name: 2 * given[name]}) > count(**given)
    # the field itself, twice in single precision, and four orders
    assert memory.field_bytes(**of_field) > 8 * 90 * 10 * 40 * 41 + 32 * 30 * 10 * 40 * 41
