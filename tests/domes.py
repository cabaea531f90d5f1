"""Domes and lamps of `skyscatter sky --no-sun`, and what skyscatter itself says of planes under that sky."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import skyscatter
from skyscatter.cli.main import main
from skyscatter.image import colour

Array = NDArray[np.float64]

WAVELENGTHS = np.array([450.0, 550.0, 650.0])  #: [nm]: three make colours, and what is compared is sums over the sky
#: Azimuth and elevation of the Sun [degree]: on no axis and in no plane of symmetry of pictures.
SUNS = {"high": (240.0, 35.0), "low": (110.0, 4.0)}
NORMALS = 20


def normals() -> Array:
    """Unit vectors spread over the sphere by the golden angle, (normal, 3)."""
    k = np.arange(NORMALS) + 0.5
    z, turn = 1 - 2 * k / NORMALS, np.pi * (3 - np.sqrt(5)) * k
    sine = np.sqrt(1 - z * z)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), z], axis=-1)


def make_dome(folder: Path, sun: str, name: str = "dome.exr", disk: bool = False, program: str | None = None) -> Path:
    """A dome by the command, with its lamp and the scene file of a program beside it unless it shows the Sun's disk."""
    azimuth, elevation = SUNS[sun]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    words = ["sky", "earth-simple", "--north", "--sun-elevation", str(elevation), "--sun-azimuth", str(azimuth),
             "--wavelengths", ",".join(f"{w:g}" for w in WAVELENGTHS), "--size", "512x256", "--tolerance", "1%",
             *(["--no-spectra"] if name.endswith(".exr") else []), "-q", "-o", str(path)]  # fmt: skip
    words += [] if disk else ["--no-sun"]
    words += [] if program is None else ["--for", program]
    assert main(words) == 0
    return path


def own_irradiances(sun: str) -> Array:
    """Linear sRGB illuminance of planes at the ground by all light, (normal, 3) [lx]."""
    azimuth, elevation = SUNS[sun]
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=elevation, sun_azimuth_deg=azimuth)
    field = skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=(elevation, elevation), tolerance=0.01)
    spectra = np.array([field.irradiance(0.0, normal) for normal in normals()])
    return np.asarray(colour.xyz_to_rgb(colour.spectrum_to_xyz(spectra, WAVELENGTHS), "srgb"))
