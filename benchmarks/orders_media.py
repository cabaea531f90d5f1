"""What the solver `orders` gives and costs over the six media of `orders_profile.py`, where it has most to do.

Parts, each with its section in RESULTS.md: `accuracy` (media by positions of the Sun, against a finer solution and
against `path`), `thick` (layers of cloud by optical depth), `bands` (400 wavelengths beside 32), `first` (a first
answer at a tolerance of 0.05, and what refining it takes).
"""

from __future__ import annotations

import statistics
import sys
from functools import partial
from typing import Any

import numpy as np
from common import WAVELENGTHS, machine, parser, processors, report, seconds, table, versions
from orders_profile import CLOUD, ELEVATIONS, MEDIA, SIZE, scene_of

import skyscatter
from skyscatter.solvers.base import Answer
from skyscatter.solvers.options import Orders, Path

PARTS = ("thick", "bands", "first", "accuracy")
CAMERA = skyscatter.Panorama(width=SIZE[0], height=SIZE[1])
DEPTHS, THICK_SUNS = (3.0, 10.0, 30.0, 100.0), (60.0, 10.0, 0.0)  #: of clouds
THIN, BAND_SUNS = MEDIA[:4], (60.0, 10.0, -6.0)
FIRST_SUNS = 60.0, -6.0  #: of first answers
MANY = np.linspace(380.0, 780.0, 400)  #: wavelengths [nm]
LOOSE = 0.05  #: tolerance of a first answer
TOLD = np.array([420.0, 550.0, 700.0])  #: wavelengths at which accuracy is looked at [nm]
LOW = np.array([1.0, 3.0, 8.0, 20.0, 40.0, 75.0])  #: elevations of the lines of sight [degree]
AROUND = np.arange(0.0, 181.0, 30.0)  #: their azimuths from the Sun [degree]
#: Tolerance of the solution that judges, and walks of `path` for each line of sight, in thin and in thick media.
FINE, WALKS = (0.0015, 0.002), (8192, 1024)
#: A deviation from walks counts as covered within so many of their own errors beside what is stated; walks whose error
#: is beyond a share of the light, or beyond what is stated, say nothing.
WIDTH, BLIND = 2.0, 0.2


def middle(function: Any, given: Any) -> float:
    """Median seconds of several calls."""
    return statistics.median(seconds(function)[0] for _ in range(given.repeats))


def picture(scene: skyscatter.Scene, wavelengths: Any, given: Any, tolerance: float | None = None) -> Any:
    """A call for a panorama."""
    how = Orders(tolerance=tolerance)
    return partial(skyscatter.render, scene, CAMERA, wavelengths, solver=how, threads=given.threads)


def thick(given: Any) -> list[str]:
    """Clouds by optical depth."""
    rows = []
    for depth in DEPTHS:
        times = [middle(picture(scene_of("cloud", sun, depth), WAVELENGTHS, given), given) for sun in THICK_SUNS]
        rows.append([f"{depth:g}", *times])
    about = (
        f"Panorama {SIZE[0]}x{SIZE[1]} from the ground under a layer of cloud, white, asymmetry {CLOUD[1]:g}, "
        f"{WAVELENGTHS.size} wavelengths, tolerance 0.005, {given.threads} threads; median of {given.repeats}. "
        "Seconds of solution and picture:"
    )
    return [about, table(["optical depth", *(f"Sun {sun:g}°" for sun in THICK_SUNS)], rows)]


def bands(given: Any) -> list[str]:
    """Many wavelengths beside few."""
    rows = []
    for medium in THIN:
        for sun in BAND_SUNS:
            scene = scene_of(medium, sun)
            few, many = (middle(picture(scene, wl, given), given) for wl in (WAVELENGTHS, MANY))
            rows.append([medium, f"{sun:g}", few, many, many / few])
    about = (
        f"Panorama {SIZE[0]}x{SIZE[1]} from the ground, tolerance 0.005, {given.threads} threads; median of "
        f"{given.repeats}. Seconds of solution and picture with {WAVELENGTHS.size} and with {MANY.size} wavelengths:"
    )
    return [about, table(["medium", "Sun [°]", f"{WAVELENGTHS.size} [s]", f"{MANY.size} [s]", "times"], rows)]


def first(given: Any) -> list[str]:
    """A first answer, and a better one from it."""
    rows = []
    for medium in (*THIN, "cloud"):
        for sun in FIRST_SUNS:
            scene = scene_of(medium, sun)
            soon, full = (middle(picture(scene, WAVELENGTHS, given, t), given) for t in (LOOSE, None))
            solve = partial(skyscatter.solve, scene, WAVELENGTHS, sun_elevations_deg=(sun, sun), threads=given.threads)
            field = solve(tolerance=LOOSE)
            refined = middle(partial(field.refined, threads=given.threads), given)
            anew = middle(partial(solve, tolerance=field.tolerance / 4), given)
            rows.append([medium, f"{sun:g}", soon, full, soon / full, refined, anew])
            print(*rows[-1], flush=True)
    about = (
        f"Panorama {SIZE[0]}x{SIZE[1]} from the ground, {WAVELENGTHS.size} wavelengths, {given.threads} threads; "
        f"median of {given.repeats}. Seconds of solution and picture at tolerances of {LOOSE:g} and 0.005; and of "
        "`field.refined()` beside a solution to the same tolerance from the beginning:"
    )
    header = ["medium", "Sun [°]", f"{LOOSE:g} [s]", "0.005 [s]", "share", "refined [s]", "anew [s]"]
    return [about, table(header, rows)]


