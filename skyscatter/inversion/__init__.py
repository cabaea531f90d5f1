"""From images and radiances back to densities and parameters, with uncertainties."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

_HOMES = {
    "VoxelFrame": "skyscatter.inversion.voxelimage",
    "VoxelLights": "skyscatter.inversion.voxelimage",
    "VoxelModel": "skyscatter.inversion.voxelimage",
    "VoxelOptics": "skyscatter.inversion.voxelimage",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from skyscatter.inversion.voxelimage import VoxelFrame, VoxelLights, VoxelModel, VoxelOptics


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(_HOMES[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
