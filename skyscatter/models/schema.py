"""A JSON schema of the model file, for editors: what each table, kind and field may be."""

from __future__ import annotations

import copy
from typing import Any

from pydantic.json_schema import models_json_schema

from skyscatter.errors import DomainError
from skyscatter.models.catalogue import sorts
from skyscatter.models.kinds import SORTS, densities
from skyscatter.models.reference import before_sections
from skyscatter.record import Record

#: The schema that editors know best; what pydantic writes is turned into it.
_DRAFT = "http://json-schema.org/draft-07/schema#"
#: Tables by which a file is known to be of a sort; one of them will do.
_MARKS: dict[str, list[dict[str, Any]]] = {
    "render": [
        {"required": ["viewpoint"]},
        *({"required": [name], "not": {"required": ["planet"]}} for name in ("bodies", "media")),
    ],
    "nebula": [{"required": ["view"]}],
}


def model_schema(sort: str | None = None) -> dict[str, Any]:
    """JSON schema (draft 7) of a model file.

    Parameters
    ----------
    sort : {"sky", "nebula", "render"}, optional
        Only of this sort of models; of all of them, told apart by their tables, when not given.

    Raises
    ------
    DomainError
        For an unknown sort.
    """
    if sort is not None and sort not in SORTS:
        raise DomainError("sort", sort, f"choose {', '.join(SORTS)}")
    places, whole = models_json_schema(
        [(record, "validation") for record in (*sorts().values(), *_records())], ref_template="#/definitions/{model}"
    )
    names = {record: place["$ref"].rpartition("/")[2] for (record, _), place in places.items()}
    definitions: dict[str, Any] = whole["$defs"]
    component = next(name for record, name in names.items() if record.__name__ == "Component")
    for command in SORTS:
        own = copy.deepcopy(definitions[component])
        fitting = [{"$ref": f"#/definitions/{names[one]}"} for one in densities(command).values()]
        own["properties"]["density"] = {"oneOf": fitting, "description": "Where it is."}
        definitions[f"{component}_{command}"] = own
    # What a sky holds in three dimensions has the densities of space.
    held = definitions[names[sorts()["sky"]]]["properties"]
    held["fields"] = _renamed(held["fields"], component, f"{component}_nebula")
    for command, model in sorts().items():
        for name in {
            names[model],
            *(n for r, n in names.items() if r.__name__ == "SurfaceMedium" and command == "render"),
        }:
            definitions[name] = _renamed(definitions[name], component, f"{component}_{command}")
    refs = {command: {"$ref": f"#/definitions/{names[model]}"} for command, model in sorts().items()}
    chosen = _by_tables(refs) if sort is None else refs[sort]
    needed = _reached(chosen, definitions)
    kept = {name: _draft7(_guarded(name, definitions)) for name in sorted(needed)}
    return {"$schema": _DRAFT, "title": "skyscatter model file", **chosen, "definitions": kept}


def _records() -> list[type[Record]]:
    """Records that the sorts share, so that their names in the schema are known."""
    from skyscatter.media.medium import Component
    from skyscatter.surfaces.scene import SurfaceMedium

    return [Component, SurfaceMedium, *{one for sort in SORTS for one in densities(sort).values()}]


def _by_tables(refs: dict[str, Any]) -> dict[str, Any]:
    """The sort by the tables that a file has."""
    chosen: dict[str, Any] = refs["sky"]
    for command in ("nebula", "render"):
        marks = {"anyOf": _MARKS[command]}
        chosen = {"if": marks, "then": refs[command], "else": chosen}
    return chosen


def _renamed(node: Any, old: str, new: str) -> Any:
    """A schema that refers to another definition."""
    if isinstance(node, dict):
        return {key: _renamed(value, old, new) for key, value in node.items()}
    if isinstance(node, list):
        return [_renamed(value, old, new) for value in node]
    return f"#/definitions/{new}" if node == f"#/definitions/{old}" else node


def _reached(node: Any, definitions: dict[str, Any]) -> set[str]:
    """Names of the definitions that a schema needs."""
    found: set[str] = set()
    open_nodes = [node]
    while open_nodes:
        one = open_nodes.pop()
        if isinstance(one, dict):
            name = str(one.get("$ref", "")).rpartition("/")[2]
            if name and name not in found:
                found.add(name)
                open_nodes.append(definitions[name])
            open_nodes += [value for key, value in one.items() if key not in ("$ref", "discriminator")]
        elif isinstance(one, list):
            open_nodes += one
    return found


def _guarded(name: str, definitions: dict[str, Any]) -> dict[str, Any]:
    """A definition that looks at what may hold itself, fields in fields, only where the kind is its own.

    Validators look at all that is wrong with every kind of which one has to fit, and kinds within kinds within kinds
    then take as many looks as there are kinds to the power of the depth.
    """
    whole: dict[str, Any] = definitions[name]
    own = whole.get("properties", {})
    kind = own.get("kind", {}).get("const")
    deep = [field for field, node in own.items() if name in _reached(node, definitions)]
    if kind is None or not deep:
        return whole
    words = ("title", "description", "default", "type")
    shallow = {field: {word: own[field][word] for word in words if word in own[field]} for field in deep}
    return {
        **whole,
        "properties": own | shallow,
        "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
        "then": {"properties": {field: own[field] for field in deep}},
    }


def _draft7(node: Any) -> Any:
    """A schema in the words of draft 7; what only other tools read is left out."""
    if isinstance(node, list):
        return [_draft7(value) for value in node]
    if not isinstance(node, dict):
        return node
    renamed = {"prefixItems": "items"}
    # The kind first: validators that go by the order then leave the branches of other kinds at once.
    ordered = {"kind": node["kind"], **node} if "kind" in node else node
    made = {renamed.get(key, key): _draft7(value) for key, value in ordered.items() if key != "discriminator"}
    if isinstance(made.get("description"), str):
        made["description"] = before_sections(made["description"])
    return made
