"""Pictures that memory does not hold, written strip by strip: some rows at a time, from the top.

A source says how large the picture is and makes the rows that it is asked for.  What it makes of them, and of the
whole, is what `SpectralImage.save` would write: the same numbers, headers and attributes.
"""

from __future__ import annotations

import importlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError, SkyscatterError

if TYPE_CHECKING:
    from skyscatter.image.skyframe import SkyFrame
    from skyscatter.image.spectral import SpectralImage

#: Bytes of the spectra in a strip, as far as a row is not more than that.
STRIP = 16_000_000
#: Extension -> module and the options that its writer takes.
WRITERS: dict[str, tuple[str, tuple[str, ...]]] = {
    ".fits": ("fitsstrips", ("dtype",)),
    ".exr": ("exrstrips", ("spectral", "scale", "half")),
    ".nc": ("arraystrips", ("dtype",)),
    ".zarr": ("arraystrips", ("dtype",)),
}


class Source(Protocol):
    """A picture that is made some rows at a time."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """(y, x, wavelength)."""

    @property
    def sky(self) -> SkyFrame | None:
        """Where the whole picture stands in the sky."""

    @property
    def filled(self) -> bool:
        """Whether every pixel has light: none is NaN."""

    def rows(self, first: int, last: int) -> SpectralImage:
        """The rows from `first` on and before `last`, without their place in the sky."""


@dataclass(frozen=True)
class Whole:
    """A picture in memory as a source.

    Parameters
    ----------
    image : SpectralImage
    """

    image: SpectralImage

    @property
    def shape(self) -> tuple[int, int, int]:
        """(y, x, wavelength)."""
        return self.image.shape

    @property
    def sky(self) -> SkyFrame | None:
        """Where it stands in the sky."""
        return self.image.sky

    @property
    def filled(self) -> bool:
        """Whether every pixel has light."""
        return bool(self.image.inside.all())

    def rows(self, first: int, last: int) -> SpectralImage:
        """Some of its rows."""
        from skyscatter.image.spectral import SpectralImage

        image, some = self.image, slice(first, last)
        layers = {name: values[some] for name, values in image.layers.items()}
        error = None if image.error is None else image.error[some]
        return SpectralImage(image.radiance[some], image.wavelengths, error, recipe=image.recipe, layers=layers)


@dataclass(frozen=True)
class Outline:
    """A picture as its headers describe it: its size, but none of its numbers."""

    shape: tuple[int, int, int]
    sky: SkyFrame | None
    recipe: dict[str, Any]

    @property
    def radiance(self) -> NDArray[np.float64]:
        """Of the shape of the picture; one number in memory."""
        return np.broadcast_to(np.float64(np.nan), self.shape)


def rows_of(shape: tuple[int, int, int]) -> int:
    """Rows in a strip of a picture of so many rows, columns and wavelengths."""
    return int(max(min(STRIP // (8 * shape[1] * shape[2]), shape[0]), 1))


def strips(source: Source, rows: int) -> Iterator[tuple[int, int, SpectralImage]]:
    """First row, row after the last one and image of each strip from the top."""
    height = source.shape[0]
    for first in range(0, height, rows):
        last = min(first + rows, height)
        yield first, last, source.rows(first, last)


def check_options(path: Path, options: dict[str, Any]) -> None:
    """Refuse files and options that cannot be written by strips.

    Raises
    ------
    DomainError
    """
    extension = path.suffix.lower()
    if extension not in WRITERS:
        rule = f"is not written in strips, as a picture larger than memory needs; choose from {', '.join(WRITERS)}"
        raise DomainError("output", str(path), rule)
    for name, value in options.items():
        if name not in WRITERS[extension][1]:
            raise DomainError(
                name, value, f"is not for {extension} files of a picture larger than memory; leave it out"
            )


def save(source: Source, path: str | os.PathLike[str], **options: Any) -> None:
    """Write a picture strip by strip, whole or not at all; the extension says how.

    Parameters
    ----------
    source : Source
    path : path-like
        ``.fits``, ``.exr``, ``.nc`` or ``.zarr``, a folder that xarray and dask read.
    **options
        ``dtype`` (FITS, netCDF and zarr); ``spectral``, ``scale`` and ``half`` (EXR) as in `SpectralImage.save`.

    Raises
    ------
    DomainError
        For other files and options.
    SkyscatterError
        If there is no room for it.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> import skyscatter
    >>> from skyscatter.image.strips import Whole, save
    >>> image = skyscatter.SpectralImage(np.full((2, 3, 5), 0.01), [400, 475, 550, 625, 700])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(Whole(image), pathlib.Path(folder, "sky.fits"))
    ...     skyscatter.SpectralImage.load(pathlib.Path(folder, "sky.fits")).shape
    (2, 3, 5)
    """
    file = Path(path)
    check_options(file, options)
    importlib.import_module(f"skyscatter.image.{WRITERS[file.suffix.lower()][0]}").write(source, file, **options)


def check_room(path: Path, needed: int) -> None:
    """Refuse to begin a file for which there is no room on its disk [byte].

    Raises
    ------
    SkyscatterError
    """
    from skyscatter.memory import format_bytes

    folder = path.parent if path.parent.is_dir() else Path()
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise SkyscatterError(
            f"{path}: takes {format_bytes(needed)}, and {format_bytes(free)} are free on its disk; make room, or write "
            "it elsewhere"
        )
