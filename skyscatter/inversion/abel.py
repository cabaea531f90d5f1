"""Abel's transform and its inverse: from the projection of a round object to its density, with errors.

The estimate is the mean of a Gaussian-process posterior (`skyscatter.inversion.smoothness`) under the condition that
no density is negative.  How smooth the density is, and how noisy the data are, is taken from the data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.brief import Brief
from skyscatter.inversion.nonnegative import project_nonnegative
from skyscatter.inversion.smoothness import Posterior, Smooth
from skyscatter.inversion.splines import nodes_for, projection_matrix, spline_values

Array = NDArray[np.float64]

ONE_SIGMA = 0.6826894921370859  #: share of a Gaussian within one standard deviation
_REPLICATES = 40  #: fits to made-up data from which the width of the band is found


@dataclass(frozen=True, repr=False)
class AbelResult(Brief):
    """A density profile and how far it can be trusted.

    Attributes
    ----------
    radius : ndarray, shape (point,)
        As given.
    density : ndarray, shape (point,)
        Never negative; in units of the projection over those of the radius.
    standard_deviation : ndarray, shape (point,)
        Root of the posterior variance: noise, smoothing, and doubt about how smooth and how noisy.
    covariance : ndarray, shape (point, point)
    lower, upper : ndarray, shape (point,)
        A band that is to cover the truth at 68.3 % of the radii: `density` -+ `band_factor` `standard_deviation`, cut
        off at zero.
    band_factor : float
        Found by fitting data made from the estimate; below 1 where the density is smoother than the prior allows for.
    fitted_projection, residual : ndarray, shape (point,)
        Projection of the density (and the background), and the data less that.
    noise : ndarray, shape (point,)
        Standard deviation of the data: as given, or as estimated.
    amplitude, length : float
        Of the prior's covariance, means over the posterior; the length in units of the radius.
    order : float
        Of the covariance with the greatest weight: 1/2, 3/2, 5/2 or infinity, from rough to smooth.
    degrees_of_freedom : float
        Numbers that the fit takes from the data.
    log_evidence : float
        Natural logarithm of the marginal likelihood of the best setting, up to a constant.
    background : float
        Fitted constant of the projection; 0 when none was asked for.
    background_error : float
        Its standard deviation.

    Examples
    --------
    All lines of sight that come near the middle see everything outside too: the density is least certain there.  The
    profile is so smooth that it takes few numbers from the 24 data.

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y = np.linspace(0, 1, 24)
    >>> found = inversion.abel_invert(y, 4 / 3 * (1 - y**2) ** 1.5, sigma=0.01)
    >>> bool(found.standard_deviation[0] > found.standard_deviation[12])
    True
    >>> f"{found.degrees_of_freedom:.0f}"
    '3'
    >>> bool(np.abs(found.residual).max() < 0.01)
    True
    """

    radius: Array
    density: Array
    standard_deviation: Array
    covariance: Array
    lower: Array
    upper: Array
    band_factor: float
    fitted_projection: Array
    residual: Array
    noise: Array
    amplitude: float
    length: float
    order: float
    degrees_of_freedom: float
    log_evidence: float
    background: float = 0.0
    background_error: float = 0.0

    @property
    def reduced_chi_square(self) -> float:
        """Sum of squared residuals over noise, divided by the data less the degrees of freedom."""
        left = max(len(self.radius) - self.degrees_of_freedom, 1.0)
        return float(((self.residual / self.noise) ** 2).sum() / left)


def abel_project(
    radius: ArrayLike, density: ArrayLike, impact: ArrayLike | None = None, edge: float | None = None
) -> Array:
    """Projection of a spherically (or, in a slice, cylindrically) symmetric density along straight lines, equation 119.

    Parameters
    ----------
    radius : array_like, shape (node,)
        Increasing radii from 0 or above, four at least.  Between them the density is a cubic spline; if the first is
        above 0, the spline goes on to the centre.
    density : array_like, shape (node,)
        Any sign.
    impact : array_like, shape (point,), optional
        Distances of the lines from the centre, in the unit of the radius; the radii when not given.
    edge : float, optional
        Radius beyond which there is nothing; the last one when not given, and never beyond it.

    Returns
    -------
    ndarray, shape (point,)
        Projections in units of the density times those of the radius: exact for the spline.

    Raises
    ------
    DomainError
        For fewer than four radii, radii that do not increase, values that are not finite, an edge beyond the radii.

    Examples
    --------
    The column through a ball of density 1 and radius 8 is the length of the chord.

    >>> from skyscatter import inversion
    >>> inversion.abel_project([0, 2, 4, 6, 8], [1, 1, 1, 1, 1]).round(2)
    array([16.  , 15.49, 13.86, 10.58,  0.  ])
    """
    r, f = _profile(radius, density, "density")
    if len(r) < 4:
        raise DomainError("radius", len(r), "needs four radii at least")
    y = r if impact is None else _numbers(impact, "impact")
    if (y < 0).any():
        raise DomainError("impact", float(y.min()), "distances from the centre are never negative")
    end = float(r[-1]) if edge is None else float(edge)
    if not 0 < end <= r[-1] * (1 + 1e-12):
        raise DomainError("edge", end, f"must be above 0 and at most the last radius, {r[-1]:g}")
    from scipy.interpolate import CubicSpline

    nodes = r[r < end * (1 - 1e-12)]
    nodes = np.concatenate([[0.0] if nodes[0] > 0 else [], nodes, [end]])
    values = f if np.array_equal(nodes, r) else CubicSpline(r, f)(nodes)
    result: Array = projection_matrix(nodes, y) @ values
    return result


def abel_invert(
    radius: ArrayLike,
    projection: ArrayLike,
    sigma: ArrayLike | None = None,
    *,
    edge: float | None = None,
    background: bool = False,
    nonnegative: bool = True,
    samples: int = 256,
    seed: int = 0,
    progress: Callable[[float], Any] | None = None,
) -> AbelResult:
    """Density of a round object from its projection: regularised by the data themselves, non-negative, with errors.

    Parameters
    ----------
    radius : array_like, shape (point,)
        Distances of the lines of sight from the centre, increasing, from 0 or above; eight at least.
    projection : array_like, shape (point,)
        Brightness of an optically thin object, or its column.
    sigma : array_like or float, optional
        Standard deviation of the data (independent of each other); estimated, the same for all, when not given.
    edge : float, optional
        Radius beyond which there is nothing; the last one when not given.
    background : bool
        Whether the projection has an unknown constant added; needs radii beyond `edge`, or a density that falls.
    nonnegative : bool
        False leaves negative densities in the estimate.
    samples : int
        Samples from which the effect of non-negativity is found.
    seed : int
        Of these samples and of the made-up data for the band.
    progress : callable, optional
        Called with the share done.

    Returns
    -------
    AbelResult

    Raises
    ------
    DomainError
        For radii that do not increase or are negative, values that are not finite, a sigma of 0 or below.

    Examples
    --------
    A ball of the density 1 - r^2 is seen as 4/3 (1 - y^2)^(3/2); back from there to its density at four radii:

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y = np.linspace(0, 1, 24)
    >>> found = inversion.abel_invert(y, 4 / 3 * (1 - y**2) ** 1.5, sigma=0.01)
    >>> found.density[[0, 6, 12, 18]].round(1)
    array([1. , 0.9, 0.7, 0.4])
    >>> (1 - y[[0, 6, 12, 18]] ** 2).round(1)
    array([1. , 0.9, 0.7, 0.4])
    """
    y, data = _profile(radius, projection, "projection")
    if len(y) < 8:
        raise DomainError("radius", len(y), "needs eight radii at least")
    known = sigma is not None
    noise = _sigma(sigma, len(y))
    end = float(y[-1]) if edge is None else float(edge)
    if not end > y[min(3, len(y) - 1)]:
        raise DomainError("edge", end, "must lie beyond the fourth radius at least")
    if samples < 16:
        raise DomainError("samples", samples, "sixteen at least")
    if not data.any():
        raise DomainError("projection", "all 0", "nothing to invert: give data that are not zero everywhere")
    problem = _problem(y.tobytes(), noise.tobytes(), end, background)
    report = progress or (lambda share: None)
    posterior = problem.posterior(data, known)
    report(0.1)
    rng = np.random.default_rng(seed)
    mean, covariance = posterior.mean, posterior.covariance
    if nonnegative:
        mean, covariance = nonnegative_moments(posterior, samples, rng, lambda share: report(0.1 + 0.4 * share))
    fitted = problem.design @ mean
    back = float(posterior.nuisances(mean)[1]) if background else 0.0
    model = (fitted + back / noise if background else fitted) * noise
    factor = band_factor(problem, posterior, mean, model, nonnegative, rng, lambda share: report(0.5 + 0.5 * share))
    return _result(y, data, posterior, mean, covariance, model, factor, back)


@lru_cache(maxsize=4)
def _problem(radius_bytes: bytes, sigma_bytes: bytes, edge: float, background: bool) -> Smooth:
    """The geometry, kept between calls: its singular values cost most of the time."""
    y, sigma = np.frombuffer(radius_bytes), np.frombuffer(sigma_bytes)
    nodes = nodes_for(y, edge)
    design = projection_matrix(nodes, y)
    ones = np.ones(len(nodes))
    nuisances, shifts = [design @ ones], [ones]
    if background:
        nuisances.append(np.ones(len(y)))
        shifts.append(np.zeros(len(nodes)))
    return Smooth(nodes, design, sigma, np.column_stack(nuisances), np.column_stack(shifts))


def nonnegative_moments(
    posterior: Posterior, samples: int, rng: np.random.Generator, report: Callable[[float], Any] = lambda share: None
) -> tuple[Array, Array]:
    """Mean and covariance of f after every sample was made non-negative.

    Only the change that this makes is found from samples, the rest being known exactly.

    Parameters
    ----------
    posterior : Posterior
    samples : int
    rng : numpy.random.Generator
    report : callable
        Called with the share done.

    Returns
    -------
    mean : ndarray, shape (node,)
    covariance : ndarray, shape (node, node)
    """
    plain, moved, done = [], [], 0
    for node, drawn in posterior.draws(samples, rng):
        plain.append(drawn)
        done += len(drawn)
        if (drawn < 0).any():
            root = posterior.node_root(node)
            spread = root @ root.T
            drawn = np.stack([project_nonnegative(f, spread) if (f < 0).any() else f for f in drawn])
        moved.append(drawn)
        report(done / samples)
    before, after = np.concatenate(plain), np.concatenate(moved)
    if np.array_equal(before, after):
        return np.maximum(posterior.mean, 0.0), posterior.covariance
    mean = np.maximum(posterior.mean + (after - before).mean(axis=0), 0.0)
    # The second term is the doubt of the samples' own mean; it keeps errors above 0 where all samples are 0.
    return mean, np.cov(after.T) + posterior.covariance / samples


def band_factor(
    problem: Smooth,
    posterior: Posterior,
    mean: Array,
    model: Array,
    nonnegative: bool,
    rng: np.random.Generator,
    report: Callable[[float], Any],
) -> float:
    """Multiple of the standard deviation that covers a known truth at 68.3 % of the radii.

    The truth is the estimate itself, the data its projection with noise (a parametric bootstrap, after Hall & Horowitz
    2013, Ann. Stat. 41, 1892).  Where densities are flat almost everywhere and steep in a few places, one standard
    deviation is too much almost everywhere.

    Parameters
    ----------
    problem : Smooth
    posterior : Posterior
    mean : ndarray, shape (node,)
        The estimate.
    model : ndarray, shape (point,)
        What it gives in place of the data, nuisances included.
    nonnegative : bool
    rng : numpy.random.Generator
    report : callable
        Called with the share done.
    """
    needed = []
    for i in range(_REPLICATES):
        made = model + posterior.noise * problem.sigma * rng.standard_normal(len(model))
        more = posterior.noise**2 * float(rng.chisquare(problem.more_points)) if problem.more_points else 0.0
        again = problem.posterior(made, posterior.known_noise, more)
        estimate, spread = again.mean, np.sqrt(np.maximum(again.variance, 1e-300))
        if nonnegative:
            estimate, spread = _clipped_moments(estimate, spread)
        needed.append(np.abs(estimate - mean) / spread)
        report((i + 1) / _REPLICATES)
    return float(np.quantile(np.concatenate(needed), ONE_SIGMA))


def _clipped_moments(mean: Array, sd: Array) -> tuple[Array, Array]:
    """Mean and standard deviation of max(x, 0) for normal x: what non-negativity does to each number on its own."""
    from scipy.special import ndtr

    z = mean / sd
    share, height = ndtr(z), np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    first = sd * (z * share + height)
    second = sd**2 * ((z**2 + 1) * share + z * height)
    # Far below zero both vanish; a thousandth of the spread keeps their ratio in bounds.
    return first, np.sqrt(np.maximum(second - first**2, 1e-6 * sd**2))


def background_error(posterior: Posterior, mean: Array, covariance: Array) -> float:
    """Standard deviation of the second nuisance, the background, beside a density with this mean and covariance.

    Densities that may not be negative push the background down; as much as they do counts as an error of its own.
    """
    problem = posterior.problem
    through = np.linalg.solve(problem.triangle, problem.basis.T @ problem.design)
    inverse = posterior.noise * np.linalg.inv(problem.triangle)
    variance = (inverse @ inverse.T + through @ covariance @ through.T)[1, 1]
    pushed = posterior.nuisances(mean)[1] - posterior.nuisances(posterior.mean)[1]
    return float(np.hypot(np.sqrt(variance), pushed))


def _result(
    y: Array,
    data: Array,
    posterior: Posterior,
    mean: Array,
    covariance: Array,
    model: Array,
    factor: float,
    back: float,
) -> AbelResult:
    problem = posterior.problem
    weights = {order: 0.0 for order in {s.order for s in problem.settings}}
    for node in posterior.nodes:
        weights[problem.settings[node.setting].order] += node.weight
    at = spline_values(problem.nodes, y)
    density = np.maximum(at @ mean, 0.0) if (mean >= 0).all() else at @ mean
    spread = at @ covariance @ at.T
    sd = np.sqrt(np.maximum(np.diagonal(spread), 0.0))
    low, high = density - factor * sd, density + factor * sd
    error = background_error(posterior, mean, covariance) if problem.nuisances.shape[1] > 1 else 0.0
    return AbelResult(
        radius=y, density=density, standard_deviation=sd, covariance=spread,
        lower=np.maximum(low, 0.0) if (mean >= 0).all() else low, upper=high, band_factor=factor,
        fitted_projection=model, residual=data - model, noise=posterior.noise * problem.sigma,
        amplitude=posterior.average("amplitude"), length=posterior.average("length"),
        order=max(weights, key=lambda order: weights[order]),
        degrees_of_freedom=posterior.freedoms,
        log_evidence=float(max(part.log_evidence.max() for part in posterior.parts)),
        background=back, background_error=error,
    )  # fmt: skip


def _numbers(values: ArrayLike, name: str) -> Array:
    """A vector of finite numbers."""
    array = np.atleast_1d(np.asarray(values, float))
    if array.ndim != 1:
        raise DomainError(name, array.shape, "must be a vector")
    bad = ~np.isfinite(array)
    if bad.any():
        raise DomainError(name, float(array[bad][0]), "must be finite; leave out points without a value")
    return array


def _profile(radius: ArrayLike, values: ArrayLike, name: str) -> tuple[Array, Array]:
    """Increasing radii, and as many finite values."""
    r, v = _numbers(radius, "radius"), _numbers(values, name)
    if len(r) != len(v):
        raise DomainError(name, len(v), f"must be as many values as there are radii, {len(r)}")
    if r[0] < 0:
        raise DomainError("radius", float(r[0]), "must be 0 or above; fold both halves of a profile first")
    if not (np.diff(r) > 0).all():
        raise DomainError("radius", float(r[1:][np.diff(r) <= 0][0]), "must increase from point to point")
    return r, v


def _sigma(sigma: ArrayLike | None, count: int) -> Array:
    """Standard deviations of all points; ones when they are to be estimated."""
    if sigma is None:
        return np.ones(count)
    s = _numbers(sigma, "sigma")
    s = np.full(count, s[0]) if len(s) == 1 else s
    if len(s) != count:
        raise DomainError("sigma", len(s), f"must be one value, or as many as there are radii, {count}")
    if not (s > 0).all():
        raise DomainError("sigma", float(s.min()), "must be above 0")
    return s
