"""Solvers against each other: runs of about equal time, and their errors against a long run."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

import skyscatter
from skyscatter.solvers.options import record_of


@dataclass(frozen=True)
class Way:
    """A solver and its options, by a short name."""

    name: str
    solver: str
    options: dict[str, Any]


PATH = Way("path", "path", {})


def photon_ways(**options: Any) -> tuple[Way, ...]:
    """The three estimators of `photons`."""
    return tuple(Way(name, "photons", {"estimator": name, **options}) for name in ("points", "paths", "both"))


@dataclass(frozen=True)
class Runs:
    """Runs of one way: samples (walks or passes) and seconds of each, images (run, ray, wavelength), stated errors."""

    way: Way
    samples: int
    seconds: float
    images: Any
    stated: Any

    def error(self, truth: Any, noise: Any, kept: Any) -> float:
        """Root mean square error of a run over the mean light, the truth's own taken off."""
        squares = ((self.images - truth) ** 2).mean(axis=0) - noise**2
        return float(np.sqrt(max(squares[kept].mean(), 0.0)) / truth[kept].mean())

    def spread(self, truth: Any, kept: Any) -> float:
        """The same from the standard errors that the solver states: noise without bias."""
        return float(np.sqrt((self.stated[:, kept] ** 2).mean()) / truth[kept].mean())

    def ratio(self, truth: Any, noise: Any, kept: Any) -> tuple[float, float]:
        """Mean light over that of the truth, and its standard error."""
        whole = truth[kept].sum()
        # Light of a pass is shared by all pixels: their errors are not independent, so the runs tell.
        each = self.images[:, kept].sum(axis=(1, 2)) / whole
        own = float(np.sqrt((noise[kept] ** 2).sum()) / whole)
        return float(each.mean()), float(np.hypot(each.std(ddof=1) / np.sqrt(len(each)), own))


def render(
    scene: Any, rays: Any, wavelengths: Any, way: Way, samples: int, seed: int, threads: int
) -> tuple[float, Any]:
    """Seconds of the processor by thread, which other work on the machine does not lengthen, and the answer."""
    start = time.process_time()
    solver = record_of(way.solver, samples=samples, seed=seed, **way.options)
    answer = skyscatter.radiance(scene, rays[0], rays[1], wavelengths, solver=solver, threads=threads)
    return (time.process_time() - start) / threads, answer


def samples_for(scene: Any, rays: Any, wavelengths: Any, way: Way, budget: float, threads: int) -> int:
    """Walks or passes that take about `budget` seconds: powers of two times 16 for walks, at least 4 passes."""
    least = 16 if way.solver == "path" else 4
    render(scene, rays, wavelengths, way, least, 10**6, threads)  # compiles, and makes tables
    samples = least
    while True:
        spent, _ = render(scene, rays, wavelengths, way, samples, 10**6 + 1, threads)
        if spent > 0.25 * budget or samples >= 2**20:
            break
        samples *= 2
    wanted = max(least, samples * budget / spent)
    return int(-(-wanted // 16) * 16) if way.solver == "path" else round(wanted)


def runs(
    scene: Any, rays: Any, wavelengths: Any, way: Way, samples: int, repeats: int, threads: int, first: int = 0
) -> Runs:
    """Several runs with other seeds."""
    spent, images, stated = [], [], []
    for seed in range(first, first + repeats):
        took, answer = render(scene, rays, wavelengths, way, samples, seed, threads)
        spent.append(took)
        images.append(answer.radiance)
        stated.append(answer.standard_error)
    return Runs(way, samples, statistics.median(spent), np.array(images), np.array(stated))
