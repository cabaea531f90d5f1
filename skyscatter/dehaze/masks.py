"""Which pixels show the ground: clouds, water and shadow by their reflectances.

Clouds: bright, nearly white, brighter in the blue than haze over ground makes it, and not snow.  Whiteness and the haze
optimised transform with their thresholds are those of Zhu & Woodcock 2012 (Remote Sens. Environ. 118, 83, eqs. 2 and
3), the snow index is theirs with a stricter threshold; the brightness in the blue keeps thick haze, which can be
corrected, from counting as cloud.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.passband import Band

Values = NDArray[np.float32]
Mask = NDArray[np.bool_]

#: Reflectance in the blue above the air's own from which a white pixel is cloud: haze of optical depth 2 stays below
#: over dark ground, thick clouds exceed 0.4.
CLOUD_BLUE = 0.28
#: Reflectance in the near infrared above which nothing is water, and below which all is dark (Zhu & Woodcock's 0.11
#: is meant above the atmosphere and lets haze over water pass).
WATER_NIR = 0.10
#: Reflectance of all visible bands below which lit ground would be darker than any known.
SHADOW_VISIBLE, SHADOW_NIR = 0.012, 0.06


class BandRoles:
    """Places of the bands by what they are good for."""

    def __init__(self, bands: Sequence[Band]) -> None:
        self.place: dict[str, int] = {}
        for k, band in enumerate(bands):
            self.place.setdefault(band.role, k)
        if "nir" not in self.place and "nir-narrow" in self.place:
            self.place["nir"] = self.place["nir-narrow"]
        self.visible = [k for k, b in enumerate(bands) if 430 < b.centre_nm < 700 and b.role != "pan"]

    def get(self, role: str) -> int | None:
        """Place of the first band of a role; None if there is none."""
        return self.place.get(role)


def clouds(values: Values, air: NDArray[np.float32], roles: BandRoles) -> Mask:
    """Pixels that are cloud.

    Parameters
    ----------
    values : array, shape (band, y, x)
        Reflectance above the atmosphere.
    air : array, shape (band,)
        Path reflectance of the air without haze.
    roles : BandRoles
    """
    if len(roles.visible) < 2:  # one band does not tell white from bright
        return np.zeros(values.shape[1:], bool)
    net = [values[k] - air[k] for k in roles.visible]
    mean = sum(net) / np.float32(len(net))
    bluest = net[int(np.argmax([air[k] for k in roles.visible]))]
    found: Mask = bluest > CLOUD_BLUE
    if not found.any():
        return found
    whiteness = sum(np.abs(n - mean) for n in net) / np.maximum(mean, np.float32(1e-3))
    found &= whiteness < 0.7 * len(net) / 3
    blue, red = roles.get("blue"), roles.get("red")
    if blue is not None and red is not None:
        found &= values[blue] - 0.5 * values[red] - 0.08 > 0
    green, swir = roles.get("green"), roles.get("swir1")
    if green is not None and swir is not None:
        index = (values[green] - values[swir]) / np.maximum(values[green] + values[swir], np.float32(1e-3))
        found &= index < 0.6  # snow is black at 1.6 um and clouds are not
    return found


def water(surface: Values, roles: BandRoles) -> Mask:
    """Pixels that are water, by surface reflectances: darker in the infrared than in the green."""
    green, nir = roles.get("green"), roles.get("nir")
    if green is None or nir is None:
        return np.zeros(surface.shape[1:], bool)
    infrared = roles.get("swir1")
    dark = surface[nir] if infrared is None else np.maximum(surface[nir], surface[infrared])
    found: Mask = (dark < WATER_NIR) & (dark < surface[green])
    return found


def shadow(surface: Values, roles: BandRoles, is_water: Mask) -> Mask:
    """Pixels darker than lit ground can be, that are not water."""
    nir = roles.get("nir")
    if nir is None or not roles.visible:
        return np.zeros(surface.shape[1:], bool)
    mean = sum(surface[k] for k in roles.visible) / np.float32(len(roles.visible))
    found: Mask = (mean < SHADOW_VISIBLE) & (surface[nir] < SHADOW_NIR) & ~is_water
    return found
