"""Which sources the machine code of a kernel depends on, and a hash of them.

Numba's disk cache looks only at the source file of the function itself.  After an edit to a constant or a function that
it takes from another file, the old machine code would still be used.  So every kernel carries a stamp made of all
sources that its own module imports, directly or not: a change in any of them (an edit, an upgrade of the package)
compiles it anew, and nothing else.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

#: The package whose sources count, and the folder that holds it.
PACKAGE = "skyscatter"
ROOT = Path(__file__).parents[2]


def _source(name: str, root: Path) -> Path | None:
    """File of a module or package; None where the name is neither."""
    path = root.joinpath(*name.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


def _imports(source: bytes) -> Iterator[ast.Import | ast.ImportFrom]:
    """Import statements of a source, wherever a statement may stand; expressions, most of a source, hold none."""
    waiting: list[ast.AST] = [ast.parse(source)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            inner = getattr(node, block, None)
            if isinstance(inner, list):  # a lambda's body is an expression
                waiting += inner


@cache
def _imported(file: Path, root: Path) -> frozenset[Path]:
    """Files of this package that a source imports, also inside functions."""
    package = file.parent.relative_to(root).parts if file.is_relative_to(root) else ()
    found = set()
    for node in _imports(file.read_bytes()):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parts = package[: len(package) + 1 - node.level] if node.level else ()
            base = ".".join([*parts, *([node.module] if node.module else [])])
            # A name may be a module of the package or something in it; its own file counts in either case.
            names = [base, *(f"{base}.{alias.name}" for alias in node.names)]
        found |= {_source(name, root) for name in names if name.split(".")[0] == PACKAGE and name != PACKAGE}
    return frozenset(path for path in found if path is not None)


def closure(first: Path, root: Path = ROOT) -> list[Path]:
    """Source files that a module's file is made of: itself and all of this package that it imports.

    It may stand outside the package: a user's own kernel that calls ours.
    """
    found, waiting = {first}, [first]
    while waiting:
        file = waiting.pop()
        new = _imported(file, root) - found
        found |= new
        waiting += new
    return sorted(found)


@cache
def source_stamp(file: Path, root: Path = ROOT) -> str:
    """Hash of all sources that the machine code of the kernels in a file depends on."""
    digest = hashlib.sha256()
    for path in closure(file, root):
        digest.update(f"{path.relative_to(root) if path.is_relative_to(root) else path.name}\0".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
