"""The same sky in skyscatter and in Mitsuba 3's spectral volumetric path tracer: same light? how long to equal error?

Air scatters by Rayleigh's phase function (Mitsuba blends phase functions with one weight for all wavelengths, so that a
mixture with haze cannot be the same in both) and is piecewise constant in concentric shells of equal vertical optical
depth, over a Lambertian ground, the Sun as a point.  Mitsuba's integrator is called along skyscatter's own rays, each
lane with 4 of the 32 wavelengths, evenly spaced and in random rotation as its spectral mode wants; no film, no camera,
no pixel filter comes between.  Its world has its origin at the observer, because it computes in single precision.
Compile times are left out on both sides.
"""

from __future__ import annotations

import glob
import os
import re
import sys
from typing import Any

import numpy as np
from common import WAVELENGTHS, machine, median_seconds, parser, processors, report, rms, seconds, show, table, versions

import skyscatter
from skyscatter.media.fields import Exponential, Tabulated
from skyscatter.optics.rayleigh import RayleighPowerLaw

RADIUS, SCALE_HEIGHT, TOP, OBSERVER = 6371e3, 8e3, 80e3, 2.0  # [m]
COEFFICIENT, ALBEDO = 1.16e-5, 0.3  # scattering at 550 nm on the ground [m-1]; of the ground
AT_ONCE = 4  # wavelengths that Mitsuba carries along one path
GROUPS = WAVELENGTHS.size // AT_ONCE
#: Mitsuba's unit of length [m].  It starts a ray 9e-5 (1 + distance from the origin) off the surface that it left: in
#: small units that is less than the error of finding a sphere of this size in single precision (about 1 m), and the
#: ground near the observer shades itself (in km, 2.7 % less light in the sky over an albedo of 1); in much larger units
#: the ray passes over a good part of a shell.
UNIT = 20e3
JUMP = 1e-3  # width of a step between shells in skyscatter's table [m]


def find_llvm() -> str:
    """Path of an LLVM library for Mitsuba: what DRJIT_LIBLLVM_PATH says, else version 19 in the usual places."""
    if os.environ.get("DRJIT_LIBLLVM_PATH"):
        return os.environ["DRJIT_LIBLLVM_PATH"]
    places = ["/usr/lib/*/libLLVM*.so*", "/usr/lib/llvm-19/lib/libLLVM*.so*", "/usr/lib*/libLLVM*.so*",
              "/usr/lib*/llvm19/lib*/libLLVM*.so*", "/opt/homebrew/opt/llvm@19/lib/libLLVM*.dylib",
              "/usr/local/opt/llvm@19/lib/libLLVM*.dylib"]  # fmt: skip
    for place in places:
        for path in sorted(glob.glob(place)):
            if re.search(r"(^|\D)19(\D|$)", os.path.realpath(path)):
                return os.path.realpath(path)
    raise SystemExit("Mitsuba needs LLVM 19: install it (apt install libllvm19) or set DRJIT_LIBLLVM_PATH")


def shells(count: int) -> tuple[Any, Any]:
    """Edges [m] and densities of shells of equal column that together hold the exponential's column."""
    share = np.linspace(0, 1, count + 1)
    edges = -SCALE_HEIGHT * np.log(1 - share * (1 - np.exp(-TOP / SCALE_HEIGHT)))
    edges[-1] = TOP
    return edges, -SCALE_HEIGHT * np.diff(np.exp(-edges / SCALE_HEIGHT)) / np.diff(edges)


def our_scene(density: Any, elevation: float) -> skyscatter.Scene:
    """The scene for skyscatter, Sun in the north."""
    air = skyscatter.Component(
        name="air", density=density, optics=RayleighPowerLaw(coefficient=COEFFICIENT, wavelength=550.0)
    )
    return skyscatter.Scene(
        medium=skyscatter.Medium(components=(air,), planet_radius=RADIUS),
        ground=skyscatter.Ground(albedo=ALBEDO),
        star=skyscatter.Star(spectrum=1.0, radius=0.0),
        sun=skyscatter.Sun(elevation_deg=elevation, azimuth_deg=0.0),
        altitude=OBSERVER,
    )


def staircase(edges: Any, densities: Any) -> Tabulated:
    """The shells as a density field."""
    lower = np.concatenate([edges[:1], edges[1:-1] + JUMP])
    altitudes = np.stack([lower, edges[1:]], axis=1).ravel()
    return Tabulated(altitudes=tuple(altitudes), densities=tuple(np.repeat(densities, 2)), interpolation="linear")


