"""Inversion: from images and radiances back to densities and parameters, with their uncertainties.

Examples
--------
The density of a ball from its brightness: projected, and found again.

>>> import numpy as np
>>> from skyscatter import inversion
>>> radius = np.linspace(0, 1, 21)
>>> brightness = inversion.abel_project(radius, 1 - radius**2)
>>> found = inversion.abel_invert(radius, brightness, sigma=1e-3)
>>> found.density[[0, 10]].round(2)  # 1 in the middle, 0.75 half-way out
array([1.  , 0.75])
"""

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
    "fit_each": "skyscatter.inversion.ensemble",
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
    from skyscatter.inversion.abel import AbelResult as AbelResult
    from skyscatter.inversion.abel import abel_invert as abel_invert
    from skyscatter.inversion.abel import abel_project as abel_project
    from skyscatter.inversion.adjoint import spreading_map as spreading_map
    from skyscatter.inversion.adjoint import through_map as through_map
    from skyscatter.inversion.adjoint import through_parameters as through_parameters
    from skyscatter.inversion.axisymmetric import AxisymmetricResult as AxisymmetricResult
    from skyscatter.inversion.axisymmetric import invert_axisymmetric as invert_axisymmetric
    from skyscatter.inversion.broadband import Broadband as Broadband
    from skyscatter.inversion.centre import Centre as Centre
    from skyscatter.inversion.centre import find_centre as find_centre
    from skyscatter.inversion.deprojection import Deprojection as Deprojection
    from skyscatter.inversion.deprojection import deproject as deproject
    from skyscatter.inversion.derivatives import Derivatives as Derivatives
    from skyscatter.inversion.derivatives import differentiate as differentiate
    from skyscatter.inversion.distributions import LogNormal as LogNormal
    from skyscatter.inversion.distributions import LogUniform as LogUniform
    from skyscatter.inversion.distributions import Normal as Normal
    from skyscatter.inversion.distributions import Uniform as Uniform
    from skyscatter.inversion.ensemble import fit_each as fit_each
    from skyscatter.inversion.fitresult import FitResult as FitResult
    from skyscatter.inversion.fitting import fit as fit
    from skyscatter.inversion.fluxes import flux_table as flux_table
    from skyscatter.inversion.images import nebula_image as nebula_image
    from skyscatter.inversion.images import sky_image as sky_image
    from skyscatter.inversion.matter import DustCloud as DustCloud
    from skyscatter.inversion.matter import LineGas as LineGas
    from skyscatter.inversion.matter import dust_from_extinction as dust_from_extinction
    from skyscatter.inversion.matter import electrons_from_emissivity as electrons_from_emissivity
    from skyscatter.inversion.matter import extinction_map as extinction_map
    from skyscatter.inversion.matter import gas_from_line_image as gas_from_line_image
    from skyscatter.inversion.parameters import with_values as with_values
    from skyscatter.inversion.priors import Entropy as Entropy
    from skyscatter.inversion.priors import Tikhonov as Tikhonov
    from skyscatter.inversion.priors import TotalVariation as TotalVariation
    from skyscatter.inversion.radiances import limb_profile as limb_profile
    from skyscatter.inversion.radiances import radiance_table as radiance_table
    from skyscatter.inversion.readers import read_observation as read_observation
    from skyscatter.inversion.reconstruction import Reconstruction as Reconstruction
    from skyscatter.inversion.shells import ShellFit as ShellFit
    from skyscatter.inversion.shells import fit_shell as fit_shell
    from skyscatter.inversion.shells import shell_column as shell_column
    from skyscatter.inversion.shells import shell_image as shell_image
    from skyscatter.inversion.spherical import SphericalResult as SphericalResult
    from skyscatter.inversion.spherical import invert_spherical as invert_spherical
    from skyscatter.inversion.tomography import reconstruct as reconstruct
    from skyscatter.inversion.views import ImageView as ImageView
    from skyscatter.inversion.voxelimage import VoxelModel as VoxelModel
    from skyscatter.inversion.voxelscene import VoxelFrame as VoxelFrame
    from skyscatter.inversion.voxelscene import VoxelLights as VoxelLights
    from skyscatter.inversion.voxelscene import VoxelOptics as VoxelOptics
    from skyscatter.inversion.voxelwalks import WalkedLight as WalkedLight
    from skyscatter.inversion.voxelwalks import multiple_scattering as multiple_scattering


if not TYPE_CHECKING:  # it would accept any name

    def __getattr__(name: str) -> Any:
        if name in _HOMES:
            return getattr(import_module(_HOMES[name]), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
