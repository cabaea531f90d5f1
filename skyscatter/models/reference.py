"""The reference of the model file, made from the classes themselves: tables, kinds, fields, units, defaults, ranges."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Iterator
from functools import lru_cache
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

import annotated_types
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from skyscatter import units
from skyscatter.errors import DomainError, shown
from skyscatter.media.arrays import FrozenArray
from skyscatter.models.catalogue import groups, sorts, tables
from skyscatter.models.examples import EXAMPLES, TABLES
from skyscatter.models.kinds import SORTS, densities
from skyscatter.record import Record, nearest
from skyscatter.spectra.table import SpectralMeasure
from skyscatter.units import Measure

_ENTRY = re.compile(r"(\w+(?:, \w+)*) ?(?::.*)?")


class Row(NamedTuple):
    """What the reference says of one field."""

    name: str
    written: str  #: what one writes, with the unit of bare numbers
    default: str  #: "required" where there is none
    range: str
    text: str


@lru_cache(maxsize=256)
def field_texts(record: type[Record]) -> dict[str, str]:
    """What the docstrings of a class and its bases say of its fields."""
    found: dict[str, str] = {}
    for part in record.__mro__:
        if issubclass(part, Record):
            found = _documented(part) | found
    return {name: text for name, text in found.items() if name in record.model_fields}


def _documented(record: type[Record]) -> dict[str, str]:
    """Fields that a docstring lists under its heading Parameters."""
    _, _, listed = inspect.cleandoc(record.__dict__.get("__doc__") or "").partition("Parameters\n----------\n")
    found: dict[str, str] = {}
    names: list[str] = []
    for line in listed.splitlines():
        entry = _ENTRY.fullmatch(line)
        if line.startswith(" "):
            found |= {name: f"{found[name]} {line.strip()}".strip() for name in names}
        elif entry:
            names = entry[1].split(", ")
            found |= dict.fromkeys(names, "")
        elif line.strip():
            break
    return found


def before_sections(text: str) -> str:
    """What a docstring says before its first section."""
    return re.split(r"^.+\n-{3,}$", inspect.cleandoc(text), maxsplit=1, flags=re.MULTILINE)[0].strip()


def summary(record: type[Record]) -> str:
    """What a record's docstring says before its first section."""
    return before_sections(record.__doc__ or "")


def rows(record: type[Record]) -> list[Row]:
    """A row for each field of a record but its kind."""
    texts = field_texts(record)
    return [_row(name, info, texts.get(name, "")) for name, info in record.model_fields.items() if name != "kind"]


def _row(name: str, info: FieldInfo, text: str) -> Row:
    written = _written(info.annotation, tuple(info.metadata))
    bounds = dict.fromkeys(_ranges(info.annotation, tuple(info.metadata)))
    return Row(name, written, _default(info), "; ".join(bounds), text)


def _default(info: FieldInfo) -> str:
    value = info.default
    if value is PydanticUndefined:
        return "required"
    if value is None:
        return "none"
    if isinstance(value, Record):
        given = ", ".join(f"{key} = {_plain(one)}" for key, one in value if one != () and one is not None)
        return f"{{ {given} }}"
    return _plain(value)


def _plain(value: Any) -> str:
    if isinstance(value, Record):
        return _default(FieldInfo(default=value))
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(_plain(part) for part in value)}]"
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return f'"{value}"' if isinstance(value, str) else shown(value)


def _written(annotation: Any, metadata: tuple[Any, ...]) -> str:
    """What one writes for an annotation."""
    for part in metadata:
        if isinstance(part, SpectralMeasure):
            names = " or ".join(f'"{name}"' for name in part.names) or ("name" if part.named else "")
            number = "" if part.measure.noun == units.RELATIVE.noun else _measure(part.measure)
            return " or ".join(way for way in (number, "table over wavelength", names) if way)
        if isinstance(part, Measure):
            return _measure(part)
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _written(inner[0], inner[1:])
    if origin is Literal:
        return " or ".join(_plain(one) for one in inner)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_written(part, ()) for part in inner if part is not type(None)))
    if origin is tuple:
        if inner[-1] is Ellipsis:
            return f"list of {_written(inner[0], ())}"
        same = len({_written(part, ()) for part in inner}) == 1
        return f"list of {len(inner)}: {_written(inner[0], ()) if same else ', '.join(_written(p, ()) for p in inner)}"
    return _name(annotation)


def _name(annotation: Any) -> str:
    if isinstance(annotation, type) and issubclass(annotation, Record):
        for title, kinds in groups().items():
            if annotation in kinds.values():
                return f"kind of [{title}](#{_anchor(title)})"
        return f"table [{annotation.__name__}](#{annotation.__name__.lower()})"
    names = {float: "number", int: "whole number", bool: "true or false", str: "text"}
    return "list of numbers" if annotation in (Any, FrozenArray) else names.get(annotation, str(annotation))


def _measure(measure: Measure) -> str:
    if measure.noun in ("number", "share"):
        return "number or percentage" if measure.noun == "share" else "number"
    return f"{measure.noun} [{measure.house}]" if measure.house else measure.noun


