"""Skies by the general walk among surfaces: deviations, coverage, time; and what the known light of the sky is worth.

    python benchmarks/worlds.py [plain] [mountain]

First walks alone, beside the sky's own walks and `orders`: a box is buried out of sight, so that the sky is the plain
one and the solver that of skies with bodies.  Then a mountain, by walks alone and by walks that begin with the light
of the empty sky: noise, time, and how often the stated error of few walks covers the mean of many runs.
"""

from __future__ import annotations

import sys
import time
import warnings
from typing import Any

import numpy as np

import skyscatter
from skyscatter.solvers.options import record_of
from skyscatter.surfaces import Body, Box, Lambert, Mesh

WAVELENGTHS = [450.0, 550.0, 650.0]
MODELS, SUNS = ("earth-simple", "earth-hazy"), (60.0, 25.0, 5.0)
BURIED = Body(name="buried", shape=Box(position=(0, 0, "-10 km"), size=(1, 1, 1)), material=Lambert())
ANGLES = [
    (180, 75),
    (180, 45),
    (180, 12),
    (150, 30),
    (90, 60),
    (90, 20),
    (90, 5),
    (30, 30),
    (0, 80),
    (0, 20),
    (0, 4),
    (0, -30),
]
WALKS, MANY, SEEDS = 1024, 1 << 15, 30
#: Models and Suns of the mountain, walks a pixel, and seeds.
LANDSCAPES = (
    ("earth", 25.0), ("earth", -4.0), ("earth-hazy", 25.0), ("earth-hazy", 5.0), ("mars", 25.0), ("mars", 10.0)
)  # fmt: skip
FEW, PICTURES = 32, 12


def directions() -> Any:
    """Unit vectors of `ANGLES`, azimuth and elevation [degree]."""
    a, e = np.radians(np.array(ANGLES, float)).T
    return np.stack([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)], axis=-1)


def look(scene: skyscatter.Scene, solver: str = "path", threads: int | None = None, **options: Any) -> Any:
    """Light at the observer."""
    how = record_of(solver, **({"sampling": "march"} if solver == "path" else {}), **options)
    return skyscatter.radiance(scene, scene.observer.position, directions(), WAVELENGTHS, solver=how, threads=threads)


def timed(scene: skyscatter.Scene) -> tuple[Any, float]:
    """An answer of one thread after a first one that compiles, and its seconds."""
    look(scene, samples=16, threads=1)
    began = time.perf_counter()
    found = look(scene, samples=4096, threads=1, seed=99)
    return found, time.perf_counter() - began


def squares(found: Any) -> float:
    """Mean square of the relative error."""
    return float(np.mean((found.error / found.radiance) ** 2))


def row(name: str, sun: float) -> str:
    """One line of the table."""
    model: Any = skyscatter.load_model(name)  # type: ignore[call-overload]
    plain = model.scene(sun_elevation_deg=sun, altitude=2.0)
    scene = model.model_copy(update={"bodies": (BURIED,)}).scene(sun_elevation_deg=sun, altitude=2.0)
    solved, marched = look(plain, "orders"), look(plain, samples=MANY, seed=1)
    found = look(scene, samples=MANY, seed=2)
    runs = [look(scene, samples=WALKS, seed=10 + k) for k in range(SEEDS)]
    z = np.array([(run.radiance - marched.radiance) / np.hypot(run.error, marched.error) for run in runs])
    (ours, slow), (theirs, quick) = timed(scene), timed(plain)
    columns = (
        f"{sun:.0f}",
        f"{100 * np.mean(found.radiance / solved.radiance - 1):+.2f} %",
        f"{100 * np.mean(found.radiance / marched.radiance - 1):+.2f} %",
        f"{100 * np.sqrt(squares(found)):.2f} %",
        f"{np.sqrt(np.mean(((found.radiance - marched.radiance) / np.hypot(found.error, marched.error)) ** 2)):.2f}",
        f"{100 * np.mean(np.abs(z) < 2):.0f} %",
        f"{squares(ours) * slow / (squares(theirs) * quick):.1f}",
    )
    return f"| {name} | " + " | ".join(columns) + " |"


