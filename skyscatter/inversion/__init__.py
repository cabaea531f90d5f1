"""From images and radiances back to densities and parameters, with uncertainties."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

_HOMES = {
    "Centre": "skyscatter.inversion.centre",
    "Entropy": "skyscatter.inversion.priors",
    "ImageView": "skyscatter.inversion.views",
    "Reconstruction": "skyscatter.inversion.reconstruction",
    "Tikhonov": "skyscatter.inversion.priors",
    "TotalVariation": "skyscatter.inversion.priors",
    "VoxelFrame": "skyscatter.inversion.voxelscene",
    "VoxelLights": "skyscatter.inversion.voxelscene",
    "VoxelModel": "skyscatter.inversion.voxelimage",
    "VoxelOptics": "skyscatter.inversion.voxelscene",
    "find_centre": "skyscatter.inversion.centre",
    "reconstruct": "skyscatter.inversion.tomography",
    "spreading_map": "skyscatter.inversion.adjoint",
    "through_map": "skyscatter.inversion.adjoint",
    "through_parameters": "skyscatter.inversion.adjoint",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from skyscatter.inversion.adjoint import spreading_map, through_map, through_parameters
    from skyscatter.inversion.centre import Centre, find_centre
    from skyscatter.inversion.priors import Entropy, Tikhonov, TotalVariation
    from skyscatter.inversion.reconstruction import Reconstruction
    from skyscatter.inversion.tomography import reconstruct
    from skyscatter.inversion.views import ImageView
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
