"""Open raster files: one handle a thread, errors of one line, quiet about pictures that have no georeference."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from skyscatter.errors import MissingDataError, SkyscatterError

#: Blocks that GDAL keeps in memory [byte]; its own choice is a twentieth of all there is, whatever that may be.
CACHE_BYTES = 256 << 20
_OPENING = threading.RLock()


def require_rasterio() -> Any:
    """The module rasterio, or one line that says how to get it."""
    try:
        import rasterio
    except ImportError as error:
        raise SkyscatterError("rasterio is not installed: pip install rasterio") from error
    return rasterio


def raster_errors() -> tuple[type[Exception], ...]:
    """What rasterio raises: its own errors, and now and then those of GDAL as they are."""
    rasterio = require_rasterio()
    from rasterio._err import CPLE_BaseError

    return rasterio.errors.RasterioError, CPLE_BaseError


@contextmanager
def quiet() -> Iterator[None]:
    """Without the warning that a file has no georeference; a picture need not have any."""
    from rasterio.errors import NotGeoreferencedWarning

    # The filters belong to the process, so that only one thread at a time may change and restore them.
    with _OPENING, warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        yield


@contextmanager
def environment(*, writing: bool = False) -> Iterator[None]:
    """GDAL with bounded memory; around everything that reads and writes.

    Parameters
    ----------
    writing : bool
        Also without files of GDAL's own beside ours.  Those beside images that are read stay in use: they may hold the
        scale.
    """
    rasterio = require_rasterio()
    options: dict[str, Any] = {"GDAL_CACHEMAX": CACHE_BYTES}
    if writing:
        options |= {"GDAL_PAM_ENABLED": "NO", "GDAL_TIFF_INTERNAL_MASK": True}
        # Of overviews on their way into a COG: compressing them took most of the time.
        options["COG_TMP_COMPRESSION"] = "NONE"
    with rasterio.Env(**options):
        yield


def first_line(error: BaseException) -> str:
    """What a library says of an error, as one line; the cause behind it where that says more."""
    deepest: BaseException = error
    while deepest.__cause__ is not None:
        deepest = deepest.__cause__
    return " ".join(str(deepest).split()) or type(deepest).__name__


def _said(error: BaseException, *names: str) -> str:
    """What was said of a file, without its name again."""
    text = first_line(error)
    for name in names:
        text = text.removeprefix(f"'{name}'").removeprefix(name)
    return text.lstrip(": ").rstrip(".")


class _Handle:
    """A dataset of one thread, with what that thread holds while it reads: GDAL crashes where another closes it."""

    def __init__(self, dataset: Any) -> None:
        self.dataset = dataset
        self.busy = threading.RLock()


class DatasetPool:
    """A raster file that many threads may read; each has its own handle.

    Parameters
    ----------
    path : str
        For GDAL, such as ``/vsizip/a.zip/b.jp2``.
    shown : str
        The file as the user knows it.

    Raises
    ------
    MissingDataError
        If it cannot be opened.
    """

    def __init__(self, path: str, shown: str) -> None:
        self.path, self.shown = path, shown
        self._local = threading.local()
        self._handles: list[_Handle] = []
        self._handle()

    def _handle(self) -> _Handle:
        """The dataset of this thread."""
        handle: _Handle | None = getattr(self._local, "handle", None)
        if handle is None:
            rasterio = require_rasterio()
            try:
                with quiet():
                    dataset = rasterio.open(self.path)
                    dataset.transform  # noqa: B018 - warns here, if at all, and not in a thread later
            except raster_errors() as error:
                raise MissingDataError(
                    self.shown,
                    f"cannot be opened as a raster ({_said(error, self.path, self.shown)}); check that it is whole",
                ) from error
            handle = self._local.handle = _Handle(dataset)
            with _OPENING:
                self._handles.append(handle)
        return handle

    @contextmanager
    def reading(self) -> Iterator[Any]:
        """The dataset of this thread, which nobody closes meanwhile; errors of reading become one line."""
        try:
            handle = self._handle()
            with handle.busy:
                yield handle.dataset
        except raster_errors() as error:
            remedy = f"is damaged or cut short ({_said(error, self.path, self.shown)}); get the file again"
            raise MissingDataError(self.shown, remedy) from error

    def close(self) -> None:
        """Close the handles of all threads once what they read is read; the next one who asks gets a new one."""
        with _OPENING:
            handles, self._handles = self._handles, []
            self._local = threading.local()
        for handle in handles:
            with handle.busy:
                handle.dataset.close()
