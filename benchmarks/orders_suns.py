"""How far off `orders` is by the Sun's height, judged by `path`: the table that opens docs/validation-orders.md.

Sights from the ground: five elevations towards, across from and against the Sun, at three wavelengths.  Deviations
are in per cent of the light; the judge's standard error stands beside them, and what `orders` stated.  Wavelengths
share their walks: the error of a mean is that of one of them over the sights.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from common import machine, parser, report, table, versions

import skyscatter

PAGE = Path(__file__).parents[1] / "docs" / "validation-orders.md"
SUNS = (60.0, 10.0, 0.0, -3.0, -6.0)  #: deeper down walks know too little to judge
MODELS = ("earth", "earth-hazy")
ELEVATIONS, AZIMUTHS = (2.0, 10.0, 30.0, 60.0, 88.0), (12.0, 90.0, 172.0)
WAVELENGTHS = (450.0, 550.0, 650.0)


def sights() -> np.ndarray:
    """Directions (sight, 3), east, north and up; the Sun stands in the north."""
    elevation, azimuth = (np.radians(a).ravel() for a in np.meshgrid(ELEVATIONS, AZIMUTHS))
    flat = np.cos(elevation)
    return np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)], axis=-1)


def row(name: str, sun: float, walks: int) -> list[object]:
    """One line of the table."""
    scene = skyscatter.load_model(name).scene(sun_elevation_deg=sun, sun_azimuth_deg=0)
    eye, ways = scene.observer.position, sights()
    began = time.perf_counter()
    solved = skyscatter.radiance(scene, eye, ways, WAVELENGTHS)
    took = time.perf_counter() - began
    judge = skyscatter.radiance(
        scene, eye, ways, WAVELENGTHS, solver=skyscatter.Path(samples=walks, tolerance=1e-4, seed=11)
    )
    off, known, stated = (
        100 * x / judge.radiance for x in (solved.radiance - judge.radiance, judge.standard_error, solved.error)
    )
    covered = np.abs(off) <= stated + 2 * known
    return [
        name, f"{sun:g}°", f"{np.median(stated):.2f} %", f"{100 * covered.mean():.0f} %",
        f"{off.mean():+.2f} ± {np.sqrt(np.mean(known**2) / len(ways)):.2f} %", f"{np.median(np.abs(off)):.2f} %",
        f"{np.median(known):.2f} %", f"{took:.1f}",
    ]  # fmt: skip


def main() -> None:
    """Solve, walk, print, and write if asked."""
    options = parser(__doc__)
    options.add_argument("--walks", type=int, default=16384, help="of the judge, for each sight")
    chosen = options.parse_args()
    before = machine()
    rows = []
    for name in MODELS:
        for sun in SUNS:
            rows.append(row(name, sun, chosen.walks))
            print(rows[-1], flush=True)
    head = ["model", "Sun", "median stated", "within stated", "mean deviation", "median", "judge's error", "s"]
    report("suns", before, versions("skyscatter", "numba"), [table(head, rows)], sys.argv, chosen.write, PAGE)


if __name__ == "__main__":
    main()
