"""A room in fog, rendered by skyscatter and by Mitsuba 3: agreement, and the time to equal error.

The walls are diffuse and coloured, an area lamp is in the ceiling, the fog is homogeneous, scatters by Henyey and
Greenstein and is grey up to a power of the wavelength.  Every variant of Mitsuba is run with both of its volumetric
path tracers: `mono` carries one wavelength in a path, `rgb` three, `spectral` four of those of the picture; its time is
that for all wavelengths.  A walk of skyscatter carries them all.
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from common import machine, parser, processors, report, seconds, show, table, versions
from mitsuba_sky import find_llvm
from rooms import AT_ONCE, FogRoom, camera_rays, mitsuba_room, surface_room, trace

import skyscatter
from skyscatter.solvers.options import record_of

VARIANTS = ("mono", "rgb", "spectral")
INTEGRATORS = ("volpath", "volpathmis")
LAMP = 20.0  #: pixels brighter than so many times the median are the lamp or its edge, and are not compared


@dataclass(frozen=True)
class Timed:
    """Runs of one renderer: images (run, pixel, chosen wavelength) and seconds for all wavelengths."""

    name: str
    clock: float
    processor: float  #: of the processor, by thread
    images: Any


def peer(
    mi: Any, dr: Any, room: FogRoom, rays: Any, wavelengths: Any, integrator: str, paths: int, given: Any
) -> Timed:
    """Mitsuba in the variant that is set; `paths` for each ray and wavelength."""
    at_once = AT_ONCE[given.variant]
    groups = peer_groups(wavelengths, given)
    scenes = [mitsuba_room(mi, room, group, integrator) for group in groups]
    samples = paths * wavelengths.size // at_once if mi.is_spectral else paths
    once = max(1, min(samples, given.at_once))
    passes = max(1, samples // once)
    trace(mi, dr, *scenes[0], rays, groups[0], once, 10**6)  # compiles
    clocks, spent, images = [], [], []
    for r in range(given.repeats):
        before, start, parts = time.process_time(), time.perf_counter(), []
        for k, (group, scene) in enumerate(zip(groups, scenes, strict=True)):
            seeds = [((r + given.first_run) * len(groups) + k) * passes + j for j in range(passes)]
            parts.append(np.mean([trace(mi, dr, *scene, rays, group, once, seed) for seed in seeds], axis=0))
        # In groups of one or three wavelengths only those are rendered that are compared.
        share = 1.0 if mi.is_spectral else np.ceil(wavelengths.size / at_once) / len(groups)
        clocks.append(share * (time.perf_counter() - start))
        spent.append(share * (time.process_time() - before) / given.threads)
        every = np.concatenate(groups)
        where = [int(np.flatnonzero(every == wavelengths[k])[0]) for k in given.chosen]
        images.append(np.concatenate(parts, axis=1)[:, where])
    name = f"Mitsuba llvm_ad_{given.variant}, {integrator}, {passes * once} paths"
    return Timed(name, statistics.median(clocks), statistics.median(spent), np.array(images))


def peer_groups(wavelengths: Any, given: Any) -> list[Any]:
    """Wavelengths of each scene of Mitsuba's: those that are compared, alone or with neighbours."""
    if given.variant == "spectral":
        return [wavelengths]
    if given.variant == "mono":
        return [wavelengths[k : k + 1] for k in given.chosen]
    starts = [min(max(k - 1, 0), wavelengths.size - 3) for k in given.chosen]
    return [wavelengths[k : k + 3] for k in starts]


def ours(name: str, run: Any, given: Any) -> Timed:
    """Runs of skyscatter; `run(seed)` returns an answer."""
    clocks, spent, images = [], [], []
    for seed in range(given.repeats):
        before = time.process_time()
        clock, answer = seconds(partial(run, seed=seed))
        clocks.append(clock)
        spent.append((time.process_time() - before) / given.threads)
        images.append(answer.radiance[:, given.chosen])
    return Timed(name, statistics.median(clocks), statistics.median(spent), np.array(images))


def errors(timed: Timed, truth: Any, noise: Any, kept: Any) -> tuple[float, float]:
    """Error of one run: median over pixels of the relative one, and root mean square over the mean light."""
    squares = ((timed.images - truth) ** 2).mean(axis=0) - noise**2
    each = np.sqrt(np.maximum(squares, 0.0))[kept] / truth[kept]
    return float(np.median(each)), float(np.sqrt(max(squares[kept].mean(), 0.0)) / truth[kept].mean())


