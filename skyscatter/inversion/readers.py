"""From files to observations."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from skyscatter.errors import DomainError, MissingDataError
from skyscatter.inversion.observations import Observation
from skyscatter.inversion.tables import Table, read_table

_RADIANCE = (
    "azimuth_deg", "elevation_deg", "wavelength_nm", "radiance", "sigma", "sun_elevation_deg", "sun_azimuth_deg",
    "altitude_m",
)  # fmt: skip
_LIMB = ("tangent_height_m", "azimuth_deg", "wavelength_nm", "radiance", "sigma")
_FLUX = ("time", "sun_elevation_deg", "wavelength_nm", "quantity", "flux", "sigma", "direct", "diffuse", "global")
#: Units that the ends of columns' names promise, as files write them.
_SUFFIXES = {
    "nm": ("nm", "nanometer", "nanometers", "nanometre"), "m": ("m", "meter", "meters", "metre"),
    "deg": ("deg", "degree", "degrees", "°"),
}  # fmt: skip
IMAGES = (".exr", ".fits", ".nc")
#: Options by the kind of data that have a use for them.
USED = {
    "radiance": ("sun_elevation_deg", "sun_azimuth_deg", "altitude", "bandwidth_nm", "units"),
    "limb": ("sun_elevation_deg", "sun_azimuth_deg", "altitude", "bandwidth_nm", "units"),
    "flux": ("sun_elevation_deg", "altitude", "bandwidth_nm", "place", "units"),
    "sky image": ("sun_elevation_deg", "sun_azimuth_deg", "altitude", "pixels", "wavelengths"),
    "nebula image": ("pixels", "wavelengths"),
}


def read_observation(path: str | os.PathLike[str], *, noise: float | None = None, **options: Any) -> Observation:
    r"""Read data from a file; its columns, or what it holds, say which kind they are.

    Parameters
    ----------
    path : path-like
        A table, ``.csv`` (remarks after ``#``) or ``.nc``, with a row for each datum, or an image:

        - sky radiances: ``azimuth_deg, elevation_deg, wavelength_nm, radiance, sigma``, and ``sun_elevation_deg,
          sun_azimuth_deg, altitude_m`` where they are not given as options;
        - a limb: ``tangent_height_m, wavelength_nm, radiance, sigma`` and perhaps ``azimuth_deg``;
        - fluxes: ``time`` (ISO 8601) or ``sun_elevation_deg``, ``wavelength_nm`` unless they are broadband, and columns
          ``direct``, ``diffuse``, ``global``, or ``quantity, flux, sigma``;
        - images that ``skyscatter sky`` or ``skyscatter nebula`` has written: ``.nc``, ``.exr``, ``.fits``.
    noise : float, optional
        Relative standard deviation of data without a column ``sigma``.
    **options
        What the file does not say: ``sun_elevation_deg``, ``sun_azimuth_deg``, ``altitude``, ``place``,
        ``bandwidth_nm``, ``units`` (else those in brackets after a column's name, ``radiance [uW cm-2 sr-1 nm-1]``, or
        in a variable's attribute ``units``); of images ``pixels`` and ``wavelengths``.

        See `radiance_table`, `limb_profile`, `flux_table`,
        `sky_image` and `nebula_image`.

    Returns
    -------
    Observation

    Raises
    ------
    MissingDataError, DomainError
        If the file is missing, or is none of these; the message says what is wrong with it.

    Examples
    --------
    A table of sky radiances that says its unit and does not say where the Sun stood:

    >>> import pathlib
    >>> import tempfile
    >>> from skyscatter import inversion
    >>> rows = ["azimuth_deg,elevation_deg,wavelength_nm,radiance [uW cm-2 sr-1 nm-1]", "180,20,550,5", "180,45,550,4"]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "sky.csv"
    ...     _ = path.write_text("\n".join(rows))
    ...     data = inversion.read_observation(path, noise=0.03, sun_elevation_deg=30)
    >>> data.kind, data.values, data.unit
    ('sky radiance', array([0.05, 0.04]), 'W m-2 sr-1 nm-1')
    """
    file = Path(path)
    if not file.is_file():
        raise MissingDataError(file, "there is no such data file; check the path")
    if file.suffix.lower() not in (".csv", *IMAGES):
        raise DomainError("data", str(path), f"the extension must be one of .csv, {', '.join(IMAGES)}")
    given = {name: value for name, value in options.items() if value is not None}
    if file.suffix.lower() != ".csv" and not _is_table(file):
        return _image(file, noise, given)
    table = read_table(file)
    kinds = {"tangent_height_m": ("limb", _limb), "azimuth_deg": ("radiance", _radiances)}
    for column, (kind, read) in kinds.items():
        if column in table:
            _refuse(kind, given, file)
            return read(table, noise, given)
    if any(name in table for name in ("flux", "direct", "diffuse", "global")):
        _refuse("flux", given, file)
        return _fluxes(table, noise, given)
    rule = (
        f"needs the columns {', '.join(_RADIANCE[:5])} (sky radiances), {', '.join(_LIMB[:1] + _LIMB[2:])} (a limb), "
        "or sun_elevation_deg and global, direct or diffuse (fluxes)"
    )
    raise DomainError("data", str(path), rule)


def _refuse(kind: str, options: dict[str, Any], path: Path) -> None:
    for name, value in options.items():
        if name not in USED[kind]:
            raise DomainError(name, value, f"means nothing to {path}, which holds {kind} data; leave it out")


def _is_table(path: Path) -> bool:
    """Whether a netCDF file holds columns; the image format has an axis of pixels."""
    if path.suffix.lower() != ".nc":
        return False
    import xarray

    try:
        with xarray.open_dataset(path) as dataset:
            return not {"x", "y", "wavelength"} <= set(map(str, dataset.sizes))
    except (OSError, ValueError) as error:
        raise DomainError("data", str(path), f"is not a netCDF file that can be read ({error})") from error


def _image(path: Path, noise: float | None, options: dict[str, Any]) -> Observation:
    from skyscatter.inversion.images import loaded, nebula_image, sky_image

    picture: Any = loaded(path)
    sky = "planet_radius" in picture.recipe.get("scene", {}).get("medium", {})
    kind, read = ("sky image", sky_image) if sky else ("nebula image", nebula_image)
    _refuse(kind, options, path)
    found: Observation = read(picture, noise=noise, **options)
    return found


def _stated(table: Table, column: str, option: str, options: dict[str, Any], default: float | None) -> Any:
    """A column of the table, or the option in its place; not both."""
    given = options.get(option)
    if column in table:
        if given is not None:
            raise DomainError(option, given, f"the file has a column {column}; leave this out")
        return table.numbers(column)
    if given is None and default is None:
        words = option.removesuffix("_deg").replace("_", "-")
        rule = f"has no column {column}; say it with --{words} ({option} in Python)"
        raise DomainError("data", str(table.path), rule)
    return default if given is None else given


def _units(table: Table, names: tuple[str, ...], options: dict[str, Any]) -> str | None:
    """The unit of the measured columns, by the file or the option; None where neither says it."""
    for name, unit in table.units.items():
        suffix = _SUFFIXES.get(name.rpartition("_")[2])
        if name not in names and suffix is not None and unit not in suffix:
            raise DomainError("data", str(table.path), f"column {name} is in {unit!r}; give it in {suffix[0]}")
    said = {table.units[name] for name in names if name in table and name in table.units}
    if len(said) > 1:
        raise DomainError("data", str(table.path), f"has units {' and '.join(sorted(said))}; give all data in one")
    given: str | None = options.get("units")
    if given is not None and said and given not in said:
        raise DomainError("units", given, f"{table.path} says that they are {said.pop()}; leave this out")
    return said.pop() if said else given


def _measured(columns: dict[str, Any], values: Any) -> dict[str, Any]:
    """Rows in which something was measured."""
    there = np.isfinite(values)
    return {name: v[there] if np.ndim(v) else v for name, v in columns.items()}


def _radiances(table: Table, noise: float | None, options: dict[str, Any]) -> Observation:
    from skyscatter.inversion.radiances import radiance_table

    table.refuse_others(_RADIANCE)
    columns: dict[str, Any] = {name: table.numbers(name) for name in _RADIANCE[:4]}
    columns["sigma"] = table.optional("sigma")
    columns["sun_elevation_deg"] = _stated(table, "sun_elevation_deg", "sun_elevation_deg", options, None)
    columns["sun_azimuth_deg"] = _stated(table, "sun_azimuth_deg", "sun_azimuth_deg", options, 180.0)
    columns["altitude"] = _stated(table, "altitude_m", "altitude", options, 0.0)
    chosen = _measured(columns, columns["radiance"])
    units = _units(table, ("radiance", "sigma"), options)
    return radiance_table(**chosen, noise=noise, bandwidth_nm=options.get("bandwidth_nm"), units=units)


def _limb(table: Table, noise: float | None, options: dict[str, Any]) -> Observation:
    from skyscatter.inversion.radiances import limb_profile

    table.refuse_others(_LIMB)
    for name in ("altitude", "sun_elevation_deg"):
        if name not in options:
            words = name.removesuffix("_deg").replace("_", "-")
            raise DomainError("data", str(table.path), f"a limb needs it: say it with --{words} ({name} in Python)")
    columns: dict[str, Any] = {name: table.numbers(name) for name in ("tangent_height_m", "wavelength_nm", "radiance")}
    columns["sigma"] = table.optional("sigma")
    columns["azimuth_deg"] = table.numbers("azimuth_deg") if "azimuth_deg" in table else 0.0
    given = {**options, "units": _units(table, ("radiance", "sigma"), options)}
    return limb_profile(**_measured(columns, columns["radiance"]), noise=noise, **given)


def _fluxes(table: Table, noise: float | None, options: dict[str, Any]) -> Observation:
    from skyscatter.inversion.fluxes import flux_table

    table.refuse_others(_FLUX)
    size = len(next(iter(table.columns.values())))
    columns: dict[str, Any] = {"wavelength_nm": table.optional("wavelength_nm")}
    if "time" in table:
        if "place" not in options:
            raise DomainError("data", str(table.path), "has times; say where with --place LAT,LON (place in Python)")
        columns |= {"times": np.array(table.words("time"), dtype=object), "sun_elevation_deg": None}
    else:
        elevation = _stated(table, "sun_elevation_deg", "sun_elevation_deg", options, None)
        columns["sun_elevation_deg"] = np.broadcast_to(elevation, (size,))
    columns = _flux_columns(table, columns, size)
    more: dict[str, Any] = {name: options[name] for name in ("altitude", "bandwidth_nm", "place") if name in options}
    more["units"] = _units(table, ("flux", "direct", "diffuse", "global", "sigma"), options)
    return flux_table(**_measured(columns, columns["flux"]), noise=noise, **more)


def _flux_columns(table: Table, columns: dict[str, Any], size: int) -> dict[str, Any]:
    """One row for each flux, whether the file has a column for each quantity or one for all."""
    from skyscatter.inversion.fluxes import QUANTITIES

    if "flux" in table:
        if "quantity" not in table:
            rule = f"a column flux needs a column quantity with {', '.join(QUANTITIES)}"
            raise DomainError("data", str(table.path), rule)
        quantity = np.array(table.words("quantity"), dtype=object)
        return {**columns, "flux": table.numbers("flux"), "sigma": table.optional("sigma"), "quantity": quantity}
    names = [name for name in QUANTITIES if name in table]
    if "sigma" in table and len(names) > 1:
        raise DomainError("data", str(table.path), "one sigma for several fluxes; use columns quantity, flux, sigma")
    repeated = {name: None if v is None else np.tile(v, len(names)) for name, v in columns.items()}
    quantity = np.repeat(np.array(names, dtype=object), size)
    values = np.concatenate([table.numbers(name) for name in names])
    return {**repeated, "flux": values, "quantity": quantity, "sigma": table.optional("sigma")}
