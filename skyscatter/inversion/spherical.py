"""Spherical objects from images: one radial profile from all pixels, with the centre and the background fitted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import ConvergenceError, DomainError
from skyscatter.inversion.abel import background_error, band_factor, nonnegative_moments
from skyscatter.inversion.brief import Brief
from skyscatter.inversion.pixels import Pixels, border_distance, check_centre, checked_image, symmetric_centre
from skyscatter.inversion.smoothness import ORDERS, Posterior, Smooth, compressed
from skyscatter.inversion.splines import projection_matrix

Array = NDArray[np.float64]

_SUBPIXELS = 3  #: along each side, over which a pixel is averaged (midpoint rule)
_TABLE = 1500  #: distances at which projections are tabulated, linear between them
_LENGTHS = 8
_MOST_NODES = 64


@dataclass(frozen=True, repr=False)
class SphericalResult(Brief):
    """A radial density profile of an image.

    Attributes
    ----------
    radius : ndarray, shape (node,)
        In the unit of `pixel_size`.
    density, standard_deviation, lower, upper : ndarray, shape (node,)
        As in `AbelResult`; in units of the image over those of `pixel_size`.
    covariance : ndarray, shape (node, node)
        The doubt about the centre included.
    free_density, free_covariance : ndarray, shape (node,), (node, node)
        The same without non-negativity: what integrals over the whole are made of.  That a density is nowhere negative
        lifts it a little wherever nothing is, and far out there is much volume.
    centre : tuple of float
        (x, y) [pixel]
    centre_error : tuple of float
        Standard deviations [pixel]; 0 where the centre was given.
    centre_covariance : ndarray, shape (2, 2)
    background, background_error : float
        In units of the image.
    fitted_image, residual : ndarray, shape (y, x)
        Also where pixels are masked; the residual is NaN there.
    noise : float
        Estimated standard deviation of a pixel; with `sigma` given, the factor by which the residual exceeds it.
    degrees_of_freedom : float
    order, length : float
        Of the prior.

    Examples
    --------
    The centre is fitted where it is not given, and lengths are in the unit of `pixel_size`.

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y, x = np.mgrid[:24, :24]
    >>> image = np.maximum(1 - ((x - 12.2) ** 2 + (y - 11) ** 2) / 64, 0) ** 1.5
    >>> found = inversion.invert_spherical(image, 0.01, averaged=False, pixel_size=0.5)
    >>> f"{found.centre[0]:.1f}, {found.centre[1]:.1f}"
    '12.2, 11.0'
    >>> bool(max(found.centre_error) < 0.1)
    True
    >>> found.density.shape == found.radius.shape, found.residual.shape
    (True, (24, 24))
    """

    radius: Array
    density: Array
    standard_deviation: Array
    covariance: Array
    lower: Array
    upper: Array
    band_factor: float
    free_density: Array
    free_covariance: Array
    centre: tuple[float, float]
    centre_error: tuple[float, float]
    centre_covariance: Array
    background: float
    background_error: float
    fitted_image: Array
    residual: Array
    noise: float
    degrees_of_freedom: float
    order: float
    length: float


class _Geometry(NamedTuple):
    pixels: Pixels
    nodes: Array  # [pixel]
    table: Array  # (distance, node) projections
    background: bool
    subpixels: int


def invert_spherical(
    image: ArrayLike,
    sigma: ArrayLike | float | None = None,
    mask: ArrayLike | None = None,
    *,
    centre: tuple[float, float] | None = None,
    edge: float | None = None,
    pixel_size: float = 1.0,
    background: bool = True,
    averaged: bool = True,
    samples: int = 256,
    seed: int = 0,
    progress: Callable[[float], Any] | None = None,
) -> SphericalResult:
    """Density of a spherical, optically thin object from its image.

    The centre is where the data's marginal likelihood is greatest, its covariance
    the inverse of the second derivatives there.

    Parameters
    ----------
    image : array_like, shape (y, x)
        Brightness or column; NaN where there is no value.
    sigma : array_like or float, optional
        Standard deviation of each pixel; estimated, the same for all, when not given.
    mask : array_like of bool, shape (y, x), optional
        True for pixels that are left out.
    centre : (x, y), optional
        [pixel]; fitted when not given.
    edge : float, optional
        Radius beyond which there is nothing, in the unit of `pixel_size`; from the centre to the nearest border when
        not given.
    pixel_size : float
        Length of a pixel's side, in any unit.
    background : bool
        Whether a uniform background is fitted.
    averaged : bool
        Whether pixels are averages over their area, as a detector's; False for values at their middles, as rendered.
    samples, seed, progress
        As in `abel_invert`.

    Returns
    -------
    SphericalResult

    Raises
    ------
    DomainError
        For an image, sigma or mask that cannot be used, and a centre or edge too near to the image's border.
    ConvergenceError
        If the centre is not found.

    Examples
    --------
    A ball of the density 1 - (r / 8)^2 beneath a background of 5, seen in pixels:

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y, x = np.mgrid[:24, :24] - 11.5
    >>> image = 5 + 32 / 3 * np.maximum(1 - (x**2 + y**2) / 64, 0) ** 1.5
    >>> found = inversion.invert_spherical(image, 0.1, centre=(11.5, 11.5), averaged=False)
    >>> np.interp([0, 5], found.radius, found.density).round(1)
    array([1. , 0.6])
    >>> f"{found.background:.1f}"
    '5.0'
    """
    pixels = checked_image(image, sigma, mask)
    if not (np.isfinite(pixel_size) and pixel_size > 0):
        raise DomainError("pixel_size", pixel_size, "must be above 0")
    if samples < 16:
        raise DomainError("samples", samples, "sixteen at least")
    report = progress or (lambda share: None)
    shape = pixels.values.shape
    start = symmetric_centre(pixels) if centre is None else check_centre("centre", centre, shape)
    reach = border_distance(shape, start) if edge is None else float(edge) / pixel_size
    if edge is None and not reach >= 6:
        rule = f"lies within six pixels of a side of the image, at {start}; give centre and edge"
        raise DomainError("centre", centre, rule)
    farthest = float(np.hypot(max(start[0], shape[1] - start[0]), max(start[1], shape[0] - start[1])))
    if not 6 <= reach <= 1.01 * farthest:
        rule = f"must lie six pixels or more from the centre, and within the image: {6 * pixel_size:.4g} to "
        raise DomainError("edge", edge, f"{rule}{farthest * pixel_size:.4g}")
    nodes = np.linspace(0.0, reach, int(np.clip(round(reach), 12, _MOST_NODES)) + 1)
    geometry = _Geometry(
        pixels,
        nodes,
        projection_matrix(nodes, np.linspace(0.0, reach, _TABLE)),
        background,
        _SUBPIXELS if averaged else 1,
    )
    first = _posterior(geometry, start)
    report(0.2)
    spread = np.zeros((2, 2))
    if centre is None:
        start, spread = _fit_centre(geometry, start, first)
        first = _posterior(geometry, start)
    report(0.5)
    rng = np.random.default_rng(seed)
    mean, covariance = nonnegative_moments(first, samples, rng)
    if centre is None:
        covariance = covariance + _through_centre(geometry, start, first, spread)
    return _result(geometry, start, spread, first, mean, covariance, pixel_size, rng, report)


def _weights(geometry: _Geometry, centre: tuple[float, float]) -> Any:
    """Sparse matrix (pixel, distance) from tabulated projections to pixels averaged over their area."""
    from scipy.sparse import csr_matrix

    y, x = np.nonzero(geometry.pixels.used)
    offsets = (np.arange(geometry.subpixels) + 0.5) / geometry.subpixels - 0.5
    dy, dx = (d.ravel() for d in np.meshgrid(offsets, offsets, indexing="ij"))
    distance = np.hypot(x[:, None] + dx - centre[0], y[:, None] + dy - centre[1])
    at = distance / geometry.nodes[-1] * (_TABLE - 1)
    low = np.minimum(at.astype(int), _TABLE - 2)
    share = at - low
    inside = distance < geometry.nodes[-1]
    row = np.broadcast_to(np.arange(len(x))[:, None], distance.shape)
    entries = [(np.where(inside, 1 - share, 0.0), low), (np.where(inside, share, 0.0), low + 1)]
    value = np.concatenate([v.ravel() for v, _ in entries]) / geometry.subpixels**2
    column = np.concatenate([c.ravel() for _, c in entries])
    return csr_matrix((value, (np.concatenate([row.ravel()] * 2), column)), shape=(len(x), _TABLE))


def _posterior(
    geometry: _Geometry, centre: tuple[float, float], orders: tuple[float, ...] = ORDERS, lengths: Array | None = None
) -> Posterior:
    pixels, nodes = geometry.pixels, geometry.nodes
    sigma = pixels.sigma[pixels.used]
    design = (_weights(geometry, centre) @ geometry.table) / sigma[:, None]
    ones = np.ones(len(nodes))
    nuisances, shifts = [design @ ones], [ones]
    if geometry.background:
        nuisances.append(1.0 / sigma)
        shifts.append(np.zeros(len(nodes)))
    few, nuis, data, more, misfit = compressed(design, np.column_stack(nuisances), pixels.values[pixels.used] / sigma)
    scales = np.geomspace(2 * nodes[1], 3 * nodes[-1], _LENGTHS) if lengths is None else lengths
    problem = Smooth(
        nodes, few, np.ones(len(few)), nuis, np.column_stack(shifts), True, orders, scales, more_points=more
    )
    return problem.posterior(data, pixels.known_noise, misfit)


def _fit_centre(geometry: _Geometry, start: tuple[float, float], first: Posterior) -> tuple[tuple[float, float], Array]:
    """Newton's method for the centre, with the likeliest covariance; and the covariance of the centre."""
    best = first.problem.settings[max(first.nodes, key=lambda node: node.weight).setting]

    def cost(x: float, y: float) -> float:
        part = _posterior(geometry, (x, y), (best.order,), np.array([best.length])).parts[0].log_evidence
        return -float(np.logaddexp.reduce(part))

    at: Any = np.array(start)
    step = 0.25
    for _ in range(12):
        gradient, hessian = _derivatives(cost, at, step)
        size = float(np.linalg.norm(gradient))
        if np.linalg.eigvalsh(hessian)[0] <= 0:  # far from the centre: downhill by half a pixel
            move = np.asarray(-0.5 * gradient / max(size, 1e-300), float)
        else:
            newton = -np.linalg.solve(hessian, gradient)
            move = np.asarray(newton * min(1.0, 2.0 / max(float(np.linalg.norm(newton)), 1e-300)), float)
            step = float(np.clip(np.linalg.norm(move), 0.02, 0.25))
        at = at + move
        if border_distance(geometry.pixels.values.shape, (at[0], at[1])) <= 0:
            raise ConvergenceError("the centre runs out of the image; give centre, or mask what is not the object")
        if np.linalg.norm(move) < 1e-3 + 0.1 * np.sqrt(np.trace(np.linalg.pinv(hessian))):
            break
    else:
        raise ConvergenceError("the centre was not found in 12 steps; give centre, or mask what is not the object")
    spread: Array = np.linalg.inv(hessian).astype(float)
    return (float(at[0]), float(at[1])), spread


