"""Names of the compiler, which is loaded when one of them is first used.

What is compiled already needs no compiler, and loading it takes longer than many a picture.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


class Later:
    """A module that is imported when something of it is asked for."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self._name), name)


ir = Later("llvmlite.ir")
types = Later("numba.types")
cgutils = Later("numba.core.cgutils")
