"""Skies by the general walk among surfaces beside the sky's own walks and `orders`: deviations, coverage, time.

    python benchmarks/worlds.py

A box is buried out of sight, so that the sky is the plain one and the solver that of skies with bodies.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import skyscatter
from skyscatter.solvers.options import record_of
from skyscatter.surfaces import Body, Box, Lambert

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


def directions() -> Any:
    """Unit vectors of `ANGLES`, azimuth and elevation [degree]."""
    a, e = np.radians(np.array(ANGLES, float)).T
    return np.stack([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)], axis=-1)


def look(scene: skyscatter.Scene, solver: str = "path", threads: int | None = None, **options: Any) -> Any:
    """Light at the observer."""
    how = record_of(solver, **options)
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


def main() -> None:
    """Print the table."""
    print("| model | Sun | over orders | over path | standard error | z, root mean square | within 2 | time |")
    print("|---|---|---|---|---|---|---|---|")
    for name in MODELS:
        for sun in SUNS:
            print(row(name, sun), flush=True)


if __name__ == "__main__":
    main()
