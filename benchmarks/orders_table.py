"""The deterministic solver `orders` beside the Monte Carlo solver `path`: the table of docs/validation-orders.md.

Atmospheres from pure air to desert dust and Mars, the Sun from 60 degrees above to 12 below the horizon, observers from
the ground to an orbit, directions over the sky and the planet's disk and limb.  Walks are kept in a folder (--cache),
so that a new `orders` is compared without walking again; a larger --budget adds walks to those that are there.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from common import machine, parser, replace_section, seconds, show, table, versions
from numpy.typing import NDArray

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.media.fields import Exponential
from skyscatter.optics.mie import LogNormalMode, MieAerosol

Array = NDArray[np.float64]

PAGE = Path(__file__).parent.parent / "docs" / "validation-orders.md"
WAVELENGTHS = (380.0, 550.0, 780.0)  #: of both solvers: irradiance is averaged over the bins between them [nm]
ELEVATIONS = (60.0, 10.0, 0.0, -3.0, -6.0, -12.0)
ALTITUDES = (0.0, 10e3, 100e3, 400e3)
DAY_BAR, TWILIGHT_BAR = 0.005, 0.01  #: relative deviations that are allowed with the Sun up and down
SIGMAS = 3.0  #: a deviation of fewer standard errors of the reference is none
#: Values of which the reference knows no more than this relative standard error are not judged.
WORST_NOISE = 0.1
#: Radiances that count as none [W m-2 sr-1 nm-1]: a tenth or less of what the darkest night sky gives off by itself.
FAINTEST = 1e-10
#: Relative standard error after which walking on would judge nothing better.
ENOUGH = 3e-4
FIRST_ORDER = 1e-6  #: tolerance of the reference's first order
SUN_AZIMUTH = 180.0
#: From the Sun, by azimuth: in front, beside, behind; a little off the vertical circle of the Sun, away from its disk.
IN_FRONT, BESIDE, BEHIND = 12.0, 90.0, 172.0


class Case(NamedTuple):
    """One sky."""

    atmosphere: str
    elevation: float
    altitude: float
    scene: skyscatter.Scene
    azimuths: Array  #: of the lines of sight, from the Sun's [degree]
    elevations: Array  #: above the horizontal [degree]

    @property
    def directions(self) -> Array:
        """Unit vectors, shape (ray, 3)."""
        made = direction_from_azimuth_elevation(SUN_AZIMUTH + self.azimuths, self.elevations)
        return np.asarray(made)


def dust() -> skyscatter.Component:
    """Desert dust: mineral accumulation mode of OPAC (Hess et al. 1998, Bull. Am. Met. Soc. 79, 831), recalled."""
    index = skyscatter.SpectralTable(
        wavelengths=(350, 400, 450, 500, 550, 800), values=(0.017, 0.013, 0.0085, 0.0078, 0.0055, 0.004)
    )
    optics = MieAerosol(
        optical_depth=0.5, wavelength=550.0, refractive_index_real=1.53, refractive_index_imag=index,
        modes=(LogNormalMode(median_radius=0.39e-6, geometric_standard_deviation=2.0, max_radius=5e-6),),
    )  # fmt: skip
    return skyscatter.Component(name="dust", density=Exponential(scale_height=2e3, top=30e3), optics=optics)


def models() -> dict[str, skyscatter.Model]:
    """The atmospheres by name."""
    earth = skyscatter.load_model("earth")
    air, ozone = earth.medium.component("air"), earth.medium.component("ozone")
    return {
        "air": earth.model_copy(update={"components": (air,)}),
        "hazy": skyscatter.load_model("earth-hazy"),
        "dusty": earth.model_copy(update={"components": (air, ozone, dust())}),
        "mars": skyscatter.load_model("mars"),
    }


def lines_of_sight(altitude: float, radius: float, top: float) -> tuple[Array, Array]:
    """Azimuths from the Sun and elevations [degree]: a dozen, or more where there are sky, limb and disk to see."""
    around = (IN_FRONT, BESIDE, BEHIND)
    if altitude < 0.5 * top:
        chosen = [(BESIDE, 90.0)] + [(a, e) for e in (60.0, 30.0, 10.0, 2.0) for a in around]
        if altitude > 0:
            dip = np.degrees(np.arccos(radius / (radius + altitude)))
            chosen += [(a, -0.5 * dip) for a in around] + [(IN_FRONT, -dip - 3), (BEHIND, -45.0)]
    else:
        heights = np.array([0.05, 0.15, 0.4]) * min(top, 100e3)  # of the tangent points
        limb = -np.degrees(np.arccos((radius + heights) / (radius + altitude)))
        dip = np.degrees(np.arccos(radius / (radius + altitude)))
        chosen = [(a, e) for e in limb for a in around]
        chosen += [(a, -e) for e in (dip + 1, dip + 15, 60.0) for a in (IN_FRONT, BEHIND)] + [(BESIDE, -89.0)]
    azimuths, elevations = np.array(chosen).T
    return azimuths, elevations


def cases(names: list[str], suns: list[float], altitudes: list[float]) -> Iterator[Case]:
    """All skies that were asked for."""
    for name, model in models().items():
        for elevation in suns if name in names else []:
            for altitude in altitudes:
                scene = model.scene(sun_elevation_deg=elevation, sun_azimuth_deg=SUN_AZIMUTH, altitude=altitude)
                rays = lines_of_sight(altitude, model.planet.radius, model.top)
                yield Case(name, elevation, altitude, scene, *rays)


@dataclass
class Walks:
    """Means of passes of walks with different seeds."""

    means: Array  #: (pass, ray, wavelength)
    errors: Array  #: the same, of each pass
    walks: NDArray[np.int64]  #: (pass,)
    seconds: float

    @property
    def mean(self) -> Array:
        """Over all passes, weighted by their walks."""
        return np.average(self.means, axis=0, weights=self.walks)

    @property
    def error(self) -> Array:
        """Standard error of `mean`: from within the passes or from their spread, whichever is larger.

        Deep in twilight few walks bring most of the light: the error within a pass is then too small as a rule, and the
        spread of the passes shows it.
        """
        share = self.walks / self.walks.sum()
        within = np.sqrt(np.einsum("p,prw->rw", share**2, self.errors**2))
        count = len(self.walks)
        if count < 4:
            return within
        spread = np.einsum("p,prw->rw", share, (self.means - self.mean) ** 2) / (count - 1)
        return np.maximum(within, np.sqrt(spread))


def key(case: Case) -> str:
    """Name of the file that keeps a case's walks."""
    content = [case.scene.model_dump(mode="json"), case.directions.round(12).tolist(), WAVELENGTHS, FIRST_ORDER]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:20]


