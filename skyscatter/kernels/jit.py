"""How kernels are compiled: serial, without the GIL, and cached on disk.

Numba's disk cache looks only at the source file of the function itself.  After an edit to a constant or a function that
it takes from another file, the old machine code would still be used.  So every kernel carries a stamp made of all
sources that its own module imports, directly or not: a change in any of them (an edit, an upgrade of the package)
compiles it anew, and nothing else.
"""

from __future__ import annotations

import ast
import hashlib
import logging
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit

from skyscatter.kernels.pipeline import OnceOptimised
from skyscatter.kernels.signals import postponed

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


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    compiled = njit(nogil=True, error_model="numpy", pipeline_class=OnceOptimised, **options)(function)
    try:
        compiled.enable_caching()
    except RuntimeError:  # no folder that numba knows of may be written to
        _say_uncached("no folder may be written to")
        return compiled
    # The index of the cache compares this stamp and starts over when it differs.
    compiled._cache._cache_file._source_stamp = source_stamp(Path(function.__code__.co_filename))
    load, save = compiled._cache.load_overload, compiled._cache.save_overload

    def load_undisturbed(signature: Any, context: Any) -> Any:
        with postponed():
            return load(signature, context)

    def save_if_possible(signature: Any, data: Any) -> None:
        try:
            save(signature, data)
        except OSError as error:  # such as a full disk
            _say_uncached(error.strerror or str(error))

    compiled._cache.load_overload, compiled._cache.save_overload = load_undisturbed, save_if_possible
    return compiled


@cache
def _say_uncached(reason: str) -> None:
    """Say once why every run will compile anew."""
    remedy = "every run compiles for up to a minute; name a folder for them in NUMBA_CACHE_DIR"
    logging.getLogger(PACKAGE).warning("compiled kernels cannot be kept (%s): %s", reason, remedy)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile an inner loop; ``.py_func`` keeps the plain Python twin.

    It must not make arrays: Numba's reference counts are switched off, because counting the arrays of a `SceneTable`
    at every call costs more than the arithmetic.  Python cannot call it, not even through another kernel's
    ``.py_func``: the wrappers that would unpack a scene's tables take as long to compile as the function.
    """
    return _compile(function, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def inlined(function: Callable[..., Any]) -> Any:
    """Like `kernel`, for small functions in the innermost loops.

    A table passed to a function that is not inlined is copied, number by number, at every call.
    """
    return _compile(function, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True)


def summing(function: Callable[..., Any]) -> Any:
    """Like `inlined`, for a sum whose order does not matter, so that it can use vector registers."""
    flags = {"reassoc", "nsz", "contract"}
    return _compile(
        function, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True, fastmath=flags
    )


def reduction(function: Callable[..., Any]) -> Any:
    """Like `kernel`, for a long sum: its terms may be added in any order, and so several at a time."""
    return _compile(
        function, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, fastmath={"reassoc", "contract"}
    )


def merged(function: Callable[..., Any]) -> Any:
    """Like `kernel`, for what is called from one place or is a line: its body is compiled there, and only there."""
    return _compile(function, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, inline="always")


def entry(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python may call; it too must not make arrays."""
    return _compile(function, _nrt=False, no_cfunc_wrapper=True)


def allocating(function: Callable[..., Any]) -> Any:
    """Like `entry`, for a kernel that makes arrays of its own."""
    return _compile(function)
