"""Tables that a user names in a model: columns of numbers with units from CSV, netCDF and FITS files.

The header of a CSV file names the columns, each with its unit: ``altitude [km]``, ``altitude (km)`` or
``altitude_km``.  Lines that start with ``#`` are remarks.  In a netCDF file the variables are the columns and their
attribute ``units`` says the unit; in FITS the columns of the first table, whose units are the keywords ``TUNITn``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from skyscatter.errors import DomainError, TableFileError
from skyscatter.record import Record, nearest
from skyscatter.units import Measure

NETCDF = (".nc", ".nc4", ".cdf", ".h5")
FITS = (".fits", ".fit", ".fts", ".fits.gz")
_WITH_UNIT = re.compile(r"(.*?)\s*[\[(]([^\])]*)[\])]\s*")


class Column(NamedTuple):
    """One column of a file as it is written there."""

    unit: str | None
    values: tuple[Any, ...]
    lines: tuple[int, ...]  #: of the file, one for each value; empty for netCDF
    place: int  #: number of the column, from 1

    def place_of(self, name: str, row: int) -> tuple[int | None, str]:
        """Line and column of a value, as errors name them."""
        if self.lines:
            return self.lines[row], f"{self.place} ({name})"
        return None, f"{name}, value {row + 1}"


class Wanted(NamedTuple):
    """What a table is asked for."""

    names: tuple[str, ...]  #: under which the column may stand
    measure: Measure
    rising: bool = False  #: whether its values must all differ and go one way; falling ones are turned round


def read_columns(
    path: str | Path, wanted: Mapping[str, Wanted], chosen: Mapping[str, str] | None = None
) -> dict[str, tuple[float, ...]]:
    """Columns of a file, converted to the units of the house.

    Parameters
    ----------
    path : str or Path
        A CSV file, or netCDF by its ending.
    wanted : mapping of str to Wanted
        What is read, by the name of the field that takes it.  The last one may stand in the file's only other column
        under any name.
    chosen : mapping of str to str, optional
        Names of columns as the user gives them, by field.

    Returns
    -------
    dict of str to tuple of float

    Raises
    ------
    TableFileError
        Naming the file, the line and the column.
    """
    text = str(path)
    columns = _columns(text)
    places: dict[str, str] = {}
    for field, want in wanted.items():
        last = field == list(wanted)[-1]
        places[field] = _find(text, columns, field, want, (chosen or {}).get(field), places.values() if last else None)
    read = {field: _converted(text, name, columns[name], wanted[field].measure) for field, name in places.items()}
    if len({len(values) for values in read.values()}) > 1:
        counts = ", ".join(f"{places[field]} {len(values)}" for field, values in read.items())
        raise TableFileError(text, f"its columns differ in length ({counts}); name those of one axis")
    falling = False
    for field, want in wanted.items():
        if want.rising:
            # Soundings and model levels often run downwards.
            falling = _falls(text, places[field], columns[places[field]], read[field])
    return {field: values[::-1] for field, values in read.items()} if falling else read


def _falls(path: str, name: str, column: Column, values: tuple[float, ...]) -> bool:
    """Whether a column falls; refused if it neither falls nor rises all the way."""
    falling = len(values) > 1 and values[1] < values[0]
    for place, (one, next_one) in enumerate(pairwise(values), start=1):
        if one == next_one or (next_one < one) != falling:
            line, where = column.place_of(name, place)
            raise TableFileError(path, f"{column.values[place]} breaks the order: must rise or fall", line, where)
    return falling


class TableRecord(Record):
    """A table that is given by its numbers, or by a file that has them; then it keeps the numbers.

    Parameters
    ----------
    file : str, optional
        CSV or netCDF file with the columns instead; in a model file the path counts from its folder.
    column : str, optional
        Which column of the file has the values, where there are several.
    """

    #: What a file is asked for, by field; the last one is that of `column`.
    columns: ClassVar[dict[str, Wanted]] = {}

    file: str | None = None
    column: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or data.get("file", data.get("column")) is None:
            return data
        return with_columns(data, cls.columns)

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Either the file, or all of the numbers."""
        written = handler(schema)
        plain = handler.resolve_ref_schema(written)
        numbers = [name for name in plain.get("required", ()) if name in cls.columns]
        plain["required"] = [name for name in plain.get("required", ()) if name not in cls.columns]
        plain["anyOf"] = [{"required": ["file"]}, {"required": numbers}]
        return written


