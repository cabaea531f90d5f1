"""How fast random walks are, and what a spectrum costs.

Walks per second, time to a given noise of a 512x256 panorama of the model `earth` at 32 wavelengths, and the cost of 32
wavelengths over 1.  A smaller picture of the same view is measured and its time scaled by the number of pixels, and
labelled so, unless --full is given.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from common import WAVELENGTHS, machine, median_seconds, parser, processors, report, seconds, show, table, versions

import skyscatter
from skyscatter.solvers.options import record_of


def size(text: str) -> tuple[int, int]:
    """``512x256`` as numbers."""
    width, height = text.split("x")
    return int(width), int(height)


def rays_of(scene: Any, picture: tuple[int, int]) -> Any:
    """Directions of a full panorama, shape (ray, 3)."""
    camera = skyscatter.Panorama(width=picture[0], height=picture[1])
    return camera.directions(scene.observer).reshape(-1, 3)


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--size", default="512x256", help="the picture that the claim is about")
    options.add_argument("--measured-size", default="64x32", help="the picture that is measured")
    options.add_argument("--full", action="store_true", help="measure the whole picture instead of scaling up")
    options.add_argument("--samples", type=int, default=64, help="walks per pixel for the rate")
    options.add_argument("--noise", type=float, default=0.01, help="relative noise to reach")
    options.add_argument("--sun-elevation", type=float, default=30.0)
    options.add_argument("--threads", default=f"1,{min(2, processors())}", help="numbers of threads, by commas")
    given = options.parse_args()
    where = machine()
    claimed = size(given.size)
    measured = claimed if given.full else size(given.measured_size)
    pixels, factor = measured[0] * measured[1], claimed[0] * claimed[1] / (measured[0] * measured[1])
    scene = skyscatter.load_model("earth").scene(sun_elevation_deg=given.sun_elevation)
    directions = rays_of(scene, measured)

    def run(wl: Any, solver: str = "path", threads: int | None = None, **more: Any) -> Any:
        how = record_of(solver, **more)
        return skyscatter.radiance(scene, scene.observer.position, directions, wl, solver=how, threads=threads)

    one = WAVELENGTHS[[WAVELENGTHS.size // 2]]
    first, _ = seconds(lambda: skyscatter.radiance(scene, scene.observer.position, directions[:1], WAVELENGTHS, "path"))
    for wl in (one, WAVELENGTHS):
        run(wl, samples=4)
    rates: list[list[Any]] = []
    costs: list[list[Any]] = []
    for threads in sorted({int(word) for word in given.threads.split(",")}):
        time, answer = median_seconds(
            lambda n=threads: run(WAVELENGTHS, samples=given.samples, threads=n), given.repeats
        )
        lit = answer.radiance > 0
        reached = float(np.median(answer.standard_error[lit] / answer.radiance[lit]))
        to_noise, quiet = seconds(lambda n=threads: run(WAVELENGTHS, noise=given.noise, threads=n))
        label = "measured" if given.full else f"scaled up from {measured[0]}x{measured[1]}"
        rates.append([
            threads, int(answer.samples.sum() / time), 100 * reached, float(quiet.samples.mean()),
            to_noise, f"{show(to_noise * factor)} ({label})",
        ])  # fmt: skip
        single, _ = median_seconds(lambda n=threads: run(WAVELENGTHS, "single", threads=n), given.repeats)
        single_one, _ = median_seconds(lambda n=threads: run(one, "single", threads=n), given.repeats)
        path_one, _ = median_seconds(lambda n=threads: run(one, samples=given.samples, threads=n), given.repeats)
        costs.append([threads, "path", 1e6 * path_one / pixels, 1e6 * time / pixels, time / path_one])
        costs.append([threads, "single", 1e6 * single_one / pixels, 1e6 * single / pixels, single / single_one])
    about = (
        f"Model earth, Sun at {given.sun_elevation:g} degrees, panorama, {WAVELENGTHS.size} wavelengths 380 to 780 nm; "
        f"{given.samples} walks per pixel for the rate, first order included. First call (kernels loaded or compiled, "
        f"tables built): {first:.2f} s."
    )
    blocks = [
        about,
        table(
            [
                "threads",
                "walks per second",
                f"median noise at {given.samples} walks [%]",
                f"walks per pixel for noise {given.noise:g}",
                f"seconds for {given.noise:g}, {measured[0]}x{measured[1]}",
                f"seconds for {given.noise:g}, {given.size}",
            ],
            rates,
        ),
        table(["threads", "solver", "1 wavelength [µs/pixel]", "32 wavelengths [µs/pixel]", "ratio"], costs),
        "Goal: 32 wavelengths cost less than twice as much as 1.",
    ]
    report("walks", where, versions("skyscatter", "numba", "numpy"), blocks, ["walks.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
