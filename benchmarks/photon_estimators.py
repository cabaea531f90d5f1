"""Variance times time of the estimators of ``photons``, over the extinction that a sphere of gathering holds.

A star of 1 W nm-1 in a ball of dust of radius 1 m (albedo 0.8, g = 0.5), three rays beside it, radius of gathering
0.05 m, light straight from the star by photons too.  Numbers are relative variance x seconds on one thread, smaller is
better; the last column is the share of the variance that the combination has of the better of both.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

import skyscatter

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from nebulae import dusty_sphere, parallel_rays

RADIUS = 0.05
WAVELENGTHS = [550.0]


def cost(depth: float, way: str, photons: int) -> float:
    """Relative variance of the radiance, averaged over the rays, times seconds."""
    rays = parallel_rays(np.array([0.2, 0.5, 0.8]))
    options = {"radius": RADIUS, "photons": photons, "estimator": way, "direct": False, "threads": 1, "samples": 24}
    begin = time.perf_counter()
    answer = skyscatter.radiance(dusty_sphere(depth, 0.8, 0.5), *rays, WAVELENGTHS, "photons", **options)
    seconds = time.perf_counter() - begin
    return float(np.mean((answer.standard_error / answer.radiance) ** 2)) * seconds


def main() -> None:
    """Print the table."""
    for way in ("points", "paths", "both"):  # compiles
        cost(1.0, way, 100)
    print("sigma R    points     paths      both      both/better")
    for product in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0):
        depth = product / RADIUS
        points, paths, both = (
            cost(depth, way, 1 << 13 if depth < 50 else 1 << 11) for way in ("points", "paths", "both")
        )
        print(f"{product:7g} {points:9.2e} {paths:9.2e} {both:9.2e} {both / min(points, paths):10.2f}", flush=True)


if __name__ == "__main__":
    main()
