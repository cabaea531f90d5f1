"""Links of the theory: from equations to the functions that compute them and back, and from "(17)" to equation 17."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from docutils import nodes
from reference import write
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)

NUMBERED = re.compile(r"^\((\d+)\)\s")
REFERENCE = re.compile(r"\((\d+)\)")
FUNCTION = re.compile(r"^[a-z_]+(\.[A-Za-z_]\w*)+$")
PAGE = "functions"


def package_folder() -> Path:
    """Where the package's sources are."""
    import skyscatter

    return Path(skyscatter.__file__).parent


@cache
def find(path: str) -> tuple[Path, ast.FunctionDef | ast.ClassDef] | None:
    """Source file and definition of a function or a class by its path below ``skyscatter.``, without importing it."""
    parts = path.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        base = package_folder().joinpath(*parts[:cut])
        file = base.with_suffix(".py") if base.with_suffix(".py").is_file() else base / "__init__.py"
        if file.is_file():
            body: Any = ast.parse(file.read_text())
            for name in parts[cut:]:
                kinds = (ast.FunctionDef, ast.ClassDef)
                body = next((n for n in getattr(body, "body", []) if isinstance(n, kinds) and n.name == name), None)
            return None if body is None else (file, body)
    return None


def theory_pages(source: Path) -> list[Path]:
    """The pages of the theory in the order of the book."""
    lines = (source / "theory" / "index.md").read_text().split("{toctree}")[-1].splitlines()
    names = [line.strip() for line in lines if re.fullmatch(r"[a-z0-9-]+", line.strip())]
    return [source / "theory" / f"{name}.md" for name in names]


def equations(source: Path) -> dict[int, tuple[str, list[str]]]:
    """For every equation its page, and the paths of the functions that its paragraphs name."""
    found: dict[int, tuple[str, list[str]]] = {}
    for page in theory_pages(source):
        number = None
        for line in page.read_text().splitlines():
            start = NUMBERED.match(line)
            number = int(start[1]) if start else None if line.startswith("#") else number
            if number is not None:
                paths = found.setdefault(number, (f"theory/{page.stem}", []))[1]
                paths += named(line)
    return found


def named(text: str) -> list[str]:
    """The paths of functions and classes in a text."""
    return [path for path in re.findall(r"`([^`]+)`", text) if FUNCTION.match(path) and find(path)]


def listing(file: Path, definition: ast.FunctionDef | ast.ClassDef) -> str:
    """The source of a definition, with its decorators."""
    first = min([definition.lineno, *(d.lineno for d in definition.decorator_list)])
    return "\n".join(file.read_text().splitlines()[first - 1 : definition.end_lineno])


def make(app: Sphinx) -> None:
    """Write the list of equations, ``api/functions.md``, and pages with the functions' sources, one for a package."""
    source = Path(app.srcdir)
    by_function: dict[str, list[int]] = {path: [] for page in theory_pages(source) for path in named(page.read_text())}
    table = ["| equation | page | computed by |", "| --- | --- | --- |"]
    for number, (page, paths) in sorted(equations(source).items()):
        unique = list(dict.fromkeys(paths))
        for path in unique:
            by_function[path].append(number)
        links = ", ".join(f"[`{path}`](#{anchor(path)})" for path in unique)
        table.append(f"| [({number})](#eq-{number}) | [{page.split('/')[1]}](../{page}.md) | {links} |")
    pages = {PAGE: ["# Equations and functions", "", *table, ""]}
    children = [f"{PAGE}-{name}" for name in sorted(packages(by_function))]
    pages[PAGE] += ["```{toctree}", ":hidden:", "", *children, "```", ""]
    for name in packages(by_function):
        pages[f"{PAGE}-{name}"] = [f"# Functions of {name}", ""]
    for path in sorted(by_function):
        file, definition = found(path)
        numbers = ", ".join(f"[({n})](#eq-{n})" for n in by_function[path])
        entry = [f"({anchor(path)})=", f"## `{path}`", "", *([f"Equation {numbers}.", ""] if numbers else [])]
        pages[f"{PAGE}-{path.split('.')[0]}"] += [*entry, "```python", listing(file, definition), "```", ""]
    for name, lines in pages.items():
        write(source / "api" / f"{name}.md", "\n".join(lines))


def packages(paths: Iterable[str]) -> set[str]:
    """First words of the paths of functions, each of which has a page."""
    return {path.split(".")[0] for path in paths}


def found(path: str) -> tuple[Path, ast.FunctionDef | ast.ClassDef]:
    """What `find` finds, where something is there."""
    place = find(path)
    assert place is not None
    return place


def anchor(path: str) -> str:
    """Label of a function in the list."""
    return "function-" + path.replace(".", "-").replace("_", "-").lower()


def link(app: Sphinx, tree: nodes.document) -> None:
    """Give equations of a page of the theory their anchors, and make links of names and of numbers."""
    page = app.env.docname
    if not page.startswith("theory/") or page.endswith("/index"):
        return
    for paragraph in list(tree.findall(nodes.paragraph)):
        start = NUMBERED.match(paragraph.astext())
        if start:
            label = f"eq-{start[1]}"
            paragraph["ids"].append(label)
            paragraph["classes"].append("equation")
            app.env.get_domain("std").anonlabels[label] = (page, label)
            app.env.get_domain("std").labels[label] = (page, label, f"({start[1]})")
    for literal in list(tree.findall(nodes.literal)):
        path = literal.astext()
        if FUNCTION.match(path) and find(path):
            wrap(literal, anchor(path), page)
    numbers = set(equations(Path(app.srcdir)))
    for text in list(tree.findall(nodes.Text)):
        if not isinstance(text.parent, (nodes.literal, nodes.math, nodes.math_block, nodes.title, nodes.reference)):
            link_numbers(text, numbers, page)


def wrap(node: nodes.Node, label: str, page: str) -> addnodes.pending_xref:
    """A reference to a label around a node, in its place."""
    reference = addnodes.pending_xref(
        "", refdomain="std", reftype="ref", reftarget=label, refexplicit=True, refwarn=True, refdoc=page
    )
    node.parent.replace(node, reference)
    reference += node
    return reference


def link_numbers(text: nodes.Text, numbers: set[int], page: str) -> None:
    """Make links of the numbers of equations in a piece of text; the number that begins a paragraph becomes bold."""
    pieces: list[nodes.Node] = []
    end = 0
    begins = isinstance(text.parent, nodes.paragraph) and text.parent.index(text) == 0
    for match in REFERENCE.finditer(text):
        if int(match[1]) not in numbers:
            continue
        pieces.append(nodes.Text(text[end : match.start()]))
        if match.start() == 0 and begins:
            pieces.append(nodes.strong("", match[0], classes=["number"]))
        else:
            reference = addnodes.pending_xref(
                "", nodes.inline("", match[0]), refdomain="std", reftype="ref", reftarget=f"eq-{match[1]}",
                refexplicit=True, refwarn=True, refdoc=page,
            )  # fmt: skip
            pieces.append(reference)
        end = match.end()
    if pieces:
        pieces.append(nodes.Text(text[end:]))
        text.parent.replace(text, [p for p in pieces if not isinstance(p, nodes.Text) or p])


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the list before anything is read; link each page when it has been read."""
    app.connect("builder-inited", make)
    app.connect("doctree-read", link)
    return {"parallel_read_safe": True, "version": "1"}
