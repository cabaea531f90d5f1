"""Where the repetition of a linear step leads, found from a few steps.

Light L that a step leaves as it is, L = S + K L, is the sum of all orders of scattering.  Repeating the step adds one
order each time.  But several lights and what the step made of them tell of the
way all together: they are weighed so that lights with the same weights change least.
Anderson (1965), J. ACM 12, 547; Walker & Ni (2011), SIAM J. Numer. Anal. 49, 1715.  Every wavelength has its own
weights.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import ConvergenceError
from skyscatter.solvers.series import greatest_change
from skyscatter.solvers.sweeps import FAINTEST
from skyscatter.solvers.transfer import Light

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Steps that are remembered, and their number at most.
MEMORY, MOST_STEPS = 6, 30
#: Greatest rate at which steps fall from one to the next that is reckoned with.
FASTEST = 0.995
#: A step that darkens a place by more than this is not believed: light is not negative.
DARKEST = 0.1
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
    past = Past()
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


class Past:
    """What a few steps made, and what they changed, of which the next light is mixed."""

    def __init__(self, images: Sequence[Light] = (), steps: Sequence[Array] = ()) -> None:
        self.images, self.steps = list(images), list(steps)  #: the latter of the mean radiance, (node, sun, wavelength)

    @classmethod
    def of(cls, kept: Mapping[str, Array]) -> Past:
        """What a checkpoint holds of it."""
        images = [Light(*pair) for pair in zip(kept["past_moments"], kept["past_flux"], strict=True)]
        return cls(images, list(kept["past_steps"]))

    def kept(self) -> dict[str, Array]:
        """What a checkpoint needs."""
        moments, flux = ([image[k] for image in self.images] for k in (0, 1))
        parts = {"past_moments": moments, "past_flux": flux, "past_steps": self.steps}
        return {name: np.stack(part) if part else np.empty((0,)) for name, part in parts.items()}

    def mixed(self, light: Light, image: Light) -> Light:
        """Where the steps lead together with one more, from a light to its image."""
        self.steps = [*self.steps[1 - MEMORY :], image.moments[:, :, 0] - light.moments[:, :, 0]]
        self.images = [*self.images[1 - MEMORY :], image]
        return _mixed(self.images, self.steps, light.moments[:, :, 0])


def _rate(light: Light, next_light: Light, image: Light, next_image: Light) -> float:
    """What a step makes of the difference of two lights, in units of it, at the wavelength where it makes most."""
    mean = image.moments[:, :, 0]
    scale = np.where(mean > FAINTEST * mean.max(), 1.0, 0.0) / np.maximum(mean, 1e-300)
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


def _mixed(images: list[Light], steps: list[Array], mean: Array) -> Light:
    """Where several steps lead: what they made, and what they changed of the mean radiance (node, sun, wavelength)."""
    last = images[-1]
    if len(images) == 1:
        return last
    scale = np.where(mean > FAINTEST * mean.max(), 1.0, 0.0) / np.maximum(mean, 1e-300)
    every = np.stack(steps) * scale
    moments, flux = last.moments.copy(), last.flux.copy()
    for w in range(mean.shape[-1]):
        rows = every[..., w].reshape(len(steps), -1)
        length = np.linalg.norm(rows[-1])
        if length == 0:
            continue
        shares = np.linalg.lstsq((rows[-1] - rows[:-1]).T / length, rows[-1] / length, rcond=1e-8)[0]
        for share, image in zip(shares, images[:-1], strict=True):
            moments[..., w] -= share * (last.moments[..., w] - image.moments[..., w])
            flux[..., w] -= share * (last.flux[..., w] - image.flux[..., w])
    tame = _tame(moments[:, :, 0], last.moments[:, :, 0])
    return Light(np.where(tame[:, :, None], moments, last.moments), np.where(_tame(flux, last.flux), flux, last.flux))


def _tame(found: Array, last: Array) -> Mask:
    return np.asarray((found * WILDEST > last) & (found < WILDEST * last))
