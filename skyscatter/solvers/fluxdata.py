"""Fluxes as labelled data: a box of altitudes, Sun elevations and wavelengths."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.fluxes import Fluxes

if TYPE_CHECKING:
    import xarray

    from skyscatter.solvers.field import RadianceField

Array = NDArray[np.float64]

UNITS = "W m-2 nm-1"
DIMS = ("altitude", "sun_elevation", "wavelength")
#: What each variable is, and its name by the CF conventions where they have one.
QUANTITIES: dict[str, tuple[str, str | None]] = {
    "direct": ("sunlight never scattered, through a horizontal plane; negative where it passes upward", None),
    "diffuse_down": ("scattered and reflected light, downward", None),
    "down": ("all light, downward", "downwelling_radiative_flux_per_unit_wavelength_in_air"),
    "up": ("all light, upward", "upwelling_radiative_flux_per_unit_wavelength_in_air"),
    "net": ("downward minus upward", None),
    "actinic": ("radiance integrated over all directions, direct sunlight included", None),
}


def quantities(fluxes: Fluxes) -> dict[str, tuple[Array, Array]]:
    """Fluxes and their estimated errors, by the names of `QUANTITIES`; errors of sums as if all had one sign."""
    beam_down, beam_up = np.maximum(fluxes.direct, 0.0), np.maximum(-fluxes.direct, 0.0)
    return {
        "direct": (fluxes.direct, fluxes.direct_error),
        "diffuse_down": (fluxes.diffuse_down, fluxes.diffuse_down_error),
        "down": (fluxes.diffuse_down + beam_down, fluxes.diffuse_down_error + fluxes.direct_error * (beam_down > 0)),
        "up": (fluxes.diffuse_up + beam_up, fluxes.diffuse_up_error + fluxes.direct_error * (beam_up > 0)),
        "net": (fluxes.net, fluxes.net_error),
        "actinic": (fluxes.actinic, fluxes.actinic_error),
    }


def to_dataset(field: RadianceField, fluxes: Fluxes, altitudes: Array, elevations: Array) -> xarray.Dataset:
    """Label fluxes of shape (altitude, elevation, wavelength)."""
    import xarray

    from skyscatter import __version__

    variables: dict[str, Any] = {}
    for name, (value, error) in quantities(fluxes).items():
        words, standard = QUANTITIES[name]
        more = {} if standard is None else {"standard_name": standard}
        attributes = {"units": UNITS, "long_name": words, "ancillary_variables": f"{name}_error", **more}
        variables[name] = (DIMS, value, attributes)
        variables[f"{name}_error"] = (DIMS, error, {"units": UNITS, "long_name": f"estimated error of {name}"})
    coordinates: dict[str, Any] = {"altitude": True, "sun": {"elevation_deg": True, "azimuth_deg": True}}
    recipe = {
        "skyscatter": __version__,
        "scene": field.scene.model_dump(mode="json", exclude=coordinates, exclude_none=True),
        "tolerance": field.tolerance,
        "solver": "orders",
    }
    sun = {"units": "degree", "standard_name": "solar_elevation_angle", "long_name": "elevation, not refracted"}
    return xarray.Dataset(
        variables,
        coords={
            "altitude": ("altitude", altitudes, {"units": "m", "standard_name": "altitude", "positive": "up"}),
            "sun_elevation": ("sun_elevation", elevations, sun),
            "wavelength": (
                "wavelength",
                field.wavelengths,
                {"units": "nm", "standard_name": "radiation_wavelength", "long_name": "wavelength in vacuum"},
            ),
        },
        attrs={
            "Conventions": "CF-1.11",
            "title": "Spectral fluxes",
            "source": f"skyscatter {__version__}",
            "recipe": json.dumps(recipe),
        },
    )


def to_csv(dataset: xarray.Dataset) -> str:
    """The same as a table with a row for each altitude, elevation and wavelength; remarks after ``#``."""
    names = [column for name in QUANTITIES for column in (name, f"{name}_error")]
    remarks = [f"# {dataset.attrs['title']} by {dataset.attrs['source']}, in {UNITS}"]
    remarks += [f"# {name}: {words}" for name, (words, _) in QUANTITIES.items()]
    header = ",".join(["altitude_m", "sun_elevation_deg", "wavelength_nm", *names])
    places = np.meshgrid(*(dataset[dim].values for dim in DIMS), indexing="ij")
    columns = [*places, *(dataset[name].values for name in names)]
    rows = np.stack([np.asarray(column, float).ravel() for column in columns], axis=1)
    lines = [",".join(f"{value:.10g}" for value in row) for row in rows.tolist()]
    return "\n".join([*remarks, header, *lines, ""])
