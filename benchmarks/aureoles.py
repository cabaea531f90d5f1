"""Aureoles and limbs by the solver orders, where forward peaks are cut off, against solutions that keep more degrees.

    python benchmarks/aureoles.py [--degree 48] [--rays 60] [--tolerance 0.005] [--write]

Dust, haze and droplets of shipped planets, seen from the ground, aloft and from orbit.  Rays lie within 60 degrees of
the Sun, from the horizon up; from orbit they pass through the limb, within 60 degrees of azimuth of the Sun.  The
judge shares the method, but keeps so many degrees of the phase functions that next to nothing is cut off; it counts
with the error that it states.  Rays with less than a thousandth of the brightest one's light are left out.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from common import machine, parser, report, table, versions
from coverage_orders import PAGE

import skyscatter
from skyscatter.solvers import sweeps

WAVELENGTH = 450.0  #: where dust and haze are deepest [nm]
NEAR = 60.0  #: degrees from the Sun
LIMB = 0.4  #: tangents of limbs lie below this share of the top
SKIES = (
    ("mars", 2.0, (60, 25, 10, 3, -3)), ("mars", 30e3, (25, 10, 0)), ("mars", 400e3, (25, 10, 0, -10)),
    ("earth-hazy", 2.0, (25, 3)), ("earth-hazy", 400e3, (5, -12)), ("earth-maritime", 2.0, (25, 3)),
    ("titan", 2.0, (40, 10)), ("titan", 600e3, (20, 0, -20)),
)  # fmt: skip
HEADER = (
    "atmosphere", "from", "Sun", "root mean square [%]", "largest [%]", "median stated [%]", "within the stated error",
    "within twice",
)  # fmt: skip


@contextmanager
def degrees(number: int) -> Iterator[None]:
    """Phase functions are kept to so many degrees, whatever the tolerance."""
    usual = sweeps.DEGREES
    sweeps.DEGREES = ((number, 1.0, 1.0),)
    try:
        yield
    finally:
        sweeps.DEGREES = usual


def sights(scene: Any, number: int) -> np.ndarray:
    """Directions near the Sun, or through the limb where the observer stands above the air."""
    rng = np.random.default_rng(5)
    radius, top, altitude = scene.medium.radius, scene.medium.top, scene.altitude
    if altitude > top:
        elevation = -np.arccos((radius + rng.uniform(0, LIMB, number) * top) / (radius + altitude))
        azimuth = np.radians(NEAR * rng.random(number) ** 1.5)
    else:
        sun, east = scene.sun.direction, np.array([1.0, 0.0, 0.0])
        angle, turn = np.radians(rng.uniform(1, NEAR, number)), rng.uniform(0, 2 * np.pi, number)
        side = np.cos(turn)[:, None] * east + np.sin(turn)[:, None] * np.cross(sun, east)
        d = np.cos(angle)[:, None] * sun + np.sin(angle)[:, None] * side
        horizon = -np.arccos(radius / (radius + altitude)) + 1e-4
        elevation, azimuth = np.arcsin(d[:, 2]), np.arctan2(d[:, 0], d[:, 1])
        elevation = np.where(elevation < horizon, horizon + rng.uniform(0, 0.3, number), elevation)
    flat = np.cos(elevation)
    return np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)], axis=-1)


def compare(model: str, altitude: float, sun: float, given: Any) -> tuple[list[str], np.ndarray]:
    """The row of one sky; deviations over what is stated, by both."""
    scene = skyscatter.load_model(model).scene(sun_elevation_deg=sun, sun_azimuth_deg=0.0, altitude=altitude)
    d = sights(scene, given.rays)
    rays = np.broadcast_to(scene.observer.position, d.shape), d, [WAVELENGTH]
    found = skyscatter.radiance(*(scene, *rays), solver=skyscatter.Orders(tolerance=given.tolerance))
    with degrees(given.degree):
        judge = skyscatter.radiance(*(scene, *rays), solver=skyscatter.Orders(tolerance=given.judge))
    lit = judge.radiance[:, 0] > 1e-3 * judge.radiance.max()
    truth = judge.radiance[lit, 0]
    missed = np.abs(found.radiance[lit, 0] - truth) / truth
    stated, own = found.estimated_error[lit, 0] / truth, judge.estimated_error[lit, 0] / truth
    apart = missed / np.hypot(stated, own)
    where = f"{altitude:.0f} m" if altitude < 1e3 else f"{altitude / 1e3:.0f} km"
    return [
        model, where, f"{sun:g}°", f"{100 * np.sqrt(np.mean(missed**2)):.2f}", f"{100 * missed.max():.2f}",
        f"{100 * np.median(stated):.2f}", f"{100 * np.mean(apart < 1):.0f} %", f"{100 * np.mean(apart < 2):.0f} %",
    ], apart  # fmt: skip


def main() -> None:
    """Run the study and report it."""
    options = parser(__doc__)
    options.add_argument("--degree", type=int, default=48, help="that the judge keeps")
    options.add_argument("--rays", type=int, default=60)
    options.add_argument("--tolerance", type=float, default=0.005)
    options.add_argument("--judge", type=float, default=0.004, help="tolerance of the judge")
    options.add_argument("--models", nargs="+", default=sorted({model for model, _, _ in SKIES}))
    given, where = options.parse_args(), machine()
    rows, apart = [], []
    for model, altitude, suns in SKIES:
        for sun in suns if model in given.models else ():
            row, ratio = compare(model, altitude, sun, given)
            rows.append(row)
            apart.append(ratio)
            print(" ".join(row), file=sys.stderr, flush=True)
    of_all = np.concatenate(apart)
    once, twice = (100 * np.mean(of_all < k) for k in (1, 2))
    blocks = [table(HEADER, rows), f"Of all {of_all.size} rays {once:.1f} % are within, {twice:.1f} % within twice."]
    report(f"aureoles-{given.tolerance:g}", where, versions("skyscatter", "numba"), blocks, sys.argv, given.write, PAGE)


if __name__ == "__main__":
    main()
