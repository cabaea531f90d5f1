"""netCDF files of images: netCDF-4, compressed, by h5netcdf; `dataset` says what they hold."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyscatter.errors import DomainError
from skyscatter.image.dataset import DIMS, LAYER, STOKES_VARIABLES, UNITS, stokes_variable
from skyscatter.image.skyframe import read_sky
from skyscatter.image.spectral import SpectralImage
from skyscatter.netcdf import save_dataset

if TYPE_CHECKING:
    import xarray

    from skyscatter.image.photometry import Counts


def from_dataset(dataset: xarray.Dataset) -> SpectralImage:
    """Build the image that a dataset in the form of `to_dataset` describes."""
    if "brightness" in dataset:
        unit = dataset["brightness"].attrs.get("units")
        raise DomainError("dataset", unit, "holds brightness for other programs; spectra are read in " + UNITS)
    for name in ("radiance", "wavelength"):
        if name not in dataset.variables:
            raise DomainError("dataset", list(map(str, dataset.variables)), f"has no variable named {name}")
    if set(dataset["radiance"].dims) != set(DIMS):
        raise DomainError("radiance", dataset["radiance"].dims, f"must have the dimensions {', '.join(DIMS)}")
    cubes = {
        str(name): _native(variable.transpose(*DIMS).values)
        for name, variable in dataset.data_vars.items()
        if set(variable.dims) == set(DIMS)
    }
    try:
        recipe = json.loads(dataset.attrs.get("recipe", "{}"))
    except (TypeError, ValueError) as error:
        raise DomainError("recipe", dataset.attrs["recipe"], f"must be JSON ({error})") from error
    return SpectralImage(
        cubes["radiance"],
        dataset["wavelength"].values,
        cubes.get("radiance_estimated_error", cubes.get("radiance_standard_error")),
        recipe=recipe,
        layers={
            **{
                layer: cubes[variable]
                for layer in STOKES_VARIABLES
                for variable in dict.fromkeys(stokes_variable(layer, sort) for sort in ("standard", "estimated"))
                if variable in cubes
            },
            **{name.removeprefix(LAYER): cube for name, cube in cubes.items() if name.startswith(LAYER)},
        },
        sky=read_sky(dataset.attrs.get("sky"), "dataset"),
    )


def _native(values: Any) -> Any:
    """In this machine's byte order (netCDF-3 is big-endian on disk)."""
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def write(image: SpectralImage, path: Path, dtype: str | None = None, unit: str | Counts | None = None) -> None:
    """Write the image as netCDF-4; with `dtype` "float32" the pixels at half the size, with a `unit` its brightness."""
    if dtype not in (None, "float32", "float64"):
        raise DomainError("dtype", dtype, "choose float32 or float64")
    if unit is not None:
        from skyscatter.image.photometry import photometric

        save_dataset(photometric(image, unit), path, dtype)
        return
    save_dataset(image.dataset, path, dtype)


def read(path: Path) -> SpectralImage:
    """Read an image that `write` wrote, or any netCDF file of that form."""
    import xarray

    with path.open("rb") as file:
        magic = file.read(8)
    if not magic.startswith((b"CDF", b"\x89HDF\r\n\x1a\n")):
        raise DomainError("image file", str(path), "is not a netCDF file")
    engine = "scipy" if magic.startswith(b"CDF") else "h5netcdf"
    if engine == "h5netcdf" and importlib.util.find_spec("h5netcdf") is None:
        raise DomainError("image file", str(path), "is netCDF-4; install h5netcdf to read it")
    try:
        with xarray.open_dataset(path, engine=engine, decode_times=False) as dataset:
            dataset.load()
    except (OSError, ValueError, TypeError, KeyError, RuntimeError) as error:
        raise DomainError("image file", str(path), f"is damaged or not netCDF ({_first_line(error)})") from error
    return from_dataset(dataset)


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
