"""A polarised image made by hand: Rayleigh's law for one scattering, whose polarisation is known in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image import SpectralImage

WAVELENGTHS = np.array([450.0, 550.0, 650.0])
SUN = direction_from_azimuth_elevation(200.0, 35.0)


def expected_degree(directions: NDArray[Any]) -> NDArray[Any]:
    """(1 - mu^2) / (1 + mu^2), Rayleigh's law without depolarisation."""
    mu = directions @ SUN
    return (1 - mu**2) / (1 + mu**2)


def rayleigh_sky(camera: Any, share: Any = (1.0, 1.0, 1.0), circular: float = 0.0, **given: Any) -> SpectralImage:
    """An image with Stokes layers; the field lies across the plane of Sun and line of sight.

    `share` scales the degree of polarisation of each wavelength, `circular` is V / I.  The components of the field are
    found from azimuth and elevation, not with the package's meridian frame.
    """
    d = camera.directions()
    azimuth, elevation = np.arctan2(d[..., 0], d[..., 1]), np.arcsin(np.clip(d[..., 2], -1, 1))
    up = np.stack(
        [-np.sin(elevation) * np.sin(azimuth), -np.sin(elevation) * np.cos(azimuth), np.cos(elevation)], axis=-1
    )
    left = np.stack([-np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)
    field = np.cross(d, SUN)
    a, b = np.sum(field * up, axis=-1), np.sum(field * left, axis=-1)
    mu = d @ SUN
    i = ((1 + mu**2)[..., None] * np.array([3.0, 2.0, 1.0])).astype(float)
    # |d x s|^2 = 1 - mu^2 is I times the degree of polarisation, in units of I / (1 + mu^2)
    q, u = (a**2 - b**2)[..., None] * np.array([3.0, 2.0, 1.0]), (2 * a * b)[..., None] * np.array([3.0, 2.0, 1.0])
    layers = {"Q": q * np.array(share), "U": u * np.array(share), "V": circular * i}
    layers |= {f"{name}_error": 0.01 * i for name in "QUV"}
    recipe = {"camera": camera.model_dump(mode="json")}
    return SpectralImage(i, WAVELENGTHS, 0.01 * i, **{"layers": layers, "recipe": recipe, **given})
