"""What a validation complains of, as lines that name the field as it stands in the file, the value and the remedy."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from skyscatter.errors import DomainError, UnitsError, shortened, shown
from skyscatter.record import UNKNOWN_FIELD, similar

#: Longest value that is shown whole.
_LONGEST = 80

#: Names that may stand in a path.
_PLAIN = re.compile(r"[\w -]{1,40}")

#: What would be accepted, by the type of a complaint.
_REMEDIES: dict[str, str] = {
    "float_type": "give a number",
    "float_parsing": "give a number",
    "int_type": "give a whole number",
    "int_parsing": "give a whole number",
    "int_from_float": "give a whole number",
    "finite_number": "give a finite number",
    "string_type": "give text in quotes",
    "bool_type": "give true or false",
    "bool_parsing": "give true or false",
    "tuple_type": "give a list [ ... ]",
    "model_type": "give a table { ... }",
    "model_attributes_type": "give a table { ... }",
    "dict_type": "give a table { ... }",
}

#: Kinds that fit where a field stands: from its path and the kinds that its type allows.
Fitting = Callable[[str, Sequence[str]], Sequence[str]]


def problem_lines(error: ValidationError, content: Any = None, fitting: Fitting | None = None) -> list[str]:
    """A line for each thing that is wrong: field, value, remedy.

    Parameters
    ----------
    error : ValidationError
    content : mapping, optional
        What was validated, as read from a file.
    fitting : callable, optional
        Which of the allowed kinds fit at a path; all of them when not given.
    """
    lines: dict[str, tuple[bool, str]] = {}
    for problem in error.errors(include_url=False):
        path = _path(problem, content)
        line = _line(problem, path, fitting)
        # Every branch of a union complains; the one that understood the value knows what is wrong with it.
        understood = problem["type"] == "value_error"
        place = f"{path} {line}" if understood or problem["type"] in ("missing", UNKNOWN_FIELD) else path
        if place not in lines or (understood and not lines[place][0]):
            lines[place] = understood, line
    return [line for _, line in lines.values()]


def _path(problem: Mapping[str, Any], content: Any) -> str:
    """Where a complaint belongs, as one would write it: without the tags and branches of unions."""
    parts, node = [], content
    location = problem["loc"]
    for place, part in enumerate(location):
        last = place == len(location) - 1
        if isinstance(node, Mapping) and (part in node or (last and problem["type"] == "missing")):
            node = node.get(part)
        elif isinstance(node, (list, tuple)) and isinstance(part, int) and part < len(node):
            node = node[part]
        elif content is not None or "(" in str(part):
            continue
        parts.append(numbered(part, node) if isinstance(part, int) else shortened(str(part)))
    return ".".join(parts)


def numbered(place: int, entry: Any) -> str:
    """An entry of a list as paths have it: its number, and its name where it has a plain one."""
    name = entry.get("name") if isinstance(entry, Mapping) else None
    return f"{place} ({name})" if isinstance(name, str) and _PLAIN.fullmatch(name) else str(place)


def _line(problem: Mapping[str, Any], path: str, fitting: Fitting | None) -> str:
    sort, context = problem["type"], problem.get("ctx", {})
    if sort == "value_error":
        return _own_words(problem, path, context.get("error"))
    if sort == "missing":
        return f"{path} is missing; add it"
    if sort == "union_tag_not_found":
        meant = similar("kind", map(str, problem["input"])) if isinstance(problem["input"], Mapping) else None
        return f"{path}.{meant}: no such field; did you mean kind?" if meant else f"{path}.kind is missing; add it"
    if sort == "union_tag_invalid":
        kinds = [kind.strip(" '") for kind in context["expected_tags"].split(",")]
        return unknown_kind(f"{path}.kind", str(context["tag"]), kinds if fitting is None else fitting(path, kinds))
    value = problem["input"]
    if sort == UNKNOWN_FIELD:
        # A whole table as the value would not fit on a line and would say nothing.
        return f"{path}{f' = {shown(value)}' if isinstance(value, (str, int, float)) else ''}: {problem['msg']}"
    return f"{path or 'model'} = {_short(value)}: {_remedy(problem)}"


def unknown_kind(field: str, kind: str, kinds: Sequence[str]) -> str:
    """The line for a kind that is not among those that fit."""
    meant = similar(kind, kinds)
    hint = f"did you mean {meant}? " if meant else ""
    return f"{field} = {shown(kind)}: no such kind here; {hint}there are {', '.join(kinds)}"


def _own_words(problem: Mapping[str, Any], path: str, error: Any) -> str:
    """The line for an error of skyscatter's own, which names the field and the value already."""
    message = " ".join(problem["msg"].removeprefix("Value error, ").split())
    if not isinstance(error, (DomainError, UnitsError)):
        return f"{path}: {message}" if path else message
    parts, value = path.split("."), problem["input"]
    named = [part for part in parts if not part[:1].isdecimal()]
    if error.name in named[-1:]:  # of the field itself, or of one of a list
        return f"{path}{message.removeprefix(error.name)}"
    inside = isinstance(value, Mapping) and error.name in value
    return f"{path}{'.' if inside else ': '}{message}" if path else message


def _remedy(problem: Mapping[str, Any]) -> str:
    sort, context = problem["type"], problem.get("ctx", {})
    if sort in _REMEDIES:
        return _REMEDIES[sort]
    if sort == "literal_error":
        choices = [choice.strip(" '") for choice in context["expected"].replace(" or ", ", ").split(",")]
        meant = similar(str(problem["input"]), choices)
        return f"{f'did you mean {meant}? ' if meant else ''}choose {' or '.join(choices)}"
    bounds = {"greater_than": ("above", "gt"), "greater_than_equal": ("at least", "ge"), "less_than": ("below", "lt"),
              "less_than_equal": ("at most", "le")}  # fmt: skip
    if sort in bounds:
        words, key = bounds[sort]
        return f"must be {words} {context[key]:g}"
    if sort in ("too_short", "too_long"):
        limit = context.get("min_length", context.get("max_length"))
        return f"has too {'few' if sort == 'too_short' else 'many'} entries ({context['actual_length']}); give {limit}"
    message = str(problem["msg"])
    return message[:1].lower() + message[1:]


def _short(value: Any) -> str:
    text = shown(value)
    return text if len(text) < _LONGEST else f"{text[: _LONGEST - 3]}..."
