"""How often the stated error of the solver orders covers, over random skies.

    python benchmarks/coverage_orders.py [--scenes 200] [--first 0] [--tolerance 0.005] [--walks 8192|--finer] [--write]

Every scene has air, haze or both, in shells, tents and layers of metres to kilometres, forward peaks up to g = 0.9,
optical depths up to 3, a ground of any albedo, a Sun from the zenith to deep twilight, and an observer on the ground,
aloft or in orbit who looks along six lines of sight, many of them grazing.  The judge is `path`, which shares
neither grid, quadrature nor cut with `orders`; it has an error of its own, so that a deviation counts as
covered where it lies within the stated error and two of the judge's; rays on which the judge's error is larger than
the stated one, or than a fifth of the light, say nothing and are left out of the shares, but counted.  With `--finer`
the judge is a solution to a sixth of the tolerance: it shares the method, and knows its error far better than walks do.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

import numpy as np
from common import machine, parser, report, table, versions

import skyscatter
from skyscatter import Component, Ground, Medium, Scene, Star, Sun
from skyscatter.errors import DomainError
from skyscatter.media.fields import Exponential, Tent, Uniform
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Rayleigh

PAGE = Path(__file__).resolve().parents[1] / "docs" / "validation-orders.md"
HEADER = (
    "tolerance", "scenes", "values that tell", "within the stated error", "within twice", "median stated",
    "mean deviation", "seconds a scene",
)  # fmt: skip
RAYS = 6
#: Relative error of the judge beyond which it has found too few walks to know its own error.
BLIND = 0.2
#: Tolerance of the judge's first order, which is an integral along the ray.
JUDGE = 1e-4
#: Tolerance of a finer solution, in units of that which is judged.
FINER = 1 / 6


def haze(rng: np.random.Generator) -> Component:
    """Particles in a shell that thins out, a layer or a tent."""
    kind = int(rng.integers(3))
    if kind == 0:
        density = Exponential(scale_height=float(rng.uniform(1e3, 4e3)))
    elif kind == 1:
        base = float(rng.uniform(0, 5e3))
        density = Uniform(base=base, top=base + float(10 ** rng.uniform(1, 3.7)))
    else:
        peak = float(rng.uniform(1e3, 15e3))
        half = float(rng.uniform(0.1, 1.0)) * peak
        density = Tent(base=peak - half, peak=peak, top=peak + half)
    optics = Particles(
        optical_depth=float(10 ** rng.uniform(-2, 0.5)),
        single_scattering_albedo=float(rng.uniform(0.7, 1.0)),
        phase=HenyeyGreenstein(g=float(rng.uniform(0, 0.9))),
    )
    return Component(name="haze", density=density, optics=optics)


def random_sky(rng: np.random.Generator) -> tuple[Scene, np.ndarray]:
    """A scene and directions of sight (ray, 3)."""
    radius = float(rng.choice([3.39e6, 6.371e6, 6.371e6, 6.371e6]))
    components = []
    if rng.random() < 0.85:
        optics = Particles(optical_depth=float(10 ** rng.uniform(-1.5, 0)), phase=Rayleigh())
        components.append(
            Component(name="air", density=Exponential(scale_height=float(rng.uniform(6e3, 12e3))), optics=optics)
        )
    if not components or rng.random() < 0.8:
        components.append(haze(rng))
    sun = float(rng.uniform(2, 90) if rng.random() < 0.6 else rng.uniform(-9, 6))
    altitude = float(rng.choice([0, 0, 0, rng.uniform(0, 2e4), 4e5]))
    dip = np.degrees(np.arccos(radius / (radius + altitude)))
    even = np.degrees(np.arcsin(rng.uniform(-1, 1, RAYS)))
    elevation = np.where(rng.random(RAYS) < 0.4, rng.uniform(-3, 5, RAYS) - dip, even)
    if altitude == 0:
        elevation = np.abs(elevation) + 0.1
    elif altitude > 1e5:
        elevation = np.where(np.arange(RAYS) < RAYS // 2, -rng.uniform(30, 90, RAYS), rng.uniform(-5, 2, RAYS) - dip)
    e, a = np.radians(elevation), rng.uniform(0, 2 * np.pi, RAYS)
    scene = Scene(
        medium=Medium(planet_radius=radius, components=tuple(components)),
        ground=Ground(albedo=float(rng.choice([0, rng.uniform(0, 1)]))),
        star=Star(spectrum=1.0, radius=0.0),
        sun=Sun(elevation_deg=sun, azimuth_deg=0.0),
        altitude=altitude,
    )
    return scene, np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1)


def telling(stated: np.ndarray, judge: np.ndarray) -> np.ndarray:
    """Where the judge knows the light well enough."""
    return np.asarray(judge <= np.minimum(stated, BLIND))


def compare(seed: int, tolerance: float, walks: int, finer: bool) -> tuple[np.ndarray, float]:
    """Deviation, stated error and the judge's error of a scene's rays, relative (3, ray); seconds of processor."""
    scene, sights = random_sky(np.random.default_rng(seed))
    rays = np.broadcast_to(scene.observer.position, sights.shape), sights
    start = time.process_time()
    answer = skyscatter.radiance(scene, *rays, [550.0], solver=skyscatter.Orders(tolerance=tolerance))
    seconds = time.process_time() - start
    if finer:
        judge = skyscatter.radiance(scene, *rays, [550.0], solver=skyscatter.Orders(tolerance=FINER * tolerance))
    else:
        judge = skyscatter.radiance(
            scene, *rays, [550.0], solver=skyscatter.Path(samples=walks, tolerance=JUDGE, seed=seed)
        )
    lit = judge.radiance[:, 0] > 0
    truth = judge.radiance[lit, 0]
    # Two of the judge's errors count: a finer solution states what it covers, walks a standard error.
    error = judge.error / 2 if finer else judge.error
    row = np.array([x[lit, 0] / truth for x in (answer.radiance - judge.radiance, answer.error, error)])
    missed = (np.abs(row[0]) > row[1] + 2 * row[2]) & telling(*row[1:])
    if missed.any():
        d, e, j = 100 * row[:, missed]
        print(f"scene {seed}: deviation {d} % stated {e} % judge {j} %", flush=True)
    return row, seconds


def table_of(rows: np.ndarray, first: int, scenes: int, tolerance: float, seconds: float) -> str:
    """The table of one study."""
    d, e, j = rows
    told = telling(e, j)
    inside, twice = (np.abs(d) <= k * e + 2 * j for k in (1, 2))
    weight = 1 / (j[told] ** 2 + 0.002**2)
    mean = f"{100 * np.average(d[told], weights=weight):+.3f} ± {100 * weight.sum() ** -0.5:.3f} %"
    cells = [
        f"{tolerance:g}", f"{first} to {first + scenes - 1}", f"{told.sum()} of {told.size}",
        *(f"{100 * part[told].mean():.1f} %" for part in (inside, twice)), f"{100 * np.median(e[told]):.2f} %", mean,
        f"{seconds / scenes:.2f}",
    ]  # fmt: skip
    return table(HEADER, [cells])


def main() -> None:
    """Run the study, which Ctrl-C ends early, and report it."""
    options = parser(__doc__)
    options.add_argument("--scenes", type=int, default=200)
    options.add_argument("--first", type=int, default=0, help="number of the first scene, which is its seed")
    options.add_argument("--tolerance", type=float, default=0.005)
    options.add_argument("--walks", type=int, default=8192)
    options.add_argument("--finer", action="store_true", help="judge by a finer solution in the place of walks")
    given, where = options.parse_args(), machine()
    warnings.simplefilter("ignore")
    rows, seconds = [], 0.0
    try:
        for seed in range(given.first, given.first + given.scenes):
            try:
                row, spent = compare(seed, given.tolerance, given.walks, given.finer)
            except DomainError as error:  # a finer solution that would take hours
                print(f"scene {seed}: left out, {error}", flush=True)
                continue
            rows.append(row)
            seconds += spent
            print(f"{len(rows)} of {given.scenes} scenes", end="\r", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print(f"interrupted after {len(rows)} scenes", file=sys.stderr)
    if rows:
        found = table_of(np.concatenate(rows, axis=1), given.first, len(rows), given.tolerance, seconds)
        section = f"random-skies-{'finer-' if given.finer else ''}{given.tolerance:g}"
        report(section, where, versions("skyscatter", "numba"), [found], sys.argv, given.write, PAGE)


if __name__ == "__main__":
    main()
