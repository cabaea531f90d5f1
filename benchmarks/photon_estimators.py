"""Variance times time of the estimators of ``photons``, over the extinction that a sphere of gathering holds.

A star of 1 W nm-1 in a ball of dust of radius 1 m (albedo 0.8, g = 0.5), three rays that pass within two mean free
paths of it, radius of gathering 0.05 m, light straight from the star by photons too.  Numbers are relative variance x
seconds on one thread, smaller is better; the last column compares the combination with the better of both.
"""

from __future__ import annotations

import time

import numpy as np

import skyscatter
from skyscatter.media.everywhere import Everywhere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.surfaces.lamps import PointLamp
from skyscatter.surfaces.materials import Interface
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene
from skyscatter.surfaces.shapes import Sphere

RADIUS = 0.05
WAVELENGTHS = [550.0]


def star_in_dust(extinction: float) -> SurfaceScene:
    """A ball of dust with a star in the middle."""
    optics = Particles(extinction=extinction, single_scattering_albedo=0.8, phase=HenyeyGreenstein(g=0.5))
    dust = skyscatter.Component(name="dust", density=Everywhere(), optics=optics)
    media = (SurfaceMedium(name="space"), SurfaceMedium(name="dust", components=(dust,)))
    ball = Body(name="ball", shape=Sphere(radius=1.0), material=Interface(), inside="dust")
    return SurfaceScene(media=media, bodies=(ball,), lamps=(PointLamp(name="star", position=(0, 0, 0), power=1.0),))


def cost(depth: float, way: str, photons: int) -> float:
    """Relative variance of the radiance, averaged over the rays, times seconds."""
    # Within sight of the star, however thick the dust is.
    origins = np.array([[min(0.7 * k / depth, 0.2 * k), 0.0, -min(2.0 / depth, 2.0)] for k in (1, 2, 3)])
    options = {"radius": RADIUS, "photons": photons, "estimator": way, "direct": False, "samples": 24}
    begin = time.perf_counter()
    answer = skyscatter.radiance(
        star_in_dust(depth), origins, [0.0, 0.0, 1.0], WAVELENGTHS, solver=skyscatter.Photons(**options), threads=1
    )
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
