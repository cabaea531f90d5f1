"""What the deterministic solver `orders` costs, and how far off it is.

Parts, each with its section in RESULTS.md: `panorama` (pictures of the model `earth`, and the next position of the Sun
from a solved field), `walks` (time to equal error beside `path`), `sasktran` (upward rays in a Rayleigh sphere beside
sasktran2), `memory` (of a fresh process), `curves` (cost over wavelengths, haze, tolerance and size of the picture, and
a drawing of them in docs/).  sasktran2 is needed for its part alone.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from common import WAVELENGTHS, machine, parser, processors, report, rms, seconds, show, table, versions
from walks import size

import skyscatter
from skyscatter import Component, Medium
from skyscatter.media.fields import Exponential
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.solvers.options import record_of

ELEVATIONS = (60.0, 10.0, 0.0, -6.0)
PARTS = ("panorama", "walks", "sasktran", "memory", "curves")
EIGHT = np.linspace(380.0, 780.0, 8)  #: those of the curve over the tolerance [nm]
FEW = np.array([380.0, 500.0, 640.0, 780.0])  #: wavelengths at which errors are looked at [nm]
DEPTHS, PEAKS = (0.03, 0.1, 0.3, 1.0, 3.0), (0.0, 0.5, 0.7, 0.85, 0.95)  #: of a haze in the curves
FINE = 0.001  #: tolerance of the solution that judges
STEP = 0.5  #: to the next position of the Sun [degree]
NEAR_SUN = np.cos(np.radians(1.0))  #: rays closer to the Sun are not compared: its disk has no error
DRAWING = Path(__file__).parent.parent / "docs" / "orders-cost.png"
#: Elevations of the Sun for which the field of the next position is solved, around the first [degree].
AROUND = 1.0


def scene_at(elevation: float) -> skyscatter.Scene:
    """Model earth, seen from the ground."""
    return skyscatter.load_model("earth").scene(sun_elevation_deg=elevation)


def camera(picture: tuple[int, int]) -> skyscatter.Panorama:
    """The whole sphere."""
    return skyscatter.Panorama(width=picture[0], height=picture[1])


def sample_rays(scene: skyscatter.Scene, picture: tuple[int, int] = (24, 48)) -> Any:
    """Directions of the sky's half of a small panorama, away from the Sun's disk; shape (ray, 3)."""
    rays = camera(picture).directions(scene.observer).reshape(-1, 3)
    return rays[(rays[:, 2] > 0) & (rays @ scene.sun.direction < NEAR_SUN)]


def errors(scene: skyscatter.Scene, threads: int) -> tuple[list[float], float]:
    """Root mean square, median and largest deviation from a finer solution, and the median of the stated error [%]."""
    rays = sample_rays(scene)
    fine, mine = (
        skyscatter.radiance(
            scene, scene.observer.position, rays, FEW, solver=skyscatter.Orders(tolerance=t), threads=threads
        )
        for t in (FINE, None)
    )
    off = np.abs(mine.radiance / fine.radiance - 1)
    stated = 100 * float(np.median(mine.standard_error / mine.radiance))
    return [100 * rms(off), 100 * float(np.median(off)), 100 * float(off.max())], stated


def cost(function: Callable[[], Any], given: Any) -> tuple[float, float, Any]:
    """Median seconds of several calls, of the clock and of each thread's processor, and what the last one returned.

    The second tells what an idle machine would take when this one is busy.
    """
    clocks, spent, answer = [], [], None
    for _ in range(given.repeats):
        before = time.process_time()
        clock, answer = seconds(function)
        clocks.append(clock)
        spent.append((time.process_time() - before) / given.threads)
    return statistics.median(clocks), statistics.median(spent), answer


def both(found: tuple[float, float, Any]) -> str:
    """Seconds of the clock, and of the processors in brackets."""
    return f"{show(found[0])} ({show(found[1])})"


def panorama(given: Any) -> list[str]:
    """First picture, next position of the Sun, and the error of both."""
    rows: list[list[Any]] = []
    picture = size(given.size)
    skyscatter.render(scene_at(30.0), camera((16, 8)), WAVELENGTHS, threads=given.threads)
    for elevation in ELEVATIONS:
        scene = scene_at(elevation)
        first = cost(partial(skyscatter.render, scene, camera(picture), WAVELENGTHS, threads=given.threads), given)
        suns = (elevation - AROUND, elevation + AROUND)
        field = skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=suns, threads=given.threads)
        following = cost(following_sun(field, picture, elevation - STEP, given.threads), given)
        off, stated = errors(scene, given.threads)
        rows.append([f"{elevation:g}", both(first), both(following), *off, stated])
    whole = cost(partial(skyscatter.solve, scene_at(0.0), WAVELENGTHS, threads=given.threads), given)
    moves = cost(following_sun(whole[2], picture, 20.0, given.threads), given)
    header = [
        "Sun [°]", "first picture [s]", "next Sun, field solved [s]", "error, rms [%]", "median [%]", "largest [%]",
        "stated, median [%]",
    ]  # fmt: skip
    about = (
        f"Model earth from the ground, panorama {given.size}, {WAVELENGTHS.size} wavelengths 380 to 780 nm, tolerance "
        f"0.005, {given.threads} threads. First picture: field and picture. Next Sun: `field.radiance` for all pixels "
        f"with the Sun {STEP:g} degrees lower, the field solved for {AROUND:g} degree either side. Seconds of the "
        "clock, in brackets of the processor in each thread: what an idle machine takes at best. Errors against a "
        f"tolerance of {FINE:g} at {FEW.size} wavelengths, in the sky, more than a degree from the Sun."
    )
    return [
        about, table(header, rows),
        f"A field for all elevations of the Sun: {both(whole)} s once, then {both(moves)} s for a picture.",
    ]  # fmt: skip


def following_sun(field: skyscatter.RadianceField, picture: tuple[int, int], elevation: float, threads: int) -> Any:
    """A call for a picture's rays with the Sun elsewhere."""
    observer = field.scene.observer
    view = camera(picture).directions(observer)
    return partial(field.radiance, observer.position, view, sun_elevation_deg=elevation, threads=threads)


