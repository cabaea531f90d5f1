"""Names of a package that are loaded when they are first used: importing it then costs nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any


def lazy_names(
    space: dict[str, Any], homes: Mapping[str, str], modules: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """``__getattr__`` and ``__dir__`` of a package.

    Parameters
    ----------
    space : dict
        Its ``globals()``, where a name is kept once it was used.
    homes : mapping
        Name -> module that has it.
    modules : sequence of str
        Modules below the package that are names of it, too.
    """
    package = space["__name__"]

    def get(name: str) -> Any:
        if name in homes:
            value = space[name] = getattr(import_module(homes[name]), name)
            return value
        if name in modules:
            return import_module(f"{package}.{name}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return get, lambda: sorted({*space, *homes, *modules})
