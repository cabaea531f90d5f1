"""How kernels are compiled: serial, without the GIL, and cached on disk.

Numba's disk cache looks only at the source file of the function itself.  After an edit to a function that it calls in
another file, the old machine code would still be used.  So every kernel here carries one stamp made of all kernel
sources: a change in any of them (an edit, an upgrade of the package) compiles all of them anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit


@cache
def source_stamp() -> str:
    """Hash of the sources of all kernels."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    compiled = njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    # The index of the cache compares this stamp and starts over when it differs.
    compiled._cache._cache_file._source_stamp = source_stamp()
    return compiled


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
    """Like `kernel`, for a function that is called from one place: its body is compiled there, and only there."""
    return _compile(function, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, inline="always")


def entry(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python may call; it too must not make arrays."""
    return _compile(function, _nrt=False, no_cfunc_wrapper=True)
