"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, SkyscatterError


def test_success_replaces(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with atomic_path(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".txt"
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def write_half(target: Path, failure: BaseException) -> None:
    with atomic_path(target) as temporary:
        temporary.write_text("half")
        raise failure


@pytest.mark.parametrize("failure", [ValueError("x"), KeyboardInterrupt(), DomainError("a", 1, "b")])
def test_failure_leaves_the_old_file_and_passes_the_error(tmp_path: Path, failure: BaseException) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(type(failure)):
        write_half(target, failure)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def fail_with(target: Path, number: int) -> None:
    with atomic_path(target):
        raise OSError(number, os.strerror(number))


@pytest.mark.parametrize(
    ("number", "words"),
    [(errno.ENOSPC, "disk is full"), (errno.EACCES, "no permission"), (errno.EIO, os.strerror(errno.EIO))],
)
def test_system_errors_become_one_line(tmp_path: Path, number: int, words: str) -> None:
    target = tmp_path / "a.txt"
    with pytest.raises(SkyscatterError, match=words) as caught:
        fail_with(target, number)
    assert str(caught.value).startswith(f"{target}: cannot be written: ")
    assert list(tmp_path.iterdir()) == []


def write(target: Path) -> None:
    with atomic_path(target) as temporary:
        temporary.write_text("x")


def test_unusable_targets(tmp_path: Path) -> None:
    with pytest.raises(SkyscatterError, match="does not exist; make it first"):
        write(tmp_path / "none" / "a.txt")
    with pytest.raises(SkyscatterError, match="this is a directory"):
        write(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(SkyscatterError, match="is a file, not a directory"):
        write(tmp_path / "file" / "a.txt")


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="only Linux has a folder that exists and takes no files")
def test_folders_that_take_no_files() -> None:
    with pytest.raises(SkyscatterError, match="takes no new files; choose another directory"):
        write(Path("/proc/a.txt"))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_no_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(SkyscatterError, match="no permission"):
            write(tmp_path / "a.txt")
    finally:
        tmp_path.chmod(0o700)


@pytest.mark.skipif(os.name == "nt", reason="permissions and links as on unix")
def test_permissions_follow_the_umask_and_links_are_followed(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.write_text("x")
    write(tmp_path / "ours")
    assert (tmp_path / "ours").stat().st_mode == plain.stat().st_mode
    link = tmp_path / "link"
    link.symlink_to(plain)
    with atomic_path(link) as temporary:
        temporary.write_text("through the link")
    assert link.is_symlink()
    assert plain.read_text() == "through the link"
