"""Images of drawn landscapes under hazes of 6SV 1.1, and what dehazing makes of them.

The light of each pixel is 6S's own, over a ground that is alike all around: rho_path + T_down T_up rho / (1 - S rho)
with the terms of `data/sixs_terms.csv` (`benchmarks/sixs_terms.py` makes it).  Nothing of this project goes into the
images but the drawing of the ground.
"""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from dehaze_judged import BlindSource, Judged, judge
from dehaze_scenes import LANDSCAPES, class_spectra, draw_landscape
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.dehaze.flags import Flag
from skyscatter.dehaze.forward import Atmosphere
from skyscatter.dehaze.passband import Band
from skyscatter.dehaze.physical import TRIED
from skyscatter.dehaze.table import Angles, TermsTable, build_table

Array = NDArray[np.float64]
Geometry = tuple[float, float, float]

TERMS = Path(__file__).with_name("data") / "sixs_terms.csv"
STORED = TERMS.with_name("solved_terms.csv")
#: Those of 6S's aerosols that are like one that dehazing solves for, and those that are not.
INSIDE, OUTSIDE = ("continental", "maritime"), ("biomass-burning", "fine", "desert")


class SixsScene(NamedTuple):
    """All that decides an image."""

    aerosol: str
    aod: float
    geometry: Geometry
    landscape: str
    seed: int = 0


@cache
def sixs_terms() -> dict[tuple[str, float, Geometry], Array]:
    """Wavelength [nm], path reflectance, T_down T_up, S of every haze: (wavelength, 4)."""
    rows: dict[Any, list[tuple[float, ...]]] = defaultdict(list)
    with TERMS.open(encoding="utf-8") as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            aerosol = row.pop("aerosol")
            v = {name: float(value) for name, value in row.items()}
            key = aerosol, v["aod"], (v["sun_zenith"], v["view_zenith"], v["relative_azimuth"])
            rows[key].append((v["wavelength_nm"], v["path"], v["down"] * v["up"], v["back"]))
    return {key: np.array(terms) for key, terms in rows.items()}


def stored_table(atmosphere: Atmosphere, bands: Sequence[Band], angles: Angles, **_: Any) -> TermsTable:
    """In place of `build_table`: what that solved for the first of the geometries, a minute's work for each model.

    `python tests/sixs_scenes.py` makes the file anew.
    """
    with STORED.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["aerosol"] == atmosphere.aerosol]
    depths = np.array(sorted({float(row["aod"]) for row in rows}))
    values = np.array([[float(row[name]) for name in ("path", "direct", "diffuse", "back")] for row in rows])
    nodes = [np.array([low]) for low, _ in (angles.sun_zenith, angles.view_zenith, angles.relative_azimuth)]
    shape = depths.size, 1, 1, 1, len(bands), 4
    return TermsTable(tuple(bands), atmosphere, depths, *nodes, values.reshape(shape), 1e-4)


def store() -> None:
    """Solve for the three models in the first of the geometries."""
    geometry = next(key[2] for key in sixs_terms())
    bands = BlindSource(picture(SixsScene("fine", 0.1, geometry, "city"))).responses.bands
    lines = ["aerosol,aod,wavelength_nm,path,direct,diffuse,back"]
    for name in TRIED:
        table = build_table(Atmosphere(aerosol=name), bands, Angles.spanned(*(np.array([a]) for a in geometry)))
        for aod, of_bands in zip(table.aod, table.values[:, 0, 0, 0], strict=True):
            for band, terms in zip(bands, of_bands, strict=True):
                numbers = ",".join(f"{term:.6f}" for term in terms)
                lines.append(f"{name},{aod:.9g},{band.centre_nm:g},{numbers}")
    with atomic_path(STORED) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def all_scenes(geometries: Iterable[Geometry] | None = None, seeds: int = 1) -> list[SixsScene]:
    """Every haze over every landscape."""
    wanted = None if geometries is None else set(geometries)
    return [
        SixsScene(*haze, landscape, seed)
        for haze, landscape, seed in product(sixs_terms(), LANDSCAPES, range(seeds))
        if wanted is None or haze[2] in wanted
    ]


def picture(scene: SixsScene, size: int = 48) -> dict[str, Any]:
    """What `dehaze_judged` takes for a scene, truth included."""
    wl, path, through, back = sixs_terms()[scene.aerosol, scene.aod, scene.geometry].T
    surface = np.moveaxis(np.array(class_spectra(tuple(wl)))[draw_landscape(scene.landscape, size, scene.seed)], -1, 0)
    path, through, back = (term[:, None, None] for term in (path, through, back))
    sun, view, azimuth = scene.geometry
    return {
        "reflectance": path + through * surface / (1 - back * surface), "surface": surface, "bands": wl,
        "sun_zenith_deg": sun, "view_zenith_deg": view, "relative_azimuth_deg": azimuth,
        "cell_size_m": 120.0, "aod": scene.aod, "aerosol": scene.aerosol,
    }  # fmt: skip


def judged(scene: SixsScene, **options: Any) -> Judged:
    """A scene dehazed, beside its truth: 6S knows no light from the side."""
    return judge(picture(scene), adjacency=False, **options)


def covered(found: Iterable[Judged]) -> Array:
    """Share of pixels (band,) whose truth is within one standard deviation; no cloud and nothing set to zero."""
    inside = []
    for one in found:
        clear = (one.mask & np.uint8(Flag.CLOUD | Flag.CLIPPED)) == 0
        inside.append((np.abs(one.error) <= one.sigma)[:, clear])
    return np.asarray(np.concatenate(inside, axis=1).mean(axis=1))


if __name__ == "__main__":
    store()
