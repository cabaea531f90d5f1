"""Several rays for every pixel: edges of surfaces become smooth.

A solver is wrapped into one that solves pixels: it sends a square of evenly placed rays through each and returns their
mean.  Walks of different rays are independent, and so the squared errors add; where a solver works in passes (see
`skyscatter.solvers.passes`) the mean is taken within each pass, and their spread is that of pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.solvers.base import Answer, Array, Asked, Rays
from skyscatter.solvers.options import USUAL_WALKS

#: Rays along each side of a pixel at most.
MOST = 16


def check_subpixels(subpixels: int) -> None:
    """Refuse numbers of rays that make no sense."""
    if not isinstance(subpixels, (int, np.integer)) or not 1 <= subpixels <= MOST:
        raise DomainError("subpixels", subpixels, f"rays along each side of a pixel, a whole number from 1 to {MOST}")


def share_of(samples: int | None, count: int) -> int:
    """Samples of each of so many rays of a pixel, which share them, rounded up."""
    return -(-(USUAL_WALKS if samples is None else int(samples)) // count)


def fine_directions(camera: Any, observer: Any, grid: Array, subpixels: int) -> Array:
    """Directions through the middles of the parts of each pixel, shape (height, width, part, 3).

    Parts outside of a round field are replaced by the middle of their pixel (`grid`).
    """
    inner = (np.arange(subpixels) + 0.5) / subpixels - 0.5
    x = np.arange(camera.width)[:, None] + np.tile(inner, subpixels)
    y = np.arange(camera.height)[:, None, None] + np.repeat(inner, subpixels)
    parts = camera.through(x, y, observer)
    seen = np.isfinite(camera.pixel(parts, observer)[0])
    return np.where(seen[..., None], parts, grid[:, :, None])


@dataclass(frozen=True)
class Subpixels:
    """A solver of pixels made of one of rays; it has the same functions."""

    module: Any
    directions: Array  #: (pixel, part, 3) of all pixels of the picture, in their order
    count: int  #: parts of a pixel

    @property
    def PASSES(self) -> bool:  # noqa: N802 - the name that solvers have
        """Whether the solver works in passes."""
        return bool(getattr(self.module, "PASSES", False))

    @property
    def TILE_RAYS(self) -> int:  # noqa: N802
        """Pixels in a tile at most."""
        from skyscatter.solvers.tiles import TILE_RAYS

        return max(getattr(self.module, "TILE_RAYS", TILE_RAYS) // self.count, 1)

    def shared(self, asked: Asked[Any]) -> Asked[Any]:
        """What is asked of each part: they share the samples, and the noise of their mean is what counts.

        Raises
        ------
        DomainError
            For fewer samples than each part needs, two, to know its error.
        """
        if self.PASSES:
            return asked
        if asked.how.noise is not None:
            noise = min(asked.how.noise * self.count**0.5, 0.999)
            return replace(asked, how=replace(asked.how, noise=noise))
        samples = USUAL_WALKS if asked.how.samples is None else asked.how.samples
        if samples < 2 * self.count:
            rule = f"with {self.count} rays a pixel at least {2 * self.count}; give more samples, or fewer subpixels"
            raise DomainError("samples", samples, rule)
        return replace(asked, how=replace(asked.how, samples=share_of(samples, self.count)))

    def check(self, asked: Asked[Any]) -> None:
        """Refuse what the solver refuses."""
        self.module.check(self.shared(asked))

    def passes(self, asked: Asked[Any]) -> int:
        """Passes at most."""
        return int(self.module.passes(asked))

    def prepare(
        self,
        scene: Any,
        rays: Rays,
        wavelengths: Array,
        asked: Asked[Any],
        threads: int,
        progress: Callable[[float], None] | None,
    ) -> Any:
        """What the solver prepares for all rays."""
        return self.module.prepare(scene, self._parts(rays), wavelengths, self.shared(asked), threads, progress)

    def solve(self, context: Any, rays: Rays, asked: Asked[Any]) -> Answer:
        """Radiance of pixels, one "ray" for each."""
        return self._mean(self.module.solve(context, self._parts(rays), self.shared(asked)))

    def solve_pass(self, context: Any, rays: Rays, number: int, asked: Asked[Any]) -> Answer:
        """Radiance of pixels from one pass."""
        return self._mean(self.module.solve_pass(context, self._parts(rays), number, asked))

    def _parts(self, rays: Rays) -> Rays:
        """The rays of all parts of some pixels, part by part."""
        directions = self.directions[rays.numbers].reshape(-1, 3)
        origins = np.repeat(rays.origins, self.count, axis=0)
        numbers = (rays.numbers[:, None] * self.count + np.arange(self.count)).ravel()
        return Rays(np.ascontiguousarray(origins), np.ascontiguousarray(directions), numbers)

    def _mean(self, answer: Answer) -> Answer:
        def split(values: NDArray[Any]) -> NDArray[Any]:
            return values.reshape(-1, self.count, *values.shape[1:])

        def combined(name: str, values: Array) -> Array:
            parts = split(values)
            is_error = name.endswith("_error")
            return np.sqrt((parts**2).sum(axis=1)) / self.count if is_error else parts.mean(axis=1)

        layers = {name: combined(name, values) for name, values in answer.layers.items()}
        error = combined("radiance_error", answer.standard_error)
        return Answer(split(answer.radiance).mean(axis=1), error, layers, split(answer.samples).sum(axis=1))
