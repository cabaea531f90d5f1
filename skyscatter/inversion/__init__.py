"""Inversion: from images and radiances back to densities and parameters, with their uncertainties."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

_HOMES = {
    "Broadband": "skyscatter.inversion.broadband",
    "Derivatives": "skyscatter.inversion.derivatives",
    "differentiate": "skyscatter.inversion.derivatives",
    "FitResult": "skyscatter.inversion.fitresult",
    "fit": "skyscatter.inversion.fitting",
    "flux_table": "skyscatter.inversion.fluxes",
    "limb_profile": "skyscatter.inversion.radiances",
    "LogNormal": "skyscatter.inversion.distributions",
    "LogUniform": "skyscatter.inversion.distributions",
    "nebula_image": "skyscatter.inversion.images",
    "Normal": "skyscatter.inversion.distributions",
    "radiance_table": "skyscatter.inversion.radiances",
    "read_observation": "skyscatter.inversion.readers",
    "sky_image": "skyscatter.inversion.images",
    "Uniform": "skyscatter.inversion.distributions",
    "with_values": "skyscatter.inversion.parameters",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from skyscatter.inversion.broadband import Broadband
    from skyscatter.inversion.derivatives import Derivatives, differentiate
    from skyscatter.inversion.distributions import LogNormal, LogUniform, Normal, Uniform
    from skyscatter.inversion.fitresult import FitResult
    from skyscatter.inversion.fitting import fit
    from skyscatter.inversion.fluxes import flux_table
    from skyscatter.inversion.images import nebula_image, sky_image
    from skyscatter.inversion.parameters import with_values
    from skyscatter.inversion.radiances import limb_profile, radiance_table
    from skyscatter.inversion.readers import read_observation


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
