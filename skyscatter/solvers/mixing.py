"""Where the repetition of a linear step leads, found from a few steps.

Light L that a step leaves as it is, L = S + K L, is the sum of all orders of scattering.  Repeating the step adds one
order each time.  But several lights and what the step made of them tell of the
way all together: they are weighed so that lights with the same weights change least.
Anderson (1965), J. ACM 12, 547; Walker & Ni (2011), SIAM J. Numer. Anal. 49, 1715.  Every wavelength has its own
weights, and so may parts of the moments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import ConvergenceError
from skyscatter.solvers.series import greatest_change
from skyscatter.solvers.sweeps import Problem, moment_weights, per_light
from skyscatter.solvers.transfer import Light

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Numbers = NDArray[np.int64]

#: Steps that are remembered, and their number at most.
MEMORY, MOST_STEPS = 6, 30
#: Greatest rate at which steps fall from one to the next that is reckoned with.
FASTEST = 0.995
#: A step that darkens a place by more than this is not believed: light is not negative.
DARKEST = 0.1
#: Squared size, in units of the largest, below which what one step tells beside the others is rounding.
LEAST_NEW = 1e-12
#: Nor what several steps together make of a place beyond this factor of what the last one made of it.
WILDEST = 3.0


def settled(step: Callable[[Light], Light], light: Light, goal: float, rate: float = 0.0) -> tuple[Light, float]:
    """The light that a linear step leaves as it is, and the rate at which steps fall at the slowest.

    Parameters
    ----------
    step : callable
    light : Light
        To begin with: not far from it.
    goal : float
        What may be missing, relatively: what a step changes, divided by one less the rate at which steps fall.
    rate : float
        The slowest that is known already; a few steps near the end do not tell.

    Raises
    ------
    ConvergenceError
        After 30 steps.
    """
    past = Past(Parts.of_the_mean(light.moments.shape[2]))
    before: tuple[Light, Light] | None = None
    for _ in range(MOST_STEPS):
        image = _believed(step(light), light)
        change = greatest_change((light.moments[:, :, 0], light.flux), (image.moments[:, :, 0], image.flux))
        if not np.isfinite(change):
            break
        if before is not None:
            rate = max(rate, _rate(before[0], light, before[1], image))
            if change / (1.0 - min(rate, FASTEST)) < goal:
                return image, rate
        before = light, image
        light = past.mixed(light, image)
    raise ConvergenceError(f"orders: light has not settled after {MOST_STEPS} steps; use solver path")


class Parts(NamedTuple):
    """Moments that are mixed together: each part has weights of its own."""

    part: Numbers  #: (moment,) number of the part that each belongs to; fluxes belong to the first, 0
    weight: Array  #: (moment,) of its changes, in units of the mean radiance

    @classmethod
    def of_the_mean(cls, moments: int) -> Parts:
        """All of so many moments as the mean radiance tells."""
        return cls(np.zeros(moments, np.int64), np.eye(1, moments)[0])

    @classmethod
    def of(cls, problem: Problem) -> Parts:
        """One for each order of azimuth: as good as apart, for air scatters alike about the vertical."""
        return cls(problem.moments.order, moment_weights(problem))


class Past:
    """What a few steps made, and what they changed, of which the next light is mixed.

    Images and steps are kept to a precision (`kind`): fine grids are large, and what is mixed is swept again.
    """

    def __init__(
        self, parts: Parts, kind: Any = np.float64, images: Sequence[Light] = (), steps: Sequence[Any] = ()
    ) -> None:
        self.parts, self.kind, self.images, self.steps = parts, kind, list(images), list(steps)

    @classmethod
    def of(cls, parts: Parts, kept: Mapping[str, Any]) -> Past:
        """What a checkpoint holds of it."""
        images = [Light(*pair) for pair in zip(kept["past_moments"], kept["past_flux"], strict=True)]
        return cls(parts, kept["past_steps"].dtype, images, list(kept["past_steps"]))

    def kept(self) -> dict[str, Any]:
        """What a checkpoint needs."""
        parts: dict[str, list[Any]] = {
            "past_moments": [image.moments for image in self.images],
            "past_flux": [image.flux for image in self.images],
            "past_steps": list(self.steps),
        }
        return {name: np.stack(part) if part else np.empty((0,), self.kind) for name, part in parts.items()}

    def mixed(self, light: Light, image: Light) -> Light:
        """Where the steps lead together with one more, from a light to its image."""
        step = (image.moments - light.moments).astype(self.kind)
        self.steps = [*self.steps[1 - MEMORY :], step]
        out = self._mixed(image, light.moments[:, :, 0]) if self.images else image
        self.images = [*self.images[2 - MEMORY :], Light(*(values.astype(self.kind) for values in image))]
        return out

    def _mixed(self, last: Light, mean: Array) -> Light:
        """The last image with what several steps make of it, by parts and wavelengths."""
        scale = per_light(mean)[:, :, None]
        moments, flux = np.empty_like(last.moments), last.flux
        for part in np.unique(self.parts.part):
            mine = np.flatnonzero(self.parts.part == part)
            telling = mine[self.parts.weight[mine] > 0]
            weight = self.parts.weight[telling, None]
            shares = _shares([step[:, :, telling] * scale * weight for step in self.steps])
            images = [image.moments[:, :, mine] for image in self.images]
            moments[:, :, mine] = _weighed(last.moments[:, :, mine], images, shares)
            if part == 0:
                flux = _weighed(last.flux, [image.flux for image in self.images], shares)
        tame, tame_flux = _tame(moments[:, :, 0], last.moments[:, :, 0]), _tame(flux, last.flux)
        return Light(np.where(tame[:, :, None], moments, last.moments), np.where(tame_flux, flux, last.flux))


def _shares(steps: Sequence[Array]) -> Array:
    """Shares of earlier ones among several steps (..., wavelength) that leave least of them all, (step, wavelength)."""
    *before, last = (step.reshape(-1, step.shape[-1]) for step in steps)
    rows = [last - step for step in before]
    system = np.array([[np.einsum("iw,iw->w", one, other) for other in rows] for one in rows])
    asked = np.array([np.einsum("iw,iw->w", row, last) for row in rows])
    out = np.zeros(asked.shape)
    for w in np.flatnonzero(np.einsum("iw,iw->w", last, last) > 0):
        out[:, w] = np.linalg.lstsq(system[:, :, w], asked[:, w], rcond=LEAST_NEW)[0]
    return out


def _weighed(last: Array, images: Sequence[Array], shares: Array) -> Array:
    """The last image with shares of earlier ones in its place, (..., wavelength)."""
    out = (1.0 - shares.sum(axis=0)) * last
    for share, image in zip(shares, images, strict=True):
        out += share * image
    return out


def _rate(light: Light, next_light: Light, image: Light, next_image: Light) -> float:
    """What a step makes of the difference of two lights, in units of it, at the wavelength where it makes most."""
    mean = image.moments[:, :, 0]
    scale = per_light(mean)
    before, now = (
        np.linalg.norm(((b.moments[:, :, 0] - a.moments[:, :, 0]) * scale).reshape(-1, mean.shape[-1]), axis=0)
        for a, b in ((light, next_light), (image, next_image))
    )
    return float(np.max(now / np.maximum(before, 1e-300)))


def _believed(image: Light, light: Light) -> Light:
    """What a step made of a light, but where it took nearly all of it away."""
    dark = image.moments[:, :, 0] < DARKEST * light.moments[:, :, 0]
    moments = np.where(dark[:, :, None], DARKEST * light.moments, image.moments)
    return Light(moments, np.maximum(image.flux, DARKEST * light.flux))


def _tame(found: Array, last: Array) -> Mask:
    return np.asarray((found * WILDEST > last) & (found < WILDEST * last))
