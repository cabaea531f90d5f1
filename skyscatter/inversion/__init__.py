"""Inversion: from images and radiances back to densities and parameters, with their uncertainties."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

_HOMES = {
    "Derivatives": "skyscatter.inversion.derivatives",
    "differentiate": "skyscatter.inversion.derivatives",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from skyscatter.inversion.derivatives import Derivatives, differentiate


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
