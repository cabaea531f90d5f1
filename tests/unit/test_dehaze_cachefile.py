"""The folder of kept results: where it is, what comes back, and what happens when it is broken."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from skyscatter.dehaze import cachefile


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(cachefile.VARIABLE, str(tmp_path / "kept"))
    return tmp_path / "kept"


def test_what_is_kept_comes_back(folder: Path) -> None:
    path = cachefile.file_of("terms", "a description")
    assert path.parent == folder / "terms"
    assert cachefile.load(path) is None
    arrays = {"values": np.random.default_rng(1).normal(size=(3, 4)), "error": np.array(1e-4)}
    assert cachefile.save(path, arrays)
    back = cachefile.load(path)
    assert back is not None
    assert set(back) == set(arrays)
    for name, values in arrays.items():
        np.testing.assert_array_equal(back[name], values)
    assert [p.name for p in path.parent.iterdir()] == [path.name]  # and nothing temporary


def test_each_description_has_its_file() -> None:
    assert cachefile.file_of("terms", "a") == cachefile.file_of("terms", "a")
    assert len({cachefile.file_of(kind, words) for kind in ("terms", "psf") for words in ("a", "b")}) == 4


@pytest.mark.parametrize("damage", ["empty", "cut", "text", "folder"])
def test_broken_files_count_as_none(damage: str) -> None:
    path = cachefile.file_of("terms", damage)
    assert cachefile.save(path, {"values": np.arange(1000.0)})
    whole = path.read_bytes()
    if damage == "folder":
        path.unlink()
        path.mkdir()
    else:
        path.write_bytes({"empty": b"", "cut": whole[: len(whole) // 2], "text": b"not an archive"}[damage])
    assert cachefile.load(path) is None
    if damage != "folder":
        assert cachefile.save(path, {"values": np.arange(3.0)})
        back = cachefile.load(path)
        assert back is not None
        np.testing.assert_array_equal(back["values"], np.arange(3.0))


def test_objects_are_not_unpickled(folder: Path) -> None:
    path = cachefile.file_of("terms", "pickled")
    path.parent.mkdir(parents=True)
    np.savez(path, values=np.array([{"a": 1}], dtype=object))
    assert cachefile.load(path) is None


def test_a_folder_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(cachefile.VARIABLE, str(tmp_path / "file" / "below"))
    path = cachefile.file_of("terms", "anything")
    assert cachefile.save(path, {"values": np.zeros(1)}) is False
    assert cachefile.load(path) is None


@pytest.mark.parametrize(
    ("platform", "variables", "expected"),
    [
        ("linux", {"XDG_CACHE_HOME": "/x"}, Path("/x/skyscatter")),
        ("linux", {}, Path.home() / ".cache/skyscatter"),
        ("darwin", {}, Path.home() / "Library/Caches/skyscatter"),
        ("win32", {"LOCALAPPDATA": "/local"}, Path("/local/skyscatter")),
    ],
)
def test_the_place_of_each_platform(
    platform: str, variables: dict[str, str], expected: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in (cachefile.VARIABLE, "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", platform)
    assert cachefile.cache_folder() == expected
