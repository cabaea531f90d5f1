"""Derivatives of radiances: what finite differences of separate solutions miss by, over the step, and what walks find.

The first table holds one line for each solver and parameter: the largest difference between the derivative that
`skyscatter.inversion.differentiate` gives and the symmetric difference of two solutions that know nothing of each
other, relative to the largest derivative along the rays, for relative steps from 0.1 to 1e-5.  The second one compares
derivatives by walks with references that make no use of them: means over many seeds, in units of their standard error,
and the spread over the seeds beside the stated error.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, report, table, versions

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.inversion import differentiate
from skyscatter.media.fields import Exponential
from skyscatter.media.shapes import Sphere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.spectra.table import SpectralTable

PAGE = Path(__file__).parent.parent / "docs" / "validation-inversion-derivatives.md"
STEPS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
#: Relative step of our own derivatives: where truncation and rounding of the solver are about equal.
OWN = {"single": 1e-4, "orders": 3e-3, "path": 1e-3}
WAVELENGTHS = (450.0, 650.0)


def sky(theta: Any) -> skyscatter.Scene:
    """Air and haze over a grey ground."""
    weight, height, g, albedo, ground, elevation = theta
    grains = Particles(extinction=1e-4, single_scattering_albedo=albedo, phase=HenyeyGreenstein(g=g))
    air = skyscatter.Component(
        name="air", density=Exponential(scale_height=8000.0), optics=RayleighPowerLaw(coefficient=1.2e-5)
    )
    haze = skyscatter.Component(name="haze", density=Exponential(scale_height=height), optics=grains, weight=weight)
    return skyscatter.Scene(
        medium=skyscatter.Medium(components=(air, haze), planet_radius=6371e3),
        ground=skyscatter.Ground(albedo=ground), sun=skyscatter.Sun(elevation_deg=elevation),
    )  # fmt: skip


def sphere(theta: Any) -> skyscatter.SpaceScene:
    """A dusty sphere around a star."""
    extinction, albedo, g, radius, luminosity = theta
    grains = Particles(extinction=extinction, single_scattering_albedo=albedo, phase=HenyeyGreenstein(g=g))
    dust = skyscatter.Component(name="dust", density=Sphere(radius=radius), optics=grains)
    star = skyscatter.PointStar(spectrum=SpectralTable(wavelengths=(500.0,), values=(luminosity,)))
    return skyscatter.SpaceScene(
        medium=skyscatter.Medium(components=(dust,)), stars=(star,), view=skyscatter.View(distance=100.0)
    )


def sky_rays() -> tuple[Any, Any]:
    """Four directions from the ground."""
    sights = ((90.0, 12.0), (180.0, 50.0), (0.0, 80.0), (170.0, 20.0))
    directions = np.array([direction_from_azimuth_elevation(*s) for s in sights])
    return np.broadcast_to([0.0, 0.0, 6371e3], directions.shape), directions


def sphere_rays() -> tuple[Any, Any]:
    """Three lines of sight beside the star."""
    origins = np.array([[x, 0.0, 10.0] for x in (0.2, 0.5, 0.8)])
    return origins, np.broadcast_to([0.0, 0.0, -1.0], origins.shape)


CASES: dict[str, tuple[Callable[[Any], Any], tuple[str, ...], tuple[float, ...], Callable[[], Any]]] = {
    "sky": (
        sky,
        (
            "haze, extinction", "haze, scale height", "haze, asymmetry", "haze, albedo", "ground, albedo",
            "Sun's elevation",
        ),
        (1.0, 1500.0, 0.6, 0.9, 0.3, 40.0), sky_rays,
    ),
    "sphere": (
        sphere, ("extinction", "albedo", "asymmetry", "radius", "luminosity"), (0.8, 0.7, 0.5, 1.0, 1.0), sphere_rays,
    ),
}  # fmt: skip


def step_study(case: str, solver: str) -> list[list[Any]]:
    """Lines of the first table."""
    scenes, names, theta, rays = CASES[case]
    at = np.array(theta)
    found = differentiate(scenes, at, OWN[solver] * at, *rays(), WAVELENGTHS, solver=solver)
    lines = []
    for number, name in enumerate(names):
        scale = np.abs(found.jacobian[number]).max()
        row: list[Any] = [case, solver, name]
        for step in STEPS:
            shift = np.eye(at.size)[number] * step * at
            if "albedo" in name:  # no copy with more than 1
                shift = np.minimum(shift, 1 - at[number])
            shift = shift * (np.arange(at.size) == number)
            plus, minus = (
                skyscatter.radiance(scenes(at + s * shift), *rays(), WAVELENGTHS, solver).radiance for s in (1, -1)
            )
            miss = np.abs((plus - minus) / (2 * shift[number]) - found.jacobian[number]).max()
            row.append("no light" if scale == 0 else f"{miss / scale:.1e}")
        lines.append(row)
    return lines


def walks(case: str, seeds: int, samples: int) -> list[list[Any]]:
    """Lines of the second table."""
    scenes, names, theta, rays = CASES[case]
    at, count = np.array(theta), len(theta)
    if case == "sky":  # a Sun that moves is no matter of walks
        at, count = at[:5], 5
        scenes = lambda t: sky([*t, 40.0])  # noqa: E731
        names = names[:5]
        judge = differentiate(
            scenes, at, OWN["orders"] * at, *rays(), WAVELENGTHS, solver=skyscatter.Orders(tolerance=1e-3)
        )
        slack, word = 1e-3 * np.abs(judge.jacobian).max(axis=(1, 2), keepdims=True), "orders"
    else:
        judge = differentiate(
            scenes,
            at,
            OWN["path"] * at,
            *rays(),
            WAVELENGTHS,
            solver=skyscatter.Path(sampling="free-flight", samples=200_000),
        )
        slack, word = judge.jacobian_error, "free flights"
    runs = [
        differentiate(
            scenes, at, OWN["path"] * at, *rays(), WAVELENGTHS, solver=skyscatter.Path(samples=samples, seed=1 + k)
        )
        for k in range(seeds)
    ]
    slopes, errors = np.stack([r.jacobian for r in runs]), np.stack([r.jacobian_error for r in runs])
    spread = slopes.std(axis=0, ddof=1)
    z = (slopes.mean(axis=0) - judge.jacobian) / np.hypot(spread / np.sqrt(seeds), slack)
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / spread
    share = np.median(spread / np.sqrt(seeds) / np.abs(judge.jacobian).max(axis=(1, 2), keepdims=True), axis=(1, 2))
    return [
        [case, word, names[k], f"{np.sqrt(np.mean(z[k] ** 2)):.2f}", f"{np.abs(z[k]).max():.1f}",
         f"{100 * share[k]:.2g} %", f"{np.median(ratio[k]):.2f}"]
        for k in range(count)
    ]  # fmt: skip


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--seeds", type=int, default=40)
    options.add_argument("--samples", type=int, default=256, help="walks per ray and seed")
    given = options.parse_args()
    where = machine()
    lines = [*step_study("sky", "single"), *step_study("sky", "orders"), *step_study("sphere", "single")]
    first = table(["scene", "solver", "parameter", *(f"step {s:g}" for s in STEPS)], lines)
    lines = [*walks("sky", given.seeds, given.samples), *walks("sphere", given.seeds, given.samples)]
    second = table(["scene", "beside", "parameter", "rms of z", "largest", "standard error", "stated / spread"], lines)
    blocks = ["### Differences of separate solutions, by their relative step", first, "### Walks", second]
    report("derivatives", where, versions("skyscatter", "numba", "numpy"), blocks, sys.argv, given.write, PAGE)


if __name__ == "__main__":
    main()
