"""Light that is scattered more than once, for estimates that are made with single scattering.

The images of an estimate by the solver ``path`` less those of the light scattered once is what the linear step leaves
out.  It is taken off the data, the estimate is made again, and so on: a few rounds, for where the optical depth is
about one the light scattered more than once changes little with small changes of the density.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.views import Stack
from skyscatter.inversion.voxelscene import VoxelFrame
from skyscatter.media.medium import Component

if TYPE_CHECKING:
    from skyscatter.media.voxels import VoxelGrid
    from skyscatter.space import SpaceScene

Array = NDArray[np.float64]

#: Independent runs whose spread tells the error; each has its own random numbers.
RUNS = 4


def with_density(scene: SpaceScene, frame: VoxelFrame, density: Array, interpolation: str = "linear") -> SpaceScene:
    """The scene with voxels (component, x, y, z) for its components' densities; a unit of them does the same."""
    components = tuple(
        _replaced(c, frame.grid(np.maximum(rho, 0.0), interpolation=interpolation))
        for c, rho in zip(scene.medium.components, density, strict=True)
    )
    return scene.model_copy(update={"medium": scene.medium.model_copy(update={"components": components})})


def _replaced(component: Component, density: VoxelGrid) -> Component:
    """Another density with the same optics.

    Optics that are stated by a depth through the whole component are so much for a unit of density: for another
    density the weight makes up for it.
    """
    before, after = (
        sum(float(v[0]) for v in component.optics.coefficients([550.0], d.reference_column())[:2])
        for d in (component.density, density)
    )
    ratio = before / after if after > 0 and np.isfinite(after) else 1.0
    if ratio == 1.0:
        return component.model_copy(update={"density": density})
    if component.emission != 0.0:
        rule = "give the optics by coefficients, not by a depth, where the component shines as well"
        raise DomainError("emission", component.name, rule)
    return component.model_copy(update={"density": density, "weight": component.weight * ratio})


def multiple_light(
    scene: SpaceScene,
    stack: Stack,
    wavelengths: Array,
    *,
    samples: int,
    seed: int,
    threads: int | None = None,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[Array, Array]:
    """Light scattered more than once, and its standard error, for every pixel of a stack.

    Parameters
    ----------
    scene : SpaceScene
    stack : Stack
        One ray through each pixel is followed, another one of the pixel's in each run.
    wavelengths : (wavelength,)
        [nm]
    samples : int
        Walks per pixel in all.
    seed : int
    threads : int, optional
    executor : int, concurrent.futures.Executor or distributed.Client, optional
        As for `skyscatter.radiance`.
    progress : callable, optional

    Returns
    -------
    mean, standard_error : ndarray, shape (pixel, wavelength)
    """
    from skyscatter.solvers.options import Path
    from skyscatter.solvers.run import radiance

    runs: list[Array] = []
    for k in range(RUNS):
        ray = np.arange(len(stack.data)) * stack.rays + (k * stack.rays) // RUNS
        answer = radiance(
            scene, stack.origins[ray], stack.directions[ray], wavelengths,
            solver=Path(samples=max(samples // RUNS, 2), seed=seed + k), parts=True, threads=threads, executor=executor,
        )  # fmt: skip
        runs.append(answer.layers["multiple"])
        if progress is not None:
            progress((k + 1) / RUNS)
    values = np.array(runs)
    mean, error = values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(RUNS)
    # Four runs know each error to 40 % only; the views' mean square steadies it.
    steady = [np.broadcast_to(np.sqrt(np.mean(e**2, axis=(0, 1), keepdims=True)), e.shape) for e in stack.split(error)]
    flat = np.concatenate([e.reshape(-1, e.shape[2]) for e in steady])
    return mean, np.sqrt(0.5 * (error**2 + flat**2))