def walks(given: Any) -> list[str]:
    """Time to equal error beside `path`."""
    rows: list[list[Any]] = []
    for elevation in ELEVATIONS:
        scene = scene_at(elevation)
        observer = scene.observer.position
        full = camera(size(given.size)).directions(scene.observer)
        full = full[full[..., 2] > 0]
        ours = cost(partial(skyscatter.radiance, scene, observer, full, WAVELENGTHS, threads=given.threads), given)
        off = errors(scene, given.threads)[0][0]
        rays = sample_rays(scene, (64, 32))
        samples = given.samples if elevation >= 0 else 4 * given.samples
        theirs = cost(
            partial(
                skyscatter.radiance,
                scene,
                observer,
                rays,
                WAVELENGTHS,
                solver=skyscatter.Path(samples=samples),
                threads=given.threads,
            ),
            given,
        )
        noise = 100 * rms(theirs[2].standard_error / theirs[2].radiance)
        scaled = [value * len(full) / len(rays) for value in theirs[:2]]
        equal = [value * (noise / off) ** 2 for value in scaled]
        rows.append([
            f"{elevation:g}", both(ours), off, samples, f"{show(scaled[0])} ({show(scaled[1])})", noise,
            f"{show(equal[0])} ({show(equal[1])})", f"{show(equal[1] / ours[1])}",
        ])  # fmt: skip
    header = [
        "Sun [°]", "orders [s]", "its error [%]", "walks of path", "path [s]", "its noise [%]",
        "path to the error of orders [s]", "times (processor)",
    ]  # fmt: skip
    about = (
        f"The sky's half of a {given.size} panorama of model earth, {WAVELENGTHS.size} wavelengths, {given.threads} "
        "threads; path measured on a 64x32 panorama and scaled by the number of rays, then by the square of the "
        "errors. Seconds of the clock, in brackets of the processor in each thread. Error: root mean square against "
        f"orders with tolerance {FINE:g} at {FEW.size} wavelengths; noise: path's own standard error, root mean "
        "square, which says too little at -6 degrees."
    )
    return [about, table(header, rows)]


