"""netCDF files and zarr folders written strip by strip: the labelled form of a picture, for xarray and dask.

Both hold what `skyscatter.image.dataset` says of a picture in memory: the same variables, coordinates and attributes.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.image.dataset import celestial_coordinates
from skyscatter.image.fits import DTYPES
from skyscatter.image.strips import Source, Whole, check_room, rows_of, strips
from skyscatter.netcdf import check_writable

if TYPE_CHECKING:
    import xarray

    from skyscatter.image.spectral import SpectralImage

#: Bytes of a chunk, about: what dask likes to take at once.
CHUNK = 8_000_000

#: ``define(name, dims, shape, dtype, chunks, attributes)`` gives an array that takes ``array[first:last] = values``.
Define = Callable[[str, tuple[str, ...], tuple[int, ...], Any, tuple[int, ...], dict[str, Any]], Any]


def write(source: Source, path: Path, dtype: str | None = None) -> None:
    """Write a picture as netCDF-4 or as a folder of zarr, with pixels of ``dtype`` "float32" or "float64"."""
    if dtype not in (None, *DTYPES):
        raise DomainError("dtype", dtype, f"choose {' or '.join(DTYPES)}")
    if path.suffix.lower() == ".zarr":
        _write_zarr(source, path, dtype)
    else:
        _write_netcdf(source, path, dtype)


def _write_netcdf(source: Source, path: Path, dtype: str | None) -> None:
    import h5netcdf

    check_writable()
    # The HDF5 library crashes where a disk fills up under it: without room for all of it nothing is begun.
    with atomic_path(path) as temporary, h5netcdf.File(temporary, "w") as file:

        def define(
            name: str, dims: tuple[str, ...], shape: tuple[int, ...], kind: Any, chunks: Any, attributes: Any
        ) -> Any:
            file.dimensions.update({d: n for d, n in zip(dims, shape, strict=True) if d not in file.dimensions})
            packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "chunks": chunks}
            fill = None if dims == (name,) or not dims else np.nan
            variable = file.create_variable(name, dims, kind, fillvalue=fill, **(packed if dims else {}))
            variable.attrs.update(attributes)
            return variable

        _fill(source, define, file.attrs.update, dtype, lambda needed: check_room(path, needed))


def _write_zarr(source: Source, path: Path, dtype: str | None) -> None:
    import zarr

    with _folder(path) as temporary:
        group = zarr.create_group(str(temporary))

        def define(
            name: str, dims: tuple[str, ...], shape: tuple[int, ...], kind: Any, chunks: Any, attributes: Any
        ) -> Any:
            return group.create_array(
                name, shape=shape, chunks=chunks, dtype=kind, dimension_names=dims, attributes=attributes,
                fill_value=np.nan if np.dtype(kind).kind == "f" else 0,
            )  # fmt: skip

        try:
            _fill(source, define, group.attrs.update, dtype, lambda needed: check_room(path, needed))
            with warnings.catch_warnings():
                # Other libraries may not read it, and do without; xarray warns where it is not there.
                warnings.simplefilter("ignore", UserWarning)
                zarr.consolidate_metadata(str(temporary))
        except OSError as error:
            raise SkyscatterError(f"{path}: cannot be written: {error.strerror or error}") from error


def _fill(
    source: Source,
    define: Define,
    describe: Callable[[dict[str, Any]], object],
    dtype: str | None,
    room: Callable[[int], object],
) -> None:
    """Make the arrays by the first strip, and put all strips in."""
    arrays: dict[str, Any] = {}
    sizes = dict(zip(("y", "x", "wavelength"), source.shape, strict=True))
    rows = rows_of(source.shape)
    for first, last, strip in strips(source, rows):
        labelled = _labelled(strip, source, first, last)
        if first == 0:
            width = np.dtype(dtype or "float64").itemsize
            room(sum(width * int(np.prod([sizes[str(d)] for d in v.dims])) for v in labelled.variables.values()))
            describe(_attributes(labelled))
            arrays = _defined(labelled, sizes, rows, define, dtype)
        for name, variable in labelled.variables.items():
            if "y" in variable.dims:
                arrays[str(name)][first:last] = variable.values
            elif first == 0:
                arrays[str(name)][...] = variable.values


def _labelled(strip: SpectralImage, source: Source, first: int, last: int) -> xarray.Dataset:
    """A strip with its labels, among them the places of its pixels in the whole picture."""
    if isinstance(source, Whole):
        return _encoded(source.image.dataset.isel(y=slice(first, last)))
    labelled = strip.dataset
    if source.sky is None:
        return labelled
    height, width, _ = source.shape
    sky = celestial_coordinates(source.sky, width, height, slice(first, last))
    return labelled.assign_coords(sky).assign_attrs(sky=source.sky.model_dump_json())


def _encoded(labelled: xarray.Dataset) -> xarray.Dataset:
    """Moments as numbers, by the CF conventions."""
    for name in [name for name, variable in labelled.variables.items() if variable.dtype.kind == "M"]:
        seconds = (labelled[name].values - np.datetime64(0, "ns")) / np.timedelta64(1, "s")
        units = {"units": "seconds since 1970-01-01 00:00:00", "calendar": "standard"}
        labelled = labelled.assign_coords({name: (labelled[name].dims, seconds, labelled[name].attrs | units)})
    return labelled


def _attributes(labelled: xarray.Dataset) -> dict[str, Any]:
    from skyscatter import __version__

    written = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {str(k): v for k, v in labelled.attrs.items()} | {
        "history": f"{written} written by skyscatter {__version__}"
    }


def _defined(
    labelled: xarray.Dataset, sizes: dict[str, int], rows: int, define: Define, dtype: str | None
) -> dict[str, Any]:
    """Arrays for all variables of the whole picture."""
    places = " ".join(sorted(str(name) for name in labelled.coords if name not in labelled.indexes))
    arrays = {}
    for name, variable in labelled.variables.items():
        dims = tuple(str(d) for d in variable.dims)
        shape = tuple(sizes[d] for d in dims)
        attributes = {str(k): v for k, v in variable.attrs.items()}
        kind: Any = variable.dtype
        if name in labelled.data_vars:
            kind = np.dtype(dtype or kind)
            attributes |= {"coordinates": places} if places else {}
        step = max(CHUNK // (kind.itemsize * rows * int(np.prod(shape[2:]))), 1)
        most = {"y": rows, "x": step}
        chunks = tuple(min(most.get(d, n), n) for d, n in zip(dims, shape, strict=True))
        arrays[str(name)] = define(str(name), dims, shape, kind, chunks, attributes)
    return arrays


@contextmanager
def _folder(path: Path) -> Iterator[Path]:
    """A folder beside its place, moved there in the end; what is there before may be a picture of ours, and goes."""
    if path.exists() and not is_picture(path):
        raise DomainError("output", str(path), "is there and is no picture of skyscatter's; choose another name")
    if not path.parent.is_dir():
        raise DomainError("output", str(path), "its directory does not exist; make it first")
    beside, old = (path.with_name(f".{path.stem[:100]}-{secrets.token_hex(6)}{end}") for end in (".new", ".old"))
    try:
        yield beside
        if path.exists():
            os.rename(path, old)
        os.rename(beside, path)
    finally:
        for left in (beside, old):
            shutil.rmtree(left, ignore_errors=True)


def is_picture(path: Path) -> bool:
    """Whether a folder is a picture that `write` wrote."""
    try:
        return bool(json.loads((path / "zarr.json").read_text())["attributes"]["source"] == "skyscatter")
    except (OSError, ValueError, KeyError, TypeError):
        return False
