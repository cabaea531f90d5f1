"""Points or paths: both estimators of `photons` in fogs of water droplets, and in a dense light guide, at equal time.

Zhdanov et al. (2013) report that in a room with a volume concentration of droplets of 0.01 % the path estimator has the
lower variance at equal time, that at 0.1 % the two come close, and that in a dense light guide the point estimator is
better.  The extinction that belongs to a concentration depends on the droplets' size, hence a table over sizes:
droplets of water by Mie's theory, log-normal with an effective variance of 0.05.  Their phase function is that of
Henyey and Greenstein with Mie's mean cosine unless `--phase mie` is given: half of what large droplets scatter goes
into a peak of diffraction narrower than a degree, which photons next to never find where they are gathered.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, processors, report, table, versions
from rooms import FogRoom, camera_rays, surface_room
from solving import PATH, Runs, photon_ways, render, runs, samples_for

import skyscatter
from skyscatter.media.everywhere import Everywhere
from skyscatter.optics.mie import LogNormalMode, MieAerosol
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.spectra.table import SpectralTable
from skyscatter.surfaces.lamps import AreaLamp
from skyscatter.surfaces.materials import Dielectric, Lambert
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene, Viewpoint
from skyscatter.surfaces.shapes import Box, Rectangle

WAVELENGTHS = np.array([450.0, 500.0, 550.0, 600.0, 650.0])
VARIANCE = 0.05
DOCS = Path(__file__).parents[1] / "docs"


def droplets(radius: float, concentration: float) -> MieAerosol:
    """Fog of droplets of an effective radius [m] that fill so much of the volume."""
    mode = LogNormalMode.from_effective(radius, VARIANCE)
    s2 = np.log(mode.geometric_standard_deviation) ** 2
    volume = 4.0 / 3.0 * np.pi * mode.median_radius**3 * np.exp(4.5 * s2)
    # Larger ones hold 0.2 % of the water, and would cost most of the time that Mie's series take.
    cut = mode.model_copy(update={"max_radius": 2.2 * radius})
    return MieAerosol(modes=(cut,), number_density=concentration / volume, material="water")


def spectrum(values: Any) -> SpectralTable:
    """Values at the wavelengths as a spectrum."""
    return SpectralTable(wavelengths=tuple(map(float, WAVELENGTHS)), values=tuple(map(float, values)))


@dataclass(frozen=True)
class Case:
    """A scene, its rays, and the radius [m] of the spheres in which light is gathered."""

    name: str
    scene: SurfaceScene
    rays: Any
    radius: float
    extinction: float  #: [m-1] at 550 nm


def fog_case(radius: float, concentration: float, given: Any) -> Case:
    """The room with a fog of droplets."""
    room = FogRoom()
    mie = droplets(radius, concentration)
    sigma = mie.coefficients([550.0], 1.0)
    optics: Any = mie
    if given.phase == "hg":
        extinction, albedo, g = mie.optical_properties(WAVELENGTHS)
        extinction = extinction * mie.number_density
        optics = Particles(
            extinction=spectrum(extinction), single_scattering_albedo=spectrum(albedo),
            phase=HenyeyGreenstein(g=float(g.mean())),
        )  # fmt: skip
    scene = surface_room(room, WAVELENGTHS)
    component = skyscatter.Component(name="fog", density=Everywhere(), optics=optics)
    scene = scene.model_copy(update={"media": (SurfaceMedium(name="fog", components=(component,)),)})
    name = f"fog of {radius * 1e6:g} um, {100 * concentration:g} %"
    return Case(
        name, scene, camera_rays(room, given.size), given.radius, float(sigma.scattering[0] + sigma.absorption[0])
    )


def guide_case(given: Any) -> Case:
    """A slab of acrylic with scattering grains, 100 x 60 x 5 mm, lit through one edge, seen from above."""
    grains = Particles(extinction=given.guide, single_scattering_albedo=0.9999, phase=HenyeyGreenstein(g=0.8))
    acrylic = SurfaceMedium(
        name="acrylic",
        index=1.49,
        components=(skyscatter.Component(name="grains", density=Everywhere(), optics=grains),),
    )
    slab = Body(name="guide", shape=Box(size=(0.1, 0.06, 0.005)), material=Dielectric(), inside="acrylic")
    strip = Rectangle(position=(-0.052, 0.0, 0.0), normal=(1.0, 0.0, 0.0), size=(0.06, 0.004))
    leds = Body(name="leds", shape=strip, material=Lambert(albedo=0.0), lamp=AreaLamp(power=1.0))
    viewpoint = Viewpoint(position=(0.0, -0.06, 0.12), target=(0.0, 0.0, 0.0))
    scene = SurfaceScene(media=(SurfaceMedium(name="air"), acrylic), bodies=(slab, leds), viewpoint=viewpoint)
    eye = replace(FogRoom(), eye=(0.0, -0.06, 0.12), target=(0.0, 0.0, 0.0))
    origins, directions = camera_rays(eye, given.size, 40.0)
    # Rays that meet the slab's upper face.
    t = (0.0025 - origins[:, 2]) / directions[:, 2]
    x = origins + t[:, None] * directions
    meets = (np.abs(x[:, 0]) < 0.05) & (np.abs(x[:, 1]) < 0.03) & (t > 0)
    name = f"light guide, {given.guide:g} per m"
    return Case(name, scene, (origins[meets], directions[meets]), given.guide_radius, given.guide)


def compare(case: Case, given: Any) -> tuple[list[Any], list[Runs]]:
    """A row of the table, and the runs."""
    made = []
    for way in photon_ways(radius=case.radius, photons=given.photons, **given.more):
        samples = samples_for(case.scene, case.rays, WAVELENGTHS, way, given.seconds, given.threads)
        made.append(runs(case.scene, case.rays, WAVELENGTHS, way, samples, given.repeats, given.threads))
    _, judge = render(case.scene, case.rays, WAVELENGTHS, PATH, given.judge, 2**32, given.threads)
    # In dense fog path finds next to nothing of the light, and does not know: the photons' own mean is the measure.
    mean = np.mean([one.images.mean(axis=0) for one in made], axis=0)
    bright = mean.mean(axis=1)
    kept = bright < 20 * np.median(bright)  # without the lamp itself
    truth = judge.radiance
    # Noise alone, from the spread between runs, at the time that was given to all.
    cost = [one.images[:, kept].var(axis=0, ddof=1).mean() / mean[kept].mean() ** 2 * one.seconds for one in made]
    ratios = [one.ratio(truth, judge.standard_error, kept) for one in made]
    row = [
        case.name, case.extinction, 100 / case.extinction, case.extinction * case.radius,
        *(one.samples for one in made), *cost, cost[0] / cost[1],
        *(f"{ratio:.3f} ± {error:.3f}" for ratio, error in ratios[:2]),
    ]  # fmt: skip
    print(row, flush=True)
    return row, made


def picture(cases: list[Case], every: list[list[Runs]], size: int, path: Path) -> None:
    """One run of each estimator, a row for each fog."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(cases), 3, figsize=(9.5, 3.3 * len(cases)), squeeze=False)
    for row, case, made in zip(axes, cases, every, strict=True):
        mean = np.mean([one.images.mean(axis=(0, 2)) for one in made], axis=0)
        top = 2.5 * np.median(mean)
        for ax, one in zip(row, made, strict=True):
            image = one.images[0][:, [4, 2, 0]].reshape(size, size, 3) / top
            ax.imshow(np.clip(image, 0, 1) ** (1 / 2.2), interpolation="nearest")
            ax.set_title(f"{one.way.name}, {one.seconds:.1f} s", fontsize=9)
            ax.set_xticks([])
            ax.set_yticks([])
        row[0].set_ylabel(case.name, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--size", type=int, default=48, help="pixels along a side")
    options.add_argument("--sizes", default="5,20,50,500", help="effective radii of droplets [um]")
    options.add_argument("--concentrations", default="0.01,0.1", help="share of the volume [%%]")
    options.add_argument("--radius", type=float, default=0.05, help="of the spheres in the room [m]")
    options.add_argument("--phase", choices=("hg", "mie"), default="hg", help="hg: Mie's mean cosine, without its peak")
    options.add_argument("--guide", type=float, default=500.0, help="extinction of the light guide [m-1]")
    options.add_argument("--guide-radius", type=float, default=0.002, help="of the spheres in it [m]")
    options.add_argument("--photons", type=int, default=20_000, help="in a pass")
    options.add_argument("--seconds", type=float, default=4.0, help="of each run")
    options.add_argument("--judge", type=int, default=256, help="walks of path that check the means")
    options.add_argument("--gather-direct", action="store_true", help="gather the lamps' own light too")
    options.add_argument("--threads", type=int, default=min(2, processors()))
    options.add_argument(
        "--picture", default=None, help="file for a picture of the first and last fog of the first size"
    )
    given = options.parse_args()
    given.more = {"direct": False} if given.gather_direct else {}
    where = machine()
    cases = [
        fog_case(float(size) * 1e-6, float(share) / 100, given)
        for size in given.sizes.split(",")
        for share in given.concentrations.split(",")
    ]
    cases.append(guide_case(given))
    made = [compare(case, given) for case in cases]
    header = [
        "medium", "extinction [1/m]", "mean free path [cm]", "extinction x radius", "passes: points", "paths", "both",
        "variance x time: points", "paths", "both", "points over paths", "mean over path's: points", "paths",
    ]  # fmt: skip
    ways = "all light gathered" if given.gather_direct else "light straight from the lamp by rays to it"
    blocks = [
        f"{given.size}x{given.size} pixels, {WAVELENGTHS.size} wavelengths, spheres of {100 * given.radius:g} cm in "
        f"the room and {1000 * given.guide_radius:g} mm in the guide, {given.photons} photons in a pass, "
        f"{given.seconds:g} s a run, {given.repeats} runs, {given.threads} threads; {ways}; "
        f"phase function: {given.phase}.",
        table(header, [row for row, _ in made]),
        "Variance x time: variance between runs over the squared mean light, averaged over pixels (the lamp left out) "
        "and wavelengths, times seconds. The spheres are the same for both, so is their bias.",
    ]
    if given.picture:
        chosen = [0, given.concentrations.count(",")]
        picture([cases[k] for k in chosen], [made[k][1] for k in chosen], given.size, Path(given.picture))
    packages = versions("skyscatter", "numba", "numpy")
    report("fog-estimators", where, packages, blocks, ["fog_estimators.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