def reference(case: Case, folder: Path, budget: float, threads: int | None) -> Walks:
    """Walks of a case: those that are kept, and more until the budget [s] is spent or the noise is low."""
    path = folder / f"{key(case)}.npz"
    shape = (0, len(case.azimuths), len(WAVELENGTHS))
    kept = Walks(np.zeros(shape), np.zeros(shape), np.zeros(0, np.int64), 0.0)
    if path.is_file():
        with np.load(path) as file:
            kept = Walks(file["means"], file["errors"], file["walks"], float(file["seconds"]))
    samples = 512
    while kept.seconds < budget:
        if len(kept.walks) >= 4:
            samples = 2048
            if np.all((kept.error < ENOUGH * kept.mean) | (kept.mean < FAINTEST)):
                break
        seed = 1 + len(kept.walks)
        time, answer = seconds(
            partial(
                skyscatter.radiance,
                case.scene,
                case.scene.observer.position,
                case.directions,
                WAVELENGTHS,
                solver=skyscatter.Path(samples=samples, seed=seed << 32, tolerance=FIRST_ORDER),
                threads=threads,
            )
        )
        kept = Walks(
            np.concatenate([kept.means, answer.radiance[None]]),
            np.concatenate([kept.errors, answer.standard_error[None]]),
            np.append(kept.walks, samples), kept.seconds + time,
        )  # fmt: skip
        np.savez(path, means=kept.means, errors=kept.errors, walks=kept.walks, seconds=kept.seconds)
    return kept


