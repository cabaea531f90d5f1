"""What walks in shipped nebulae cost by every way to a transmittance: time, noise, and the way that is chosen.

    python benchmarks/transmittances.py [PIXELS [WALKS [SEEDS]]]

The table stands in `skyscatter/solvers/transmittance.py`.  Noise is the spread of pictures over seeds, the brightest
pixels, where the star is, left out: its median and its root mean square, over the light.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import skyscatter
from skyscatter.solvers.transmittance import cheapest
from skyscatter.solvers.volume import compile_volume
from skyscatter.units import PARSEC

WAVELENGTHS = (450.0, 550.0, 656.0)
WAYS = ("quadrature", "ratio", "residual-ratio")
#: Width of the pictures [pc].
WIDTHS = {
    "dusty-disk": 0.0044, "hii-region": 2.0, "reflection-nebula": 1.2, "ring-nebula": 0.5, "star-in-dust": 0.12,
    "turbulent-pillar": 2.2,
}  # fmt: skip


def measure(name: str, pixels: int, walks: int, seeds: int) -> None:
    """Print the rows of one model."""
    scene = skyscatter.load_model(name).scene()
    chosen = WAYS[cheapest(compile_volume(scene, WAVELENGTHS))]
    camera = skyscatter.Telescope.from_length(pixels, pixels, WIDTHS[name] * PARSEC, scene.view.distance)
    for way in WAYS:
        pictures, least = [], np.inf
        for seed in range(seeds):
            begin = time.process_time()
            image = skyscatter.render(
                scene,
                camera,
                WAVELENGTHS,
                solver=skyscatter.Path(samples=walks, transmittance=way, seed=seed),
                threads=1,
            )
            # The first compiles.
            least = min(least, time.process_time() - begin) if seed else least
            pictures.append(np.asarray(image.radiance))
        mean, spread = np.mean(pictures, axis=0), np.std(pictures, axis=0, ddof=1)
        brightness = mean.mean(axis=-1)
        kept = (brightness <= np.sort(brightness.ravel())[-7]) & (mean.min(axis=-1) > 0)
        median = np.median(spread[kept] / mean[kept])
        rms = np.sqrt(np.mean(spread[kept] ** 2)) / mean[kept].mean()
        mark = " chosen" if way == chosen else ""
        print(f"{name:18} {way:15} {least:6.2f} s  median {median:.3f}  rms {rms:.3f}{mark}", flush=True)


def main() -> None:
    pixels, walks, seeds = (*map(int, sys.argv[1:]), *(16, 16, 5)[len(sys.argv) - 1 :])
    for name in WIDTHS:
        measure(name, pixels, walks, seeds)


if __name__ == "__main__":
    main()