def with_columns(
    data: Mapping[str, Any], columns: Mapping[str, Wanted], fields: Iterable[str] | None = None
) -> dict[str, Any]:
    """The content of a table with the columns of its file in place of the file's name.

    `fields`, which the file stands for, must not be given beside it; those of the columns if nothing is said.
    """
    if data.get("file") is None:
        raise DomainError("column", data["column"], "names a column of a file; give file too")
    fields = tuple(columns if fields is None else fields)
    if any(data.get(name) is not None for name in fields):
        raise DomainError("file", data["file"], f"give either the file or {', '.join(fields)}, not both")
    if not isinstance(data["file"], (str, Path)):
        raise DomainError("file", data["file"], 'give the name of a CSV or netCDF file, such as "profile.csv"')
    last = list(columns)[-1]
    chosen = {} if data.get("column") is None else {last: str(data["column"])}
    rest = {name: value for name, value in data.items() if name not in ("file", "column")}
    return rest | read_columns(data["file"], columns, chosen)


def column_names(path: str | Path) -> tuple[str, ...]:
    """Names of the columns of a file, without their units."""
    return tuple(_columns(str(path)))


def _columns(path: str) -> dict[str, Column]:
    try:
        stamp = Path(path).stat().st_mtime_ns
    except (OSError, ValueError) as error:
        remedy = f"cannot be read ({getattr(error, 'strerror', None) or error}); check the path"
        raise TableFileError(path, remedy) from error
    if path.lower().endswith(FITS):
        return _read_fits(path, stamp)
    return _read_netcdf(path, stamp) if path.lower().endswith(NETCDF) else _read_csv(path, stamp)


def _find(
    path: str, columns: Mapping[str, Column], field: str, want: Wanted, chosen: str | None, taken: Iterable[str] | None
) -> str:
    """Name of the column that has what a field wants."""
    if chosen is not None:
        if chosen not in columns:
            raise TableFileError(path, f"has no column {chosen}; {nearest(chosen, columns)}")
        return chosen
    lowered = {name.lower(): name for name in columns}
    for name in (field, *want.names):
        if name.lower() in lowered:
            return lowered[name.lower()]
    if taken is None:
        raise TableFileError(path, f"has no column {' or '.join(want.names)}; there are {', '.join(columns)}")
    others = [name for name in columns if name not in set(taken)]
    if len(others) != 1:
        rule = f'say in the model which one is meant: column = "{others[0]}"' if others else "add one"
        names = f"{len(others)} columns that {field} could be ({', '.join(others)})" if others else f"no column {field}"
        raise TableFileError(path, f"has {names}; {rule}")
    return others[0]


def _converted(path: str, name: str, column: Column, measure: Measure) -> tuple[float, ...]:
    unit = "" if column.unit is None or column.unit in ("1", "-", "none") else column.unit
    if not unit and measure.house:
        inside = "give it an attribute units (TUNIT in FITS)"
        rule = f'write it there, such as "{name} [{measure.house}]"' if column.lines else inside
        raise TableFileError(path, f"does not say the unit of {name}; {rule}", column=name)
    factor = measure.factor(unit)
    if factor is None:
        units = ", ".join(measure.units) or "none"
        raise TableFileError(path, f"the unit {unit} is none of a {measure.noun}; give one of {units}", column=name)
    numbers = []
    for place, value in enumerate(column.values):
        line, where = column.place_of(name, place)
        try:
            number = float(value) * factor
            if not np.isfinite(number):
                raise ValueError
            measure.check(number, name, value)
        except DomainError as error:
            raise TableFileError(path, f"{value}: {error.allowed}", line, where) from error
        except ValueError as error:
            raise TableFileError(path, f"{value!r} is not a finite number; mend it", line, where) from error
        numbers.append(number)
    return tuple(numbers)


