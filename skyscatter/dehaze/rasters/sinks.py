"""Where results go: files that appear whole or not at all, and arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path, remove_beginnings
from skyscatter.errors import DomainError, SkyscatterError


class RasterSink(ABC):
    """An image that is written window by window, in any order, by one thread at a time.

    Leaving the ``with`` block finishes the file; leaving it by an exception leaves nothing behind, and what
    was at its place before is still there.
    """

    def __init__(self, height: int, width: int, count: int) -> None:
        self.height, self.width, self.count = height, width, count
        self.tags: dict[str, str] = {}

    @abstractmethod
    def write(self, row0: int, col0: int, values: NDArray[Any]) -> None:
        """Write a window.

        Parameters
        ----------
        row0, col0 : int
            Its first row and column.
        values : ndarray, shape (band, y, x) or, for one band, (y, x)
            NaN where there are no data.
        """

    def tag(self, tags: Mapping[str, Any]) -> None:
        """Note something about the result; it goes into the file where that can hold it."""
        self.tags.update({key: str(value) for key, value in tags.items()})

    def prepare(self) -> None:  # noqa: B027 - nothing to do is right for many
        """Everything that may still fail, but the move into place."""

    def commit(self) -> None:  # noqa: B027
        """Move the finished file into place."""

    def abort(self) -> None:  # noqa: B027
        """Leave nothing behind."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self.abort()
            return
        try:
            self.prepare()
            self.commit()
        except BaseException:
            self.abort()
            raise

    def _checked(self, row0: int, col0: int, values: NDArray[Any]) -> NDArray[Any]:
        cube = values[np.newaxis] if values.ndim == 2 else values
        inside = cube.ndim == 3 and 0 <= row0 <= self.height - cube.shape[1] and 0 <= col0 <= self.width - cube.shape[2]
        if not inside or cube.shape[0] != self.count:
            rule = f"must be {self.count} bands inside of {self.height} rows and {self.width} columns"
            raise DomainError("window", f"shape {values.shape} at ({row0}, {col0})", rule)
        return cube


SinkT = TypeVar("SinkT", bound=RasterSink)


@contextmanager
def together(sinks: Mapping[str, SinkT]) -> Iterator[Mapping[str, SinkT]]:
    """Several sinks that are finished together: none is moved into place before all of them are whole."""
    try:
        yield sinks
        for sink in sinks.values():
            sink.prepare()
        for sink in sinks.values():
            sink.commit()
    except BaseException:
        for sink in sinks.values():
            sink.abort()
        raise


class _AbandonedError(Exception):
    """Tells `atomic_path` that the file shall not be."""


class PendingFile:
    """A temporary path that becomes a file on `commit`; `atomic_path` in two steps."""

    def __init__(self, path: str | Path) -> None:
        self.shown = Path(path)
        self._manager = atomic_path(path)
        self.path = self._manager.__enter__()
        self._open = True

    def commit(self) -> None:
        """Move the file into place."""
        if self._open:
            self._open = False
            self._manager.__exit__(None, None, None)

    def abort(self) -> None:
        """Remove the file and all that was made beside it under its temporary name."""
        if self._open:
            self._open = False
            with suppress(_AbandonedError):
                self._manager.__exit__(_AbandonedError, _AbandonedError(), None)
        remove_beginnings(self.path)

    def explained(self, error: OSError) -> Exception:
        """Give the file up for an error of the operating system; the same error as one line with the remedy."""
        if self._open:
            self._open = False
            try:
                self._manager.__exit__(type(error), error, None)
            except SkyscatterError as said:
                return said
        return error


class ArraySink(RasterSink):
    """Results in memory.

    Attributes
    ----------
    array : ndarray, shape (band, y, x)
        NaN (0 for integers) until it is written.
    """

    def __init__(self, height: int, width: int, count: int, dtype: str = "float32") -> None:
        super().__init__(height, width, count)
        fill = np.nan if dtype.startswith("float") else 0
        self.array: NDArray[Any] = np.full((count, height, width), fill, dtype=dtype)

    def write(self, row0: int, col0: int, values: NDArray[Any]) -> None:
        """Write a window; see `RasterSink`."""
        cube = self._checked(row0, col0, values)
        self.array[:, row0 : row0 + cube.shape[1], col0 : col0 + cube.shape[2]] = cube
