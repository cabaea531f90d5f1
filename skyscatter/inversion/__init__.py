"""From images and radiances back to densities and parameters, with uncertainties."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

_HOMES = {
    "VoxelFrame": "skyscatter.inversion.voxelscene",
    "VoxelLights": "skyscatter.inversion.voxelscene",
    "VoxelModel": "skyscatter.inversion.voxelimage",
    "VoxelOptics": "skyscatter.inversion.voxelscene",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from skyscatter.inversion.voxelimage import VoxelModel
    from skyscatter.inversion.voxelscene import VoxelFrame, VoxelLights, VoxelOptics


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(_HOMES[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
