"""How often the error bars of ``path`` in nebulae cover the truth.

One line of sight through each scene is followed with many seeds (as that many rays: each draws numbers of its own),
and once with many walks for the reference.

    python benchmarks/coverage_nebula.py [part of a scene's name ...] [--seeds 200] [--samples 64] [--write]
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, report, versions
from error_bars import HEADER, coverage, table_row

import skyscatter
from skyscatter.lights import ParallelLight, PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.media.shapes import GaussianSphere, Sphere
from skyscatter.media.structures import Box
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import SpectralTable

PAGE = Path(__file__).resolve().parents[1] / "docs" / "validation-nebulae.md"
#: Walks of the reference for every walk of an estimate, and rays among which they are divided.
REFERENCE_FACTOR, REFERENCE_RAYS = 64, 1000


def sphere(tau: float, albedo: float, g: float = 0.0, density: Any = None) -> SpaceScene:
    """A ball of dust around a star of 1 W nm-1."""
    optics = Particles(
        extinction=tau, single_scattering_albedo=albedo, phase=HenyeyGreenstein(g=g) if g else Isotropic()
    )
    dust = Component(name="dust", density=density or Sphere(radius=1.0), optics=optics)
    star = PointStar(spectrum=SpectralTable(wavelengths=(500.0,), values=(1.0,)))
    return SpaceScene(medium=Medium(components=(dust,)), stars=(star,), view=View(distance=100.0))


def lit_slab(tau: float, albedo: float, g: float) -> SpaceScene:
    """A slab seen from the side that is not lit."""
    scene = sphere(tau / 2, albedo, g, Box(half_sizes=(10.0, 10.0, 1.0)))
    light = ParallelLight(direction=(0.0, 0.0, -1.0), irradiance=1.0)
    return scene.model_copy(update={"stars": (), "parallel": (light,)})


def lit_from_aside(tau: float, albedo: float, g: float) -> SpaceScene:
    """A ball of dust under parallel light from the side."""
    light = ParallelLight(direction=(1.0, 0.0, 0.0), irradiance=1.0)
    return sphere(tau, albedo, g).model_copy(update={"stars": (), "parallel": (light,)})


def lit_from_the_camera(tau: float, albedo: float, g: float) -> SpaceScene:
    """The same from the other side."""
    light = ParallelLight(direction=(0.3, 0.0, 1.0), irradiance=1.0)
    return lit_slab(tau, albedo, g).model_copy(update={"parallel": (light,)})


def scenes() -> dict[str, tuple[SpaceScene, float]]:
    """Scenes by name, and the offset of the line of sight from the middle."""
    return {
        "sphere, depth 1, albedo 0.6": (sphere(1.0, 0.6), 0.3),
        "Gaussian, depth 3, albedo 0.7, g 0.6": (sphere(5.0, 0.7, 0.6, GaussianSphere(width=0.3)), 0.2),
        "dense dust, depth 10, albedo 0.6, g 0.5": (sphere(10.0, 0.6, 0.5), 0.3),
        "dense dust, depth 30, albedo 0.6": (sphere(30.0, 0.6), 0.3),
        "white cloud, depth 3": (sphere(3.0, 1.0), 0.3),
        "white cloud, depth 10": (sphere(10.0, 1.0), 0.3),
        "white cloud, depth 30": (sphere(30.0, 1.0), 0.3),
        "white cloud, depth 10, g 0.8": (sphere(10.0, 1.0, 0.8), 0.3),
        "white slab from behind, depth 20, g 0.8": (lit_slab(20.0, 1.0, 0.8), 0.0),
        "grey slab from behind, albedo 0.98, depth 40, g 0.85": (lit_slab(40.0, 0.98, 0.85), 0.0),
        "white slab, lit side, depth 20, g 0.5": (lit_from_the_camera(20.0, 1.0, 0.5), 0.0),
        "white slab, lit side, depth 20, g 0.85": (lit_from_the_camera(20.0, 1.0, 0.85), 0.0),
        "dark slab, lit side, depth 20, albedo 0.6, g 0.9": (lit_from_the_camera(20.0, 0.6, 0.9), 0.0),
        "dark slab, lit side, depth 3, albedo 0.5, g 0.95": (lit_from_the_camera(3.0, 0.5, 0.95), 0.0),
        "white ball lit from aside, depth 10, g 0.6": (lit_from_aside(10.0, 1.0, 0.6), 0.3),
        "white ball lit from aside, depth 3, g 0.9": (lit_from_aside(3.0, 1.0, 0.9), 0.3),
        "dark ball lit from aside, depth 5, albedo 0.6, g 0.85": (lit_from_aside(5.0, 0.6, 0.85), 0.3),
        "dark ball lit from aside, depth 3, albedo 0.5, g 0.93": (lit_from_aside(3.0, 0.5, 0.93), 0.3),
        "dark ball around a star, depth 5, albedo 0.6, g 0.9": (sphere(5.0, 0.6, 0.9), 0.3),
    }


def study(scene: SpaceScene, offset: float, seeds: int, samples: int, threads: int) -> Any:
    """Coverage of one scene."""

    def multiple(rays: int, walks: int, seed: int) -> tuple[Any, Any]:
        origins = np.broadcast_to([offset, 0.0, 10.0], (rays, 3))
        answer = skyscatter.radiance(
            scene,
            origins,
            [0.0, 0.0, -1.0],
            [550.0],
            solver=skyscatter.Path(samples=walks, seed=seed),
            threads=threads,
            parts=True,
        )
        return answer.layers["multiple"][:, 0], answer.standard_error[:, 0]

    values, errors = multiple(seeds, samples, 1)
    rays = min(REFERENCE_RAYS, max(REFERENCE_FACTOR * samples // 16, 1))
    truth, _ = multiple(rays, REFERENCE_FACTOR * samples // rays // 16 * 16, 2)
    return coverage(values, errors, float(truth.mean()), float(truth.std(ddof=1) / np.sqrt(rays)))


def main() -> None:
    """Run the study and report it."""
    arguments = parser(__doc__)
    arguments.add_argument("scene", nargs="*", help="part of the name of a scene")
    arguments.add_argument("--seeds", type=int, default=200)
    arguments.add_argument("--samples", type=int, default=64)
    arguments.add_argument("--threads", type=int, default=None)
    given, where, rows = arguments.parse_args(), machine(), []
    for name, (scene, offset) in scenes().items():
        if given.scene and not any(part in name for part in given.scene):
            continue
        rows.append(table_row(name, study(scene, offset, given.seeds, given.samples, given.threads)))
        print(rows[-1], flush=True)
    blocks = [f"{given.seeds} seeds of {given.samples} walks along one ray.", "\n".join([HEADER, *rows])]
    report("nebula-coverage", where, versions("skyscatter", "numba"), blocks, sys.argv, given.write, PAGE)


if __name__ == "__main__":
    main()