def their_scene(mi: Any, edges: Any, densities: Any, sun: Any, integrator: str) -> tuple[Any, Any]:
    """The scene for Mitsuba, the observer at its origin, and the medium around the observer."""
    centre = [0.0, 0.0, -(RADIUS + OBSERVER) / UNIT]
    sigma = UNIT * COEFFICIENT * (550.0 / WAVELENGTHS) ** 4
    parts: dict[str, Any] = {"type": "scene", "integrator": {"type": integrator}}
    for i, density in enumerate(densities):
        spectrum = {
            "type": "irregular",
            "wavelengths": ", ".join(repr(float(w)) for w in WAVELENGTHS),
            "values": ", ".join(repr(float(s)) for s in sigma * density),
        }
        parts[f"air{i}"] = {
            "type": "homogeneous", "albedo": {"type": "uniform", "value": 1.0}, "phase": {"type": "rayleigh"},
            "sigma_t": {"type": "constvolume", "value": spectrum},
        }  # fmt: skip
    parts["ground"] = {
        "type": "sphere", "center": centre, "radius": RADIUS / UNIT, "exterior": {"type": "ref", "id": "air0"},
        "bsdf": {"type": "diffuse", "reflectance": {"type": "uniform", "value": ALBEDO}},
    }  # fmt: skip
    for i, edge in enumerate(edges[1:]):
        parts[f"shell{i}"] = {
            "type": "sphere", "center": centre, "radius": (RADIUS + edge) / UNIT, "bsdf": {"type": "null"},
            "interior": {"type": "ref", "id": f"air{i}"},
        }  # fmt: skip
        if i + 1 < len(densities):
            parts[f"shell{i}"]["exterior"] = {"type": "ref", "id": f"air{i + 1}"}
    light = {"type": "uniform", "value": 1.0}
    parts["sun"] = {"type": "directional", "direction": [-float(x) for x in sun], "irradiance": light}
    scene = mi.load_dict(parts)
    ground = [s for s in scene.shapes() if s.interior_medium() is None and s.exterior_medium() is not None]
    return scene, ground[0].exterior_medium()