class Verdict(NamedTuple):
    """What a case came to; deviations are relative, of `orders` from `path`."""

    deviation: Array  #: (ray, wavelength)
    noise: Array  #: standard error of the reference, relative
    claimed: Array  #: error that `orders` states, relative
    judged: NDArray[np.bool_]
    outside: NDArray[np.bool_]
    understated: NDArray[np.bool_]  #: off by more than the stated error and the reference's noise together

    @property
    def mean(self) -> tuple[float, float]:
        """Mean of the judged deviations and its standard error.

        Not weighted by the noise: walks that missed the rare bright paths have both a low mean and a low noise.
        """
        mine = self.judged
        return float(self.deviation[mine].mean()), float(np.sqrt(np.sum(self.noise[mine] ** 2)) / mine.sum())


def judge(case: Case, walks: Walks, answer: Any) -> Verdict:
    """Compare an answer of `orders` with the walks."""
    bar = DAY_BAR if case.elevation >= 0 else TWILIGHT_BAR
    mean = np.maximum(walks.mean, FAINTEST)
    deviation, noise, claimed = answer.radiance / mean - 1, walks.error / mean, answer.standard_error / mean
    judged = (noise < WORST_NOISE) & (walks.mean > FAINTEST)
    outside = judged & (np.abs(deviation) > np.maximum(bar, SIGMAS * noise))
    understated = judged & (np.abs(deviation) > claimed + SIGMAS * noise)
    return Verdict(deviation, noise, claimed, judged, outside, understated)


def row(case: Case, v: Verdict) -> list[Any]:
    """One line of the long table."""
    off, sigma = 100 * np.abs(v.deviation[v.judged]), np.abs(v.deviation / np.maximum(v.noise, 1e-12))[v.judged]
    start = [case.atmosphere, f"{case.elevation:g}", f"{case.altitude / 1e3:g}", int(v.judged.sum())]
    if not off.size:
        return [*start, *["-"] * 10]
    mean, error = v.mean
    stated = 100 * v.claimed[v.judged]
    return [
        *start, f"{100 * np.median(v.noise[v.judged]):.2f}", f"{np.median(off):.2f}", f"{off.max():.2f}",
        f"{np.median(sigma):.1f}", f"{sigma.max():.1f}", int(v.outside.sum()), f"{100 * mean:+.2f} ± {100 * error:.2f}",
        f"{np.median(stated):.2f}", f"{stated.max():.2f}", int(v.understated.sum()),
    ]  # fmt: skip


HEADER = [
    "atmosphere", "Sun [°]", "observer [km]", "values", "noise [%]", "median [%]", "largest [%]", "median [σ]",
    "largest [σ]", "outside", "mean [%]", "stated, median [%]", "stated, largest [%]", "understated",
]  # fmt: skip


def details(case: Case, walks: Walks, v: Verdict) -> list[str]:
    """The values that are outside, one a line."""
    lines = []
    for r, w in zip(*np.nonzero(v.outside), strict=True):
        lines.append(
            f"{case.atmosphere} Sun {case.elevation:g} at {case.altitude / 1e3:g} km, azimuth {case.azimuths[r]:g}, "
            f"elevation {case.elevations[r]:.2f}, {WAVELENGTHS[w]:g} nm: {100 * v.deviation[r, w]:+.2f} % "
            f"± {100 * v.noise[r, w]:.2f}, stated {100 * v.claimed[r, w]:.2f} %; radiance {walks.mean[r, w]:.3g}"
        )
    return lines


def summary(found: list[tuple[Case, Walks, Verdict]]) -> str:
    """The table by atmosphere and Sun, over all observers."""
    rows: list[list[Any]] = []
    for name in dict.fromkeys(case.atmosphere for case, _, _ in found):
        for elevation in dict.fromkeys(case.elevation for case, _, _ in found):
            mine = [(c, v) for c, _, v in found if (c.atmosphere, c.elevation) == (name, elevation)]
            if mine:
                joined = Verdict(*(np.concatenate([v[k] for _, v in mine]) for k in range(len(Verdict._fields))))
                line = row(mine[0][0], joined)
                rows.append([*line[:2], *line[3:]])
    return table([*HEADER[:2], *HEADER[3:]], rows)


