"""Blind scenes: satellite images of known ground, by Monte Carlo, for judging what takes their haze off.

Nothing of the retrieval goes into them: the images come from the walks of the solver `path`
(`skyscatter.dehaze.simulate`, polarised), the ground from drawn landscapes with textured patches, dark beside bright.
Gases do not absorb, each band is one wavelength, and the sensor sees all pixels under the same angles.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from skyscatter.atomic import atomic_path
from skyscatter.dehaze.aerosols import aerosol_components
from skyscatter.dehaze.simulate import simulate
from skyscatter.ground import Ground, GroundMap
from skyscatter.media.fields import UsStandard1976
from skyscatter.media.medium import Component, Medium
from skyscatter.optics.rayleigh import RayleighAir
from skyscatter.scene import Scene, Sun
from skyscatter.spectra.table import SpectralTable

Array = NDArray[np.float64]

#: Central wavelengths of Sentinel-2's bands 1 to 8, 8A, 11 and 12 (MSI User Guide) [nm]; 9 and 10 see little ground.
BANDS = (442.7, 492.4, 559.8, 664.6, 704.1, 740.5, 782.8, 832.8, 864.7, 1613.7, 2202.4)

#: Albedos of what landscapes are made of, one for each of `BANDS`: two digits, drawn after published spectra before
#: there was anything to try on them, and not measurements of one place.  Grass: Feister & Grewe 1995 (Photochem.
#: Photobiol. 62, 736) to 800 nm.  Sand and clear water: the ground reflectances of 6S (Vermote et al. 1997) to 1100 nm,
#: water less the light that its surface adds.  The others, and all beyond, as such surfaces look in the ECOSTRESS
#: library (Meerdink et al. 2019, Remote Sens. Environ. 230, 111196), recalled.
MATERIALS = {
    "conifer": (0.015, 0.018, 0.035, 0.022, 0.052, 0.14, 0.20, 0.22, 0.23, 0.10, 0.045),
    "broadleaf": (0.022, 0.027, 0.06, 0.030, 0.085, 0.29, 0.39, 0.42, 0.43, 0.21, 0.095),
    "grass": (0.030, 0.034, 0.089, 0.037, 0.11, 0.44, 0.58, 0.58, 0.57, 0.29, 0.15),
    "stubble": (0.07, 0.09, 0.13, 0.18, 0.21, 0.24, 0.27, 0.29, 0.30, 0.39, 0.29),
    "soil": (0.07, 0.09, 0.13, 0.18, 0.20, 0.215, 0.23, 0.245, 0.255, 0.34, 0.31),
    "sand": (0.095, 0.107, 0.131, 0.185, 0.218, 0.246, 0.264, 0.285, 0.292, 0.40, 0.40),
    "bright sand": (0.18, 0.22, 0.31, 0.41, 0.43, 0.45, 0.46, 0.48, 0.48, 0.57, 0.54),
    "asphalt": (0.075, 0.085, 0.10, 0.115, 0.12, 0.125, 0.13, 0.135, 0.14, 0.17, 0.17),
    "concrete": (0.20, 0.24, 0.29, 0.33, 0.34, 0.35, 0.355, 0.36, 0.365, 0.40, 0.36),
    "tiles": (0.06, 0.07, 0.11, 0.22, 0.25, 0.27, 0.28, 0.28, 0.28, 0.36, 0.33),
    "white roof": (0.45, 0.55, 0.60, 0.62, 0.62, 0.62, 0.61, 0.60, 0.60, 0.52, 0.45),
    "clear water": (0.025, 0.022, 0.016, 0.006, 0.005, 0.004, 0.003, 0.002, 0.002, 0.001, 0.001),
    "turbid water": (0.040, 0.052, 0.075, 0.060, 0.042, 0.018, 0.018, 0.013, 0.011, 0.002, 0.001),
}

#: Covers: what they are mixed of, from one end of their texture to the other.
COVERS = {
    "forest": ("conifer", "broadleaf"),
    "meadow": ("grass", "broadleaf"),
    "crops": ("grass", "soil"),
    "harvested": ("stubble", "soil"),
    "town": ("tiles", "asphalt", "broadleaf", "concrete"),
    "works": ("concrete", "asphalt", "white roof"),
    "shore": ("sand", "bright sand"),
    "dunes": ("bright sand", "sand"),
    "lake": ("clear water", "turbid water"),
}
#: Steps from one end of a cover's texture to the other, and its brightnesses: 15 classes a cover.
MIXES, BRIGHTNESS = 5, (0.85, 1.0, 1.15)

#: Landscapes: shares of the covers in the patches.
LANDSCAPES = {
    "farmland": {"crops": 4, "harvested": 3, "meadow": 3, "forest": 3, "town": 1, "lake": 1},
    "city": {"town": 5, "works": 3, "meadow": 2, "forest": 1, "lake": 2},
    "coast": {"lake": 6, "shore": 2, "forest": 3, "town": 2, "meadow": 1},
    "desert": {"dunes": 5, "shore": 4, "harvested": 2, "crops": 1},
}


@dataclass(frozen=True)
class BlindScene:
    """All that decides an image."""

    landscape: str = "farmland"
    aerosol: str = "continental"
    aod: float = 0.2
    sun_zenith_deg: float = 40.0
    view_zenith_deg: float = 5.0
    relative_azimuth_deg: float = 60.0
    size: int = 64
    cell_size_m: float = 120.0
    scale_height_m: float = 2000.0
    bands: tuple[float, ...] = BANDS
    walks: int = 1 << 19
    seed: int = 0

    @property
    def name(self) -> str:
        """For a file: what a reader asks for first, and a digest of all of it."""
        digest = hashlib.blake2b(json.dumps(asdict(self), sort_keys=True).encode(), digest_size=4).hexdigest()
        return f"{self.landscape}-{self.aerosol}-{self.aod:g}-{self.sun_zenith_deg:g}-{digest}"


def draw_landscape(kind: str, size: int, seed: int) -> NDArray[np.int64]:
    """Classes (size, size) of a landscape: patches of covers, crossed by a river, with texture inside.

    Class number = (cover * MIXES + mix) * 3 + brightness, in the order of `COVERS`.
    """
    rng = np.random.default_rng([seed, *kind.encode()])
    names, shares = list(LANDSCAPES[kind]), np.array(list(LANDSCAPES[kind].values()), float)
    patches = max((size // 9) ** 2, 4)
    place = rng.uniform(0, size, (patches, 2))
    cover = rng.choice([list(COVERS).index(name) for name in names], patches, p=shares / shares.sum())
    y, x = np.indices((size, size))
    # Crooked borders: distances are taken from displaced points.
    dy, dx = (gaussian_filter(rng.normal(size=(size, size)), 3, mode="wrap") * 12 for _ in range(2))
    distance = (y + dy - place[:, 0, None, None]) ** 2 + (x + dx - place[:, 1, None, None]) ** 2
    picture = cover[np.argmin(distance, axis=0)]
    if kind != "desert":
        middle = size * (0.5 + 0.15 * np.sin(2 * np.pi * (1.5 * np.arange(size) / size + rng.uniform())))
        picture[np.abs(x - middle[:, None]) < 0.02 * size] = list(COVERS).index("lake")
    smooth = gaussian_filter(rng.normal(size=(size, size)), 1.5, mode="wrap")
    texture = 0.7 * smooth / smooth.std() + 0.7 * rng.normal(size=(size, size))
    mix = np.clip(np.floor((texture + 1.5) / 3.0 * MIXES), 0, MIXES - 1).astype(int)
    return (picture * MIXES + mix) * len(BRIGHTNESS) + rng.integers(0, len(BRIGHTNESS), (size, size))


def class_spectra(bands: tuple[float, ...]) -> list[Array]:
    """Albedo of every class at the bands, each (band,)."""
    table = {name: np.interp(bands, BANDS, values) for name, values in MATERIALS.items()}
    spectra = []
    for parts in COVERS.values():
        ends = np.array([table[name] for name in parts])
        for mix in range(MIXES):
            at = mix / (MIXES - 1) * (len(ends) - 1)
            k = min(int(at), len(ends) - 2)
            mixed = ends[k] + (at - k) * (ends[k + 1] - ends[k])
            spectra += [mixed * bright for bright in BRIGHTNESS]
    return spectra


def build(blind: BlindScene) -> Scene:
    """The scene; its map is twice as wide as the picture, and outside lies the mean of it."""
    classes = draw_landscape(blind.landscape, 2 * blind.size, blind.seed)
    used, classes = np.unique(classes, return_inverse=True)
    spectra = [class_spectra(blind.bands)[k] for k in used]
    mean = np.bincount(classes.ravel(), minlength=used.size) / classes.size @ np.array(spectra)

    def table(values: Array) -> SpectralTable | float:
        if len(blind.bands) == 1:
            return float(values[0])
        return SpectralTable(wavelengths=blind.bands, values=tuple(float(v) for v in values))

    picture = GroundMap(
        classes=classes.reshape(2 * blind.size, -1), albedos=tuple(map(table, spectra)), cell_size=blind.cell_size_m
    )
    air = Component(name="air", density=UsStandard1976(), optics=RayleighAir())
    haze = aerosol_components(blind.aerosol, blind.aod, blind.scale_height_m)
    return Scene(
        medium=Medium(planet_radius=6371e3, components=(air, *haze)),
        ground=Ground(albedo=table(mean), map=picture),
        sun=Sun(elevation_deg=90 - blind.sun_zenith_deg, azimuth_deg=0.0),
    )


def render(blind: BlindScene, folder: str | Path | None = None) -> dict[str, Any]:
    """Image and truth of a blind scene, from its file in `folder` if there is one.

    Returns
    -------
    dict
        ``reflectance``, ``standard_error``, ``surface`` (band, y, x); ``surroundings`` (band, 2 y, 2 x), the surface of
        the whole map, whose middle is the picture; and every field of the `BlindScene`.
    """
    path = None if folder is None else Path(folder) / f"{blind.name}.npz"
    if path is not None and path.is_file():
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    scene = build(blind)
    image = simulate(
        scene,
        blind.bands,
        (blind.size, blind.size),
        view_zenith_deg=blind.view_zenith_deg,
        view_azimuth_deg=blind.relative_azimuth_deg,
        walks=blind.walks,
        seed=blind.seed,
    )
    whole = scene.ground.map
    assert whole is not None
    surroundings = np.moveaxis(whole.reflectance(blind.bands)[whole.classes.array.astype(int)], -1, 0)
    content: dict[str, Any] = {
        "reflectance": image.reflectance, "standard_error": image.standard_error, "surface": image.surface,
        "surroundings": surroundings,
    }  # fmt: skip
    content |= {name: np.asarray(value) for name, value in asdict(blind).items()}
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, **content)
    return content


def standard_set(size: int = 64, walks: int = 1 << 19) -> list[BlindScene]:
    """Three aerosols at five optical depths, with suns, views and landscapes taken in turn."""
    scenes = []
    for a, aerosol in enumerate(("continental", "maritime", "urban")):
        for k, aod in enumerate((0.05, 0.1, 0.2, 0.5, 1.0)):
            n = 5 * a + k
            scenes.append(
                BlindScene(
                    landscape=list(LANDSCAPES)[n % len(LANDSCAPES)],
                    aerosol=aerosol,
                    aod=aod,
                    sun_zenith_deg=(20.0, 35.0, 50.0, 60.0)[(n + n // 4) % 4],
                    view_zenith_deg=(2.0, 6.0, 10.0)[n % 3],
                    relative_azimuth_deg=(30.0, 100.0, 160.0)[n % 3],
                    size=size,
                    cell_size_m=(150.0, 60.0, 300.0)[n % 3],
                    walks=walks,
                    seed=n,
                )
            )
    return scenes
