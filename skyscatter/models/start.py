"""A model to start from: a shipped one as a file to edit, with comments on what may stand in it."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator

from skyscatter.datafiles import models_dir
from skyscatter.errors import ModelFileError
from skyscatter.models.catalogue import groups, records_in
from skyscatter.models.files import load_model, model_names
from skyscatter.models.reference import Row, rows, summary
from skyscatter.record import Record, similar

_WIDTH = 110
_TABLE = re.compile(r"\[+([\w.]+)\]+\s*")
_KIND = re.compile(r'(\w+)(?: = \{ kind)? = "([\w-]+)".*')
#: Groups of kinds by the name of the field that takes them.
_GROUPS = {
    "density": ("densities of skies", "densities in space"), "optics": ("optics",), "camera": ("cameras",),
    "shape": ("shapes",), "material": ("materials",), "lamps": ("lamps",), "towns": ("towns",),
}  # fmt: skip


def model_to_edit(name: str) -> str:
    """A shipped model as text with comments; what it leaves out stands there with its default, commented out.

    Raises
    ------
    ModelFileError
        If no such model is shipped.
    """
    if name not in model_names():
        meant = similar(name, model_names())
        hint = f"did you mean {meant}? " if meant else ""
        raise ModelFileError(name, f"no such shipped model; {hint}choose from {', '.join(model_names())}")
    model = load_model(name)
    text = (models_dir() / f"{name}.toml").read_text(encoding="utf-8")
    lines = [*_head(name, model.command), *_commented(text.splitlines(), type(model)), *_left_out(text, type(model))]
    return "\n".join(lines) + "\n"


def _head(name: str, command: str) -> list[str]:
    return [
        f'# After the model {name} of skyscatter.  Lengths are in metres unless a unit follows: "8 km".',
        "#   skyscatter models check FILE           says what is wrong in it",
        f"#   skyscatter {command} FILE -o picture.png{'':<{8 - len(command)}} renders it",
        "#   skyscatter models reference            lists all tables, kinds and fields",
        "",
    ]


def _commented(lines: list[str], model: type[Record]) -> Iterator[str]:
    """The lines of a model file with a comment on each sort of table and on each kind, where it is first met."""
    said: set[str] = set()
    table = ""
    for line in lines:
        header, kind = _TABLE.fullmatch(line), _KIND.fullmatch(line)
        if header:
            table = header[1].rpartition(".")[2]
            record = _record(model, header[1])
            if record is not None and record.__name__ not in said:
                said.add(record.__name__)
                yield from _comment(_first_sentence(record))
                for row in rows(record):
                    yield from _comment(f"{row.name}: {_said(row)}")
        elif kind:
            field = table if kind[1] == "kind" else kind[1]
            kinds = [groups()[title] for title in _GROUPS.get(field, ())]
            record = next((one[kind[2]] for one in kinds if kind[2] in one), None)
            if record is not None and f"{field} {kind[2]}" not in said:
                said.add(f"{field} {kind[2]}")
                yield from _comment(f"{field} {kind[2]}: {_first_sentence(record)}")
        yield line


def _record(model: type[Record], path: str) -> type[Record] | None:
    """The table without a kind that stands at the path of a header."""
    found: type[Record] | None = model
    for part in path.split("."):
        info = found.model_fields.get(part) if found is not None else None
        held = [] if info is None else [one for one in records_in(info.annotation) if "kind" not in one.model_fields]
        found = held[0] if held else None
    return found


def _left_out(text: str, model: type[Record]) -> Iterator[str]:
    """Tables that the file does not have, with their defaults, as comments."""
    for name, info in model.model_fields.items():
        record = info.annotation
        if not (isinstance(record, type) and issubclass(record, Record)) or info.is_required():
            continue
        if f"[{name}]" not in text:
            yield from (
                "",
                *_comment(f"{_first_sentence(record)}  As it is when this table is left out:"),
                f"# [{name}]",
            )
            for row in rows(record):
                yield from _comment(f"{row.name}: {_said(row)}")
                yield f"# {row.name} = {row.default}" if row.default != "none" else f"# {row.name} ="


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text.replace("``", "`"), _WIDTH, initial_indent="# ", subsequent_indent="#     ")


def _said(row: Row) -> str:
    written = re.sub(r"\[([^\]]*)\]\(#[^)]*\)", r"\1", row.written)
    return f"{written}{f', {row.range}' if row.range else ''}. {row.text}".strip()


def _first_sentence(record: type[Record]) -> str:
    return " ".join(summary(record).split("\n\n")[0].split())