#: Optical depth of the haze and zenith angle of the Sun [degree] of the spheres beside sasktran2.
SPHERES = ((0.0, 60.0), (0.3, 60.0), (0.3, 85.0), (0.3, 90.0))
#: Error to which both are timed [%], or to the noise of the judge where that is more.
EQUAL = 0.2
#: Moments of a phase function that hold its peak, and what cuts it.
PEAKED = {"num_singlescatter_moments": 64}
#: Name, distance of the nodes [m], source of multiple scattering, and settings of sasktran2: in air alone and in haze.
IN_AIR: tuple[tuple[str, float, str, dict[str, Any]], ...] = (
    ("discrete ordinates, 1 km", 1000.0, "DiscreteOrdinates", {}),
    ("discrete ordinates, 500 m", 500.0, "DiscreteOrdinates", {}),
    ("discrete ordinates, 500 m, 5 Sun angles", 500.0, "DiscreteOrdinates", {"num_sza": 5}),
    ("successive orders, 1 km", 1000.0, "SuccessiveOrders", {}),
    ("successive orders, 500 m", 500.0, "SuccessiveOrders", {}),
    ("successive orders, 1 km, 5 Sun angles", 1000.0, "SuccessiveOrders", {"num_sza": 5}),
)
IN_HAZE: tuple[tuple[str, float, str, dict[str, Any]], ...] = (
    ("discrete ordinates, 1 km, delta-M", 1000.0, "DiscreteOrdinates", {**PEAKED, "delta_m_scaling": True}),
    ("discrete ordinates, 250 m, delta-M", 250.0, "DiscreteOrdinates", {**PEAKED, "delta_m_scaling": True}),
    ("discrete ordinates, 250 m, 40 streams", 250.0, "DiscreteOrdinates", {**PEAKED, "num_streams": 40}),
    ("successive orders, 1 km", 1000.0, "SuccessiveOrders", PEAKED),
    ("successive orders, 250 m", 250.0, "SuccessiveOrders", PEAKED),
    ("successive orders, 500 m, 302 directions", 500.0, "SuccessiveOrders", {
        **PEAKED, "num_successive_orders_incoming": 302, "num_successive_orders_outgoing": 302,
    }),
)  # fmt: skip
#: Under a low Sun it has to be told so, and takes five times as long.
LOW_SUN = {**PEAKED, "num_sza": 5}
AT_LOW_SUN: tuple[tuple[str, float, str, dict[str, Any]], ...] = (
    ("discrete ordinates, 1 km, delta-M", 1000.0, "DiscreteOrdinates", {**LOW_SUN, "delta_m_scaling": True}),
    ("discrete ordinates, 250 m, delta-M", 250.0, "DiscreteOrdinates", {**LOW_SUN, "delta_m_scaling": True}),
    ("successive orders, 1 km", 1000.0, "SuccessiveOrders", LOW_SUN),
    ("successive orders, 1 km, 302 directions", 1000.0, "SuccessiveOrders", {
        **LOW_SUN, "num_successive_orders_incoming": 302, "num_successive_orders_outgoing": 302,
    }),
)  # fmt: skip


def sasktran(given: Any) -> list[str]:
    """Upward rays in spheres of air and of haze beside sasktran2, each against one long run of `path`."""
    blocks = [
        f"100 rays x {WAVELENGTHS.size} wavelengths, air of optical depth 0.093 at 550 nm whose density is linear "
        "between nodes 1 km apart (for all, whatever their own nodes), albedo 0.3, scalar, "
        f"{given.threads} threads. Haze: white, asymmetry 0.7 by Henyey and Greenstein, scale height 2 km. Errors are "
        f"root mean squares relative to `path`, {given.reference} walks per ray, whose noise is taken off in "
        "quadrature; they are judged down to a third of it. Under a low Sun sasktran2 has 5 Sun angles."
    ]
    for haze, sun in SPHERES:
        blocks += _sphere(given, haze, sun)
    return blocks


