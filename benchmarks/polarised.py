"""Polarised light by walks among surfaces, against published tables and against the solver orders.

    python benchmarks/polarised.py [--walks 131072] [--write]

A Rayleigh slab of optical depth 1 over a black ground, lit 53 degrees from the zenith, in 32 directions from above and
below: the corrected tables of Coulson, Dave & Sekera (Natraj, Li & Yung 2009), which SKYSCATTER_REFERENCE holds.  As a
room it is a box of gas 400 thick by its width, as a nebula a slab of 1e4.  And skies with a body out of sight: walks
that begin with what `orders` knows, and walks alone, beside `orders` for the plain sky.  All deviations are in per cent
of I, root mean squares over the directions.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, report, table, versions

import skyscatter

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests" / part) for part in ("", "system")]
from test_path_stokes import as_nebula, as_room, slab_rays  # noqa: E402
from worlds import BURIED, sky  # noqa: E402

from skyscatter.geometry.vectors import direction_from_azimuth_elevation  # noqa: E402

PAGE = Path(__file__).resolve().parents[1] / "docs" / "validation-surfaces.md"
SKIES = (("earth", 50.0), ("earth", 8.0), ("earth-maritime", 30.0), ("earth-simple", -4.0))
SLAB = ("slab of depth 1", "walks a ray", "seconds", "I", "Q", "U", "stated for I", "for Q", "scalar I")
SKY = ("sky", "Sun", "walks", "seconds", "I", "Q", "U", "stated for I", "for Q", "largest degree")


def spread(values: Any) -> list[str]:
    """Root mean squares of deviations in parts of I, (ray, parameter), in per cent."""
    return [f"{100 * value:.2f}" for value in np.sqrt(np.mean(np.square(values), axis=0))]


def slabs(walks: int, reference: Path) -> list[list[str]]:
    """Rows of the slab."""
    o, d, expected, toward = slab_rays(reference)
    ways = (
        ("room by path", as_room(toward), skyscatter.Path(samples=walks)),
        ("nebula by path", as_nebula(toward), skyscatter.Path(samples=walks)),
    )
    rows = []
    for name, scene, solver in ways:
        skyscatter.radiance(scene, o, d, [550.0], solver=skyscatter.Path(samples=16), stokes=True)
        began = time.perf_counter()
        found = skyscatter.radiance(scene, o, d, [550.0], solver=solver, stokes=True)
        seconds = time.perf_counter() - began
        scalar = skyscatter.radiance(scene, o, d, [550.0], solver=solver)
        missed = (found.stokes[:, 0, :3] - expected) / expected[:, :1]
        stated = found.stokes_error[:, 0, :2] / expected[:, :1]
        alone = (scalar.radiance - expected[:, :1]) / expected[:, :1]
        rows.append([name, str(walks), f"{seconds:.1f}", *spread(missed), *spread(stated), *spread(alone)])
        print(" ".join(rows[-1]), file=sys.stderr, flush=True)
    return rows


def skies(walks: int) -> list[list[str]]:
    """Rows of skies with a body out of sight."""
    rng = np.random.default_rng(4)
    d = direction_from_azimuth_elevation(rng.uniform(0, 360, 24), np.degrees(np.arcsin(rng.uniform(0.1, 0.98, 24))))
    rows = []
    for name, sun in SKIES:
        plain, world = sky(name, sun), sky(name, sun, bodies=(BURIED,))
        at = (plain.observer.position, d, [450.0, 650.0])
        truth = skyscatter.radiance(plain, *at, stokes=True)
        for sampling in (None, "march") if sun > 0 else (None,):
            solver = skyscatter.Path(samples=walks, sampling=sampling)
            began = time.perf_counter()
            found = skyscatter.radiance(world, *at, solver=solver, stokes=True)
            seconds, light = time.perf_counter() - began, truth.radiance[..., None]
            missed = ((found.stokes - truth.stokes) / light)[..., :3].reshape(-1, 3)
            stated = (found.stokes_error / light)[..., :2].reshape(-1, 2)
            degree = np.hypot(truth.layers["Q"], truth.layers["U"]) / truth.radiance
            how = "alone" if sampling else "with what orders knows"
            cells = [name, f"{sun:g}°", f"{walks} {how}", f"{seconds:.1f}", *spread(missed), *spread(stated)]
            rows.append([*cells, f"{100 * degree.max():.0f} %"])
            print(" ".join(rows[-1]), file=sys.stderr, flush=True)
    return rows


def main() -> None:
    """Run the study and report it."""
    options = parser(__doc__)
    options.add_argument("--walks", type=int, default=1 << 17, help="of each ray through the slab")
    given, where = options.parse_args(), machine()
    folder = Path(os.environ.get("SKYSCATTER_REFERENCE", Path(__file__).parents[2] / "shared" / "reference"))
    blocks = [table(SLAB, slabs(given.walks, folder)), table(SKY, skies(1 << 12))]
    report("polarised-walks", where, versions("skyscatter", "numba"), blocks, sys.argv, given.write, PAGE)


if __name__ == "__main__":
    main()