def _ranges(annotation: Any, metadata: tuple[Any, ...]) -> Iterator[str]:
    """The bounds of a field in words."""
    for part in metadata:
        measure = part.measure if isinstance(part, SpectralMeasure) else part
        if isinstance(measure, Measure) and measure.range:
            yield measure.range
        for name, words in (("gt", "above"), ("ge", "at least"), ("lt", "below"), ("le", "at most")):
            if getattr(part, name, None) is not None:
                yield f"{words} {getattr(part, name):g}"
        if isinstance(part, annotated_types.MinLen):
            yield f"{part.min_length} or more"
    inner = get_args(annotation)
    if get_origin(annotation) is Annotated:
        yield from _ranges(inner[0], inner[1:])
    elif get_origin(annotation) is not Literal:
        for one in inner:
            yield from _ranges(one, ())


def section(title: str, record: type[Record], example: str) -> str:
    """The part of the reference on one record, as Markdown."""
    lines = [f"### {title}", "", summary(record).replace("|", "\\|"), ""]
    listed = rows(record)
    if listed:
        lines += ["| field | what | default | range | meaning |", "| --- | --- | --- | --- | --- |"]
        lines += [f"| `{r.name}` | {r.written} | {r.default} | {r.range} | {r.text} |".replace("  ", " ")
                  .replace("|z|", "\\|z\\|") for r in listed]  # fmt: skip
        lines.append("")
    return "\n".join([*lines, "```toml", example, "```", ""])


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")


#: The key before an example of a kind, by the group.
KEYS = {
    "densities of skies": "density", "densities in space": "density", "optics": "optics", "phase functions": "phase",
    "lamps": "lamp", "lobes": "lobe", "materials": "material", "shapes": "shape", "cameras": "camera",
    "towns": "town",
}  # fmt: skip


def reference(name: str | None = None) -> str:
    """The reference of the model file as Markdown.

    Parameters
    ----------
    name : str, optional
        Only of this kind or table.

    Raises
    ------
    DomainError
        If there is no kind or table of that name.
    """
    parts = list(_parts())
    if name is None:
        return "\n".join(text for _, text in parts).rstrip() + "\n"
    chosen = [text for title, text in parts if title.lower() == name.lower()]
    if not chosen:
        raise DomainError(
            "name", name, f"no such kind or table; {nearest(name, [title for title, _ in parts if title])}"
        )
    return "\n".join(chosen).rstrip() + "\n"


def _parts() -> Iterator[tuple[str, str]]:
    """Parts of the reference: the kind or table that each is about, and its text."""
    yield "", _INTRODUCTION.format(units=_unit_table())
    yield "", "## Models\n"
    for command, model in sorts().items():
        title = {"sky": "A sky", "nebula": "A nebula", "render": "A scene of surfaces"}[command]
        example = f"# skyscatter models new {_STARTS[command]} my.toml writes one to start from"
        yield model.__name__, section(f"{title} ({model.__name__})", model, example)
        fitting = ", ".join(f"[{kind}](#{kind})" for kind in densities(command))
        yield "", f"Densities that fit {SORTS[command]}: {fitting}.\n"
    yield "", "## Tables\n"
    for record in tables():
        yield (
            record.__name__,
            section(record.__name__, record, f"{record.__name__.lower()} = {TABLES[record.__name__]}"),
        )
    for title, kinds in groups().items():
        yield "", f"## {title[0].upper()}{title[1:]}\n"
        for kind, record in kinds.items():
            yield kind, section(kind, record, f"{KEYS[title]} = {EXAMPLES[title][kind]}")


_STARTS = {"sky": "earth", "nebula": "reflection-nebula", "render": "fog-room"}


def _unit_table() -> str:
    measures = [value for value in vars(units).values() if isinstance(value, Measure) and value.house]
    lines = ["| quantity | bare numbers are | units | example |", "| --- | --- | --- | --- |"]
    for one in measures:
        lines.append(f'| {one.noun} | {one.house} | {", ".join(one.units)} | `"{one.example}"` |')
    return "\n".join(dict.fromkeys(lines))


_INTRODUCTION = """# The model file

A model is a [TOML](https://toml.io) file. This page is made from the program's own classes by
`skyscatter models reference`, which also prints the part on one kind or table: `skyscatter models reference tabulated`.

- `skyscatter models new earth my.toml` writes a model to start from, with comments; `skyscatter models` lists them all.
- `skyscatter models check my.toml` says what is wrong, a line for each field.
- `skyscatter models schema -o skyscatter.json` writes a JSON schema. With `#:schema ./skyscatter.json` in its first
  line an editor with Taplo (Even Better TOML) completes and checks a model file as it is written.

A file with a table `view` is a nebula, one with `viewpoint`, or with `bodies` or `media` but no `planet`, a scene of
surfaces, any other a sky.

**Units.** A number is in the unit that stands in brackets, or it is text with a unit: `"8 km"`, `"0.3 AU"`, `"30%"`.
In Python the same text will do, or an astropy Quantity. Beside the units below every unit of astropy's of the same
dimension is understood.

{units}

**Values over wavelength.** A field that is a number or a *table over wavelength* takes
`{{ wavelengths = [400, 700], values = [0.1, 0.3] }}`, or a file: `{{ file = "grass.csv", column = "albedo" }}`.

**Files.** A file is CSV or netCDF and is looked for from the folder of the model file. The header of a CSV names the
columns, each with its unit: `altitude [km],density [cm-3]`; lines that start with `#` are remarks. In netCDF the
variables are the columns, with the attribute `units`. A column of lengths, angles or wavelengths that does not say its
unit is refused. Profiles, size distributions, phase functions, lobes and everything over wavelength (albedos, optical
depths, refractive indices, spectra of lamps) can stand in files.
"""