def trace(mi: Any, dr: Any, scene: Any, around: Any, directions: Any, samples: int, seed: int) -> Any:
    """Mean radiance of `samples` paths along each ray, shape (ray, wavelength)."""
    rays, count = len(directions), WAVELENGTHS.size
    lanes = rays * samples
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, lanes)
    lane = dr.arange(mi.UInt32, lanes)
    ray, hero = lane // samples, lane % count
    # The first of the wavelengths decides the flights; every member of a group leads equally often.
    index = [(hero + GROUPS * j) % count for j in range(AT_ONCE)]
    grid = mi.Float(WAVELENGTHS.astype(np.float32))
    where = mi.RayDifferential3f(
        o=mi.Point3f(0.0),
        d=mi.Vector3f(*(dr.gather(mi.Float, mi.Float(directions[:, k].astype(np.float32)), ray) for k in range(3))),
        time=0.0,
        wavelengths=mi.Spectrum(*(dr.gather(mi.Float, grid, i) for i in index)),
    )
    light = scene.integrator().sample(scene, sampler, where, around, True)[0]
    total = dr.zeros(mi.Float, rays * count)
    for j, i in enumerate(index):
        dr.scatter_reduce(dr.ReduceOp.Add, total, light[j], ray * count + i)
    return np.array(total, float).reshape(rays, count) / (samples * AT_ONCE / count)


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--size", default="16x8", help="pixels of the upper half of the sky that are compared")
    options.add_argument("--shells", type=int, default=16)
    options.add_argument("--samples", type=int, default=256, help="Mitsuba's paths per pixel and pass: 32, 64, ...")
    options.add_argument("--passes", type=int, default=16, help="passes, whose spread tells Mitsuba's error")
    options.add_argument("--integrator", choices=("volpathmis", "volpath"), default="volpathmis")
    options.add_argument("--walks", type=int, default=256, help="skyscatter's walks per pixel that are timed")
    options.add_argument("--reference", type=int, default=8192, help="skyscatter's walks per pixel of the long run")
    options.add_argument("--sun-elevation", type=float, default=30.0)
    options.add_argument("--threads", type=int, default=min(2, processors()))
    given = options.parse_args()
    if given.samples % WAVELENGTHS.size or given.passes < 2:
        raise SystemExit(f"--samples needs a multiple of {WAVELENGTHS.size}, --passes at least 2")
    where = machine()
    os.environ["DRJIT_LIBLLVM_PATH"] = find_llvm()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_spectral")
    dr.set_thread_count(given.threads)
    edges, densities = shells(given.shells)
    scene = our_scene(staircase(edges, densities), given.sun_elevation)
    smooth = our_scene(Exponential(scale_height=SCALE_HEIGHT, top=TOP), given.sun_elevation)
    width, height = (int(word) for word in given.size.split("x"))
    camera = skyscatter.Panorama(width=width, height=height, elevation_min_deg=0.0)
    directions = camera.directions(scene.observer).reshape(-1, 3)

    def ours(which: skyscatter.Scene, samples: int, **more: Any) -> Any:
        return skyscatter.radiance(
            which,
            which.observer.position,
            directions,
            WAVELENGTHS,
            threads=given.threads,
            solver=skyscatter.Path(samples=samples, **more),
        )

    ours(scene, 16), ours(smooth, 16)
    long, reference = seconds(lambda: ours(scene, given.reference, seed=2**32, tolerance=1e-7))
    exact = reference.radiance
    own = rms(reference.standard_error / exact)
    timed: list[list[Any]] = []
    for name, which, judge in (("the same shells", scene, exact), ("smooth exponential", smooth, None)):
        time, answer = median_seconds(lambda w=which: ours(w, given.walks), given.repeats)
        stated = rms(answer.standard_error / answer.radiance)
        actual = stated if judge is None else float(np.sqrt(max(rms(answer.radiance / judge - 1) ** 2 - own**2, 0)))
        timed.append([f"skyscatter path, {name}, {given.walks} walks", time, 100 * stated, 100 * actual])
    peer, around = their_scene(mi, edges, densities, scene.sun.direction, given.integrator)
    trace(mi, dr, peer, around, directions, given.samples, 10**6)  # compiles
    runs = [seconds(lambda k=k: trace(mi, dr, peer, around, directions, given.samples, k)) for k in range(given.passes)]
    total = sum(run[0] for run in runs)
    means = np.array([run[1] for run in runs]) / exact
    stated = float(np.sqrt(np.mean(means.var(axis=0, ddof=1)) / given.passes))
    paths = given.samples * given.passes
    actual = float(np.sqrt(max(rms(means.mean(axis=0) - 1) ** 2 - own**2, 0)))
    theirs: list[Any] = [
        f"Mitsuba {given.integrator}, {given.shells} shells, {paths} paths",
        total,
        100 * stated,
        100 * actual,
    ]
    needed = total * (theirs[2] / timed[0][3]) ** 2
    blocks = [
        f"Rayleigh air, vertical optical depth {COEFFICIENT * SCALE_HEIGHT:.3f} at 550 nm, albedo {ALBEDO}, Sun at "
        f"{given.sun_elevation:g} degrees, {width}x{height} pixels of the upper half of the sky, {WAVELENGTHS.size} "
        f"wavelengths, {given.threads} threads. Long run of skyscatter: {given.reference} walks per pixel, "
        f"{long:.0f} s, noise {100 * own:.3f} %.",
        "Agreement, Mitsuba over skyscatter, with the standard error of the mean (from the spread over passes):",
        agreement(means, height, width),
        "Errors are root mean squares over pixels and wavelengths; the second is against the long run:",
        table(["renderer", "seconds", "stated error [%]", "actual error [%]"], [*timed, theirs]),
        f"Mitsuba's time to skyscatter's error of {show(timed[0][3])} %, scaled by the square of its stated error: "
        f"{show(needed)} s, {show(needed / timed[0][1])} times skyscatter's. Goal: at least 100 times.",
    ]
    packages = versions("skyscatter", "mitsuba", "drjit", "numba", "numpy")
    report("mitsuba", where, packages, blocks, ["mitsuba_sky.py", *sys.argv[1:]], given.write)


def agreement(means: Any, height: int, width: int) -> str:
    """Ratio by elevation and by wavelength, each with its standard error; `means` is (pass, pixel, wavelength)."""

    def cell(values: Any) -> str:
        return f"{values.mean():.4f} ± {values.std(ddof=1) / np.sqrt(values.size):.4f}"

    cube = means.reshape(len(means), height, width, -1)
    elevation = 90.0 * (height - 0.5 - np.arange(height)) / height
    rows: list[list[Any]] = [
        [f"elevation {e:.1f}°", cell(cube[:, j].mean(axis=(1, 2)))] for j, e in enumerate(elevation)
    ]
    for k in range(0, WAVELENGTHS.size, 8):
        part = cube[..., k : k + 8].mean(axis=(1, 2, 3))
        rows.append([f"{WAVELENGTHS[k]:.0f} to {WAVELENGTHS[k + 7]:.0f} nm", cell(part)])
    rows.append(["all", cell(cube.mean(axis=(1, 2, 3)))])
    return table(["mean over", "ratio"], rows)


if __name__ == "__main__":
    main()
