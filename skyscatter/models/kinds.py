"""Which kinds of records there are, and which of them fit where."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, get_args

from skyscatter.problems import numbered
from skyscatter.record import Record

#: What a model is of, by the command that renders it.
SORTS = {"sky": "a planet with its air", "nebula": "a nebula", "render": "a scene of surfaces"}
#: Optics of use in each sort of model, the plain ones first; others are not refused.
_OPTICS = {
    "sky": ("rayleigh-air", "rayleigh", "particles", "mie", "gas-absorption", "absorption-table"),
    "nebula": ("dust", "gas-lines", "particles", "mie", "rayleigh", "absorption-table"),
    "render": ("particles", "mie", "artist", "rayleigh-air", "rayleigh", "gas-absorption", "absorption-table"),
}


#: Tables that hold components, and the sort of models whose densities fit there; that of the model where none is named.
_HOLDERS = {"components": "", "media": "render", "fields": "nebula"}


def kinds_of(union: Any) -> dict[str, type[Record]]:
    """Classes of a union of records by their kinds."""
    found: dict[str, type[Record]] = {}
    for part in get_args(union):
        if isinstance(part, type) and issubclass(part, Record):
            found[str(part.model_fields["kind"].default)] = part
        else:
            found |= kinds_of(part)
    return found


def densities(command: str) -> dict[str, type[Record]]:
    """Density fields that fit the components of a sort of models, by their kinds."""
    from skyscatter.media.everywhere import Everywhere
    from skyscatter.media.fields import AnyField
    from skyscatter.media.operations import AnySpatialField

    if command == "sky":
        return kinds_of(AnyField)
    return kinds_of(AnySpatialField) | ({"everywhere": Everywhere} if command == "render" else {})


def fitting_kinds(command: str, path: str, kinds: Sequence[str]) -> Sequence[str]:
    """Those kinds, of all that a type allows, that fit at a place of a model's file."""
    parts = path.split(".")
    in_component = len(parts) > 2 and parts[-3] in ("components", "fields") and parts[0] in _HOLDERS
    if in_component and parts[-1] == "density":
        return list(densities(_HOLDERS[parts[0]] or command))
    if in_component and parts[-1] == "optics":
        return _OPTICS[command]
    return [kind for kind in kinds if not (parts[-1] == "camera" and kind == "planet")]


def misplaced(command: str, content: Mapping[str, Any]) -> list[str]:
    """A line for each density field that belongs to another sort of model, or to another table."""
    known = {sort: set(densities(sort)) for sort in SORTS}
    everywhere = set().union(*known.values())
    lines = []
    for path, kind in _densities(content):
        sort = _HOLDERS[path.partition(".")[0]] or command
        if kind in everywhere - known[sort]:
            place = SORTS[command] if sort == command else "this table"
            rule = f"does not fit {place}; choose {', '.join(densities(sort))}"
            lines.append(f"{path}.density.kind = {kind!r}: {rule}")
    return lines


def _densities(content: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Paths of components and the kinds of their densities."""
    for name in _HOLDERS:
        tables = content.get(name)
        for place, table in enumerate(tables if isinstance(tables, (list, tuple)) else ()):
            if not isinstance(table, Mapping):
                continue
            density = table.get("density")
            if name == "media":
                yield from _densities(table, f"{path}media.{numbered(place, table)}.")
            elif isinstance(density, Mapping) and isinstance(density.get("kind"), str):
                yield f"{path}{name}.{numbered(place, table)}", density["kind"]
