"""Multiple scattering in voxels by random walks, with the derivatives for all voxels along the same walks.

`VoxelModel` brings the light that is scattered once, without noise; walks bring the rest, and what a change of any
voxel changes of it.  Lights are the stars and the distant lights; light that the medium itself or what lies outside
gives off is not scattered, as in `VoxelModel`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.brief import Brief

if TYPE_CHECKING:
    from skyscatter.inversion.voxelimage import VoxelModel
    from skyscatter.kernels.adjoint.replay import Draws, Walk

Array = NDArray[np.float64]

#: Independent batches of walks, from whose spread the standard errors come.
BATCHES = 8
#: Collisions of a walk at most; roulette ends nearly all of them long before.
MOST_COLLISIONS = 256


@dataclass(frozen=True, repr=False)
class WalkedLight(Brief):
    """Light of the second and all higher orders of scattering, and derivatives of a number made of it.

    Attributes
    ----------
    light, light_error : ndarray, shape (ray, wavelength)
        [W m-2 sr-1 nm-1] and its standard error.
    density, density_error : ndarray, shape (component, x, y, z)
        Derivatives of sum(weights light) with respect to the densities, and their standard errors.

    Examples
    --------
    Standard errors fall with the root of the number of walks.

    >>> import numpy as np
    >>> from skyscatter.inversion import VoxelFrame, VoxelLights, VoxelModel, VoxelOptics, multiple_scattering
    >>> frame, lights = VoxelFrame.cube(4, 2.0), VoxelLights.stars([[0, 0, 0]], [[4 * np.pi]])
    >>> model = VoxelModel(frame, VoxelOptics.make(1.0, 1.0), lights, np.zeros(1))
    >>> rho, ray = np.ones(frame.shape), ([[1.5, 0.0, -10.0]], [[0, 0, 1.0]])
    >>> few, many = (multiple_scattering(model, rho, *ray, weights=1.0, samples=n) for n in (64, 8192))
    >>> bool(many.light_error[0, 0] < few.light_error[0, 0])
    True
    >>> many.density.shape  # component, x, y, z
    (1, 4, 4, 4)
    """

    light: Array
    light_error: Array
    density: Array
    density_error: Array


def multiple_scattering(
    model: VoxelModel,
    density: ArrayLike,
    origins: ArrayLike,
    directions: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    samples: int = 64,
    seed: int = 0,
) -> WalkedLight:
    """Light scattered more than once along rays, and the derivatives of sum(weights light) for all voxels.

    Every estimate is unbiased but for the steps of the quadrature along legs (`VoxelModel.step`).  For the gradient of
    a misfit, weights must not come from the same walks: take them from a run with another seed.

    Parameters
    ----------
    model : VoxelModel
    density : array_like, shape (component, x, y, z) or (x, y, z)
    origins, directions : array_like, shape (ray, 3)
        [m], and unit vectors.
    weights : array_like, shape (ray, wavelength), optional
        Derivative of the number with respect to the light.  Without, no derivatives are made.
    samples : int
        Walks per ray, shared out among `BATCHES` batches.
    seed : int
        Same seed, same numbers, whatever the threads.

    Returns
    -------
    WalkedLight

    Raises
    ------
    DomainError
        For shapes that do not fit, fewer walks than batches, and densities that are constant within cells.

    Examples
    --------
    A cube of fog around a star, of the optical depth 2 from the star to its sides: along this ray more light has been
    scattered several times than once.

    >>> import numpy as np
    >>> from skyscatter.inversion import VoxelFrame, VoxelLights, VoxelModel, VoxelOptics, multiple_scattering
    >>> frame, lights = VoxelFrame.cube(4, 2.0), VoxelLights.stars([[0, 0, 0]], [[4 * np.pi]])
    >>> model = VoxelModel(frame, VoxelOptics.make(1.0, 1.0), lights, np.zeros(1))
    >>> rho, ray = np.ones(frame.shape), ([[1.5, 0.0, -10.0]], [[0, 0, 1.0]])
    >>> more = multiple_scattering(model, rho, *ray, samples=4096)
    >>> bool(more.light[0, 0] > model.image(rho, *ray)[0, 0])
    True
    """
    from skyscatter.inversion.voxelimage import _added, _like, _rays
    from skyscatter.kernels.adjoint.replay import walk_rays

    if samples < BATCHES:
        raise DomainError("samples", samples, f"at least {BATCHES}, one for each batch")
    o, d = _rays(origins, directions)
    shape = (len(o), model.background.size)
    if model.interpolation != "linear":
        raise DomainError("interpolation", model.interpolation, "must be linear for walks through voxels")
    derive = weights is not None
    weight = _like("weights", 0.0 if weights is None else weights, shape)
    ready = model.prepare(density)
    table, draws, walks = model._table(ready), _draws(model, ready.density), -(-int(samples) // BATCHES)
    light, slopes = np.zeros((BATCHES, *shape)), []
    for batch in range(BATCHES):

        def work(part: slice, _: int, batch: int = batch) -> list[Array]:
            sums = [np.zeros_like(ready.density), np.zeros_like(ready.toward)]
            walk_rays(
                table, draws, o[part], d[part], np.int64(part.start), np.int64(seed), np.int64(batch), np.int64(walks),
                weight[part], np.bool_(derive), _walk(model), light[batch, part], *sums,
            )  # fmt: skip
            return sums

        parts = model._in_parts(len(o), work, ready.density.nbytes + ready.toward.nbytes)
        if derive:
            nodes, toward = _added(parts)
            slopes.append(model._inner(nodes + model._columns_back(toward)))
    found = np.stack(slopes) if derive else np.zeros((BATCHES, *model.shape))
    return WalkedLight(*_mean(light), *_mean(found))


def _mean(batches: Array) -> tuple[Array, Array]:
    """Mean over batches and its standard error."""
    return batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(len(batches))


def _draws(model: VoxelModel, density: Array) -> Draws:
    """What directions are drawn from: mean phase functions, and their distribution functions."""
    from skyscatter.kernels.adjoint.replay import Draws

    optics = model.optics
    share = np.where(optics.sigma_s.sum(axis=1, keepdims=True) > 0, optics.sigma_s, 1.0)
    phase = np.einsum("cw,caw->ca", share / share.sum(axis=1, keepdims=True), optics.phase)
    mu = 1 - 2 * (np.arange(phase.shape[1]) / (phase.shape[1] - 1)) ** 2
    steps = np.pi * (phase[:, 1:] + phase[:, :-1]) * -np.diff(mu)
    cdf = np.concatenate([np.zeros((len(phase), 1)), np.cumsum(steps, axis=1)], axis=1)
    total = cdf[:, -1:]
    # The scale of densities where there is something; any number will do where there is nothing at all.
    filled = np.count_nonzero(density, axis=0)
    scale = np.where(filled > 0, density.sum(axis=0) / np.maximum(filled, 1), 1.0)
    return Draws(optics.sigma_s.mean(axis=1), phase / total, cdf / total, scale)


def _walk(model: VoxelModel) -> Walk:
    """Scratch of a walk."""
    from skyscatter.kernels.adjoint.replay import Walk

    (c, w), k = model.optics.sigma_t.shape, MOST_COLLISIONS
    return Walk(
        np.zeros((k, 3)), np.zeros((k, 3)), np.zeros((k, 3)), np.zeros(k), np.zeros(k), np.zeros(k, np.int64),
        np.zeros(k), np.zeros((k, c)), np.zeros((k, w)), np.zeros(w), np.zeros(w), np.zeros(c), np.zeros(w),
        np.zeros(c), np.zeros((3, w)), np.zeros(c), np.zeros(1, np.int64), np.zeros(1, np.uint64),
    )  # fmt: skip
