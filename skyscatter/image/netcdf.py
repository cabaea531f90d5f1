"""netCDF files, and the labelled form of an image that they hold.

netCDF-4, compressed, by h5netcdf.  A sky whose recipe has its camera carries azimuth, elevation, scattering angle and
solid angle of every pixel, the place of the Sun and the height of the observer, and, where they are known, latitude,
longitude and time, as coordinates by the CF conventions.
"""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyscatter.errors import DomainError
from skyscatter.image.horizon import sky_view
from skyscatter.image.polarisation import FRAME, STOKES, STOKES_ERRORS
from skyscatter.image.skyframe import read_sky
from skyscatter.image.spectral import UNITS, SpectralImage
from skyscatter.netcdf import save_dataset

if TYPE_CHECKING:
    import xarray

    from skyscatter.image.filterimage import FilterImage
    from skyscatter.image.photometry import Counts

_DIMS = ("y", "x", "wavelength")
_PIXELS = ("y", "x")
_LAYER = "layer_"
_NORTH = "from north through east"
_TIME = {"standard_name": "time", "long_name": "time (UTC)", "units_metadata": "leap_seconds: none"}
_SOLID_ANGLE = {"units": "sr", "long_name": "solid angle of the pixel"}
#: Variable of each Stokes layer.
_STOKES_VARIABLES = {
    **{name: f"stokes_{name}" for name in STOKES},
    **{name: f"stokes_{name[0]}_standard_error" for name in STOKES_ERRORS},
}


def to_dataset(image: SpectralImage) -> xarray.Dataset:
    """Label the image as an xarray Dataset (dims y, x, wavelength) over the same arrays, with CF attributes."""
    import xarray

    radiance = {"units": UNITS, "long_name": "spectral radiance per wavelength"}
    variables: dict[str, Any] = {"radiance": (_DIMS, image.radiance, radiance)}
    if image.error is not None:
        sort = "estimated" if image.error_kind == "estimated" else "standard"
        attributes = {"units": UNITS, "long_name": f"{sort} error of the spectral radiance"}
        variables[f"radiance_{sort}_error"] = (_DIMS, image.error, attributes)
        radiance["ancillary_variables"] = f"radiance_{sort}_error"
    if image.polarised:
        variables.update(_polarisation(image))
    for name, values in image.layers.items():
        if image.polarised and name in _STOKES_VARIABLES:
            continue
        attributes = {"units": UNITS, "long_name": f"part of the spectral radiance: {name}", "layer": name}
        variables[_LAYER + name] = (_DIMS, values, attributes)
    coords, attrs = coordinates(image)
    return xarray.Dataset(variables, coords=coords, attrs=attrs)


def coordinates(image: SpectralImage | FilterImage) -> tuple[dict[str, Any], dict[str, Any]]:
    """Coordinates of an image, and the attributes of the dataset that holds it."""
    wavelength = {"units": "nm", "standard_name": "radiation_wavelength", "long_name": "wavelength in vacuum"}
    if isinstance(image, SpectralImage):
        axis: dict[str, Any] = {"wavelength": ("wavelength", image.wavelengths, wavelength)}
    else:
        pivots = [curve.pivot for curve in image.filters]
        long_name = {"long_name": "pivot wavelength in vacuum"}
        axis = {"filter": list(image.names), "wavelength": ("filter", pivots, {**wavelength, **long_name})}
    attributes = {
        "Conventions": "CF-1.11",
        "title": "Spectral image",
        "source": "skyscatter",
        "comment": "The first row is the top of the picture; NaN lies outside the camera's field.",
        "recipe": json.dumps(image.recipe),
        **({} if image.sky is None else {"sky": image.sky.model_dump_json()}),
    }
    return {**axis, **_sky_coordinates(image), **_horizontal_coordinates(image)}, attributes


def _sky_coordinates(image: SpectralImage | FilterImage) -> dict[str, Any]:
    """Right ascension and declination of the pixel centres, for images that stand in the sky."""
    if image.sky is None:
        return {}
    height, width = image.radiance.shape[:2]
    ra, dec = image.sky.coordinates(width, height)
    return {
        "ra": (_PIXELS, ra, {"units": "degree", "long_name": "right ascension (ICRS)"}),
        "dec": (_PIXELS, dec, {"units": "degree", "long_name": "declination (ICRS)"}),
        "solid_angle": (_PIXELS, image.sky.pixel_solid_angle(width, height), _SOLID_ANGLE),
    }


