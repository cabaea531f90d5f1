"""The labelled form of an image: an xarray Dataset by the CF conventions.

A sky whose recipe has its camera carries azimuth, elevation, scattering angle and solid angle of every pixel, the place
of the Sun and the height of the observer, and, where they are known, latitude, longitude and time, as coordinates.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from skyscatter.image.filterimage import FilterImage
from skyscatter.image.horizon import sky_view
from skyscatter.image.polarisation import FRAME, STOKES, STOKES_ERRORS

if TYPE_CHECKING:
    import xarray

    from skyscatter.image.skyframe import SkyFrame
    from skyscatter.image.spectral import SpectralImage

#: Of spectral radiance.
UNITS = "W m-2 sr-1 nm-1"
DIMS = ("y", "x", "wavelength")
_PIXELS = ("y", "x")
#: Layers of denoised images, and what they are.
RAW_LAYERS = {
    "raw": "Spectral radiance as it was computed, before it was denoised.",
    "raw_error": "Standard error of the radiance as it was computed.",
}
LAYER = "layer_"
_NORTH = "from north through east"
_TIME = {"standard_name": "time", "long_name": "time (UTC)", "units_metadata": "leap_seconds: none"}
_SOLID_ANGLE = {"units": "sr", "long_name": "solid angle of the pixel"}
#: Variables of the Stokes layers; those of errors begin so.
STOKES_VARIABLES = {name: f"stokes_{name[0]}" for name in (*STOKES, *STOKES_ERRORS)}


def stokes_variable(layer: str, sort: str) -> str:
    """Variable of a Stokes layer, errors being "standard" or "estimated"."""
    return STOKES_VARIABLES[layer] + (f"_{sort}_error" if layer in STOKES_ERRORS else "")


def to_dataset(image: SpectralImage) -> xarray.Dataset:
    """Label the image as an xarray Dataset (dims y, x, wavelength) over the same arrays, with CF attributes."""
    import xarray

    radiance = {"units": UNITS, "long_name": "spectral radiance per wavelength"}
    if image.is_denoised:
        radiance["comment"] = "Denoised, not as it was computed; layer_raw is."
    variables: dict[str, Any] = {"radiance": (DIMS, image.radiance, radiance)}
    if image.error is not None:
        sort = "estimated" if image.error_kind == "estimated" else "standard"
        attributes = {"units": UNITS, "long_name": f"{sort} error of the spectral radiance"}
        variables[f"radiance_{sort}_error"] = (DIMS, image.error, attributes)
        radiance["ancillary_variables"] = f"radiance_{sort}_error"
    if image.polarised:
        variables.update(_polarisation(image))
    for name, values in image.layers.items():
        if image.polarised and name in STOKES_VARIABLES:
            continue
        what = f"part of the spectral radiance: {name}"
        if image.is_denoised and name in RAW_LAYERS:
            what = RAW_LAYERS[name]
        attributes = {"units": UNITS, "long_name": what, "layer": name}
        variables[LAYER + name] = (DIMS, values, attributes)
    coords, attrs = coordinates(image)
    return xarray.Dataset(variables, coords=coords, attrs=attrs)


def coordinates(image: SpectralImage | FilterImage) -> tuple[dict[str, Any], dict[str, Any]]:
    """Coordinates of an image, and the attributes of the dataset that holds it."""
    wavelength = {"units": "nm", "standard_name": "radiation_wavelength", "long_name": "wavelength in vacuum"}
    if not isinstance(image, FilterImage):
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
    return celestial_coordinates(image.sky, width, height)


def celestial_coordinates(sky: SkyFrame, width: int, height: int, rows: slice = slice(None)) -> dict[str, Any]:
    """Right ascension, declination and solid angle of the pixels of some rows of a picture."""
    ra, dec = sky.coordinates(width, height, rows)
    return {
        "ra": (_PIXELS, ra, {"units": "degree", "long_name": "right ascension (ICRS)"}),
        "dec": (_PIXELS, dec, {"units": "degree", "long_name": "declination (ICRS)"}),
        "solid_angle": (_PIXELS, sky.pixel_solid_angle(width, height, rows), _SOLID_ANGLE),
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
    sort = "estimated" if image.error_kind == "estimated" else "standard"
    for name in STOKES_VARIABLES:
        if name not in image.layers:
            continue
        what = f"Stokes {name[0]} per wavelength"
        attributes = {"units": UNITS, "long_name": what, "comment": FRAME, "layer": name}
        if name in STOKES_ERRORS:
            attributes["long_name"] = f"{sort} error of {what}"
        elif f"{name}_error" in image.layers:
            attributes["ancillary_variables"] = stokes_variable(f"{name}_error", sort)
        variables[stokes_variable(name, sort)] = (DIMS, image.layers[name], attributes)
    biased = "Noise makes small values too large."
    linear = {"units": "1", "long_name": "degree of linear polarisation", "comment": f"sqrt(Q^2 + U^2) / I. {biased}"}
    total = {"units": "1", "long_name": "degree of polarisation", "comment": f"sqrt(Q^2 + U^2 + V^2) / I. {biased}"}
    angle = {
        "units": "degree",
        "long_name": "angle of linear polarisation",
        "comment": "0 to 180 from the meridian plane through the zenith, anticlockwise as the observer sees it.",
    }
    variables["degree_of_linear_polarisation"] = (DIMS, image.degree_of_linear_polarisation, linear)
    variables["degree_of_polarisation"] = (DIMS, image.degree_of_polarisation, total)
    variables["angle_of_linear_polarisation"] = (DIMS, image.angle_of_linear_polarisation, angle)
    return variables
