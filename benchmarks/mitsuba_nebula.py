"""Nebulae in skyscatter and in Mitsuba 3's volumetric path tracer: same light? how long to equal error?

A dusty sphere with a star in its middle (optical depth 1 and 10 along the radius at 550 nm) and a turbulent cloud on
voxels (3 through its middle) with a star within; albedo 0.6, Henyey-Greenstein with g = 0.5, extinction as the inverse
of the wavelength.  Mitsuba's integrator is called along skyscatter's own rays, with no film and no filter between; its
rays start near the cloud, for it computes in single precision; the cloud's skin is a sphere, not a cube, which spares
it empty space.  It renders one wavelength at a time in its monochrome variant, compiled by LLVM: its spectral variant
knows no voxels whose extinction varies with wavelength (for the sphere, see `--variant spectral`).

Both are judged the same way: by the deviations of `--repeats` runs with other seeds from a long run of skyscatter, in
the lit pixels further than 5 pixels from the star's image.  Mitsuba's is looked at in a few of the wavelengths, its
time multiplied up to all of them.  Compile times and the building of scenes are left out on both sides, and told.
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from clouds import turbulent_cloud
from common import machine, parser, processors, report, seconds, show, table, versions
from mitsuba_sky import find_llvm

import skyscatter
from skyscatter.geometry.telescope import Telescope
from skyscatter.lights import PointStar
from skyscatter.media.shapes import Sphere
from skyscatter.media.voxels import VoxelGrid
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import SpectralTable

WAVELENGTHS = np.linspace(400.0, 700.0, 16)  #: [nm]
MIDDLE = 550.0  #: where the optical depths count [nm]
ALBEDO, G, ANGSTROM = 0.6, 0.5, 1.0
DISTANCE, START = 100.0, 2.0  #: of the observer, and of the origins of Mitsuba's rays, from the centre [radius]
NEAR_STAR = 5.0  #: pixels around the star's image that are not compared: there skyscatter averages over the pixel
LIT = 1e-3  #: pixels with less than this part of the mean light are not compared
AT_ONCE = 4  #: wavelengths that a path of Mitsuba's spectral variant carries
CASES = ("sphere-1", "sphere-10", "cloud")
STAR_IN_CLOUD = (0.15, 0.2, 0.1)


@dataclass(frozen=True)
class Case:
    """A scene for both."""

    title: str
    scene: SpaceScene
    star: tuple[float, float, float]
    depth: float  #: extinction at 550 nm where the density is 1 [1 / radius]
    density: Any = None  #: voxels (x, y, z) on the cube from -1 to 1, None for the uniform sphere

    def extinction(self, wavelength: float) -> float:
        """Where the density is 1 [1 / radius]."""
        return float(self.depth * (wavelength / MIDDLE) ** -ANGSTROM)


def make_case(name: str, cells: int) -> Case:
    """One of CASES."""
    if name == "cloud":
        density = turbulent_cloud(cells)
        # The column through the middle is 2 radii at a mean density of 1.
        title, depth, star = f"turbulent cloud on {cells}^3 voxels, optical depth 3 through", 1.5, STAR_IN_CLOUD
        field: Any = VoxelGrid(values=density, low=(-1, -1, -1), high=(1, 1, 1))
    else:
        density, depth, star = None, float(name.split("-")[1]), (0.0, 0.0, 0.0)
        title, field = f"uniform sphere, optical depth {depth:g} along the radius", Sphere(radius=1.0)
    dust = Particles(
        extinction=depth, wavelength=MIDDLE, angstrom_exponent=ANGSTROM, single_scattering_albedo=ALBEDO,
        phase=HenyeyGreenstein(g=G),
    )  # fmt: skip
    flat = SpectralTable(wavelengths=(MIDDLE,), values=(1.0,))
    scene = SpaceScene(
        medium=skyscatter.Medium(components=(skyscatter.Component(name="dust", density=field, optics=dust),)),
        stars=(PointStar(position=star, spectrum=flat),),
        view=View(distance=DISTANCE),
    )
    return Case(title, scene, star, depth, density)


# --- Mitsuba ----------------------------------------------------------------------------------------------------------


def their_scene(mi: Any, case: Case, wavelengths: Any, integrator: str) -> Any:
    """The scene at one wavelength, or at all in the spectral variant."""
    sigma: Any = case.extinction(wavelengths[0])
    if len(wavelengths) > 1:
        spectrum = {
            "type": "irregular",
            "wavelengths": ", ".join(repr(float(w)) for w in wavelengths),
            "values": ", ".join(repr(case.extinction(w)) for w in wavelengths),
        }
        sigma = {"type": "constvolume", "value": spectrum}
    phase, albedo = {"type": "hg", "g": G}, {"type": "constvolume", "value": {"type": "uniform", "value": ALBEDO}}
    medium: dict[str, Any] = {"type": "homogeneous", "sigma_t": sigma, "albedo": albedo, "phase": phase}
    if case.density is not None:
        grid = mi.VolumeGrid(np.ascontiguousarray(case.density.transpose(2, 1, 0)))
        cube = mi.ScalarTransform4f().translate([-1, -1, -1]).scale([2, 2, 2])
        voxels = {"type": "gridvolume", "grid": grid, "to_world": cube, "filter_type": "trilinear"}
        medium |= {"type": "heterogeneous", "sigma_t": voxels, "scale": sigma}
    return mi.load_dict({
        "type": "scene", "integrator": {"type": integrator, "max_depth": -1},
        "cloud": {"type": "sphere", "bsdf": {"type": "null"}, "interior": medium},
        "star": {
            "type": "point", "position": list(case.star),
            "intensity": {"type": "uniform", "value": 1 / (4 * np.pi)},
        },
    })  # fmt: skip


def trace(mi: Any, dr: Any, scene: Any, origins: Any, directions: Any, samples: int, seed: int) -> Any:
    """Mean radiance of `samples` paths along each ray, shape (ray, wavelength): 1 in the monochrome variant, else all.

    A path in the spectral variant carries 4 of the wavelengths, evenly spaced, each of which leads equally often.
    """
    rays, spectral = len(origins), mi.is_spectral
    lanes = rays * samples
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, lanes)
    lane = dr.arange(mi.UInt32, lanes)
    ray = lane // samples

    def point(values: Any) -> list[Any]:
        return [dr.gather(mi.Float, mi.Float(values[:, k].astype(np.float32)), ray) for k in range(3)]

    index, count, more = [mi.UInt32(0)], 1, {}
    if spectral:
        count = WAVELENGTHS.size
        index = [(lane + count // AT_ONCE * j) % count for j in range(AT_ONCE)]
        grid = mi.Float(WAVELENGTHS.astype(np.float32))
        more = {"wavelengths": mi.Spectrum(*(dr.gather(mi.Float, grid, i) for i in index))}
    where = mi.RayDifferential3f(o=mi.Point3f(*point(origins)), d=mi.Vector3f(*point(directions)), time=0.0, **more)
    light = scene.integrator().sample(scene, sampler, where, None, True)[0]
    total = dr.zeros(mi.Float, rays * count)
    for j, i in enumerate(index):
        dr.scatter_reduce(dr.ReduceOp.Add, total, light[j], ray * count + i)
    return np.array(total, float).reshape(rays, count) / (samples * len(index) / count)


def peer_runs(
    mi: Any, dr: Any, case: Case, rays: Any, chosen: list[int], paths: int, given: Any
) -> tuple[float, float, Any]:
    """Seconds of a run at all wavelengths, by the clock and by processor and thread, and runs (run, ray, chosen)."""
    every = WAVELENGTHS.size if mi.is_spectral else 1
    groups = [WAVELENGTHS] if mi.is_spectral else [WAVELENGTHS[k : k + 1] for k in chosen]
    scenes = [their_scene(mi, case, group, given.integrator) for group in groups]
    once = min(paths, given.at_once)
    passes = paths // once
    trace(mi, dr, scenes[0], *rays, once, 10**6)  # compiles
    clocks, spent, runs = [], [], []
    for r in range(given.repeats):
        before, images = time.process_time(), []
        clock = 0.0
        for k, scene in enumerate(scenes):
            seeds = [(r * len(scenes) + k) * passes + j for j in range(passes)]
            took, parts = seconds(lambda s=scene, n=seeds: [trace(mi, dr, s, *rays, once, seed) for seed in n])
            clock += took
            images.append(np.mean(parts, axis=0))
        whole = WAVELENGTHS.size / (every * len(scenes))
        clocks.append(whole * clock)
        spent.append(whole * (time.process_time() - before) / given.threads)
        run = np.concatenate(images, axis=1)
        runs.append(run[:, chosen] if mi.is_spectral else run)
    return statistics.median(clocks), statistics.median(spent), np.array(runs)


# --- skyscatter and the comparison ------------------------------------------------------------------------------------


def our_runs(render: Callable[..., Any], walks: int, given: Any) -> tuple[float, float, Any]:
    """Seconds of a run, by the clock and by processor and thread, and runs (run, ray, wavelength)."""
    clocks, spent, runs = [], [], []
    for seed in range(given.repeats):
        before = time.process_time()
        clock, image = seconds(lambda s=seed: render(solver=skyscatter.Path(samples=walks, seed=s)))
        clocks.append(clock)
        spent.append((time.process_time() - before) / given.threads)
        runs.append(image.radiance.reshape(-1, WAVELENGTHS.size))
    return statistics.median(clocks), statistics.median(spent), np.array(runs)


def errors(runs: Any, truth: Any, noise: Any) -> tuple[float, float]:
    """Errors of one run: median over pixels of the relative one, and root mean square over the mean light.

    `runs` is (run, pixel, wavelength); a pixel's error is the root of the mean squared deviation of the runs from the
    truth, the truth's own variance taken off.
    """
    squares = np.maximum(((runs - truth) ** 2).mean(axis=0) - noise**2, 0.0)
    return float(np.median(np.sqrt(squares) / truth)), float(np.sqrt(squares.mean()) / truth.mean())


def agreement(names: list[str], theirs: Any, truth: Any, noise: Any, radius: Any, chosen: list[int]) -> str:
    """Light of Mitsuba over that of the long run by distance from the star's image and by wavelength."""

    def row(name: str, part: Any, waves: slice) -> list[str]:
        whole = truth[part][:, waves].sum()
        runs = theirs[:, part][:, :, waves]
        # From the spread of every pixel between runs: a few runs do not tell the spread of their mean.
        variance = (runs.var(axis=0, ddof=1) / len(runs)).sum() + (noise[part][:, waves] ** 2).sum()
        ratio, error = runs.mean(axis=0).sum() / whole, np.sqrt(variance) / whole
        return [name, f"{ratio:.4f} ± {error:.4f}", f"{(ratio - 1) / error:+.1f}"]

    every, edges = slice(None), (0.0, 0.2, 0.4, 0.7, 2.0)
    rows = [
        row(f"{a:g} to {b:g} radii from the star", (radius >= a) & (radius < b), every)
        for a, b in pairwise(edges)
        if ((radius >= a) & (radius < b)).any()
    ]
    rows += [row(f"{WAVELENGTHS[k]:.0f} nm", radius >= 0, slice(n, n + 1)) for n, k in enumerate(chosen)]
    rows.append(row("all", radius >= 0, every))
    return table([names[0], names[1], "standard errors off 1"], rows)