def sights() -> Any:
    """Lines of sight, (ray, 3), the Sun in the azimuth 0."""
    elevation, azimuth = (np.radians(a) for a in np.meshgrid(LOW, AROUND))
    flat = np.cos(elevation)
    return np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)


def looked(scene: skyscatter.Scene, how: Orders | Path, given: Any) -> Answer:
    """Light along them."""
    return skyscatter.radiance(scene, scene.observer.position, sights(), TOLD, solver=how, threads=given.threads)


def covered(answer: Answer, light: Any, own: Any) -> tuple[int, float, float]:
    """Values that tell, and shares of them within the stated error and twice it; the light has an error of its own."""
    off = np.abs(answer.radiance - light)
    tells = (own < answer.standard_error) & (own < BLIND * light)
    if not tells.any():
        return 0, np.nan, np.nan
    inside = [float(np.mean((off < k * answer.standard_error + WIDTH * own)[tells])) for k in (1, 2)]
    return int(tells.sum()), inside[0], inside[1]


def accuracy(given: Any) -> list[str]:
    """Whether the stated error covers, medium by medium and Sun by Sun."""
    rows: list[list[Any]] = []
    pairs: list[tuple[Answer, Answer, Answer]] = []
    for medium in given.media.split(","):
        for sun in ELEVATIONS:
            scene = scene_of(medium, sun)
            scene = scene.model_copy(update={"sun": scene.sun.model_copy(update={"azimuth_deg": 0.0})})
            kind = 0 if medium in THIN else 1
            answer, finer = (looked(scene, Orders(tolerance=t), given) for t in (0.005, FINE[kind]))
            walks = looked(scene, Path(samples=WALKS[kind], seed=1), given)
            pairs.append((answer, finer, walks))
            off = np.abs(answer.radiance / finer.radiance - 1)
            _, once, _ = covered(answer, finer.radiance, 0.0)
            tell, by_walks, twice = covered(answer, walks.radiance, walks.standard_error)
            stated = 100 * float(np.median(answer.standard_error / answer.radiance))
            median, most = 100 * float(np.median(off)), 100 * float(off.max())
            rows.append([medium, f"{sun:g}", stated, median, most, share(once), tell, share(by_walks), share(twice)])
            print(*rows[-1], flush=True)
    about = (
        f"{sights().shape[0]} lines of sight from the ground, elevations of {LOW[0]:g} to {LOW[-1]:g} degrees all "
        f"around, {TOLD.size} wavelengths, tolerance 0.005. Deviations from a solution to {FINE[0]:g}, in Titan and "
        f"clouds to {FINE[1]:g}; and from {WALKS[0]} walks of `path` for each, there {WALKS[1]}, of whose own error "
        f"{WIDTH:g} are allowed for; walks whose error is larger than the stated one do not tell."
    )
    header = [
        "medium", "Sun [°]", "stated, median [%]", "off, median [%]", "largest [%]", "within [%]", "walks that tell",
        "within [%]", "twice [%]",
    ]  # fmt: skip
    return [about, table(header, rows), together(pairs)]


def together(pairs: list[tuple[Answer, Answer, Answer]]) -> str:
    """The same of all values."""
    finer = [covered(answer, judge.radiance, 0.0) for answer, judge, _ in pairs]
    walks = [covered(answer, judge.radiance, judge.standard_error) for answer, _, judge in pairs]
    mean = lambda found, k: share(sum(f[0] * f[k] for f in found if f[0]) / max(sum(f[0] for f in found), 1))  # noqa: E731
    many = sum(f[0] for f in walks)
    return (
        f"All {sum(f[0] for f in finer)} values: {mean(finer, 1)} % within what is stated of the finer solution, "
        f"{mean(finer, 2)} % within twice that; {mean(walks, 1)} and {mean(walks, 2)} % of the {many} by walks."
    )


def share(value: float) -> str:
    """In percent."""
    return "-" if np.isnan(value) else f"{100 * value:.1f}"


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--parts", default=",".join(PARTS), help="by commas")
    options.add_argument("--media", default=",".join(MEDIA), help="of the accuracy, by commas")
    options.add_argument("--threads", type=int, default=min(2, processors()))
    given = options.parse_args()
    where = machine()
    picture(scene_of("earth-hazy", 30.0), WAVELENGTHS, given)()  # kernels are loaded
    work = {"thick": thick, "bands": bands, "first": first, "accuracy": accuracy}
    for part in given.parts.split(","):
        words = [w for w in sys.argv[1:] if not w.startswith("--parts") and w not in (given.parts, "--write")]
        blocks = work[part](given)
        command = ["orders_media.py", "--parts", part, *words]
        report(f"orders-{part}", where, versions("skyscatter", "numba", "numpy"), blocks, command, given.write)


if __name__ == "__main__":
    main()
