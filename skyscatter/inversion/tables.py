"""Tables of numbers with named columns, from CSV and netCDF files."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError, MissingDataError
from skyscatter.record import nearest

#: A column's name, and after it perhaps a unit in brackets.
_HEAD = re.compile(r"\s*(\w+)\s*(?:\[([^\]]*)\])?\s*")


class Table:
    """Columns of one length, by name; words are kept where a column has any."""

    def __init__(self, path: Path, columns: dict[str, list[Any]], units: dict[str, str] | None = None) -> None:
        self.path, self.columns = path, columns
        #: What the file says of the units of its columns.
        self.units = units or {}

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def numbers(self, name: str) -> NDArray[np.float64]:
        """A column of numbers; empty cells are NaN."""
        if name not in self.columns:
            raise DomainError("data", str(self.path), f"has no column {name}; {nearest(name, self.columns)}")
        values = []
        for row, cell in enumerate(self.columns[name], start=1):
            try:
                values.append(float(cell) if str(cell).strip() else float("nan"))
            except (TypeError, ValueError):
                rule = f"row {row} of column {name} is {cell!r}, which is no number"
                raise DomainError("data", str(self.path), rule) from None
        return np.array(values)

    def optional(self, name: str) -> NDArray[np.float64] | None:
        """A column of numbers, or None where there is no such column."""
        return self.numbers(name) if name in self else None

    def words(self, name: str) -> list[str]:
        """A column of words."""
        return [str(cell).strip() for cell in self.columns[name]]

    def refuse_others(self, known: tuple[str, ...]) -> None:
        """Refuse columns that nothing would be done with: a misspelt one would be ignored in silence."""
        for name in self.columns:
            if name not in known:
                raise DomainError("data", str(self.path), f"column {name!r} means nothing here; {nearest(name, known)}")


def read_table(path: Path) -> Table:
    """A table from a ``.csv`` file (lines that start with ``#`` are remarks) or a ``.nc`` file of equal columns."""
    if not path.is_file():
        raise MissingDataError(path, "there is no such data file; check the path")
    return _read_netcdf(path) if path.suffix.lower() == ".nc" else _read_csv(path)


def _read_csv(path: Path) -> Table:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise MissingDataError(path, f"cannot be read as text ({error.__class__.__name__}); check the path") from error
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    rows = list(csv.reader(lines))
    if len(rows) < 2:
        raise DomainError("data", str(path), "needs a line with the names of columns and at least one row of numbers")
    heads = [_HEAD.fullmatch(name) for name in rows[0]]
    names = [head[1] if head else name.strip() for head, name in zip(heads, rows[0], strict=True)]
    units = {head[1]: head[2].strip() for head in heads if head and head[2]}
    for number, row in enumerate(rows[1:], start=1):
        if len(row) != len(names):
            raise DomainError("data", str(path), f"row {number} has {len(row)} cells and the header {len(names)}")
    return Table(path, {name: [row[k] for row in rows[1:]] for k, name in enumerate(names)}, units)


def _read_netcdf(path: Path) -> Table:
    import xarray

    try:
        with xarray.open_dataset(path) as dataset:
            content = dataset.load()
    except (OSError, ValueError) as error:
        raise DomainError("data", str(path), f"is not a netCDF file that can be read ({error})") from error
    variables = {**content.data_vars, **content.coords}
    widest: Any = max(variables.values(), key=lambda v: v.size)
    columns = {}
    units = {str(name): str(v.attrs["units"]).strip() for name, v in variables.items() if v.attrs.get("units")}
    for name, variable in variables.items():
        try:
            # Coordinates of a grid become columns of a list, every combination a row.
            columns[str(name)] = variable.broadcast_like(widest).transpose(*widest.dims).values.ravel().tolist()
        except ValueError as error:
            raise DomainError(
                "data", str(path), f"variable {name} does not share the dimensions of {widest.name}"
            ) from error
    return Table(path, columns, units)