def _horizontal_coordinates(image: SpectralImage | FilterImage) -> dict[str, Any]:
    """Where the pixels of a planet's sky look, and where Sun and observer stand."""
    view = sky_view(image)
    if view is None:
        return {}
    azimuth, elevation, scattering = view.angles()
    sun = view.scene.sun
    return {
        "azimuth": (_PIXELS, azimuth, {"units": "degree", "long_name": f"azimuth of the line of sight, {_NORTH}"}),
        "elevation": (
            _PIXELS,
            elevation,
            {"units": "degree", "long_name": "elevation of the line of sight above the horizontal, not refracted"},
        ),
        "scattering_angle": (
            _PIXELS,
            scattering,
            {
                "units": "degree",
                "standard_name": "scattering_angle",
                "long_name": "angle between the line of sight and the direction to the Sun's middle",
            },
        ),
        "solid_angle": (_PIXELS, view.solid_angle(), _SOLID_ANGLE),
        "sun_elevation": _scalar(sun.elevation_deg, "degree", "solar_elevation_angle", "elevation, not refracted"),
        "sun_azimuth": _scalar(sun.azimuth_deg % 360.0, "degree", "solar_azimuth_angle", f"azimuth, {_NORTH}"),
        "sun_distance": _scalar(view.scene.star_distance, "m", None, "distance of the star"),
        "observer_altitude": _scalar(view.scene.altitude, "m", "height", "of the observer", positive="up"),
        **_site_coordinates(sun.site),
    }


def _site_coordinates(site: Any) -> dict[str, Any]:
    """Latitude, longitude and time, where they are known."""
    if site is None:
        return {}
    import numpy as np

    return {
        "latitude": _scalar(site.latitude_deg, "degrees_north", "latitude", "of the observer"),
        "longitude": _scalar(site.longitude_deg, "degrees_east", "longitude", "of the observer"),
        "time": ((), np.datetime64(site.time, "ns"), _TIME),
    }


def _scalar(value: float, units: str, standard_name: str | None, long_name: str, **more: str) -> Any:
    name = {} if standard_name is None else {"standard_name": standard_name}
    return ((), float(value), {"units": units, **name, "long_name": long_name, **more})


def _polarisation(image: SpectralImage) -> dict[str, Any]:
    """Stokes layers, and what follows from them; readers need only the former."""
    variables: dict[str, Any] = {}
    for name, variable in _STOKES_VARIABLES.items():
        if name not in image.layers:
            continue
        what = f"Stokes {name[0]} per wavelength"
        attributes = {"units": UNITS, "long_name": what, "comment": FRAME, "layer": name}
        if name in STOKES_ERRORS:
            attributes["long_name"] = f"standard error of {what}"
        elif f"{name}_error" in image.layers:
            attributes["ancillary_variables"] = _STOKES_VARIABLES[f"{name}_error"]
        variables[variable] = (_DIMS, image.layers[name], attributes)
    biased = "Noise makes small values too large."
    linear = {"units": "1", "long_name": "degree of linear polarisation", "comment": f"sqrt(Q^2 + U^2) / I. {biased}"}
    total = {"units": "1", "long_name": "degree of polarisation", "comment": f"sqrt(Q^2 + U^2 + V^2) / I. {biased}"}
    angle = {
        "units": "degree",
        "long_name": "angle of linear polarisation",
        "comment": "0 to 180 from the meridian plane through the zenith, anticlockwise as the observer sees it.",
    }
    variables["degree_of_linear_polarisation"] = (_DIMS, image.degree_of_linear_polarisation, linear)
    variables["degree_of_polarisation"] = (_DIMS, image.degree_of_polarisation, total)
    variables["angle_of_linear_polarisation"] = (_DIMS, image.angle_of_linear_polarisation, angle)
    return variables


def from_dataset(dataset: xarray.Dataset) -> SpectralImage:
    """Build the image that a dataset in the form of `to_dataset` describes."""
    if "brightness" in dataset:
        unit = dataset["brightness"].attrs.get("units")
        raise DomainError("dataset", unit, "holds brightness for other programs; spectra are read in " + UNITS)
    for name in ("radiance", "wavelength"):
        if name not in dataset.variables:
            raise DomainError("dataset", list(map(str, dataset.variables)), f"has no variable named {name}")
    if set(dataset["radiance"].dims) != set(_DIMS):
        raise DomainError("radiance", dataset["radiance"].dims, f"must have the dimensions {', '.join(_DIMS)}")
    cubes = {
        str(name): _native(variable.transpose(*_DIMS).values)
        for name, variable in dataset.data_vars.items()
        if set(variable.dims) == set(_DIMS)
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
            **{layer: cubes[variable] for layer, variable in _STOKES_VARIABLES.items() if variable in cubes},
            **{name.removeprefix(_LAYER): cube for name, cube in cubes.items() if name.startswith(_LAYER)},
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