def _named(header: str, known: str = "nm um m km deg K m2") -> tuple[str, str | None]:
    """Name and unit of a column from its header."""
    match = _WITH_UNIT.fullmatch(header.strip())
    if match:
        return match[1], match[2].strip()
    name, per, unit = header.strip().partition("_per_")
    if per and unit in known.split():
        return name, f"1/{unit}"
    name, underscore, unit = header.strip().rpartition("_")
    return (name, unit) if underscore and unit in known.split() else (header.strip(), None)


@lru_cache(maxsize=16)
def _read_csv(path: str, _: int) -> dict[str, Column]:
    try:
        rows = list(enumerate(Path(path).read_text(encoding="utf-8-sig").splitlines(), start=1))
    except (OSError, UnicodeDecodeError) as error:
        raise TableFileError(path, f"cannot be read as text ({error.__class__.__name__}); check the path") from error
    rows = [(line, text) for line, text in rows if text.strip() and not text.lstrip().startswith("#")]
    if len(rows) < 2:
        raise TableFileError(path, "needs a header line with the names of the columns, and rows of numbers below it")
    split = ";" if ";" in rows[0][1] else "," if "," in rows[0][1] else "\t" if "\t" in rows[0][1] else ","
    cells = [(line, next(csv.reader([text], delimiter=split))) for line, text in rows]
    header = [_named(cell) for cell in cells[0][1]]
    for line, row in cells[1:]:
        if len(row) != len(header):
            raise TableFileError(path, f"has {len(row)} cells, the header {len(header)}; mend it", line)
    lines = tuple(line for line, _ in cells[1:])
    columns: dict[str, Column] = {}
    for place, (name, unit) in enumerate(header):
        if name in columns or not name:
            raise TableFileError(path, "each column needs a name of its own", cells[0][0], f"{place + 1} ({name})")
        columns[name] = Column(unit, tuple(row[place].strip() for _, row in cells[1:]), lines, place + 1)
    return columns


@lru_cache(maxsize=16)
def _read_fits(path: str, _: int) -> dict[str, Column]:
    import warnings

    from astropy.io import fits

    try:
        with warnings.catch_warnings():
            # What astropy would mend or only remark on is of no concern to numbers that can be read.
            warnings.simplefilter("ignore")
            with fits.open(path) as parts:
                table = next((part for part in parts if isinstance(part, (fits.BinTableHDU, fits.TableHDU))), None)
                if table is None:
                    raise TableFileError(path, "holds no table; save the columns as a table extension")
                found = {column.name: (column.unit, np.asarray(table.data[column.name])) for column in table.columns}
    except (OSError, ValueError, TypeError) as error:
        if isinstance(error, TableFileError):
            raise
        reason = " ".join(str(error).split())[:120]
        raise TableFileError(path, f"cannot be read as FITS ({reason}); check the file") from error
    return {
        name: Column(unit, tuple(values.tolist()), (), place)
        for place, (name, (unit, values)) in enumerate(found.items(), start=1)
        if values.ndim == 1 and values.dtype.kind in "fiu"
    }


@lru_cache(maxsize=16)
def _read_netcdf(path: str, _: int) -> dict[str, Column]:
    import xarray

    try:
        with xarray.open_dataset(path, decode_times=False) as data:
            found = {
                str(name): (data[name].attrs.get("units"), np.atleast_1d(np.squeeze(data[name].values)))
                for name in data.variables
            }
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise TableFileError(path, f"cannot be read as netCDF ({reason}); check the file") from error
    return {
        name: Column(None if unit is None else str(unit), tuple(values.tolist()), (), place)
        for place, (name, (unit, values)) in enumerate(found.items(), start=1)
        if values.ndim == 1 and values.dtype.kind in "fiu"
    }
