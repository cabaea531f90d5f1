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
IMAGES = (".exr", ".fits", ".nc")


def read_observation(path: str | os.PathLike[str], *, noise: float | None = None, **options: Any) -> Observation:
    """Read data from a file; its columns, or what it holds, say which kind they are.

    Parameters
    ----------
    path : path-like
        A table, ``.csv`` or ``.nc``, with columns ``azimuth_deg, elevation_deg, wavelength_nm, radiance, sigma`` and,
        where not given as options, ``sun_elevation_deg, sun_azimuth_deg, altitude_m``.
    noise : float, optional
        Relative standard deviation of data without a column ``sigma``.
    **options
        ``sun_elevation_deg``, ``sun_azimuth_deg``, ``altitude``: what the file does not say.

    Returns
    -------
    Observation

    Raises
    ------
    MissingDataError, DomainError
        If the file is missing, or is none of these; the message says what is wrong with it.
    """
    file = Path(path)
    if not file.is_file():
        raise MissingDataError(file, "there is no such data file; check the path")
    if file.suffix.lower() not in (".csv", *IMAGES):
        raise DomainError("data", str(path), f"the extension must be one of .csv, {', '.join(IMAGES)}")
    table = read_table(file)
    if "azimuth_deg" in table:
        return _radiances(table, noise, options)
    raise DomainError("data", str(path), f"needs the columns {', '.join(_RADIANCE[:5])}")


def _stated(table: Table, column: str, option: str, options: dict[str, Any], default: float | None) -> Any:
    """A column of the table, or the option in its place; not both."""
    given = options.get(option)
    if column in table:
        if given is not None:
            raise DomainError(option, given, f"the file has a column {column}; leave this out")
        return table.numbers(column)
    if given is None and default is None:
        rule = f"has no column {column}; say it: --{option.removesuffix('_deg').replace('_', '-')}"
        raise DomainError("data", str(table.path), rule)
    return default if given is None else given


def _radiances(table: Table, noise: float | None, options: dict[str, Any]) -> Observation:
    from skyscatter.inversion.radiances import radiance_table

    table.refuse_others(_RADIANCE)
    measured = np.isfinite(table.numbers("radiance"))
    columns: dict[str, Any] = {name: table.numbers(name) for name in _RADIANCE[:4]}
    columns["sigma"] = table.optional("sigma")
    columns["sun_elevation_deg"] = _stated(table, "sun_elevation_deg", "sun_elevation_deg", options, None)
    columns["sun_azimuth_deg"] = _stated(table, "sun_azimuth_deg", "sun_azimuth_deg", options, 180.0)
    columns["altitude"] = _stated(table, "altitude_m", "altitude", options, 0.0)
    chosen = {name: v[measured] if np.ndim(v) else v for name, v in columns.items()}
    return radiance_table(**chosen, noise=noise)
