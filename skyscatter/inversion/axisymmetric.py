"""Axisymmetric objects whose axis lies in the plane of the image: all rows inverted together.

The density f(r, z) has a Gaussian-process prior that is a product of covariances across and along the axis.  Lengths,
order and amplitude are those of the greatest marginal likelihood, which for an even noise is cheap through the
eigenvectors of both (Saatci 2011, thesis, Cambridge, ch. 5).  With these the density is found with every pixel's own
noise, in the combinations of eigenvectors that the data can tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import ConvergenceError, DomainError
from skyscatter.inversion.brief import Brief
from skyscatter.inversion.pixels import Pixels, checked_image, symmetric_centre
from skyscatter.inversion.smoothness import covariance
from skyscatter.inversion.splines import projection_matrix

Array = NDArray[np.float64]

_ORDERS = (0.5, 1.5, 2.5, np.inf)
_ACROSS, _ALONG = 7, 7  #: lengths that are weighed
_RATIOS = np.linspace(-2.0, 12.0, 43)  #: log10 of the greatest signal to noise, squared
_SUBPIXELS = 4  #: of a row, over which a pixel is averaged
_TOLD = 1e-3  #: signal to noise, squared, below which a combination is left at zero, with its variance
_MOST_MODES = 2000  #: that the linear algebra takes in seconds
_MOST_NODES = 96  #: across


@dataclass(frozen=True, repr=False)
class AxisymmetricResult(Brief):
    """A density over distance from the axis and place along it.

    Attributes
    ----------
    radius : ndarray, shape (node,)
        Distances from the axis, in the unit of `pixel_size`.
    along : ndarray, shape (row,)
        Places along the axis, in the same unit, from the image's first pixel along it.
    density, standard_deviation, lower, upper : ndarray, shape (row, node)
        Never negative; in units of the image over those of `pixel_size`.
    axis_position, axis_error : float
        Where the axis is [pixel], across it; the error is 0 where the position was given.
    background, background_error : float
        In units of the image.
    fitted_image, residual : ndarray, shape (y, x)
        The residual is NaN where pixels are masked.
    noise : float
        Estimated standard deviation of a pixel; with `sigma` given, the factor by which the residual exceeds it.
    order, length_across, length_along, amplitude : float
        Of the prior; lengths in the unit of `pixel_size`.
    degrees_of_freedom : float

    Examples
    --------
    The axis of a jet is found where it was not given, to less than a pixel.

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> row = np.sqrt(18 * np.pi) * np.exp(-((np.arange(17) - 8.3) ** 2) / 18)
    >>> found = inversion.invert_axisymmetric(np.tile(row, (12, 1)), 0.05)
    >>> f"{found.axis_position:.1f}"
    '8.3'
    >>> found.axis_error < 0.05
    True
    >>> found.residual.shape == (12, 17)
    True
    """

    radius: Array
    along: Array
    density: Array
    standard_deviation: Array
    lower: Array
    upper: Array
    axis_position: float
    axis_error: float
    background: float
    background_error: float
    fitted_image: Array
    residual: Array
    noise: float
    order: float
    length_across: float
    length_along: float
    amplitude: float
    degrees_of_freedom: float


class _Across(NamedTuple):
    """Geometry across the axis."""

    nodes: Array  # [pixel]
    subpixels: int

    def design(self, columns: int, place: float) -> Array:
        """From densities at the nodes to a row of pixels, averaged over their width; shape (column, node)."""
        offsets = (np.arange(self.subpixels) + 0.5) / self.subpixels - 0.5
        distance = np.abs(np.arange(columns)[:, None] + offsets - place)
        matrix = projection_matrix(self.nodes, np.minimum(distance, self.nodes[-1]).ravel())
        return matrix.reshape(columns, self.subpixels, len(self.nodes)).mean(axis=1)


class _Prior(NamedTuple):
    order: float
    across: float
    along: float
    ratio: float  # A^2 / sigma^2
    noise: float  # in units of sigma
    log_evidence: float


def invert_axisymmetric(
    image: ArrayLike,
    sigma: ArrayLike | float | None = None,
    mask: ArrayLike | None = None,
    *,
    axis: Literal["y", "x"] = "y",
    axis_position: float | None = None,
    edge: float | None = None,
    pixel_size: float = 1.0,
    background: bool = True,
    averaged: bool = True,
    samples: int = 128,
    seed: int = 0,
    progress: Callable[[float], Any] | None = None,
) -> AxisymmetricResult:
    """Density of an optically thin object that is symmetric about an axis in the plane of the image.

    Negative densities of the posterior's samples are set to zero.

    Parameters
    ----------
    image : array_like, shape (y, x)
        Brightness or column; NaN where there is no value.
    sigma : array_like or float, optional
        Standard deviation of each pixel; estimated, the same for all, when not given.
    mask : array_like of bool, shape (y, x), optional
        True for pixels that are left out.
    axis : {"y", "x"}
        Along which of the image's sides the axis runs.
    axis_position : float, optional
        Its x (or y, for `axis` "x") [pixel]; fitted when not given.
    edge : float, optional
        Distance from the axis beyond which there is nothing, in the unit of `pixel_size`; to the nearest border when
        not given.
    pixel_size : float
        Length of a pixel's side, in any unit.
    background : bool
        Whether a uniform background is fitted.
    averaged : bool
        Whether pixels are averages across the axis, as a detector's; False for values at their middles, as rendered.
    samples, seed, progress
        As in `abel_invert`.

    Returns
    -------
    AxisymmetricResult

    Raises
    ------
    DomainError
        For an image, sigma or mask that cannot be used, an axis or edge outside the image.
    ConvergenceError
        If the data do not tell where the axis is.

    Examples
    --------
    A jet with the density exp(-r^2 / 18) and its axis at x = 8 is seen as sqrt(18 pi) exp(-(x - 8)^2 / 18):

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> row = np.sqrt(18 * np.pi) * np.exp(-((np.arange(17) - 8) ** 2) / 18)
    >>> found = inversion.invert_axisymmetric(np.tile(row, (12, 1)), 0.05, axis_position=8, background=False)
    >>> found.density.shape  # row, node
    (12, 9)
    >>> middle = np.interp([0, 3], found.radius, found.density[6])
    >>> f"{middle[0]:.1f} on the axis, {middle[1]:.1f} three pixels beside it"
    '1.0 on the axis, 0.6 three pixels beside it'
    """
    if axis not in ("x", "y"):
        raise DomainError("axis", axis, 'must be "y" (up the image) or "x" (along its rows)')
    if not (np.isfinite(pixel_size) and pixel_size > 0):
        raise DomainError("pixel_size", pixel_size, "must be above 0")
    if samples < 16:
        raise DomainError("samples", samples, "sixteen at least")
    given = checked_image(image, sigma, mask)
    pixels = given if axis == "y" else Pixels(given.values.T, given.sigma.T, given.used.T, given.known_noise)
    columns = pixels.values.shape[1]
    fit_axis = axis_position is None
    place = symmetric_centre(pixels)[0] if axis_position is None else float(axis_position)
    if not 0 <= place <= columns - 1:
        raise DomainError("axis_position", axis_position, f"must lie in the image, 0 to {columns - 1}")
    reach = min(place + 0.5, columns - 0.5 - place) if edge is None else float(edge) / pixel_size
    if not reach >= 4:
        raise DomainError("edge", edge, "must lie four pixels or more from the axis")
    nodes = np.linspace(0.0, reach, int(np.clip(round(reach), 8, _MOST_NODES)) + 1)
    geometry = _Across(nodes, _SUBPIXELS if averaged else 1)
    filled = _filled(pixels, place)
    prior = _best_prior(filled, geometry, place, background)
    (progress or (lambda share: None))(0.4)
    error = 0.0
    if fit_axis:
        place, error = _fit_axis(filled, geometry, place, prior, background)
        prior = _best_prior(_filled(pixels, place), geometry, place, background)
    (progress or (lambda share: None))(0.8)
    result = _solve(pixels, geometry, place, error, prior, background, pixel_size, samples, seed)
    (progress or (lambda share: None))(1.0)
    return result if axis == "y" else _turned(result)


def _turned(result: AxisymmetricResult) -> AxisymmetricResult:
    from dataclasses import replace

    return replace(result, fitted_image=result.fitted_image.T, residual=result.residual.T)


class _Filled(NamedTuple):
    """An image with a value everywhere and one noise, the root mean square: enough for the prior."""

    values: Array
    sigma: float
    points: int  # pixels that truly count


def _filled(pixels: Pixels, place: float) -> _Filled:
    """Pixels that are left out take the value of their mirror image, or else of the nearest in their row."""
    values, used = pixels.values.copy(), pixels.used
    columns = values.shape[1]
    mirror = np.rint(2 * place - np.arange(columns)).astype(int)
    valid = (mirror >= 0) & (mirror < columns)
    mirror = np.clip(mirror, 0, columns - 1)
    use_mirror = ~used & valid & used[:, mirror]
    values = np.where(use_mirror, values[:, mirror], values)
    have = used | use_mirror
    if not have.all():
        from scipy.ndimage import distance_transform_edt

        _, (y, x) = distance_transform_edt(~have, return_indices=True)
        values = values[y, x]
    return _Filled(values, float(np.sqrt((pixels.sigma[used] ** 2).mean())), int(used.sum()))


def _eigen(nodes: Array, rows: int, order: float, across: float, along: float) -> tuple[Array, Array, Array]:
    """Root of the covariance across, and eigenvalues and eigenvectors along the axis."""
    values, vectors = np.linalg.eigh(covariance(nodes, across, order, True))
    keep = values > 1e-13 * values[-1]
    root = vectors[:, keep] * np.sqrt(values[keep])
    # Along the axis the object has a middle level as well; a constant of the same variance lets it have one.
    t, q = np.linalg.eigh(covariance(np.arange(rows, dtype=float), along, order, False) + 1.0)
    return root, np.maximum(t, 0.0), q


def _evidence(filled: _Filled, left: Array, singular: Array, t: Array, q: Array, back: bool) -> tuple[Array, Array]:
    """Logarithm of the marginal likelihood for each ratio, and the noise squared; the background is integrated out.

    The noise is found here even where `sigma` is given, for it stands for all pixels.
    """
    y = filled.values / filled.sigma
    transformed = q.T @ y @ left
    ones = np.outer(q.sum(axis=0), left.sum(axis=0))
    strength = np.outer(t, singular**2)
    told = strength > 1e-14 * strength.max()  # the rest changes nothing at any ratio
    strength, transformed, ones = strength[told], transformed[told], ones[told]
    total = 1.0 + 10.0 ** _RATIOS[:, None] / strength.max() * strength
    gain = 1.0 / total - 1.0  # of the modes, less 1
    yy = (y**2).sum() + gain @ transformed**2
    log = -0.5 * np.log(total).sum(axis=1)
    freedoms = filled.points
    if back:
        one = y.size + gain @ ones**2
        cross = y.sum() + gain @ (ones * transformed)
        yy, log, freedoms = yy - cross**2 / one, log - 0.5 * np.log(one), freedoms - 1
    # Filled pixels say nothing new: sums over all pixels are scaled to those that count.
    yy = np.maximum(yy, 1e-30 * (y**2).sum() + 1e-300) * filled.points / y.size
    return log - 0.5 * freedoms * np.log(yy), yy / freedoms


def _best_prior(filled: _Filled, geometry: _Across, place: float, background: bool) -> _Prior:
    """The prior of the greatest marginal likelihood."""
    rows, columns = filled.values.shape
    nodes = geometry.nodes
    design = geometry.design(columns, place) / filled.sigma
    best: _Prior | None = None
    for order in _ORDERS:
        alongs = [
            (float(n), *_eigen(nodes, rows, order, nodes[-1], float(n))[1:]) for n in np.geomspace(2, 2 * rows, _ALONG)
        ]
        for across in np.geomspace(2 * nodes[1], 2 * nodes[-1], _ACROSS):
            root = _eigen(nodes, 2, order, float(across), 1.0)[0]
            left, singular, _ = np.linalg.svd(design @ root, full_matrices=False)
            for along, t, q in alongs:
                log, noise = _evidence(filled, left, singular, t, q, background)
                k = int(np.argmax(log))
                if best is None or log[k] > best.log_evidence:
                    ratio = 10.0 ** _RATIOS[k] / (t.max() * singular[0] ** 2)
                    best = _Prior(order, float(across), along, float(ratio), float(np.sqrt(noise[k])), float(log[k]))
    assert best is not None
    return best


def _fit_axis(filled: _Filled, geometry: _Across, place: float, prior: _Prior, background: bool) -> tuple[float, float]:
    """Place of the axis with the greatest marginal likelihood, and its standard deviation."""
    from scipy.optimize import minimize_scalar

    rows, columns = filled.values.shape
    root, t, q = _eigen(geometry.nodes, rows, prior.order, prior.across, prior.along)

    def cost(x: float) -> float:
        left, singular, _ = np.linalg.svd(geometry.design(columns, x) / filled.sigma @ root, full_matrices=False)
        log, _ = _evidence(filled, left, singular, t, q, background)
        return -float(np.logaddexp.reduce(log))

    low, high = max(place - 3.0, 0.0), min(place + 3.0, columns - 1.0)
    grid = np.linspace(low, high, 13)
    costs = [cost(x) for x in grid]
    k = int(np.argmin(costs))
    if k in (0, len(grid) - 1):
        raise ConvergenceError("the axis was not found within 3 pixels of the image's symmetry; give axis_position")
    found = minimize_scalar(cost, bounds=(grid[k - 1], grid[k + 1]), method="bounded", options={"xatol": 1e-3})
    x, h = float(found.x), 0.1
    curvature = (cost(x + h) + cost(x - h) - 2 * cost(x)) / h**2
    if not curvature > 0:
        raise ConvergenceError("the data do not tell where the axis is; give axis_position")
    return x, float(curvature**-0.5)


class _Modes(NamedTuple):
    """Combinations of eigenvectors across and along that the data can tell."""

    across: Array  # (node, mode across) densities
    along: Array  # (row, mode along)
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]]  # of modes across and along
    variance: Array  # (row, node) of all the rest


def _modes(nodes: Array, design: Array, rows: int, prior: _Prior, sigma: float) -> _Modes:
    root, t, q = _eigen(nodes, rows, prior.order, prior.across, prior.along)
    _, singular, right = np.linalg.svd(design @ root / sigma, full_matrices=True)
    s = np.zeros(len(right))
    s[: len(singular)] = singular
    amplitude = np.sqrt(prior.ratio) * prior.noise
    across, along = amplitude * root @ right.T, q * np.sqrt(t)
    told = prior.ratio * np.outer(s**2, t)
    least = _TOLD
    if (told > least).sum() > _MOST_MODES:
        least = np.sort(told.ravel())[-_MOST_MODES]
    i, j = np.nonzero(told > least)
    rest = np.where(told > least, 0.0, 1.0)
    return _Modes(across, along, (i, j), along**2 @ rest.T @ (across**2).T)


def _solve(
    pixels: Pixels, geometry: _Across, place: float, error: float, prior: _Prior, background: bool,
    pixel_size: float, samples: int, seed: int,
) -> AxisymmetricResult:  # fmt: skip
    """The density with every pixel's own noise."""
    rows, columns = pixels.values.shape
    weight = np.where(pixels.used, pixels.sigma**-2, 0.0)
    nodes, design = geometry.nodes, geometry.design(columns, place)
    modes = _modes(nodes, design, rows, prior, float((weight.sum() / pixels.used.sum()) ** -0.5))
    vector, inverse, noise = _normal_equations(pixels, weight, design @ modes.across, modes, prior, background)
    count = len(modes.pairs[0])
    coefficients, level = vector[:count], (vector[count] if background else 0.0)

    def density(z: Array) -> Array:
        full = np.zeros((modes.along.shape[1], modes.across.shape[1]))
        full[modes.pairs[1], modes.pairs[0]] = z
        return np.asarray(modes.along @ full @ modes.across.T)

    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(inverse[:count, :count])
    mean = density(coefficients)
    drawn = np.stack([mean + density(root @ rng.standard_normal(count)) for _ in range(samples)])
    drawn = drawn + np.sqrt(modes.variance) * rng.standard_normal(drawn.shape)
    clipped = np.maximum(drawn, 0.0)
    estimate = np.maximum(mean + (clipped - drawn).mean(axis=0), 0.0)
    sd = np.sqrt(clipped.var(axis=0, ddof=1) + drawn.var(axis=0, ddof=1) / samples)
    fitted = estimate @ design.T + level
    residual = np.where(pixels.used, pixels.values - fitted, np.nan)
    freedom = float(count - np.trace(inverse[:count, :count])) + background
    if pixels.known_noise:
        left = max(pixels.used.sum() - freedom, 1.0)
        noise = float(np.sqrt(np.nansum((residual / pixels.sigma) ** 2) / left))
    f, s = estimate / pixel_size, sd / pixel_size
    return AxisymmetricResult(
        radius=nodes * pixel_size, along=np.arange(rows, dtype=float) * pixel_size, density=f, standard_deviation=s,
        lower=np.maximum(f - s, 0.0), upper=f + s, axis_position=place, axis_error=error, background=float(level),
        background_error=float(np.sqrt(inverse[count, count])) if background else 0.0,
        fitted_image=fitted, residual=residual, noise=noise, order=prior.order,
        length_across=prior.across * pixel_size, length_along=prior.along * pixel_size,
        amplitude=float(np.sqrt(prior.ratio) * prior.noise) / pixel_size, degrees_of_freedom=freedom,
    )  # fmt: skip


def _normal_equations(
    pixels: Pixels, weight: Array, seen: Array, modes: _Modes, prior: _Prior, background: bool
) -> tuple[Array, Array, float]:
    """Best coefficients of the modes (and the background), their covariance, and the noise in units of sigma."""
    i, j = modes.pairs
    size = len(i) + background
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for row, w in enumerate(weight):
        if not w.any():
            continue
        # One row of pixels: the design is seen[:, i] along[row, j].
        part = seen[:, i] * modes.along[row, j]
        if background:
            part = np.column_stack([part, np.ones(len(part))])
        matrix += (part.T * w) @ part
        right += part.T @ (w * pixels.values[row])
    noise2 = 1.0 if pixels.known_noise else prior.noise**2
    precision = matrix / noise2
    precision[np.arange(len(i)), np.arange(len(i))] += 1.0
    inverse = np.linalg.inv(precision)
    inverse = 0.5 * (inverse + inverse.T)
    return inverse @ (right / noise2), inverse, float(np.sqrt(noise2))
