"""Files appear whole or not at all: written beside their final place, then moved onto it in one step."""

from __future__ import annotations

import errno
import glob
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skyscatter.errors import SkyscatterError

_REMEDY = {
    errno.ENOENT: "its directory does not exist; make it first",
    errno.ENOTDIR: "a part of its path is a file, not a directory; choose another path",
    errno.EISDIR: "this is a directory; add a file name",
    errno.EACCES: "no permission to write there; choose another directory",
    errno.EPERM: "no permission to write there; choose another directory",
    errno.EROFS: "that file system is read-only; choose another directory",
    errno.ENOSPC: "the disk is full; free some space or choose another disk",
    errno.EDQUOT: "the disk quota is used up; free some space or choose another disk",
    errno.ENAMETOOLONG: "the file name is too long; choose a shorter one",
}

#: Files that are being written, under their temporary names.
_unfinished: set[Path] = set()


def discard_unfinished() -> None:
    """Remove what is being written at this moment: for a process that is about to end without unwinding."""
    for path in tuple(_unfinished):
        remove_beginnings(path)


def remove_beginnings(temporary: Path) -> None:
    """Remove a temporary file and what libraries have made beside it under its name."""
    for left in temporary.parent.glob(f"{glob.escape(temporary.stem)}*"):
        with suppress(OSError):
            left.unlink()


def _explain(path: Path, error: OSError) -> SkyscatterError:
    number = error.errno
    if number == errno.ENOENT and Path(os.path.realpath(path)).parent.is_dir():  # as in /proc
        return SkyscatterError(f"{path}: cannot be written: its directory takes no new files; choose another directory")
    text = " ".join((error.strerror or str(error)).split())
    if number is None and " space " in text:  # libraries that lose the number say it in words
        number = errno.ENOSPC
    remedy = _REMEDY.get(number or 0, text)
    return SkyscatterError(f"{path}: cannot be written: {remedy}")


def explained(error: OSError) -> str:
    """What the operating system refused, and the remedy, as one line."""
    text = error.strerror or str(error)
    remedy = _REMEDY.get(error.errno or 0, text)
    return f"{error.filename or 'standard output'}: {text if remedy == text else f'{text}: {remedy}'}"


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path to write to; on success it takes the place of `path`, on failure it is removed.

    Parameters
    ----------
    path : path-like
        Where the file shall be.  A symbolic link is followed: the file that it points to is replaced.

    Yields
    ------
    pathlib.Path
        An empty file in the same directory (so that the move stays within one file system) with the same extension.

    Raises
    ------
    SkyscatterError
        If the operating system refuses (missing directory, no permission, full disk): one line with the remedy.
        Any other exception of the body passes unchanged.  Whatever was at `path` before is then still there.
    """
    shown = Path(path)
    target = Path(os.path.realpath(shown))
    # Reserve room for the random part: the longest name that file systems take is 255 bytes.
    temporary = target.with_name(f".{target.stem[:100]}-{secrets.token_hex(6)}{target.suffix}")
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        # Unlike tempfile.mkstemp, this leaves the permissions to the user's umask.
        _unfinished.add(temporary)
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        _unfinished.discard(temporary)
        raise _explain(shown, error) from error
    try:
        yield temporary
        os.replace(temporary, target)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError) and not isinstance(error, SkyscatterError):
            raise _explain(shown, error) from error
        raise
    finally:
        _unfinished.discard(temporary)
