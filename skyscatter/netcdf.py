"""Labelled data as netCDF-4 files."""

from __future__ import annotations

import importlib.util
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyscatter import __version__
from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError

if TYPE_CHECKING:
    import xarray


def check_writable() -> None:
    """Refuse to write netCDF where the library for netCDF-4 is absent: netCDF-3 knows no compression."""
    if importlib.util.find_spec("h5netcdf") is None:
        raise DomainError("output", ".nc", "netCDF needs h5netcdf: pip install h5netcdf")


def save_dataset(dataset: xarray.Dataset, path: Path, dtype: str | None = None) -> None:
    """Write a dataset as compressed netCDF-4, whole or not at all; its variables as `dtype` where one is given."""
    check_writable()
    packed = {"zlib": True, "complevel": 1, "shuffle": True}
    encoding: dict[Any, dict[str, Any]] = {name: dict(packed) for name, v in dataset.variables.items() if v.ndim}
    for name in dataset.data_vars if dtype is not None else ():
        encoding[name]["dtype"] = dtype
    for name in dataset.indexes:  # which have a value everywhere
        encoding.setdefault(name, {})["_FillValue"] = None
    if "time" in dataset.variables:
        encoding["time"] = {"units": "seconds since 1970-01-01 00:00:00", "dtype": "float64", "calendar": "standard"}
    written = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    dataset = dataset.assign_attrs(history=f"{written} written by skyscatter {__version__}")
    # Made in memory: the HDF5 library crashes when the disk fills up under it.
    data = dataset.to_netcdf(engine="h5netcdf", encoding=encoding)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)