def _derivatives(cost: Callable[[float, float], float], at: Array, h: float) -> tuple[Array, Array]:
    """Gradient and second derivatives of a function of two numbers, by differences over h."""
    x, y = at
    f = {(i, j): cost(x + i * h, y + j * h) for i, j in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1))}
    gradient = np.array([f[1, 0] - f[-1, 0], f[0, 1] - f[0, -1]]) / (2 * h)
    xx, yy = (f[1, 0] + f[-1, 0] - 2 * f[0, 0]) / h**2, (f[0, 1] + f[0, -1] - 2 * f[0, 0]) / h**2
    both = (f[1, 1] + f[-1, -1] - 2 * f[0, 0]) / h**2
    xy = 0.5 * (both - xx - yy)
    return gradient, np.array([[xx, xy], [xy, yy]])


def _through_centre(geometry: _Geometry, centre: tuple[float, float], first: Posterior, spread: Array) -> Array:
    """Covariance of f that the doubt about the centre adds, to first order."""
    best = first.problem.settings[max(first.nodes, key=lambda node: node.weight).setting]
    h = np.sqrt(np.diagonal(spread))

    def mean(dx: float, dy: float) -> Array:
        at = (centre[0] + dx, centre[1] + dy)
        return _posterior(geometry, at, (best.order,), np.array([best.length])).mean

    slope = np.stack([(mean(h[0], 0) - mean(-h[0], 0)) / (2 * h[0]), (mean(0, h[1]) - mean(0, -h[1])) / (2 * h[1])])
    return np.asarray(slope.T @ spread @ slope)