def _sphere(given: Any, haze: float, sun: float) -> list[str]:
    """One of them."""
    import sasktran_rays as sphere

    nodes = np.arange(0.0, sphere.TOP + 1.0, 1000.0)
    zenith = np.repeat(np.linspace(2.0, 85.0, 10), 10)
    cosine, azimuth = np.cos(np.radians(zenith)), np.tile(np.linspace(0.0, np.pi, 10), 10)
    across = np.sqrt(1 - cosine**2)
    directions = np.stack([across * np.sin(azimuth), across * np.cos(azimuth), cosine], axis=-1)
    scene = sphere.our_scene(nodes, sun, haze)
    observer = scene.observer.position

    def ours(solver: str, **more: Any) -> Any:
        return skyscatter.radiance(
            scene, observer, directions, WAVELENGTHS, threads=given.threads, solver=record_of(solver, **more)
        )

    ours("orders"), ours("path", samples=16)  # kernels are loaded
    long, judge = seconds(lambda: ours("path", samples=given.reference, seed=2**32, tolerance=1e-7))
    noise = rms(judge.standard_error / judge.radiance)

    def line(name: str, run: Any) -> list[Any]:
        found = cost(run, given)
        ratio = found[2] / judge.radiance - 1
        error = np.sqrt(max(rms(ratio) ** 2 - noise**2, 0.0))
        by_zenith = ratio.reshape(10, -1).mean(axis=1)
        means = [ratio.mean(), *(by_zenith[k] for k in (0, 6, 9))]
        return [name, found[0], found[1], 100 * float(error), *(f"{100 * mean:+.3f}" for mean in means)]

    mine = [
        line(f"skyscatter orders, tolerance {t:g}", lambda t=t: ours("orders", tolerance=t).radiance)
        for t in (0.02, 0.005, 0.002, 0.001, *((0.0003,) if haze == 0 else ()))
    ]
    walked = line("skyscatter path, 1024 walks", lambda: ours("path", samples=1024).radiance)
    theirs = []
    for name, step, source, settings in IN_AIR if haze == 0 else IN_HAZE if sun < 80 else AT_LOW_SUN:
        fine = np.arange(0.0, sphere.TOP + 1.0, step)
        density = np.interp(fine, nodes, np.exp(-nodes / sphere.SCALE_HEIGHT))
        run = partial(sphere.peer, fine, cosine, azimuth, float(np.cos(np.radians(sun))), given.threads, settings)
        theirs.append(line(f"sasktran2, {name}", partial(run, source, density, haze)))
    title = f"**{f'Haze of depth {haze:g}' if haze else 'Air alone'}, Sun at a zenith angle of {sun:g} degrees.**"
    header = [
        "solver",
        "seconds",
        "of the processor, by thread",
        "error, rms [%]",
        "mean [%]",
        "zenith angle 2° [%]",
        "57° [%]",
        "85° [%]",
    ]
    judged = f"{title} Judge: {long:.0f} s, noise {100 * noise:.3f} %."
    return [judged, table(header, [*mine, walked, *theirs]), _verdict(mine, theirs, max(EQUAL, 100 * float(noise)))]


def _verdict(mine: list[list[Any]], theirs: list[list[Any]], limit: float) -> str:
    """The quickest of each that are as exact as a limit [%], or the most exact where none is."""

    def best(rows: list[list[Any]]) -> list[Any]:
        exact = [row for row in rows if row[3] <= limit]
        return min(exact, key=lambda row: row[1]) if exact else min(rows, key=lambda row: row[3])

    ours, other = best(mine), best(theirs)
    reached = f"to {limit:.2g} %" if other[3] <= limit else f"which does not reach {limit:.2g} % but {other[3]:.2g} %"
    return (
        f"{ours[0]} ({ours[3]:.2g} %) takes {show(ours[1])} s; {other[0]}, {reached}, {show(other[1])} s: "
        f"{other[1] / ours[1]:.3g} times as long."
    )


