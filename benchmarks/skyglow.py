"""Brightness of the night sky against the distance from a city, on a round Earth, beside Walker's law.

The model city-skyglow without the rest of the night sky: a point with Garstang's upward lobe, air and aerosol. Walker
(1977, PASP 89, 405) found from sky brightness at 45 degrees from the zenith, towards cities of population P at d km,
that their light over that of the natural sky is 0.01 P d^-2.5.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from typing import Any

import numpy as np
from common import machine, parser, processors, report, seconds, table, versions

import skyscatter
from skyscatter.datafiles import read_table

EARTH = 6_371_000.0  #: radius [m], as in the model
EFFICACY = 683.0  #: lm W-1
PEOPLE = 500_000  #: of the model's city
WALKER = 0.01, -2.5


def luminance(radiance: Any, wavelengths: Any) -> Any:
    """[cd m-2] of radiances (..., wavelength) [W m-2 sr-1 nm-1], each wavelength standing for its cell."""
    eye = read_table("cie1931.csv")
    bar = np.interp(wavelengths, eye["wavelength_nm"], eye["y_bar"], left=0.0, right=0.0)
    cells = np.diff(np.concatenate([[wavelengths[0]], (wavelengths[1:] + wavelengths[:-1]) / 2, [wavelengths[-1]]]))
    return EFFICACY * (radiance * (bar * cells)).sum(axis=-1)


def sight(distance: float, zenith_deg: float) -> tuple[Any, Any]:
    """Origin and direction (3,) of an observer 2 m above the ground, so far from the city [m], looking towards it."""
    angle = distance / EARTH
    up = np.array([0.0, -np.sin(angle), np.cos(angle)])
    towards = np.array([0.0, np.cos(angle), np.sin(angle)])
    zenith = np.radians(zenith_deg)
    return (EARTH + 2.0) * up - [0.0, 0.0, EARTH], np.cos(zenith) * up + np.sin(zenith) * towards


def slopes(distances: Any, values: Any) -> Any:
    """d ln value / d ln distance between neighbours."""
    return np.diff(np.log(values)) / np.diff(np.log(distances))


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--distances", default="5,10,20,30,50,80,120", help="[km]")
    options.add_argument("--walks", type=int, default=4096)
    options.add_argument("--wavelengths", type=int, default=16, help="from 420 to 700 nm")
    options.add_argument("--sky", type=float, default=2e-4, help="luminance of the natural sky [cd m-2]")
    options.add_argument("--threads", type=int, default=min(2, processors()))
    given = options.parse_args()
    where = machine()
    wavelengths = np.linspace(420.0, 700.0, given.wavelengths)
    scene = skyscatter.load_model("city-skyglow").scene()
    city = tuple(lamp for lamp in scene.lamps if lamp.kind == "point")
    scene = scene.model_copy(update={"lamps": city})
    distances = np.array([float(word) for word in given.distances.split(",")])
    zeniths = (0.0, 45.0)
    rays = [sight(1000.0 * d, z) for z in zeniths for d in distances]
    origins, directions = (np.array([ray[k] for ray in rays]) for k in range(2))
    spent, answer = seconds(
        lambda: skyscatter.radiance(
            scene, origins, directions, wavelengths, solver=skyscatter.Path(samples=given.walks), threads=given.threads
        )
    )
    light = luminance(answer.radiance, wavelengths).reshape(2, -1)
    # Wavelengths share their walks: their errors add up in size, which bounds the error of the sum.
    error = luminance(answer.standard_error, wavelengths).reshape(2, -1)
    law = WALKER[0] * PEOPLE * distances ** WALKER[1]
    rows = []
    for k, d in enumerate(distances):
        parts = [f"{1e6 * light[z, k]:.4g} ± {100 * error[z, k] / light[z, k]:.1f} %" for z in range(2)]
        over = [light[z, k] / given.sky for z in range(2)]
        rows.append([f"{d:g}", *parts, over[0], over[1], law[k], over[1] / law[k]])
    header = ["distance [km]", "zenith [ucd m-2]", "45 deg towards the city", "zenith over natural sky",
              "45 deg over natural sky", "Walker's law", "45 deg over Walker's"]  # fmt: skip
    inner = (distances >= 10) & (distances <= 50)
    fits = [np.polyfit(np.log(distances[inner]), np.log(light[z][inner]), 1)[0] for z in range(2)]
    steps = [
        [f"{a:g} to {b:g}", *(slopes(distances, light[z])[k] for z in range(2))]
        for k, (a, b) in enumerate(pairwise(distances))
    ]
    blocks = [
        f"{given.wavelengths} wavelengths 420 to 700 nm, {given.walks} walks, {given.threads} threads, {spent:.0f} s, "
        f"natural sky {given.sky:g} cd m-2, {PEOPLE} people at 1000 lm.",
        table(header, rows),
        table(["km", "slope at the zenith", "slope at 45 deg"], steps),
        f"Slope fitted from 10 to 50 km: {fits[0]:.2f} at the zenith, {fits[1]:.2f} at 45 degrees towards the city; "
        f"Walker's law: {WALKER[1]}.",
    ]
    packages = versions("skyscatter", "numba", "numpy")
    report("skyglow", where, packages, blocks, ["skyglow.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