def agreement(long: Timed, truth: Any, noise: Any, kept: Any, wavelengths: Any) -> list[list[Any]]:
    """Mean light of a long run of Mitsuba over that of skyscatter, by wavelength and by part of the picture."""
    runs, size = long.images, round(len(truth) ** 0.5)
    rows = np.arange(len(truth)) // size
    parts = [(f"{w:.0f} nm", kept, slice(k, k + 1)) for k, w in enumerate(wavelengths)]
    parts += [
        ("upper half", kept & (rows < size // 2), slice(None)),
        ("lower half", kept & (rows >= size // 2), slice(None)),
    ]
    parts.append(("all", kept, slice(None)))
    made = []
    for name, pixels, waves in parts:
        whole = truth[pixels][:, waves].sum()
        mine = runs[:, pixels][:, :, waves]
        variance = (mine.var(axis=0, ddof=1) / len(runs)).sum() + (noise[pixels][:, waves] ** 2).sum()
        ratio, error = mine.mean(axis=0).sum() / whole, np.sqrt(variance) / whole
        made.append([name, f"{ratio:.4f} ± {error:.4f}", f"{(ratio - 1) / error:+.1f}"])
    return made


def main() -> None:
    options = parser(__doc__, repeats=4)
    options.add_argument("--size", type=int, default=64, help="pixels along a side")
    options.add_argument("--wavelengths", type=int, default=32, help="from 400 to 700 nm")
    options.add_argument("--extinction", type=float, default=FogRoom.extinction, help="of the fog at 550 nm [m-1]")
    options.add_argument("--walks", type=int, default=64, help="of skyscatter's path, for each pixel")
    options.add_argument("--passes", type=int, default=16, help="of skyscatter's photons, see samples")
    options.add_argument("--paths", type=int, default=64, help="of Mitsuba's, for each pixel and wavelength")
    options.add_argument("--reference", type=int, default=64, help="how many times as many walks the long run has")
    options.add_argument("--chosen", type=int, default=4, help="wavelengths that are compared")
    options.add_argument("--at-once", type=int, default=128, help="paths for each pixel in one pass of Mitsuba's")
    options.add_argument("--threads", type=int, default=min(2, processors()))
    options.add_argument("--solvers", default="path,photons", help="of skyscatter, by commas")
    given = options.parse_args()
    where = machine()
    os.environ["DRJIT_LIBLLVM_PATH"] = find_llvm()
    import drjit as dr
    import mitsuba as mi

    wavelengths = np.linspace(400.0, 700.0, given.wavelengths)
    given.chosen = np.unique(np.linspace(0, wavelengths.size - 1, given.chosen).round().astype(int)).tolist()
    room = FogRoom(extinction=given.extinction)
    scene = surface_room(room, wavelengths)
    rays = camera_rays(room, given.size)

    def solve(solver: str, **options: Any) -> skyscatter.Answer:
        return skyscatter.radiance(
            scene, *rays, wavelengths, solver=record_of(solver, **options), threads=given.threads
        )  # fmt: skip

    runs = []
    for solver in given.solvers.split(","):
        samples = given.walks if solver == "path" else given.passes
        call = partial(solve, solver, samples=samples)
        building, _ = seconds(partial(call, seed=10**6))
        print(f"{solver}: first run {building:.1f} s", flush=True)
        runs.append(ours(f"skyscatter {solver}, {samples} samples", call, given))
    long, answer = seconds(lambda: solve("path", samples=given.walks * given.reference, seed=2**32))
    truth, noise = answer.radiance[:, given.chosen], answer.standard_error[:, given.chosen]
    kept = truth.mean(axis=1) < LAMP * np.median(truth.mean(axis=1))
    given.first_run, best = 0, None
    for variant in VARIANTS:
        mi.set_variant(f"llvm_ad_{variant}")
        dr.set_thread_count(given.threads)
        given.variant = variant
        for integrator in INTEGRATORS:
            timed = peer(mi, dr, room, rays, wavelengths, integrator, given.paths, given)
            score = timed.processor * errors(timed, truth, noise, kept)[1] ** 2
            print(timed.name, f"{timed.processor:.2f} s", score, flush=True)
            if best is None or score < best[0]:
                best = (score, variant, integrator)
            runs.append(timed)
    assert best is not None
    mi.set_variant(f"llvm_ad_{best[1]}")
    given.variant, given.first_run, given.repeats = best[1], 1000, 8
    check = peer(mi, dr, room, rays, wavelengths, best[2], given.paths * given.reference // 8, given)
    base = errors(runs[0], truth, noise, kept)
    rows = []
    for timed in runs:
        median, square = errors(timed, truth, noise, kept)
        by_median, needed = ((timed.processor * (e / b) ** 2) for e, b in zip((median, square), base, strict=True))
        rows.append([timed.name, timed.clock, timed.processor, 100 * median, 100 * square, by_median, needed,
                     by_median / runs[0].processor, needed / runs[0].processor])  # fmt: skip
    header = ["renderer", "seconds", "of the processor, by thread", "median error [%]", "root mean square [%]",
              "to the first's median", "to its root mean square", "times the first's by the median",
              "by the root mean square"]  # fmt: skip
    blocks = [
        f"{given.size}x{given.size} pixels, {wavelengths.size} wavelengths 400 to 700 nm, room of "
        f"{' x '.join(f'{a:g}' for a in room.size)} m, extinction {room.extinction:g} per m at 550 nm, albedo "
        f"{room.albedo}, g {room.g}; {given.threads} threads, medians of {len(runs[0].images)} runs with "
        f"other seeds. Errors of one run at {', '.join(f'{wavelengths[k]:.0f}' for k in given.chosen)} nm against a "
        f"long run of path ({given.walks * given.reference} walks, {long:.0f} s, root mean square noise "
        f"{100 * float(np.sqrt((noise[kept] ** 2).mean()) / truth[kept].mean()):.2g} %), the lamp's pixels left out.",
        table(header, rows),
        f"Agreement: {check.name} and {len(check.images)} runs, over the long run.",
        table(["mean over", "Mitsuba over skyscatter", "standard errors off 1"],
              agreement(check, truth, noise, kept, wavelengths[given.chosen])),
    ]  # fmt: skip
    times = show(best[0] / (runs[0].processor * base[1] ** 2))
    blocks.append(f"Mitsuba at its best ({best[1]}, {best[2]}) needs {times} times the time of path to equal root mean "
                  "square error, all wavelengths counted. Goal: 10 times.")  # fmt: skip
    packages = versions("skyscatter", "mitsuba", "drjit", "numba", "numpy")
    report("mitsuba-room", where, packages, blocks, ["mitsuba_room.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