def compare(mi: Any, dr: Any, name: str, given: Any) -> list[str]:
    """The blocks of one scene."""
    case = make_case(name, given.cells)
    camera = Telescope.from_length(given.size, given.size, 2.0, DISTANCE)
    render = partial(skyscatter.render, case.scene, camera, WAVELENGTHS, threads=given.threads)
    small = Telescope.from_length(4, 4, 2.0, DISTANCE)
    building, _ = seconds(
        lambda: skyscatter.render(
            case.scene, small, WAVELENGTHS, solver=skyscatter.Path(samples=2), threads=given.threads
        )
    )
    walks, paths = given.walks[name], given.paths[name]
    ours = our_runs(render, walks, given)
    long, image = seconds(
        lambda: render(solver=skyscatter.Path(samples=walks * given.reference, seed=2**32, tolerance=1e-4))
    )
    truth, own = (values.reshape(-1, WAVELENGTHS.size) for values in (image.radiance, image.standard_error))

    directions = camera.directions(case.scene.observer).reshape(-1, 3)
    origins = case.scene.view.position + (DISTANCE - START) * directions
    offset = np.asarray(case.star) - case.scene.view.position
    towards = case.scene.view.position + directions * (directions @ offset)[:, None]
    radius = np.linalg.norm(towards - np.asarray(case.star), axis=1)
    across = np.linalg.norm(np.cross(case.scene.view.position, directions), axis=1)
    lit = (across < 1) & (radius > NEAR_STAR * 2 / given.size) & (truth.min(axis=1) > LIT * truth.mean())
    chosen = given.chosen
    theirs = peer_runs(mi, dr, case, (origins, directions), chosen, paths, given)

    mine = errors(ours[2][:, lit][:, :, chosen], truth[lit][:, chosen], own[lit][:, chosen])
    other = errors(theirs[2][:, lit], truth[lit][:, chosen], own[lit][:, chosen])
    needed = [[theirs[t] * (other[e] / mine[e]) ** 2 for e in (0, 1)] for t in (0, 1)]
    header = ["renderer", "seconds", "of the processor, by thread", "median error [%]", "root mean square [%]"]
    rows = [
        [f"skyscatter path, {walks} walks", *ours[:2], 100 * mine[0], 100 * mine[1]],
        [f"Mitsuba {given.integrator}, {paths} paths", *theirs[:2], 100 * other[0], 100 * other[1]],
    ]
    peak = ""
    if case.density is not None:
        peak = f" Largest density over the mean: {case.density.max() / case.density.mean():.0f}."
    return [
        f"**{case.title[0].upper()}{case.title[1:]}.**{peak} Long run: {walks * given.reference} walks, {long:.0f} s, "
        f"median noise {100 * np.median(own[lit] / truth[lit]):.2g} %. First picture of 4x4 pixels, tables and kernels "
        f"included: {building:.1f} s.",
        table(header, rows),
        f"Mitsuba's time to skyscatter's error: {show(needed[0][0])} s by the median, {show(needed[0][1])} s by the "
        f"root mean square: {show(needed[0][0] / ours[0])} and {show(needed[0][1] / ours[0])} times skyscatter's by "
        f"the clock, {show(needed[1][0] / ours[1])} and {show(needed[1][1] / ours[1])} times by processor.",
        agreement(["mean over", "Mitsuba over skyscatter"], theirs[2][:, lit], truth[lit][:, chosen],
                  own[lit][:, chosen], radius[lit], chosen),
    ]  # fmt: skip


