"""What denoising gains over shipped nebulae and rooms, and whether its stated errors hold, beside long runs.

Errors are root mean squares over pixels and wavelengths, each wavelength relative to the mean of its noisy light.  The
long runs have noise of their own: its square, as they state it, is subtracted.  Where that leaves nothing (a tile whose
error is below the noise of the judge) the tile does not count.  `--keep DIR` keeps the renders, and takes those that
are there.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from common import machine, parser, report, table, versions, view

import skyscatter
from skyscatter.solvers.corrections import seen
from skyscatter.solvers.features import picture_sight
from skyscatter.solvers.options import record_of

Array = Any
WAVELENGTHS = [450.0, 550.0, 650.0]
TILE = 32


class Case(NamedTuple):
    """A scene, its solver, walks a pixel (passes of photons) of the runs and of the judge."""

    solver: str
    counts: tuple[int, ...]
    judge: int


CASES = {
    "dark-globule": Case("path", (16, 32, 128, 512), 8192),
    "reflection-nebula": Case("path", (16, 32, 128, 512), 4096),
    "milk-and-water": Case("path", (16, 32, 128), 2048),
    "light-guide": Case("path", (16, 32, 128, 512, 2048), 16384),
    "fog-room": Case("photons", (16, 32, 128), 768),
}


def picture(name: str, side: int, samples: int, seed: int, keep: Path | None) -> Any:
    """A render with its halves, or the one that was kept."""
    file = None if keep is None else keep / f"{name}-{side}-{samples}-{seed}.nc"
    scene, camera = view(name, side)
    if file is not None and file.is_file():
        return sighted(skyscatter.SpectralImage.load(file), scene, camera)
    solver = CASES[name].solver
    image = skyscatter.render(
        scene, camera, WAVELENGTHS, solver=record_of(solver, samples=samples, seed=seed), halves=True
    )
    if file is not None:
        image.save(file)
    return image


def sighted(image: Any, scene: Any, camera: Any) -> Any:
    """A picture that was kept, with what its pixels see first, which files do not hold."""
    features = picture_sight(scene, seen(scene, camera), image.wavelengths)
    return skyscatter.SpectralImage(
        image.radiance, image.wavelengths, image.error, recipe=image.recipe, layers=image.layers, features=features
    )


class Judged(NamedTuple):
    """Relative errors of a picture and its tiles."""

    raw: float
    clean: float
    stated: float
    worst_tile: float
    flux: float


def judged(image: Any, clean: Any, long: Any) -> Judged:
    """Errors beside a long run; the greatest ratio of a tile's errors, and the change of light in standard errors."""
    light = (image.layers["half_a"] + image.layers["half_b"]).mean(axis=(0, 1)) / 2

    def square(picture: Any, part: Any = np.s_[:, :]) -> float:
        return float(np.mean((((picture.radiance - long.radiance) ** 2 - long.error**2) / light**2)[part]))

    tiles = []
    for j in range(0, image.shape[0], TILE):
        for i in range(0, image.shape[1], TILE):
            part = np.s_[j : j + TILE, i : i + TILE]
            raw, found = square(image, part), square(clean, part)
            if raw > 0 and found > 0:
                tiles.append(np.sqrt(found / raw))
    chance = np.sqrt((image.error**2).sum(axis=(0, 1))) / image.radiance[..., 0].size
    flux = np.abs((clean.radiance - image.radiance).mean(axis=(0, 1)) / chance)
    errors = (np.sqrt(max(square(some), 0.0)) for some in (image, clean))
    stated = float(np.sqrt(np.mean(clean.error**2 / light**2)))
    return Judged(*errors, stated, max(tiles, default=np.nan), float(flux.max()))


def rows_of(name: str, options: Any) -> list[list[Any]]:
    """Rows of the table for a scene: a count of walks and a method each."""
    case, rows = CASES[name], []
    long = picture(name, options.side, case.judge, 7, options.keep)
    for number, count in enumerate(case.counts):
        image = picture(name, options.side, count, 100 + number, options.keep)
        for method in options.methods:
            found = judged(image, image.denoised(method), long)
            gain, trust = found.raw / found.clean, found.stated / found.clean
            words = [f"{100 * value:.3g} %" for value in (found.raw, found.clean)]
            rows.append(
                [f"{name}, `{case.solver}`", count, method, *words, f"{gain:.2f}", f"{trust:.2f}",
                 f"{found.worst_tile:.2f}", f"{found.flux:.2f}"]
            )  # fmt: skip
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Render, denoise, judge and report."""
    made = parser(__doc__)
    made.add_argument("--side", type=int, default=64, help="side of the pictures [pixel]")
    made.add_argument("--scenes", nargs="+", choices=list(CASES), default=list(CASES), metavar="NAME")
    made.add_argument("--methods", nargs="+", default=["oidn", "nlm"], choices=["oidn", "nlm"])
    made.add_argument("--keep", type=Path, metavar="DIR", help="folder in which renders are kept")
    options = made.parse_args()
    if options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
    where = machine()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scenes in which walks are rare are meant
        rows = [row for name in options.scenes for row in rows_of(name, options)]
    header = ["scene, solver", "walks or passes", "method", "raw error", "denoised", "gain", "stated over true",
              "worst tile over raw", "change of light / standard error"]  # fmt: skip
    judges = ", ".join(f"{name} {CASES[name].judge}" for name in options.scenes)
    side = options.side
    size = f"Pictures of {side}x{side} pixels, 3 wavelengths, tiles of 32x32. Walks of the judges: {judges}."
    report(
        "denoising", where, versions("skyscatter", "pyoidn", "numba"), [size, table(header, rows)], sys.argv,
        options.write,
    )  # fmt: skip


if __name__ == "__main__":
    main()