def _result(
    geometry: _Geometry, centre: tuple[float, float], spread: Array, posterior: Posterior, mean: Array,
    covariance: Array, pixel_size: float, rng: np.random.Generator, report: Callable[[float], Any],
) -> SphericalResult:  # fmt: skip
    pixels, problem = geometry.pixels, posterior.problem
    back = posterior.nuisances(mean)
    model = problem.design @ mean
    level, level_error = 0.0, 0.0
    if geometry.background:
        level = float(back[1])
        model = model + problem.nuisances[:, 1] * level
        level_error = background_error(posterior, mean, covariance)
    factor = band_factor(problem, posterior, mean, model, True, rng, lambda share: report(0.5 + 0.5 * share))
    everywhere = geometry._replace(pixels=pixels._replace(used=np.ones_like(pixels.used)))
    fitted = (_weights(everywhere, centre) @ (geometry.table @ mean)).reshape(pixels.values.shape) + level
    residual = np.where(pixels.used, pixels.values - fitted, np.nan)
    best = problem.settings[max(posterior.nodes, key=lambda node: node.weight).setting]
    noise = posterior.noise
    if pixels.known_noise:
        left = max(pixels.used.sum() - posterior.freedoms, 1.0)
        noise = float(np.sqrt(np.nansum((residual / pixels.sigma) ** 2) / left))
    sd = np.sqrt(np.diagonal(covariance)) / pixel_size
    density = mean / pixel_size
    return SphericalResult(
        radius=geometry.nodes * pixel_size, density=density, standard_deviation=sd,
        covariance=covariance / pixel_size**2, lower=np.maximum(density - factor * sd, 0.0),
        upper=density + factor * sd, band_factor=factor,
        free_density=posterior.mean / pixel_size, free_covariance=posterior.covariance / pixel_size**2, centre=centre,
        centre_error=(float(np.sqrt(spread[0, 0])), float(np.sqrt(spread[1, 1]))), centre_covariance=spread,
        background=level, background_error=level_error, fitted_image=fitted, residual=residual, noise=noise,
        degrees_of_freedom=posterior.freedoms, order=best.order, length=best.length * pixel_size,
    )  # fmt: skip
