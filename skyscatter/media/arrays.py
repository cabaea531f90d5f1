"""Arrays as fields of frozen records, and how they are read from files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

from skyscatter.errors import DomainError, MissingDataError, SkyscatterError
from skyscatter.media.space import SpatialField

#: Arrays of up to so many numbers are written out with their record; larger ones only as shape and digest.
WRITTEN_NUMBERS = 4096
_UNWRITTEN = "array of "


class FrozenArray:
    """A read-only array of finite numbers that is compared, and hashed, by its content.

    Parameters
    ----------
    values : array_like
        Kept as it is when it is a read-only float32 or float64 array, else copied.
    """

    def __init__(self, values: Any) -> None:
        array = np.asarray(values)
        if array.dtype not in (np.float32, np.float64):
            array = array.astype(np.float64)
        if array.flags.writeable or not array.flags.c_contiguous:
            array = np.array(array, order="C")
            array.flags.writeable = False
        self.array: NDArray[Any] = array

    @cached_property
    def digest(self) -> str:
        """Digest of type, shape and content."""
        digest = hashlib.blake2b(digest_size=16)
        digest.update(f"{self.array.dtype.str}{self.array.shape}".encode())
        digest.update(self.array.data.cast("B") if self.array.size else b"")
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FrozenArray) and (self is other or self.digest == other.digest)

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        return f"{_UNWRITTEN}{'x'.join(map(str, self.array.shape))} numbers, digest {self.digest}"


def _frozen(value: Any) -> Any:
    if value is None or isinstance(value, FrozenArray):
        return value
    if isinstance(value, str):
        raise DomainError("array", value, "give the numbers themselves, or name their file in the field `file`")
    try:
        return FrozenArray(value)
    except (TypeError, ValueError) as error:
        raise DomainError("array", type(value).__name__, f"needs a block of numbers ({error})") from error


def _written(value: FrozenArray | None) -> Any:
    if value is None:
        return None
    return value.array.tolist() if value.array.size <= WRITTEN_NUMBERS else repr(value)


def unwritten(value: Any) -> bool:
    """Whether this stands for an array that was too large to be written out with its record."""
    return isinstance(value, str) and value.startswith(_UNWRITTEN) and ", digest " in value


#: A field of a record that holds an array; takes anything that numpy takes, `None` for no array.
ArrayField = Annotated[
    Any,
    BeforeValidator(_frozen),
    PlainSerializer(_written, return_type=Any, when_used="json"),
    WithJsonSchema({"type": "array"}),
]


class ArrayRecord(SpatialField):
    """A field that holds arrays, and keeps what it makes of them: only its fields say whether it equals another one."""

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and all(
            getattr(self, name) == getattr(other, name) for name in type(self).model_fields
        )


def read_arrays(path: str, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Named arrays from a .npz file or from the columns of the first table of a FITS file.

    Names that the file does not have are left out.
    """
    return _read_arrays(*stamp(path), names)


def read_cube(path: str) -> NDArray[Any]:
    """One block of numbers with axes (x, y, z) from a .npy, .npz or FITS file.

    In .npy and .npz files the axes are as they are in Python.  The fastest axis of a FITS image, NAXIS1, is x, NAXIS3
    is z, as in every other FITS cube; the first image with three axes is taken.
    """
    return _read_cube(*stamp(path))


def check_classes(field: str, values: NDArray[Any], count: int, names: str) -> None:
    """Refuse a picture (y, x) of anything but whole numbers from 0 to `count` - 1."""
    if values.ndim != 2 or values.size == 0:
        raise DomainError(field, f"shape {values.shape}", "a picture of shape (y, x) with at least one cell")
    known = np.isfinite(values) & (values >= 0) & (values < count) & (values == np.floor(values))
    if not known.all():
        rule = f"whole numbers from 0 to {count - 1}, one for each of the {names}"
        raise DomainError(field, float(values[~known][0]), rule)


def stamp(path: str) -> tuple[str, int]:
    """The path and the time of its last change, so that a file that was written anew is read anew."""
    try:
        return path, Path(path).stat().st_mtime_ns
    except OSError as error:
        raise MissingDataError(path, f"cannot be read ({error.strerror or error}); check the path") from error
    except ValueError as error:  # a NUL in the name
        raise MissingDataError(path, f"no file has such a name ({error})") from error


@contextmanager
def undamaged(path: str) -> Iterator[None]:
    """Say of a file that its reader stumbles over that it is damaged; readers raise whatever their parsing meets."""
    try:
        yield
    except SkyscatterError:
        raise
    except Exception as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise MissingDataError(path, f"is damaged, or not what its name says ({what})") from error


@lru_cache(maxsize=8)
def _read_arrays(path: str, _: int, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    if path.endswith(".npz"):
        with undamaged(path), open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            return {name: _native(file[name]) for name in names if name in file.files}
    from astropy.io import fits

    with _opened_fits(path) as hdus:
        for hdu in hdus:
            if isinstance(hdu, fits.BinTableHDU):
                known = {column.lower(): column for column in hdu.columns.names}
                return {name: _native(hdu.data[known[name]]) for name in names if name in known}
    raise MissingDataError(path, "holds no table; give a .npz file or a FITS binary table")


@lru_cache(maxsize=8)
def _read_cube(path: str, _: int) -> NDArray[Any]:
    if path.endswith(".npy"):
        with undamaged(path):
            return _native(np.load(path, allow_pickle=False))
    if path.endswith(".npz"):
        with undamaged(path), open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            name = "values" if "values" in file.files else file.files[0]
            return _native(file[name])
    with _opened_fits(path) as hdus:
        for hdu in hdus:
            if hdu.is_image and hdu.header.get("NAXIS") == 3:
                return _native(np.asarray(hdu.data).T)
    raise MissingDataError(path, "holds no image with three axes; give a .npy or .npz file or a FITS cube")


@contextmanager
def _opened_fits(path: str) -> Iterator[Any]:
    """Its parts; the file is opened here, for astropy leaves it open where a header is damaged."""
    from astropy.io import fits

    with undamaged(path), open(path, "rb") as raw:
        try:
            hdus = fits.open(raw, memmap=False)
        except OSError as error:
            raise MissingDataError(path, "is neither .npy nor .npz nor FITS; check the file") from error
        with hdus:
            yield hdus


def _native(values: Any) -> NDArray[Any]:
    """A read-only copy in the machine's own byte order, float32 kept as such."""
    array = np.asarray(values)
    kind = np.float32 if array.dtype.kind == "f" and array.dtype.itemsize == 4 else np.float64
    array = np.array(array, dtype=kind, order="C")
    array.flags.writeable = False
    return array
