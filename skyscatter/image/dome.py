"""The Sun that a dome leaves out, as other programs take it: a lamp in the units of the dome's picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError
from skyscatter.image import colour
from skyscatter.image.spectral import SpectralImage


def lamp(image: SpectralImage, scale: float = 1.0) -> dict[str, Any]:
    """What a program needs to light a scene with a dome and its Sun.

    Parameters
    ----------
    image : SpectralImage
        Rendered without the Sun's disk (``sun_disk=False``).
    scale : float
        RGB of a white of 1 cd m-2 in the dome's file.

    Returns
    -------
    dict
        ``sun``: as in the recipe, with ``wavelengths_nm``, the illuminance of a plane that faces it [lx], and ``rgb``,
        the same times `scale` in linear sRGB: irradiance in the dome's RGB times steradians.  ``dome``: scale, view and
        the azimuth in the middle.  ``blender``: angles [degree], strength and colour of a sun lamp, x east, y north and
        z up, and, for panoramas, the rotation of the environment about z.

    Raises
    ------
    DomainError
        If the image has its Sun.
    """
    if "sun_lamp" not in image.recipe:
        raise DomainError("image", "with its Sun", "render it without: sun_disk=False (--no-sun)")
    sun, camera = dict(image.recipe["sun_lamp"]), image.recipe["camera"]
    spectrum = np.array(sun.pop("irradiance"))
    xyz = colour.spectrum_to_xyz(spectrum, image.wavelengths)
    rgb = scale * colour.xyz_to_rgb(xyz, "srgb")
    strength = float(rgb.max())
    middle = camera.get("centre_azimuth_deg")
    return {
        "sun": {
            **sun,
            "wavelengths_nm": image.wavelengths.tolist(),
            "irradiance_W_m-2_nm-1": spectrum.tolist(),
            "illuminance_lx": float(xyz[1]),
            "rgb": rgb.tolist(),
        },
        "dome": {"rgb_per_cd_m-2": scale, "view": camera["kind"], "middle_azimuth_deg": middle},
        "blender": {
            "sun_rotation_euler_deg": [90.0 - sun["elevation_deg"], 0.0, (180.0 - sun["azimuth_deg"]) % 360.0],
            "sun_strength": strength,
            "sun_colour": (rgb / strength if strength > 0.0 else rgb).tolist(),
            "sun_angle_deg": sun["angular_diameter_deg"],
            **({} if middle is None else {"world_mapping_rotation_z_deg": (middle - 90.0 + 180.0) % 360.0 - 180.0}),
        },
    }


def write_lamp(image: SpectralImage, path: Path, scale: float = 1.0) -> None:
    """Write `lamp` as JSON."""
    text = json.dumps(lamp(image, scale), indent=1, allow_nan=False)
    with atomic_path(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
