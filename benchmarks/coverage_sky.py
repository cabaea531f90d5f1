"""How often the error bars of walks in skies cover the truth, where walks that matter are rare.

    python benchmarks/coverage_sky.py [--seeds 200] [--walks 1024] [--only mars] [--write]

Each scene is looked at along six lines of sight at two wavelengths.  Every ray has random numbers of its own, so that
copies of a ray are runs with other seeds.  The truth is the mean of 64 times as many walks, by marching whatever the
study's own sampling.  One line a scene, pooled over rays and wavelengths.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
from common import machine, parser, report, versions
from error_bars import HEADER, Coverage, coverage, pooled, table_row

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation

PAGE = Path(__file__).resolve().parents[1] / "docs" / "validation.md"
#: Name, model, elevation of the Sun [degree] and way to walk.
SCENES = (
    ("Earth by day", "earth", 30.0, "march"),
    ("Earth at sunset", "earth", 0.0, "march"),
    ("Earth in twilight, Sun at -4", "earth", -4.0, "march"),
    ("hazy Earth, Sun at 20", "earth-hazy", 20.0, "march"),
    ("hazy Earth, Sun at 3", "earth-hazy", 3.0, "march"),
    ("Mars, Sun at 40", "mars", 40.0, "march"),
    ("Mars, Sun at 3", "mars", 3.0, "march"),
    ("Mars in twilight, Sun at -3", "mars", -3.0, "march"),
    ("Earth by day, free flights", "earth", 30.0, "free-flight"),
    ("hazy Earth, Sun at 20, free flights", "earth-hazy", 20.0, "free-flight"),
    ("Mars, Sun at 3, free flights", "mars", 3.0, "free-flight"),
)
WAVELENGTHS = (450.0, 650.0)
#: Towards the Sun (azimuth 180), beside and behind it; low and high.
SIGHTS = [(azimuth, elevation) for azimuth in (180.0, 120.0, 0.0) for elevation in (5.0, 50.0)]


def study(model: str, sun: float, sampling: str, seeds: int, walks: int) -> Coverage:
    """Coverage of one scene."""
    scene = skyscatter.load_model(model).scene(sun_elevation_deg=sun, sun_azimuth_deg=180.0)
    sights = direction_from_azimuth_elevation(*np.array(SIGHTS).T)

    def look(copies: int, count: int, way: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
        answer = skyscatter.radiance(
            scene,
            scene.observer.position,
            np.tile(sights, (copies, 1)),
            WAVELENGTHS,
            solver=skyscatter.Path(samples=count, sampling=way, seed=seed),
        )
        shape = (copies, len(sights) * len(WAVELENGTHS))
        return answer.radiance.reshape(shape), answer.standard_error.reshape(shape)

    truth, _ = look(16, 4 * walks, "march", 1)
    values, errors = look(seeds, walks, sampling, 0)
    uncertain = truth.std(axis=0, ddof=1) / 4.0
    found = [
        coverage(values[:, k], errors[:, k], float(truth[:, k].mean()), float(uncertain[k]))
        for k in range(values.shape[1])
    ]
    return pooled(found)


def main() -> None:
    """Run the study and report it."""
    arguments = parser(__doc__)
    arguments.add_argument("--seeds", type=int, default=200)
    arguments.add_argument("--walks", type=int, default=1024, help="walks of a run")
    arguments.add_argument("--only", default="", help="scenes whose name holds this")
    options, where, rows = arguments.parse_args(), machine(), []
    warnings.simplefilter("ignore")  # what walks are warned of is what is studied here
    for name, model, sun, sampling in SCENES:
        if options.only.lower() in name.lower():
            rows.append(table_row(name, study(model, sun, sampling, options.seeds, options.walks)))
            print(rows[-1], flush=True)
    blocks = ["\n".join([HEADER, *rows])]
    report("sky-coverage", where, versions("skyscatter", "numba"), blocks, sys.argv, options.write, PAGE)


if __name__ == "__main__":
    main()
