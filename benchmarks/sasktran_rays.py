"""100 upward rays x 32 wavelengths in a pure Rayleigh sphere, beside the successive orders of sasktran2.

Both solve the same scalar scene: air whose density is linear between nodes 1 km apart on an exponential, a Lambertian
ground, the Sun as a point.  Errors are root mean squares relative to a long `path` run; the long run's own noise is
taken off in quadrature.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from common import WAVELENGTHS, machine, median_seconds, parser, processors, report, rms, seconds, show, table, versions

import skyscatter
from skyscatter.media.fields import Tabulated
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.optics.rayleigh import RayleighPowerLaw

RADIUS, SCALE_HEIGHT, TOP, OBSERVER = 6371e3, 8e3, 80e3, 2.0  # [m]; the observer stands just above the ground
COEFFICIENT, ALBEDO = 1.16e-5, 0.3  # scattering at 550 nm on the ground [m-1]; of the ground
ASYMMETRY, HAZE_HEIGHT = 0.7, 2e3  # of a haze by Henyey and Greenstein; its scale height [m]
#: Settings of sasktran2 that are tried: its own, and finer ones.
SETTINGS: dict[str, dict[str, int]] = {
    "as it comes": {},
    "5 Sun angles": {"num_sza": 5},
    "5 Sun angles, 302 directions": {
        "num_sza": 5, "num_successive_orders_incoming": 302, "num_successive_orders_outgoing": 302,
    },
}  # fmt: skip


def haze_at(altitudes: Any, depth: float) -> Any:
    """Extinction of the haze [m-1], (altitude,): linear between nodes 1 km apart on an exponential, of such a depth."""
    nodes = np.arange(0.0, TOP + 1.0, 1000.0)
    density = np.exp(-nodes / HAZE_HEIGHT)
    return depth / np.trapezoid(density, nodes) * np.interp(altitudes, nodes, density)


def peer(
    nodes: Any, cos_view: Any, azimuth: Any, cos_sun: float, threads: int, settings: dict[str, Any],
    source: str = "SuccessiveOrders", density: Any = None, haze: float = 0.0,
) -> Any:  # fmt: skip
    """Radiance by sasktran2, shape (ray, wavelength); everything from an empty configuration on is part of the time.

    The density at the nodes is exponential unless given; `haze` is an optical depth.
    """
    import sasktran2 as sk

    config = sk.Config()
    config.num_threads, config.num_stokes = threads, 1
    config.multiple_scatter_source = getattr(sk.MultipleScatterSource, source)
    for name, value in settings.items():
        setattr(config, name, value)
    geometry = sk.Geometry1D(
        cos_sza=cos_sun, solar_azimuth=0, earth_radius_m=RADIUS, altitude_grid_m=nodes,
        interpolation_method=sk.InterpolationMethod.LinearInterpolation, geometry_type=sk.GeometryType.Spherical,
    )  # fmt: skip
    view = sk.ViewingGeometry()
    for c, a in zip(cos_view, azimuth, strict=True):
        view.add_ray(sk.SolarAnglesObserverLocation(cos_sun, a, c, OBSERVER))
    air = sk.Atmosphere(geometry, config, wavelengths_nm=WAVELENGTHS, calculate_derivatives=False)
    density = np.exp(-nodes / SCALE_HEIGHT) if density is None else density
    extinction = COEFFICIENT * density[:, None] * (550.0 / WAVELENGTHS) ** 4
    moments = np.zeros((config.num_singlescatter_moments, *extinction.shape))
    moments[0], moments[2] = 1.0, 0.5  # 3/4 (1 + mu^2) = P0 + P2 / 2
    air["air"] = sk.constituent.Manual(extinction, np.ones_like(extinction), moments)
    if haze > 0.0:
        degree = np.arange(len(moments), dtype=float)[:, None, None]
        peaked = np.broadcast_to((2 * degree + 1) * ASYMMETRY**degree, moments.shape).copy()
        spectral = np.repeat(haze_at(nodes, haze)[:, None], WAVELENGTHS.size, axis=1)
        air["haze"] = sk.constituent.Manual(spectral, np.ones_like(spectral), peaked)
    air["ground"] = sk.constituent.LambertianSurface(ALBEDO)
    found = sk.Engine(config, geometry, view).calculate_radiance(air)["radiance"]
    return np.asarray(found.isel(stokes=0).transpose("los", "wavelength") if "stokes" in found.dims else found)


def our_scene(nodes: Any, sun_zenith: float, haze: float = 0.0) -> skyscatter.Scene:
    """The same scene for skyscatter."""
    density = Tabulated(altitudes=tuple(nodes), densities=tuple(np.exp(-nodes / SCALE_HEIGHT)), interpolation="linear")
    air = skyscatter.Component(
        name="air", density=density, optics=RayleighPowerLaw(coefficient=COEFFICIENT, wavelength=550.0)
    )
    components = [air]
    if haze > 0.0:
        layer = Tabulated(altitudes=tuple(nodes), densities=tuple(haze_at(nodes, 1.0)), interpolation="linear")
        optics = Particles(optical_depth=haze, phase=HenyeyGreenstein(g=ASYMMETRY), angstrom_exponent=0.0)
        components.append(skyscatter.Component(name="haze", density=layer, optics=optics))
    return skyscatter.Scene(
        medium=skyscatter.Medium(components=tuple(components), planet_radius=RADIUS),
        ground=skyscatter.Ground(albedo=ALBEDO),
        star=skyscatter.Star(spectrum=1.0, radius=0.0),
        sun=skyscatter.Sun(elevation_deg=90.0 - sun_zenith, azimuth_deg=0.0),
        altitude=OBSERVER,
    )


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--samples", default="64,256,1024", help="walks per ray to time, by commas")
    options.add_argument("--reference", type=int, default=16384, help="walks per ray of the long run")
    options.add_argument(
        "--settings", type=int, default=1, help=f"how many of {len(SETTINGS)} settings of the peer to try"
    )
    options.add_argument("--sun-zenith", type=float, default=60.0)
    options.add_argument("--step", type=float, default=1000.0, help="distance of the nodes [m]")
    options.add_argument("--threads", type=int, default=min(2, processors()))
    given = options.parse_args()
    where = machine()
    nodes = np.arange(0.0, TOP + 1.0, given.step)
    zenith = np.repeat(np.linspace(2.0, 85.0, 10), 10)
    cos_view, azimuth = np.cos(np.radians(zenith)), np.tile(np.linspace(0.0, np.pi, 10), 10)
    across = np.sqrt(1 - cos_view**2)
    directions = np.stack([across * np.sin(azimuth), across * np.cos(azimuth), cos_view], axis=-1)
    scene = our_scene(nodes, given.sun_zenith)

    def ours(samples: int, **more: Any) -> Any:
        return skyscatter.radiance(
            scene,
            scene.observer.position,
            directions,
            WAVELENGTHS,
            threads=given.threads,
            solver=skyscatter.Path(samples=samples, **more),
        )

    ours(16)
    # A finer tolerance for the first order, so that the long run has no error but its noise.
    long, reference = seconds(lambda: ours(given.reference, seed=2**32, tolerance=1e-7))
    own = rms(reference.standard_error / reference.radiance)

    def error(radiance: Any) -> float:
        return float(np.sqrt(max(rms(radiance / reference.radiance - 1) ** 2 - own**2, 0.0)))

    mine: list[list[Any]] = []
    for samples in sorted({int(word) for word in given.samples.split(",")}):
        time, answer = median_seconds(lambda n=samples: ours(n), given.repeats)
        mine.append([f"skyscatter path, {samples} walks", time, 100 * error(answer.radiance)])
    theirs: list[list[Any]] = []
    by_zenith: list[list[Any]] = []
    cos_sun = float(np.cos(np.radians(given.sun_zenith)))
    for name, settings in list(SETTINGS.items())[: given.settings]:
        time, radiance = median_seconds(
            lambda s=settings: peer(nodes, cos_view, azimuth, cos_sun, given.threads, s), given.repeats
        )
        theirs.append([f"sasktran2, {name}", time, 100 * error(radiance)])
        ratio = radiance / reference.radiance - 1
        by_zenith.append([name, *(f"{100 * x:+.3f}" for x in ratio.reshape(10, -1).mean(axis=1))])
    blocks = [
        f"100 rays x {WAVELENGTHS.size} wavelengths, Sun zenith angle {given.sun_zenith:g} degrees, vertical optical "
        f"depth {COEFFICIENT * SCALE_HEIGHT:.3f} at 550 nm, albedo {ALBEDO}, scalar, {given.threads} threads. Long "
        f"run: {given.reference} walks per ray, {long:.0f} s, noise {100 * own:.3f} %, the half of which it can judge.",
        table(["solver", "seconds", "error [%]"], [*mine, *theirs]),
        table(
            ["to the error of", "its seconds", "skyscatter's seconds, scaled", "time over skyscatter's"],
            equal_error(mine[-1], theirs, 100 * own),
        ),
        "sasktran2 over skyscatter minus 1, mean over azimuths and wavelengths [%], by view zenith angle:",
        table(["", *(f"{z:.0f}°" for z in zenith[::10])], by_zenith),
        "Scaled: the time at the most walks times the squared ratio of the errors. Goal: the same error in less time.",
    ]
    packages = versions("skyscatter", "sasktran2", "numba", "numpy")
    report("sasktran", where, packages, blocks, ["sasktran_rays.py", *sys.argv[1:]], given.write)


def equal_error(mine: list[Any], theirs: list[list[Any]], noise: float) -> list[list[Any]]:
    """Our time to the error of each setting of the peer, by 1/sqrt(walks) from our longest timed run."""
    rows: list[list[Any]] = []
    for name, time, error in theirs:
        if error < 0.5 * noise:
            least = mine[1] * (mine[2] / (0.5 * noise)) ** 2
            rows.append([name, time, f"more than {show(least)}", "long run too short to say"])
        else:
            scaled = mine[1] * (mine[2] / error) ** 2
            rows.append([name, time, scaled, time / scaled])
    return rows


if __name__ == "__main__":
    main()
