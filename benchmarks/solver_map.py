"""Where each solver is best: time to equal error of `path` and of `photons`, over optical depth.

Two scenes: a street lamp in a block of fog on a diffuse floor, and a star in the middle of a ball of dust (there `path`
is that of nebulae).  Every way gets about the same time; its error is the root mean square deviation from a long run of
`path`, bias included, and the cost is that error squared times the time.  Photons use their own radius, which falls.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, processors, report, show, table, versions
from rooms import FogRoom, camera_rays
from solving import PATH, photon_ways, render, runs, samples_for

import skyscatter
from skyscatter.lights import PointStar
from skyscatter.media.everywhere import Everywhere
from skyscatter.media.shapes import Sphere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import SpectralTable
from skyscatter.surfaces.lamps import Led
from skyscatter.surfaces.materials import Interface, Lambert
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene
from skyscatter.surfaces.shapes import Box, Rectangle

WAVELENGTHS = np.linspace(400.0, 700.0, 16)
DOCS = Path(__file__).parents[1] / "docs"
SCENES = ("lamp", "star")
COLOURS = {"path": "#222222", "points": "#c1443c", "paths": "#2f6fb0", "both": "#7a4fa3"}


def dust(extinction: float, albedo: float, g: float) -> Particles:
    """Grains whose extinction goes as 1 / wavelength."""
    return Particles(
        extinction=extinction, wavelength=550.0, angstrom_exponent=1.0, single_scattering_albedo=albedo,
        phase=HenyeyGreenstein(g=g),
    )  # fmt: skip


def lamp_in_fog(depth: float, size: int) -> tuple[Any, Any]:
    """A block of fog 3 m wide and 2 m high, of a vertical optical depth at 550 nm; its scene and rays."""
    component = skyscatter.Component(name="fog", density=Everywhere(), optics=dust(depth / 2.0, 0.95, 0.7))
    media = (SurfaceMedium(name="air"), SurfaceMedium(name="fog", components=(component,)))
    floor = Rectangle(position=(0.0, 0.0, -0.01), size=(8.0, 8.0))
    bodies = (
        Body(name="floor", shape=floor, material=Lambert(albedo=0.3)),
        Body(name="fog", shape=Box(position=(0, 0, 1), size=(3, 3, 2)), material=Interface(), inside="fog"),
    )
    lamp = Led(position=(0.0, 0.0, 1.6), axis=(0.0, 0.0, -1.0), power=1.0, half_angle_deg=60.0)
    scene = SurfaceScene(media=media, bodies=bodies, lamps=(lamp,))
    return scene, camera_rays(FogRoom(eye=(0.0, -5.0, 1.6), target=(0.0, 0.0, 0.9)), size, 35.0)


def star_in_dust(depth: float, size: int) -> tuple[Any, Any]:
    """A ball of dust of an optical depth from its middle at 550 nm, where a star is."""
    ball = skyscatter.Component(name="dust", density=Sphere(radius=1.0), optics=dust(depth, 0.6, 0.6))
    star = PointStar(spectrum=SpectralTable(wavelengths=(550.0,), values=(1.0,)))
    scene = SpaceScene(medium=skyscatter.Medium(components=(ball,)), stars=(star,), view=View(distance=100.0))
    across = (2 * (np.arange(size) + 0.5) / size - 1) * 0.95
    x, y = np.meshgrid(across, across)
    origins = np.stack([x.ravel(), y.ravel(), np.full(x.size, 10.0)], axis=1)
    return scene, (origins, np.broadcast_to([0.0, 0.0, -1.0], origins.shape).copy())


def one(name: str, depth: float, given: Any) -> dict[str, Any]:
    """All ways at one optical depth."""
    scene, rays = (lamp_in_fog if name == "lamp" else star_in_dust)(depth, given.size)
    ways = (PATH, *photon_ways(photons=given.photons))
    made = []
    for way in ways:
        samples = samples_for(scene, rays, WAVELENGTHS, way, given.seconds, given.threads)
        made.append(runs(scene, rays, WAVELENGTHS, way, samples, given.repeats, given.threads))
    judge = made[0].samples * given.reference
    spent, answer = render(scene, rays, WAVELENGTHS, PATH, judge, 2**32, given.threads)
    truth, noise = answer.radiance, answer.standard_error
    mean = truth.mean(axis=1)
    kept = (mean > 0.02 * mean.mean()) & (mean < 50 * np.median(mean[mean > 0]))
    result: dict[str, Any] = {"depth": depth, "judge": judge, "judged in": spent}
    for run in made:
        error = run.error(truth, noise, kept)
        ratio = run.ratio(truth, noise, kept)
        result[run.way.name] = (
            error**2 * run.seconds,
            error,
            run.spread(truth, kept),
            *ratio,
            run.samples,
            run.seconds,
        )
        words = " ".join(show(float(v)) for v in result[run.way.name])
        print(f"{name} {depth:g} {run.way.name}: {words}", flush=True)
    return result


def plot(results: dict[str, list[dict[str, Any]]], path: Path) -> None:
    """Cost over optical depth, a panel for each scene."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(results), figsize=(5.2 * len(results), 4.2), squeeze=False)
    titles = {"lamp": "lamp in fog, over a floor", "star": "star in dust"}
    for ax, (name, rows) in zip(axes[0], results.items(), strict=True):
        for way, colour in COLOURS.items():
            ax.loglog(
                [row["depth"] for row in rows], [row[way][0] for row in rows], "o-", color=colour, label=way, ms=4
            )
        ax.set_xlabel("optical depth at 550 nm")
        ax.set_title(titles[name], fontsize=10)
        ax.grid(alpha=0.3)
    axes[0][0].set_ylabel("squared error x time [s]")
    axes[0][-1].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--scenes", default=",".join(SCENES))
    options.add_argument("--depths", default="0.01,0.03,0.1,0.3,1,3,10,30")
    options.add_argument("--size", type=int, default=24, help="pixels along a side")
    options.add_argument("--seconds", type=float, default=2.0, help="of each run")
    options.add_argument("--photons", type=int, default=20_000, help="in a pass")
    options.add_argument("--reference", type=int, default=16, help="how many times as many walks the long run has")
    options.add_argument("--threads", type=int, default=min(2, processors()))
    options.add_argument("--picture", default=str(DOCS / "solver-map.png"), help="file of the plot, made with --write")
    given = options.parse_args()
    where = machine()
    depths = [float(word) for word in given.depths.split(",")]
    results = {name: [one(name, depth, given) for depth in depths] for name in given.scenes.split(",")}
    blocks = [
        f"{given.size}x{given.size} pixels, {WAVELENGTHS.size} wavelengths, about {given.seconds:g} s a run, "
        f"{given.repeats} runs of each, {given.photons} photons in a pass, {given.threads} threads. Squared root mean "
        f"square error (relative to the mean light, bias included) times seconds; mean light over that of the long "
        f"run of path ({given.reference} times the walks).",
    ]
    for name, rows in results.items():
        lines = []
        for row in rows:
            best = min(COLOURS, key=lambda way: row[way][0])
            costs = [row[way][0] for way in COLOURS]
            means = [f"{row[way][3]:.3f} ± {row[way][4]:.3f}" for way in COLOURS]
            lines.append([row["depth"], *costs, best, *means])
        header = ["optical depth", *COLOURS, "best", *(f"mean of {way}" for way in COLOURS)]
        blocks += [f"**{'A lamp in fog' if name == 'lamp' else 'A star in dust'}.**", table(header, lines)]
    if given.write:
        plot(results, Path(given.picture))
    packages = versions("skyscatter", "numba", "numpy")
    report("solver-map", where, packages, blocks, ["solver_map.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
