"""Inversion: from images and radiances back to densities and parameters, each with its uncertainty.

Names load when they are first used, as those of the package itself.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "FitResult": "skyscatter.inversion.fitresult",
    "LogNormal": "skyscatter.inversion.distributions",
    "LogUniform": "skyscatter.inversion.distributions",
    "Normal": "skyscatter.inversion.distributions",
    "Uniform": "skyscatter.inversion.distributions",
    "fit": "skyscatter.inversion.fit",
    "optimal_estimation": "skyscatter.inversion.estimation",
    "radiance_table": "skyscatter.inversion.radiances",
    "read_observation": "skyscatter.inversion.readers",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'skyscatter.inversion' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
