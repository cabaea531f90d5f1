"""The theory as a book: one numbering of its equations, and functions that exist, found without importing them."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import skyscatter

PACKAGE = Path(skyscatter.__file__).parent
BOOK = Path(__file__).parents[2] / "docs" / "theory"

#: What begins a dotted path: the sub-packages and modules of the package.
TOP = {p.stem for p in PACKAGE.iterdir() if p.suffix == ".py" or (p / "__init__.py").is_file()}

NUMBER = re.compile(r"\((\d+)\) ")
CODE = re.compile(r"`([^`]*)`")
PATH = re.compile(r"[a-z_]+(\.[A-Za-z_]\w*)+")
MATH = re.compile(r"\$\$.*?\$\$|\$[^$]*\$", re.DOTALL)
#: Greek letters and signs that belong into formulas.
SYMBOL = re.compile(r"[\u0370-\u03ff\u2200-\u2211\u2213-\u22ff\u27e8\u27e9\u2080-\u209c]")

pytestmark = pytest.mark.skipif(not BOOK.is_dir(), reason="the pages are not beside an installed package")


def pages() -> list[str]:
    """Names of the pages, in the order of the table of contents."""
    toctree = (BOOK / "index.md").read_text(encoding="utf-8").split("```{toctree}\n")[1].split("```")[0]
    return [line for line in toctree.split("\n") if line and not line.startswith(":")]


def text_of(name: str) -> str:
    """A page without its fenced blocks."""
    text = (BOOK / f"{name}.md").read_text(encoding="utf-8")
    return re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)


def numbered(text: str) -> list[tuple[int, str]]:
    """Numbered paragraphs: each from its number to the next one or the next heading."""
    found: list[tuple[int, str]] = []
    open_ = False
    for line in text.split("\n"):
        if begins := NUMBER.match(line):
            found.append((int(begins[1]), line))
            open_ = True
        elif line.startswith("#"):
            open_ = False
        elif open_:
            found[-1] = (found[-1][0], found[-1][1] + "\n" + line)
    return found


@cache
def names_of(file: Path) -> frozenset[str]:
    """Functions, classes and what classes define, in a module."""
    names: set[str] = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            names.update(f"{node.name}.{part.name}" for part in node.body if isinstance(part, ast.FunctionDef))
    return frozenset(names)


def paths_in(text: str) -> list[str]:
    """Dotted paths of the package in code spans."""
    spans = CODE.findall(text)
    return [span for span in spans if PATH.fullmatch(span) and span.split(".")[0] in TOP]


def exists(path: str) -> bool:
    """Whether a module has that function, class or method, or a package that module."""
    parts = path.split(".")
    for k in range(len(parts), 0, -1):
        place = PACKAGE.joinpath(*parts[:k])
        file = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
        if file.is_file():
            return k == len(parts) or ".".join(parts[k:]) in names_of(file)
    return False


def test_the_table_of_contents_has_every_page_once() -> None:
    assert sorted(pages()) == sorted(p.stem for p in BOOK.glob("*.md") if p.stem != "index")


def test_numbers_run_from_one_without_gaps() -> None:
    numbers = [number for name in pages() for number, _ in numbered(text_of(name))]
    assert len(numbers) > 100
    assert numbers == list(range(1, len(numbers) + 1))


@pytest.mark.parametrize("name", pages() if BOOK.is_dir() else [])
def test_functions_of_a_page_exist(name: str) -> None:
    assert not [path for path in paths_in(text_of(name)) if not exists(path)]


@pytest.mark.parametrize("name", pages() if BOOK.is_dir() else [])
def test_every_equation_names_a_function(name: str) -> None:
    for number, text in numbered(text_of(name)):
        found = [path for path in paths_in(text) if not PACKAGE.joinpath(*path.split(".")).with_suffix(".py").is_file()]
        assert found, f"equation {number} names no function"


@pytest.mark.parametrize("name", pages() if BOOK.is_dir() else [])
def test_symbols_stand_in_formulas(name: str) -> None:
    """Greek letters and signs of formulas are typeset: outside of dollars and code there are none."""
    plain = CODE.sub("", MATH.sub("", text_of(name)))
    assert not [line for line in plain.split("\n") if not line.startswith("#") and SYMBOL.search(line)]


@pytest.mark.parametrize("name", pages() if BOOK.is_dir() else [])
def test_formulas_read_well_on_both_sites(name: str) -> None:
    """Displays between dollars on lines of their own, with empty lines around; no formula is broken over lines."""
    lines = text_of(name).split("\n")
    fences = [k for k, line in enumerate(lines) if line == "$$"]
    assert sum(line.count("$$") for line in lines) == len(fences)
    assert len(fences) % 2 == 0
    inside: set[int] = set()
    for first, last in zip(fences[::2], fences[1::2], strict=True):
        assert lines[first - 1] == ""
        assert lines[last + 1] == ""
        assert all(lines[first + 1 : last]), "an empty line ends a display"
        inside.update(range(first, last + 1))
    for k, line in enumerate(lines):
        if k not in inside:
            assert CODE.sub("", line).count("$") % 2 == 0, line
            assert not re.search(r"\\[^A-Za-z]", line), f"Markdown takes the backslash away: {line}"


def test_the_checker_sees_what_is_missing() -> None:
    assert exists("kernels.path.march")
    assert exists("solvers.series.Series.shares")
    assert exists("kernels.adjoint")
    assert not exists("kernels.path.marched")
    assert not exists("solvers.series.Series.nothing")
    assert not exists("kernels.nowhere.march")
    assert [n for n, _ in numbered("(1) a\nb\n\n# h\nc\n(2) d")] == [1, 2]
    assert numbered("(1) a\nb\n# h\nc")[0][1] == "(1) a\nb"
