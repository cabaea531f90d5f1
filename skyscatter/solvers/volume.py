"""From a scene in three dimensions and wavelengths to the tables that the kernels read."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.compile import medium_optics, phase_cosines
from skyscatter.solvers.diffusion import guess_correction, mean_cosines
from skyscatter.solvers.guide import make_guide
from skyscatter.solvers.modes import MOMENTS, slowest_mode

if TYPE_CHECKING:
    from skyscatter.kernels.space import SpaceTable
    from skyscatter.kernels.volume import MeanPhase, VolumeTable
    from skyscatter.lights import PointStar
    from skyscatter.space import SpaceScene

Array = NDArray[np.float64]

#: Angles from a star at which the light around it is tabulated.
ANGLES = 129
#: Exponent of the light in the depths below which it is followed over many orders.
SLOW = 0.4


@lru_cache(maxsize=4)
def compile_volume(scene: SpaceScene, wavelengths: tuple[float, ...]) -> VolumeTable:
    """Tables of a scene at wavelengths [nm]; kept between calls."""
    from skyscatter.kernels.volume import VolumeTable
    from skyscatter.media.spacetables import medium_table

    wl = np.array(wavelengths)
    space = medium_table(scene.medium.fields)
    sigma_s, sigma_t, emission, phase, cdf = medium_optics(scene.medium, wavelengths)
    dims, emits = np.any(sigma_t > 0, axis=1), np.any(emission > 0, axis=1)
    space, clear = _with_columns(space, dims), _with_columns(space, emits & ~dims)
    distance = scene.view.distance
    # A star without a surface, given by its spectrum alone, stops growing where nothing could be seen of it.
    least = 1e-9 * float(np.linalg.norm(space.bound_step * space.cells))
    lights = [
        (
            np.array(star.position),
            False,
            least if star.temperature is None else star.radius_m(distance),
            _intensity(star, wl, distance),
        )
        for star in scene.stars
    ]
    lights += [(light.towards, True, 0.0, light.spectral_irradiance(wl)) for light in scene.parallel]
    power = np.array([power for *_, power in lights], float).reshape(-1, wl.size)
    background = scene.background_radiance(wl)
    decay, shape, around = _modes(sigma_s, sigma_t, phase)
    table = VolumeTable(
        space=space,
        clear=clear,
        sigma_s=sigma_s,
        sigma_t=sigma_t,
        emission=emission,
        phase=phase,
        phase_cdf=cdf,
        mean=_mean_phase(sigma_s, phase),
        place=np.array([place for place, *_ in lights], float).reshape(-1, 3),
        distant=np.array([distant for _, distant, *_ in lights], bool),
        size=np.array([size for *_, size, _ in lights], float),
        power=power,
        share=(power / np.maximum(power.sum(axis=0), 1e-300)).mean(axis=1),
        background=background,
        emits=bool(np.any(emission)),
        glows=bool(np.any(emission) or np.any(background)),
        decay=decay,
        shape=shape,
        shape_cdf=_distribution(shape),
        around=around,
        around_cdf=_distribution(around),
        floor=np.zeros(wl.size),
        rate=_rates(sigma_t, emission, space.bound_step * space.cells),
        tracking=0,
        onward=sigma_s[:, wl.size // 2] * mean_cosines(phase)[:, wl.size // 2],
        recall=1.0,
        correction=np.zeros((0, 0, 0, wl.size)),
        guide=np.zeros((len(lights), 2, 2, 2, len(sigma_s))),
        focus=np.full((len(lights), 3, 2), -1.0),
    )
    guide, focus = make_guide(table)
    table = table._replace(guide=guide, focus=focus)
    table = table._replace(floor=_floor(table), recall=_recall(table))
    return table._replace(correction=guess_correction(table)) if table.decay[wl.size // 2] < SLOW else table


def _with_columns(space: SpaceTable, wanted: NDArray[np.bool_]) -> SpaceTable:
    """The medium with columns of some of its components (component,) alone."""
    from skyscatter.kernels.codes.space import TRANSPARENT

    return space._replace(method=np.where(np.repeat(wanted, np.diff(space.term_start)), space.method, TRANSPARENT))


def _mean_phase(sigma_s: Array, phase: Array) -> MeanPhase:
    """Scattering and phase functions averaged over the wavelengths, these by the light scattered."""
    from skyscatter.kernels.volume import MeanPhase

    mean = sigma_s.mean(axis=1)
    share = np.where(mean[:, None] > 0, sigma_s, 1.0)
    values = np.einsum("cw,caw->ca", share / share.sum(axis=1, keepdims=True), phase)
    steps = 0.5 * (values[:, 1:] + values[:, :-1]) * -np.diff(phase_cosines())
    cdf = np.concatenate([np.zeros((len(mean), 1)), np.cumsum(steps, axis=1)], axis=1)
    return MeanPhase(mean[:, None], values[:, :, None].copy(), (cdf / cdf[:, -1:])[:, None, :].copy())


def _intensity(star: PointStar, wl: Array, distance: float) -> Array:
    """Radiant intensity of a star [W sr-1 nm-1]."""
    return star.spectral_luminosity(wl, distance) / (4 * np.pi)


def _distribution(density: Array) -> Array:
    """Distribution function of a density that is linear between equally spaced nodes."""
    steps = 0.5 * (density[1:] + density[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()


def _around(mean: Array) -> Array:
    """Density of the angle theta from a star in which a point near it sees scattered light [rad-1].

    Without extinction a ray at that angle gathers (1 / sin theta) int p(cos T) dT from theta to pi, since dt / d^2 is
    dT / (r sin theta) and the scattering angle T grows from theta to pi along it; 1 / sin theta goes with the solid
    angle.
    """
    theta = np.linspace(0.0, np.pi, ANGLES)
    # Sums from pi down, on the tables' own angles.
    nodes = np.arccos(phase_cosines())
    steps = 0.5 * (mean[1:] + mean[:-1]) * np.diff(nodes)
    if not steps.sum() > 0:  # nothing scatters
        return np.full(ANGLES, 1 / np.pi)
    beyond = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    values = np.interp(theta, nodes, beyond)
    values = np.maximum(values, 1e-2 * values.mean())
    return values / np.trapezoid(values, theta)


def _modes(sigma_s: Array, sigma_t: Array, phase: Array) -> tuple[Array, Array, Array]:
    """Exponents (wavelength,) of light in the depths of the medium, its shape, and that of light around near stars.

    For all components equally dense; the shape is that of the middle wavelength, the last for the mean of all.
    """
    mu = phase_cosines()
    share = sigma_s / np.maximum(sigma_s.sum(axis=0), 1e-300)
    omega = sigma_s.sum(axis=0) / np.maximum(sigma_t.sum(axis=0), 1e-300)
    polynomials = np.polynomial.legendre.legvander(mu, MOMENTS - 1)
    mean = np.einsum("cw,caw->wa", share, phase)
    moments = -2 * np.pi * np.trapezoid(mean[:, :, None] * polynomials, mu, axis=1)
    moments[moments[:, 0] <= 0, 0] = 1.0  # nothing scatters
    modes = [slowest_mode(float(o), m / m[0]) for o, m in zip(omega, moments, strict=True)]
    return np.array([kappa for kappa, _ in modes]), modes[len(modes) // 2][1], _around(mean.mean(axis=0))


def _rates(sigma_t: Array, emission: Array, size: Array) -> Array:
    """Rates of tentative collisions per unit density; a component that only shines needs some of them too."""
    least = np.where(np.any(emission > 0, axis=1), 4 / np.linalg.norm(size), 0.0)
    return np.maximum(sigma_t.max(axis=1), least)


def _recall(table: VolumeTable) -> float:
    """Share of the scattered light of distant lights that knows their direction where it enters.

    The rest has diffused in the medium: the more, the more transport free paths it is deep and the less it absorbs.
    """
    middle = table.background.size // 2
    across = table.guide[table.distant] @ (table.sigma_s[:, middle] - table.onward)
    return 1.0 / (1.0 + (1.0 - float(table.decay[middle])) * float(across.max(initial=0.0)))


def _floor(table: VolumeTable) -> Array:
    """Irradiance that is everywhere: light from outside and emission, and a trace of the lights' where it is least."""
    size = np.linalg.norm(table.space.bound_step * table.space.cells)
    emitted = np.max(table.space.upper, axis=0) @ table.emission * size
    floor = 4 * np.pi * (table.background + 0.1 * emitted)
    if len(table.power):
        far = np.where(table.distant, 1.0, size)[:, None, None, None, None] * table.guide @ table.sigma_t
        depth = far.reshape(len(table.power), -1, table.background.size).max(axis=1)
        fall = np.where(table.distant, 1.0, 1 / size**2)[:, None]
        floor += 1e-2 * np.sum(table.power * fall * np.exp(-table.decay * depth), axis=0)
    return np.where(floor > 1e-280, floor, 1e-280 if len(table.power) else 1.0)