def text(found: list[tuple[Case, Walks, Verdict]], given: Any) -> list[str]:
    """All blocks of the page's section."""
    all_walks = np.array([walks.walks.sum() for _, walks, _ in found])
    outside, understated, judged = (
        sum(int(getattr(v, name).sum()) for _, _, v in found) for name in ("outside", "understated", "judged")
    )
    total = sum(v.judged.size for _, _, v in found)
    about = (
        f"{len(found)} skies, {total} values (directions times {', '.join(f'{w:g}' for w in WAVELENGTHS)} nm), "
        f"{judged} of which are brighter than {FAINTEST:g} W m⁻² sr⁻¹ nm⁻¹ and known to {100 * WORST_NOISE:g} % or "
        f"better by the reference: these are judged. Walks of `path` per ray: {show(int(all_walks.min()))} to "
        f"{show(int(all_walks.max()))}, {sum(walks.seconds for _, walks, _ in found) / 60:.0f} minutes in all. "
        f"`orders` with tolerance {given.tolerance:g}. **Outside**, that is off by more than {100 * DAY_BAR:g} % (Sun "
        f"at or above the horizon) or {100 * TWILIGHT_BAR:g} % (below) and by more than {SIGMAS:g} standard errors: "
        f"**{outside}**. Off by more than the stated error and {SIGMAS:g} standard errors together: **{understated}**."
    )
    meaning = (
        "Noise: median standard error of the reference. Median and largest: of the deviations' sizes, relative and in "
        "standard errors of the reference. Mean: signed, with its standard error. Stated: "
        "the error that `orders` gives. Understated: off by more than that and three standard errors."
    )
    return [about, meaning, summary(found), "By observer:", table(HEADER, [row(c, v) for c, _, v in found])]


def numbers(words: str) -> list[float]:
    """Numbers given by commas."""
    return [float(word) for word in words.split(",")]


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--budget", type=float, default=10.0, help="seconds of walks for each sky, kept ones included")
    options.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "skyscatter-walks")
    options.add_argument("--tolerance", type=float, default=0.005, help="of orders")
    options.add_argument("--atmospheres", default="air,hazy,dusty,mars", help="by commas")
    suns = ",".join(f"{e:g}" for e in ELEVATIONS)
    options.add_argument("--suns", default=suns, help="elevations [degree], with an equals sign: --suns=-3,-6")
    options.add_argument("--altitudes", default=",".join(f"{a:g}" for a in ALTITUDES), help="of observers [m]")
    options.add_argument("--details", action="store_true", help="also print every value that is outside")
    options.add_argument("--threads", type=int)
    given = options.parse_args()
    where = machine()
    given.cache.mkdir(parents=True, exist_ok=True)
    found, lines = [], []
    first = next(cases(["air"], [60.0], [0.0]))  # so that compilation is not taken for walking
    skyscatter.radiance(
        first.scene, first.scene.observer.position, first.directions, WAVELENGTHS, solver=skyscatter.Path(samples=2)
    )
    for case in cases(given.atmospheres.split(","), numbers(given.suns), numbers(given.altitudes)):
        walks = reference(case, given.cache, given.budget, given.threads)
        time, answer = seconds(
            partial(
                skyscatter.radiance,
                case.scene,
                case.scene.observer.position,
                case.directions,
                WAVELENGTHS,
                solver=skyscatter.Orders(tolerance=given.tolerance),
                threads=given.threads,
            )
        )
        verdict = judge(case, walks, answer)
        found.append((case, walks, verdict))
        lines += details(case, walks, verdict)
        print(" | ".join(show(cell) for cell in row(case, verdict)), f"| {time:.1f} s", file=sys.stderr, flush=True)
    packages = versions("skyscatter", "numba", "numpy")
    chosen = {name: getattr(given, name) for name in ("budget", "tolerance", "atmospheres", "suns", "altitudes")}
    asked = [f" --{name}={value}" for name, value in chosen.items() if value != options.get_default(name)]
    command = "python benchmarks/orders_table.py" + "".join(asked)
    body = "\n\n".join([f"`{command}`; {packages}; {where.split(',')[0]}.", *text(found, given)])
    print(body)
    if given.details:
        print("\n".join(["", *lines]))
    if given.write:
        replace_section(PAGE, "table", body)


if __name__ == "__main__":
    main()