#: What a fresh process does before its peak memory is read.
CHILD = """
import resource, skyscatter, numpy as np
scene = skyscatter.load_model("earth").scene(sun_elevation_deg={elevation})
wl = np.linspace(380, 780, {wavelengths})
{work}
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
RENDER = "skyscatter.render(scene, skyscatter.Panorama(width={0}, height={1}), wl, skyscatter.{2})"


def memory(given: Any) -> list[str]:
    """Peak memory of fresh processes."""
    width, height = size(given.size)
    works = [
        ("kernels loaded, one ray", 32, RENDER.format(1, 2, "Single()")),
        (f"path, {given.size}, 2 walks", 32, RENDER.format(width, height, "Path(samples=2)")),
        (f"orders, {given.size}", 32, RENDER.format(width, height, "Orders()")),
        (f"orders, {given.size}, 128 wavelengths", 128, RENDER.format(width, height, "Orders()")),
        (f"orders, 16x8, tolerance {FINE:g}", 32, RENDER.format(16, 8, f"Orders(tolerance={FINE})")),
        ("orders, a field for all Suns", 32, "skyscatter.solve(scene, wl)"),
        ("orders, a field for all Suns, polarised", 32, "skyscatter.solve(scene, wl, stokes=True)"),
    ]
    rows: list[list[Any]] = []
    for name, wavelengths, work in works:
        code = CHILD.format(elevation=-3, wavelengths=wavelengths, work=work)
        command = [sys.executable, "-c", code]
        clock, done = seconds(partial(subprocess.run, command, check=True, capture_output=True, text=True))
        unit = 2**20 if sys.platform == "darwin" else 2**10  # bytes there, KiB elsewhere
        rows.append([name, wavelengths, int(done.stdout.split()[-1]) // unit, clock])
    return [
        "Peak memory of a fresh process (`ru_maxrss`), model earth, Sun at -3 degrees.",
        table(["work", "wavelengths", "peak [MiB]", "seconds, start included"], rows),
    ]


def curves(given: Any) -> list[str]:
    """Cost over wavelengths, haze, tolerance and size of the picture."""

    def picture(scene: Any, count: int, shape: tuple[int, int]) -> float:
        wl = np.linspace(380.0, 780.0, count) if count > 1 else np.array([550.0])
        run = lambda: skyscatter.render(scene, camera(shape), wl, threads=given.threads)  # noqa: E731
        return cost(run, given)[1]

    day, dusk = scene_at(30.0), scene_at(-3.0)
    skyscatter.render(day, camera((16, 8)), WAVELENGTHS, threads=given.threads)
    by_count = [[n, picture(day, n, (128, 64)), picture(dusk, n, (128, 64))] for n in (1, 4, 16, 32, 64, 128)]
    by_size: list[list[Any]] = [
        [f"{w}x{w // 2}", picture(day, 32, (w, w // 2)), picture(dusk, 32, (w, w // 2))]
        for w in (16, 64, 128, 256, 512)
    ]
    by_depth = [[d, *(picture(with_haze(scene, d, 0.7), 32, (128, 64)) for scene in (day, dusk))] for d in DEPTHS]
    by_peak = [[g, *(picture(with_haze(scene, 0.3, g), 32, (128, 64)) for scene in (day, dusk))] for g in PEAKS]
    by_tolerance: list[list[Any]] = []
    judges: dict[int, Any] = {}
    for tolerance in (0.001, 0.002, 0.005, 0.01, 0.015):
        row: list[Any] = [tolerance]
        for scene in (day, dusk):
            rays = sample_rays(scene)
            run = partial(
                skyscatter.radiance,
                scene,
                scene.observer.position,
                rays,
                EIGHT,
                solver=skyscatter.Orders(tolerance=tolerance),
                threads=given.threads,
            )
            _, spent, answer = cost(run, given)
            judge = judges.setdefault(id(scene), answer.radiance)
            error = rms(answer.radiance / judge - 1) if judge is not answer.radiance else float("nan")
            row += [spent, 100 * error, 100 * rms(answer.standard_error / answer.radiance)]
        by_tolerance.append(row)
    draw(by_count, by_tolerance, by_size)
    return [
        f"Model earth from the ground, the Sun at 30 and -3 degrees, {given.threads} threads; field and picture "
        "together. Seconds of the processor in each thread. By number of wavelengths, 128x64 pixels:",
        table(["wavelengths", "30° [s]", "-3° [s]"], [*by_count, exponents(by_count)]),
        "By optical depth of a haze (Henyey-Greenstein, asymmetry 0.7, scale height 2 km), 32 wavelengths:",
        table(["depth", "30° [s]", "-3° [s]"], [*by_depth, exponents(by_depth)]),
        "By asymmetry of such a haze of depth 0.3:",
        table(["asymmetry", "30° [s]", "-3° [s]"], by_peak),
        f"By tolerance, {EIGHT.size} wavelengths, the sky's half of a small panorama; errors are root mean "
        "squares against the finest:",
        table(["tolerance", "30° [s]", "error [%]", "stated [%]", "-3° [s]", "error [%]", "stated [%]"], by_tolerance),
        f"By size of the picture, {WAVELENGTHS.size} wavelengths:",
        table(["pixels", "30° [s]", "-3° [s]"], by_size),
        "Exponents are slopes of the logarithms, fitted over the last three rows. Drawn in `docs/orders-cost.png`.",
    ]


def with_haze(scene: Any, depth: float, asymmetry: float) -> Any:
    """The scene with a haze of optical depth and asymmetry, 2 km high."""
    optics = Particles(optical_depth=depth, phase=HenyeyGreenstein(g=asymmetry))
    haze = Component(name="more haze", density=Exponential(scale_height=2e3), optics=optics)
    air = scene.medium
    return scene.model_copy(
        update={"medium": Medium(planet_radius=air.planet_radius, components=(*air.components, haze))}
    )


def exponents(rows: list[list[Any]]) -> list[Any]:
    """A row with the slope of the logarithms of each column over that of the first, over the last three rows."""
    x, *columns = np.log(np.array(rows[-3:], float)).T
    return ["exponent", *(f"{np.polyfit(x, y, 1)[0]:.2f}" for y in columns)]


def draw(by_count: Any, by_tolerance: Any, by_size: Any) -> None:
    """The three curves as a picture."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

    figure = Figure(figsize=(11, 3.6), layout="constrained", dpi=110)
    panels = figure.subplots(1, 3)
    pixels = [int(np.prod([int(n) for n in row[0].split("x")])) for row in by_size]
    reached = [row for row in by_tolerance if np.isfinite(row[2])]
    data: tuple[tuple[str, list[list[float]], list[list[float]]], ...] = (
        ("wavelengths", [[row[0]] * 2 for row in by_count], [row[1:3] for row in by_count]),
        ("error reached, root mean square [%]", [row[2::3] for row in reached], [row[1::3] for row in reached]),
        ("pixels", [[count] * 2 for count in pixels], [row[1:3] for row in by_size]),
    )
    for panel, (label, x, y) in zip(panels, data, strict=True):
        for k, (name, colour, marker) in enumerate((("Sun at 30°", "#c46a00", "o"), ("Sun at -3°", "#3b4f9e", "s"))):
            panel.plot([row[k] for row in x], [row[k] for row in y], marker + "-", color=colour, label=name)
        panel.set(xscale="log", yscale="log", xlabel=label)
        panel.grid(alpha=0.3, which="both", linewidth=0.5)
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        panel.yaxis.set_minor_formatter(NullFormatter())
    panels[0].set_ylabel("seconds of processor, field and picture")
    panels[0].set_xscale("log", base=2)
    for panel in panels[:2]:
        panel.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        panel.xaxis.set_minor_formatter(NullFormatter())
    panels[0].legend(frameon=False)
    panels[0].set_title("128x64 pixels, tolerance 0.005", fontsize=10)
    panels[1].set_title("576 rays, 8 wavelengths", fontsize=10)
    panels[2].set_title("32 wavelengths, tolerance 0.005", fontsize=10)
    figure.savefig(DRAWING, metadata={"Software": None})


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--parts", default=",".join(PARTS), help="by commas")
    options.add_argument("--size", default="512x256", help="the picture")
    options.add_argument("--samples", type=int, default=64, help="walks per ray for path, in twilight four times")
    options.add_argument("--reference", type=int, default=65536, help="walks per ray of the judge beside sasktran2")
    options.add_argument("--threads", type=int, default=min(2, processors()))
    given = options.parse_args()
    where = machine()
    work = {"panorama": panorama, "walks": walks, "sasktran": sasktran, "memory": memory, "curves": curves}
    for part in given.parts.split(","):
        blocks = work[part](given)
        packages = versions("skyscatter", "numba", "numpy", *(["sasktran2"] if part == "sasktran" else []))
        words = [w for w in sys.argv[1:] if not w.startswith("--parts") and w not in (given.parts, "--write")]
        report(f"orders-{part}", where, packages, blocks, ["orders_speed.py", "--parts", part, *words], given.write)


if __name__ == "__main__":
    main()
