"""Brightness of the night sky beside a city against the law of Walker: numbers, and docs/gallery/skyglow-law.png.

The shipped model city-skyglow, without its natural sky, is seen at several distances: luminance in the zenith and 45
degrees high towards the city.  Walker (1977), PASP 89, 405, measured around cities of California that the sky 45
degrees high towards a city of P people at d kilometres is brighter than the natural one by the factor
1 + 0.01 P d^-2.5; the natural sky is taken as 2.1e-4 cd m-2 (22 mag per square arc second in V).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import skyscatter
from skyscatter.datafiles import read_table

RADIUS = 6371e3
PEOPLE, NATURAL = 5e5, 2.1e-4
DISTANCES = np.array([5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 50.0, 80.0])
WAVELENGTHS = np.arange(380.0, 781.0, 20.0)


def luminances(distance_km: float, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Luminance [cd m-2] in the zenith and 45 degrees high towards the city, and standard errors; each (2,)."""
    model = skyscatter.load_model("city-skyglow").scene()
    city = model.model_copy(update={"lamps": tuple(lamp for lamp in model.lamps if lamp.kind == "point")})
    angle = distance_km * 1e3 / RADIUS
    up = np.array([0.0, -np.sin(angle), np.cos(angle)])
    towards = np.array([0.0, np.cos(angle), np.sin(angle)])
    place = np.array([0.0, 0.0, -RADIUS]) + (RADIUS + 2.0) * up
    directions = np.array([up, (up + towards) / np.sqrt(2)])
    answer = skyscatter.radiance(city, place, directions, WAVELENGTHS, solver=skyscatter.Path(samples=samples))
    eye = read_table("cie1931.csv")
    weights = 683.0 * 20.0 * np.interp(WAVELENGTHS, eye["wavelength_nm"], eye["y_bar"])
    # Wavelengths of a walk go together: the error of their sum is at most the sum of their errors.
    return answer.radiance @ weights, answer.standard_error @ weights


def main() -> None:
    """Compute, print, draw."""
    from matplotlib.figure import Figure

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=4096)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/gallery/skyglow-law.png"))
    given = parser.parse_args()
    law = 0.01 * PEOPLE * DISTANCES**-2.5 * NATURAL
    rows = [luminances(distance, given.samples) for distance in DISTANCES]
    value, error = (np.array([row[k] for row in rows]) for k in range(2))
    print("km    zenith   45 deg   its error   Walker   ratio")
    for d, v, e, w in zip(DISTANCES, value, error, law, strict=True):
        print(f"{d:4g}  {v[0]:8.2e} {v[1]:8.2e} {e[1] / v[1]:8.1%}   {w:8.2e} {v[1] / w:6.2f}")
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.errorbar(DISTANCES, value[:, 1], error[:, 1], fmt="o", label="45° high towards the city")
    axes.errorbar(DISTANCES, value[:, 0], error[:, 0], fmt="s", label="zenith")
    axes.plot(DISTANCES, law, "k-", label="Walker (1977), 45°")
    axes.axhline(NATURAL, color="grey", linestyle=":", label="natural sky")
    axes.set(xscale="log", yscale="log", xlabel="distance from the city [km]", ylabel="luminance [cd m$^{-2}$]")
    axes.set_xticks([5, 10, 20, 50, 80], labels=["5", "10", "20", "50", "80"])
    axes.minorticks_off()
    axes.legend()
    figure.savefig(given.output, dpi=100)


if __name__ == "__main__":
    main()
