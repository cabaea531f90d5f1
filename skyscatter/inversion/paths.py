"""Numbers inside records, by dotted names: reading them, and making new, checked records with another number there."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from skyscatter.errors import DomainError
from skyscatter.record import Record, nearest

_AXES = ("x", "y", "z")


def offered(node: Any) -> list[str]:
    """Names by which one can go on from a node."""
    if isinstance(node, Record):
        return [name for name in type(node).model_fields if name != "kind"]
    if isinstance(node, tuple) and node and isinstance(node[0], Record):
        names = [getattr(item, "name", None) for item in node]
        return [str(name) for name in names if name] or [str(k) for k in range(len(node))]
    if isinstance(node, tuple):
        return list(_AXES) if len(node) == 3 else [str(k) for k in range(len(node))]
    return []


def _index(node: tuple[Any, ...], word: str) -> int | None:
    """Which item of a tuple a word means: by its number, its name, or its axis."""
    if word.isdecimal():
        return int(word) if int(word) < len(node) else None
    if node and isinstance(node[0], Record):
        found = [k for k, item in enumerate(node) if getattr(item, "name", None) == word]
        return found[0] if found else None
    return _AXES.index(word) if len(node) == 3 and word in _AXES else None


def child(node: Any, word: str, name: str) -> Any:
    """One step down; `name` is the whole dotted name, for the error."""
    if isinstance(node, Record) and word in type(node).model_fields and word != "kind":
        return getattr(node, word)
    if isinstance(node, tuple):
        index = _index(node, word)
        if index is not None:
            return node[index]
    known = offered(node)
    remedy = f"{word!r} is no such name here; {nearest(word, known)}" if known else f"nothing lies below {word!r}"
    raise DomainError("free", name, remedy)


def read(node: Any, words: tuple[str, ...], name: str) -> Any:
    """What lies at the end of a path."""
    for word in words:
        node = child(node, word, name)
    return node


def number(node: Any, words: tuple[str, ...], name: str) -> float:
    """The number at the end of a path."""
    value = read(node, words, name)
    if value is None:
        raise DomainError("free", name, "the model gives no number there; state it in the model file first")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        known = offered(value)
        remedy = f"go on with one of {', '.join(known)}" if known else "free a number"
        raise DomainError("free", name, f"is not a number but a {type(value).__name__}; {remedy}")
    return float(value)


def replaced(node: Any, words: tuple[str, ...], value: Any, name: str) -> Any:
    """The same record with another value at the end of a path; every record on the way is made, and checked, anew."""
    if not words:
        return value
    below = replaced(child(node, words[0], name), words[1:], value, name)
    if isinstance(node, tuple):
        index = _index(node, words[0])
        return tuple(below if k == index else item for k, item in enumerate(node))
    return changed(node, name, **{words[0]: below})


def changed(record: Any, name: str, **fields: Any) -> Any:
    """The same record with other fields, checked; `name` is blamed where they are refused."""
    content = {field: getattr(record, field) for field in type(record).model_fields}
    try:
        return type(record)(**(content | fields))
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        cause = problem.get("ctx", {}).get("error")
        rule = cause.allowed if isinstance(cause, DomainError) else problem["msg"].removeprefix("Value error, ")
        shown = next((v for v in fields.values() if isinstance(v, (int, float))), problem["input"])
        raise DomainError(name, shown if isinstance(shown, (int, float, str)) else "this value", rule) from error