def mountain() -> Body:
    """A ridge of 2200 m, 9 km north of the observer."""
    x = np.linspace(-5e3, 5e3, 51)
    east, north = np.meshgrid(x, x + 9e3, indexing="ij")
    ridge = np.maximum(1 - np.hypot(east / 4e3, (north - 9e3) / 3e3), 0)
    height = 2200 * ridge**1.3 * (1 + 0.25 * np.sin(east / 450 + np.sin(north / 700)) * np.cos(north / 380)) - 60
    c = np.arange(50 * 51).reshape(50, 51)[:, :50].ravel()
    faces = np.concatenate([np.stack([c, c + 51, c + 52], 1), np.stack([c, c + 52, c + 1], 1)])
    rock = Mesh(vertices=np.stack([east, north, height], axis=-1).reshape(-1, 3), faces=faces)
    return Body(name="mountain", shape=rock, material=Lambert(albedo=0.25))


def landscape(name: str, sun: float) -> str:
    """One line of the mountain's table."""
    model: Any = skyscatter.load_model(name)  # type: ignore[call-overload]
    model = model.model_copy(update={"bodies": (mountain(),)})
    scene = model.scene(sun_elevation_deg=sun, sun_azimuth_deg=240, altitude="150 m")
    camera = skyscatter.Perspective(width=60, height=40, azimuth_deg=0, elevation_deg=5, fov_deg=50)
    columns = [f"{sun:.0f}"]
    runs = {}
    for sampling in ("march", None):
        images, began = [], 0.0
        for seed in range(PICTURES + 1):  # the first compiles
            if seed == 1:
                began = time.perf_counter()
            how = skyscatter.Path(samples=FEW, seed=seed, sampling=sampling)
            images.append(skyscatter.render(scene, camera, WAVELENGTHS, solver=how, threads=1))
        seconds = (time.perf_counter() - began) / PICTURES
        light = np.array([np.asarray(image.radiance) for image in images[1:]])
        error = np.array([np.asarray(image.standard_error) for image in images[1:]])
        mean, spread = light.mean(axis=0), light.std(axis=0, ddof=1)
        # Of one run beside the mean of the others, whose own error counts too.
        others = (mean * PICTURES - light) / (PICTURES - 1)
        inside = np.mean(np.abs(light - others) < 2 * np.hypot(error, spread / np.sqrt(PICTURES - 1)))
        noise = np.median(spread / mean), np.sqrt((spread**2).mean()) / mean.mean()
        runs[sampling] = mean.mean(axis=(0, 1)), np.sqrt((spread**2).sum(axis=(0, 1)) / PICTURES) / spread[..., 0].size
        columns += [f"{seconds:.1f} s", *(f"{100 * n:.1f} %" for n in noise), f"{100 * inside:.0f} %"]
    (one, chance), (two, _) = runs["march"], runs[None]
    columns.append(f"{100 * (two / one - 1).mean():+.2f} ± {100 * (chance / one).mean():.2f} %")
    return f"| {name} | " + " | ".join(columns) + " |"


def landscapes() -> None:
    """Print the mountain's table."""
    one = ["s", "median noise", "rms", "within 2"]
    print("| model | Sun | " + " | ".join(f"{part}, alone" for part in one), end=" | ")
    print(" | ".join(f"{part}, known" for part in one) + " | light, known over alone |")
    print("|---|---|" + "---|" * 9)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # walks alone in twilight are meant
        for name, sun in LANDSCAPES:
            print(landscape(name, sun), flush=True)


def main() -> None:
    """Print the tables that are asked for, or both."""
    asked = sys.argv[1:] or ["plain", "mountain"]
    if "plain" in asked:
        plain_skies()
    if "mountain" in asked:
        landscapes()


def plain_skies() -> None:
    """Print the table of plain skies."""
    print("| model | Sun | over orders | over path | standard error | z, root mean square | within 2 | time |")
    print("|---|---|---|---|---|---|---|---|")
    for name in MODELS:
        for sun in SUNS:
            print(row(name, sun), flush=True)


if __name__ == "__main__":
    main()
