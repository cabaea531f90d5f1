"""Inversion: from images and radiances back to densities and parameters, with their uncertainties."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

_HOMES = {
    "abel_invert": "skyscatter.inversion.abel",
    "abel_project": "skyscatter.inversion.abel",
    "AbelResult": "skyscatter.inversion.abel",
    "AxisymmetricResult": "skyscatter.inversion.axisymmetric",
    "Broadband": "skyscatter.inversion.broadband",
    "Centre": "skyscatter.inversion.centre",
    "deproject": "skyscatter.inversion.deprojection",
    "Deprojection": "skyscatter.inversion.deprojection",
    "Derivatives": "skyscatter.inversion.derivatives",
    "differentiate": "skyscatter.inversion.derivatives",
    "dust_from_extinction": "skyscatter.inversion.matter",
    "DustCloud": "skyscatter.inversion.matter",
    "electrons_from_emissivity": "skyscatter.inversion.matter",
    "Entropy": "skyscatter.inversion.priors",
    "extinction_map": "skyscatter.inversion.matter",
    "find_centre": "skyscatter.inversion.centre",
    "fit": "skyscatter.inversion.fitting",
    "fit_shell": "skyscatter.inversion.shells",
    "FitResult": "skyscatter.inversion.fitresult",
    "flux_table": "skyscatter.inversion.fluxes",
    "gas_from_line_image": "skyscatter.inversion.matter",
    "ImageView": "skyscatter.inversion.views",
    "invert_axisymmetric": "skyscatter.inversion.axisymmetric",
    "invert_spherical": "skyscatter.inversion.spherical",
    "limb_profile": "skyscatter.inversion.radiances",
    "LineGas": "skyscatter.inversion.matter",
    "LogNormal": "skyscatter.inversion.distributions",
    "LogUniform": "skyscatter.inversion.distributions",
    "multiple_scattering": "skyscatter.inversion.voxelwalks",
    "nebula_image": "skyscatter.inversion.images",
    "Normal": "skyscatter.inversion.distributions",
    "radiance_table": "skyscatter.inversion.radiances",
    "read_observation": "skyscatter.inversion.readers",
    "reconstruct": "skyscatter.inversion.tomography",
    "Reconstruction": "skyscatter.inversion.reconstruction",
    "shell_column": "skyscatter.inversion.shells",
    "shell_image": "skyscatter.inversion.shells",
    "ShellFit": "skyscatter.inversion.shells",
    "sky_image": "skyscatter.inversion.images",
    "SphericalResult": "skyscatter.inversion.spherical",
    "spreading_map": "skyscatter.inversion.adjoint",
    "through_map": "skyscatter.inversion.adjoint",
    "through_parameters": "skyscatter.inversion.adjoint",
    "Tikhonov": "skyscatter.inversion.priors",
    "TotalVariation": "skyscatter.inversion.priors",
    "Uniform": "skyscatter.inversion.distributions",
    "VoxelFrame": "skyscatter.inversion.voxelscene",
    "VoxelLights": "skyscatter.inversion.voxelscene",
    "VoxelModel": "skyscatter.inversion.voxelimage",
    "VoxelOptics": "skyscatter.inversion.voxelscene",
    "WalkedLight": "skyscatter.inversion.voxelwalks",
    "with_values": "skyscatter.inversion.parameters",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from skyscatter.inversion.abel import AbelResult, abel_invert, abel_project
    from skyscatter.inversion.adjoint import spreading_map, through_map, through_parameters
    from skyscatter.inversion.axisymmetric import AxisymmetricResult, invert_axisymmetric
    from skyscatter.inversion.broadband import Broadband
    from skyscatter.inversion.centre import Centre, find_centre
    from skyscatter.inversion.deprojection import Deprojection, deproject
    from skyscatter.inversion.derivatives import Derivatives, differentiate
    from skyscatter.inversion.distributions import LogNormal, LogUniform, Normal, Uniform
    from skyscatter.inversion.fitresult import FitResult
    from skyscatter.inversion.fitting import fit
    from skyscatter.inversion.fluxes import flux_table
    from skyscatter.inversion.images import nebula_image, sky_image
    from skyscatter.inversion.matter import (
        DustCloud,
        LineGas,
        dust_from_extinction,
        electrons_from_emissivity,
        extinction_map,
        gas_from_line_image,
    )
    from skyscatter.inversion.parameters import with_values
    from skyscatter.inversion.priors import Entropy, Tikhonov, TotalVariation
    from skyscatter.inversion.radiances import limb_profile, radiance_table
    from skyscatter.inversion.readers import read_observation
    from skyscatter.inversion.reconstruction import Reconstruction
    from skyscatter.inversion.shells import ShellFit, fit_shell, shell_column, shell_image
    from skyscatter.inversion.spherical import SphericalResult, invert_spherical
    from skyscatter.inversion.tomography import reconstruct
    from skyscatter.inversion.views import ImageView
    from skyscatter.inversion.voxelimage import VoxelModel
    from skyscatter.inversion.voxelscene import VoxelFrame, VoxelLights, VoxelOptics
    from skyscatter.inversion.voxelwalks import WalkedLight, multiple_scattering


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