def main() -> None:
    options = parser(__doc__, repeats=4)
    options.add_argument("--quick", action="store_true", help="64x64 pixels, 64^3 voxels and few paths, for a trial")
    options.add_argument("--cases", default=",".join(CASES), help="by commas")
    options.add_argument("--size", type=int, default=256, help="pixels along a side")
    options.add_argument("--cells", type=int, default=256, help="voxels along a side")
    options.add_argument("--walks", default="4,16,8", help="skyscatter's walks per pixel that are timed, by case")
    options.add_argument("--reference", type=int, default=8, help="how many times as many the long run has")
    options.add_argument("--paths", default="256,1024,64", help="Mitsuba's paths per pixel and wavelength in a run")
    options.add_argument("--at-once", type=int, default=64, help="of them in one pass, as memory allows")
    options.add_argument("--chosen", type=int, default=4, help="wavelengths that Mitsuba renders, its time scaled up")
    options.add_argument("--integrator", choices=("volpath", "volpathmis"), default="volpath")
    options.add_argument("--variant", choices=("mono", "spectral"), default="mono", help="spectral: spheres alone")
    options.add_argument("--threads", type=int, default=min(2, processors()))
    given = options.parse_args()
    if given.quick:
        given.size, given.cells, given.at_once = 64, 64, 1024
    names = given.cases.split(",")
    if set(names) - set(CASES) or given.repeats < 2 or (given.variant == "spectral" and "cloud" in names):
        raise SystemExit(f"--cases from {', '.join(CASES)}, no cloud in the spectral variant; --repeats 2 or more")
    for name in ("walks", "paths"):
        numbers = [int(word) for word in getattr(given, name).split(",")]
        setattr(given, name, dict(zip(CASES, numbers, strict=True)))
    given.chosen = np.unique(np.linspace(0, WAVELENGTHS.size - 1, given.chosen).round().astype(int)).tolist()
    where = machine()
    os.environ["DRJIT_LIBLLVM_PATH"] = find_llvm()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(f"llvm_ad_{given.variant}")
    dr.set_thread_count(given.threads)
    about = (
        f"{given.size}x{given.size} pixels, {WAVELENGTHS.size} wavelengths 400 to 700 nm, albedo {ALBEDO}, g {G}, "
        f"extinction as 1/wavelength, {given.threads} threads, {given.repeats} runs of each with other seeds. Mitsuba: "
        f"llvm_ad_{given.variant}, judged at {', '.join(f'{WAVELENGTHS[k]:.0f}' for k in given.chosen)} nm."
    )
    blocks = [about]
    for name in names:
        blocks += compare(mi, dr, name, given)
    blocks.append("Errors are those of one run against the long run, in lit pixels away from the star's image; times "
                  "are scaled by their squares. Goal: at least 100 times.")  # fmt: skip
    packages = versions("skyscatter", "mitsuba", "drjit", "numba", "numpy")
    report("mitsuba-nebula", where, packages, blocks, ["mitsuba_nebula.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
