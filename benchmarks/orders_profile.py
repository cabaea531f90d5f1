"""Where the time of the solver `orders` goes: six media by six positions of the Sun.

For each a panorama from the ground: seconds of the clock for the tables of the medium, for the coarse solution, for the
fine one and for the picture's rays, by the words that the solver logs when it goes on; and how many orders of
scattering it took.
"""

from __future__ import annotations

import logging
import statistics
import sys
import time
from typing import Any

from common import WAVELENGTHS, machine, parser, processors, report, table, versions

import skyscatter
from skyscatter import Component, Medium, Scene
from skyscatter.errors import DomainError
from skyscatter.media.fields import Uniform
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein

MEDIA = ("earth", "earth-hazy", "earth-maritime", "mars", "titan", "cloud")
ELEVATIONS = (60.0, 25.0, 10.0, 0.0, -6.0, -12.0)
SIZE = (512, 256)
#: A layer of cloud in the air of the model earth: optical depth, asymmetry, altitudes [m].
CLOUD = 30.0, 0.86, 500.0, 1500.0
#: What the solver says when it begins with a part of its work.
PARTS = {
    "tables": "tables [s]",
    "orders of scattering, coarser, for the error": "coarse [s]",
    "orders of scattering": "fine [s]",
    "rays": "rays [s]",
}


class Clock(logging.Handler):
    """When each part of the work began."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.begun: list[tuple[str, float]] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Note the words and the time."""
        if record.getMessage() in PARTS:
            self.begun.append((record.getMessage(), time.perf_counter()))

    def spent(self, end: float) -> dict[str, float]:
        """Seconds by part."""
        ends = [begin for _, begin in self.begun[1:]] + [end]
        return {words: until - begin for (words, begin), until in zip(self.begun, ends, strict=True)}


def scene_of(medium: str, elevation: float, depth: float = CLOUD[0]) -> Scene:
    """A shipped model, or the Earth's air with a layer of cloud of an optical depth, seen from the ground."""
    if medium != "cloud":
        return skyscatter.load_model(medium).scene(sun_elevation_deg=elevation)
    scene = skyscatter.load_model("earth").scene(sun_elevation_deg=elevation)
    _, g, base, top = CLOUD
    optics = Particles(optical_depth=depth, single_scattering_albedo=1.0, phase=HenyeyGreenstein(g=g))
    cloud = Component(name="cloud", density=Uniform(base=base, top=top), optics=optics)
    air = scene.medium
    return scene.model_copy(
        update={"medium": Medium(planet_radius=air.planet_radius, components=(*air.components, cloud))}
    )


def picture(scene: Scene, threads: int, tolerance: float | None) -> dict[str, float]:
    """Seconds of one panorama, whole and by part."""
    clock, log = Clock(), logging.getLogger("skyscatter")
    level = log.level
    log.addHandler(clock)
    log.setLevel(logging.INFO)
    start = time.perf_counter()
    try:
        skyscatter.render(
            scene,
            skyscatter.Panorama(width=SIZE[0], height=SIZE[1]),
            WAVELENGTHS,
            solver=skyscatter.Orders(tolerance=tolerance),
            threads=threads,
            progress=lambda _: None,
        )
    finally:
        log.removeHandler(clock)
        log.setLevel(level)
    end = time.perf_counter()
    return {"whole": end - start, **clock.spent(end)}


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--media", default=",".join(MEDIA), help="by commas")
    options.add_argument("--suns", default=",".join(f"{e:g}" for e in ELEVATIONS), help="elevations, by commas")
    options.add_argument("--tolerance", type=float)
    options.add_argument("--threads", type=int, default=min(2, processors()))
    given = options.parse_args()
    where = machine()
    rows: list[list[Any]] = []
    picture(scene_of("earth-hazy", 30.0), given.threads, given.tolerance)  # kernels are loaded
    for medium in given.media.split(","):
        for elevation in (float(e) for e in given.suns.split(",")):
            scene = scene_of(medium, elevation)
            try:
                runs = [picture(scene, given.threads, given.tolerance) for _ in range(given.repeats)]
            except DomainError as refusal:
                rows.append([medium, f"{elevation:g}", f"refused: {refusal.allowed}", *["-"] * len(PARTS)])
            else:
                middle = {key: statistics.median(run.get(key, 0.0) for run in runs) for key in ("whole", *PARTS)}
                rows.append([medium, f"{elevation:g}", *middle.values()])
            print(*rows[-1], flush=True)
    about = (
        f"Panorama {SIZE[0]}x{SIZE[1]} from the ground, {WAVELENGTHS.size} wavelengths 380 to 780 nm, tolerance "
        f"{given.tolerance or 0.005:g}, {given.threads} threads, `skyscatter.render`; median of {given.repeats}. "
        f"Cloud: model earth with a layer of optical depth {CLOUD[0]:g} and asymmetry {CLOUD[1]:g}, white. The "
        "last part has the picture's last steps as well."
    )
    header = ["medium", "Sun [°]", "picture [s]", *PARTS.values()]
    words = [w for w in sys.argv[1:] if w != "--write"]
    report(
        "orders-profile", where, versions("skyscatter", "numba", "numpy"), [about, table(header, rows)],
        ["orders_profile.py", *words], given.write,
    )  # fmt: skip


if __name__ == "__main__":
    main()
