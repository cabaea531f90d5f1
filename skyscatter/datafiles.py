"""Where the shipped tables and model files live, and how a table is read."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import MissingDataError

_PACKAGE = Path(__file__).resolve().parent


def _folder(name: str) -> Path:
    """Folder inside the installed wheel (``skyscatter/_data``), else the one beside the package in a checkout."""
    shipped = _PACKAGE / f"_{name}"
    return shipped if shipped.is_dir() else _PACKAGE.parent / name


def models_dir() -> Path:
    """Folder of the shipped model files (TOML)."""
    return _folder("models")


def data_path(name: str) -> Path:
    """Path of a shipped data file.

    Parameters
    ----------
    name : str
        File name such as ``"ussa1976.csv"``.

    Raises
    ------
    MissingDataError
        If there is no such file.
    """
    path = _folder("data") / name
    if not path.is_file():
        raise MissingDataError(path, "no such shipped data file; reinstall skyscatter, or check the name")
    return path


@lru_cache(maxsize=32)
def read_table(name: str) -> dict[str, NDArray[np.float64]]:
    """Columns of a shipped CSV table, by the names in its header line.

    Lines that start with ``#`` are remarks (origin, licence, units).  The result is cached and its arrays are
    read-only.

    Parameters
    ----------
    name : str
        File name such as ``"o3_cross_section.csv"``.

    Returns
    -------
    dict of str to ndarray, each of shape (row,)

    Raises
    ------
    MissingDataError
        If the file is absent or is not a table of numbers.
    """
    path = data_path(name)
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip() and line[0] != "#"]
    try:
        header = [column.strip() for column in lines[0].split(",")]
        values = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]], dtype=float)
        columns = dict(zip(header, values.T, strict=True))
    except (IndexError, ValueError) as error:
        raise MissingDataError(path, f"not a CSV table of numbers under one header line ({error})") from error
    for column in columns.values():
        column.flags.writeable = False
    return columns
