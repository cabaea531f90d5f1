"""Ellipsoidal shells fitted to images of optically thin light or of columns.

A density that is constant on similar ellipsoids, rho(m), is seen as a function of one elliptical radius q in the plane
of the sky (Stark 1977, ApJ 213, 368; Binney 1985, MNRAS 212, 767).  For a spheroid with equatorial radius a and polar
radius c, its axis inclined by i to the line of sight,

    N = (a c / b) F(q),  F(q) = 2 integral of rho(m) m / sqrt(m^2 - q^2) dm from q,  (125 of docs/theory/abel.md)
    q^2 = X^2 / a^2 + Y^2 / b^2,  b^2 = a^2 cos^2 i + c^2 sin^2 i,                       (126)

with Y along the projected axis.  So one image tells the ellipse (a, b), never c and i apart: `deproject` says what
remains possible, given what is known otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import ConvergenceError, DomainError
from skyscatter.inversion.brief import Brief
from skyscatter.inversion.pixels import Pixels, border_distance, check_centre, checked_image, symmetric_centre

Array = NDArray[np.float64]
Profile = Literal["uniform", "gaussian"]

_SUBPIXELS = 3  #: along each side, over which a pixel is averaged (midpoint rule)
_CUT = 6.07  #: widths at which a Gaussian shell ends, as in `skyscatter.fields.GaussianShell`
_TABLE = 600
_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(8)
_PANELS = 12
_STARTS = (0.12, 0.3, 0.6)  #: relative thicknesses from which the fit sets out
_FIRST, _LAST = 12, 80  #: steps at most, from each of these, and from the best of what they led to
NAMES = ("x", "y", "major", "minor", "position_angle_deg", "thickness", "brightness", "background")
GRADIENTS = ("gradient_x", "gradient_y")


@dataclass(frozen=True, repr=False)
class ShellFit(Brief):
    """An ellipsoidal shell as it is seen.

    Attributes
    ----------
    parameters : dict of str to float
        `x`, `y`: centre [pixel].  `major`, `minor`: semi-axes of the ellipse in which the shell's outer surface
        ("uniform") or ridge ("gaussian") is seen [unit of `pixel_size`].  `position_angle_deg`: of the major axis, from
        up (north) anticlockwise (through east, on the left), 0 to below 180.  `thickness`: (outer - inner) / outer, or
        standard deviation over the ridge's radius.  `brightness`: density times a c / b of (125), so that the image is
        `brightness` F(q) + `background` [unit of the image].  With a gradient `gradient_x`, `gradient_y`: relative rise
        of the column to the right and upwards [1 / unit of `pixel_size`].
    errors : dict of str to float
        Standard deviations.
    covariance : ndarray, shape (parameter, parameter)
        In the order of the parameters.
    profile : {"uniform", "gaussian"}
    fitted_image, residual : ndarray, shape (y, x)
        The residual is NaN where pixels are masked.
    noise : float
        Root mean square of the residual where `sigma` was not given, else of the residual over sigma.
    pixel_size : float

    Examples
    --------
    >>> from skyscatter import inversion
    >>> true = {"x": 16, "y": 12, "major": 9, "minor": 6, "position_angle_deg": 30, "thickness": 0.3}
    >>> image = inversion.shell_image((24, 32), {**true, "brightness": 5, "background": 1})
    >>> fit = inversion.fit_shell(image, sigma=0.1, pixel_size=2.0)  # arcsec, say
    >>> value, error = fit.ratio
    >>> f"axis ratio {value:.2f}, major semi-axis {fit.parameters['major']:.1f} arcsec"
    'axis ratio 0.67, major semi-axis 18.0 arcsec'
    >>> error < 0.01, fit.errors["major"] < 0.05
    (True, True)
    """

    parameters: dict[str, float]
    errors: dict[str, float]
    covariance: Array
    profile: Profile
    fitted_image: Array
    residual: Array
    noise: float
    pixel_size: float

    @property
    def ratio(self) -> tuple[float, float]:
        """Minor over major semi-axis as seen, and its standard deviation."""
        p, names = self.parameters, list(self.parameters)
        value = p["minor"] / p["major"]
        slope = np.zeros(len(names))
        slope[names.index("minor")], slope[names.index("major")] = 1 / p["major"], -value / p["major"]
        return value, float(np.sqrt(slope @ self.covariance @ slope))


def shell_column(q: ArrayLike, thickness: float, profile: Profile = "uniform") -> Array:
    """F(q) of equation 125 for a shell of density 1 (on its ridge) whose outer surface (ridge) is m = 1.

    Parameters
    ----------
    q : array_like
        Elliptical radius, 0 or above.
    thickness : float
        Uniform: (outer - inner) / outer, above 0, at most 1 (a full ellipsoid).  Gaussian: standard deviation, the
        shell being cut at 6.07 of them.
    profile : {"uniform", "gaussian"}

    Returns
    -------
    ndarray
        Of the shape of `q`.

    Examples
    --------
    A thin shell is brightest just inside its inner surface, here at 0.7 of its radius, where the chord through it is
    longest.

    >>> from skyscatter import inversion
    >>> inversion.shell_column([0, 0.7, 0.9, 1], 0.3).round(2)
    array([0.6 , 1.43, 0.87, 0.  ])
    """
    x = np.asarray(q, float)
    if profile == "uniform":
        inner = max(1.0 - thickness, 0.0)
        return 2 * (np.sqrt(np.maximum(1 - x**2, 0.0)) - np.sqrt(np.maximum(inner**2 - x**2, 0.0)))
    end = 1.0 + _CUT * thickness
    nodes = np.linspace(0.0, end, _TABLE)
    table = _gaussian_column(nodes, thickness, end)
    return np.interp(x, nodes, table, right=0.0)


def _gaussian_column(q: Array, width: float, end: float) -> Array:
    """Gauss's rule over the half of the line of sight that lies within the cut."""
    # Panels are even in the radius m, so that the ridge is met however thin it is.
    low = np.maximum(q, max(1.0 - _CUT * width, 0.0))
    edges = low[:, None] + (end - low)[:, None] * np.linspace(0.0, 1.0, _PANELS + 1)
    along = np.sqrt(np.maximum(edges**2 - q[:, None] ** 2, 0.0))
    half, middle = 0.5 * np.diff(along, axis=1), 0.5 * (along[:, 1:] + along[:, :-1])
    places = middle[..., None] + half[..., None] * _GAUSS_X
    value = np.exp(-0.5 * ((np.sqrt(places**2 + q[:, None, None] ** 2) - 1.0) / width) ** 2)
    result: Array = 2 * np.einsum("ijk,ij,k->i", value, half, _GAUSS_W)
    return result


def shell_image(
    shape: tuple[int, int], parameters: dict[str, float], profile: Profile = "uniform", *, pixel_size: float = 1.0,
    psf: float = 0.0, averaged: bool = True,
) -> Array:  # fmt: skip
    """Image of a shell with the parameters of `ShellFit`, pixels averaged over their area.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns.
    parameters : dict of str to float
        As in `ShellFit`; gradients may be left out.
    profile : {"uniform", "gaussian"}
    pixel_size : float
    psf : float
        Standard deviation of a Gaussian point spread [pixel].
    averaged : bool
        Whether pixels are averages over their area, as a detector's; False for values at their middles, as rendered.

    Returns
    -------
    ndarray, shape (y, x)

    Raises
    ------
    DomainError
        If a parameter is missing.

    Examples
    --------
    >>> from skyscatter import inversion
    >>> shell = {"x": 16, "y": 12, "major": 9, "minor": 6, "position_angle_deg": 90, "thickness": 0.3}
    >>> image = inversion.shell_image((24, 32), {**shell, "brightness": 5, "background": 1})
    >>> image.shape
    (24, 32)
    >>> image[12, [2, 16]].round(1)  # beside the shell, and through its middle
    array([1., 4.])
    """
    p = {name: float(value) for name, value in parameters.items()}
    missing = [name for name in NAMES if name not in p]
    if missing:
        raise DomainError("parameters", missing[0], "is missing")
    count = _SUBPIXELS if averaged else 1
    offsets = (np.arange(count) + 0.5) / count - 0.5
    x = ((np.arange(shape[1])[:, None] + offsets).ravel() - p["x"]) * pixel_size
    up = -((np.arange(shape[0])[:, None] + offsets).ravel() - p["y"]) * pixel_size
    sine, cosine = np.sin(np.radians(p["position_angle_deg"])), np.cos(np.radians(p["position_angle_deg"]))
    major = -x[None, :] * sine + up[:, None] * cosine
    minor = x[None, :] * cosine + up[:, None] * sine
    column = shell_column(np.hypot(major / p["major"], minor / p["minor"]), p["thickness"], profile)
    if "gradient_x" in p or "gradient_y" in p:
        column = column * (1.0 + p.get("gradient_x", 0.0) * x[None, :] + p.get("gradient_y", 0.0) * up[:, None])
    column = column.reshape(shape[0], count, shape[1], count).mean(axis=(1, 3))
    if psf > 0:
        from scipy.ndimage import gaussian_filter

        column = gaussian_filter(column, psf, mode="nearest")
    result: Array = p["brightness"] * column + p["background"]
    return result


def fit_shell(
    image: ArrayLike,
    sigma: ArrayLike | float | None = None,
    mask: ArrayLike | None = None,
    *,
    profile: Profile = "uniform",
    gradient: bool = False,
    centre: tuple[float, float] | None = None,
    pixel_size: float = 1.0,
    psf: float = 0.0,
    averaged: bool = True,
    robust: bool = False,
    progress: Callable[[float], Any] | None = None,
) -> ShellFit:
    """Ellipsoidal shell that is nearest to an image, by least squares.

    Parameters
    ----------
    image : array_like, shape (y, x)
        Brightness of optically thin light, or column; NaN where there is no value.  Where it is not linear in either
        (photographic densities), only the geometry means anything.
    sigma : array_like or float, optional
        Standard deviation of each pixel.  Without it the errors are scaled to the residual.
    mask : array_like of bool, shape (y, x), optional
        True for pixels that are left out (stars).
    profile : {"uniform", "gaussian"}
        Density between two surfaces, or falling off from a ridge.
    gradient : bool
        Whether the density may rise linearly in some direction.
    centre : (x, y), optional
        Where to start [pixel]; it is fitted in any case.
    pixel_size : float
        Length of a pixel's side, in any unit.
    psf : float
        Standard deviation of the image's point spread [pixel].
    averaged : bool
        Whether pixels are averages over their area, as a detector's; False for values at their middles, as rendered.
    robust : bool
        Count large deviations by their size, not their square (soft L1), so that stars that were not masked matter
        little.
    progress : callable, optional
        Called with the share done.

    Returns
    -------
    ShellFit

    Raises
    ------
    DomainError
        For an image, sigma or mask that cannot be used.
    ConvergenceError
        If no start leads to a shell within the image.

    Examples
    --------
    >>> from skyscatter import inversion
    >>> true = {"x": 16, "y": 12, "major": 9, "minor": 6, "position_angle_deg": 30, "thickness": 0.3}
    >>> image = inversion.shell_image((24, 32), {**true, "brightness": 5, "background": 1})
    >>> fit = inversion.fit_shell(image, sigma=0.1)
    >>> [round(fit.parameters[name], 1) for name in ("major", "minor", "position_angle_deg", "thickness")]
    [9.0, 6.0, 30.0, 0.3]
    """
    pixels = checked_image(image, sigma, mask)
    if profile not in ("uniform", "gaussian"):
        raise DomainError("profile", profile, 'must be "uniform" or "gaussian"')
    if not (np.isfinite(pixel_size) and pixel_size > 0):
        raise DomainError("pixel_size", pixel_size, "must be above 0")
    if not (np.isfinite(psf) and psf >= 0):
        raise DomainError("psf", psf, "must be 0 or above")
    place = symmetric_centre(pixels) if centre is None else check_centre("centre", centre, pixels.values.shape)
    scale = float(np.std(_capped(pixels)[pixels.used]))
    if not scale > 0:
        raise DomainError("image", float(pixels.values[pixels.used][0]), "is the same everywhere: there is no shell")
    optics = {"psf": psf, "averaged": averaged}
    best: Any = None
    for number, thickness in enumerate(_STARTS):
        start = _start(pixels, place, thickness, profile, gradient, scale)
        found = _least_squares(pixels, start, profile, optics, scale, robust, _FIRST)
        if best is None or found.cost < best.cost:
            best = found
        if progress:
            progress((number + 1) / (len(_STARTS) + 1))
    best = _least_squares(pixels, best.x, profile, optics, scale, robust, _LAST)
    if not _is_shell(best, pixels.values.shape):
        raise ConvergenceError("no shell was found in the image; give centre, or mask what is not the shell")
    if progress:
        progress(1.0)
    return _fit_result(pixels, best, profile, optics, scale, pixel_size)


#  Inner parameters: x, y, ln sqrt(ab), e1, e2 with e = ln(major / minor) (cos, sin)(2 position angle), ln thickness,
#  brightness and background in units of the image's spread, gradients per pixel.  None is singular for a circle.


def _outer(v: Array, scale: float) -> dict[str, float]:
    e = float(np.hypot(v[3], v[4]))
    angle = float(np.degrees(0.5 * np.arctan2(v[4], v[3]))) % 180.0
    values = [
        v[0],
        v[1],
        np.exp(v[2] + 0.5 * e),
        np.exp(v[2] - 0.5 * e),
        angle,
        np.exp(v[5]),
        v[6] * scale,
        v[7] * scale,
    ]
    return dict(zip((*NAMES, *GRADIENTS), [float(x) for x in (*values, *v[8:])], strict=False))


def _capped(pixels: Pixels) -> Array:
    """The image with its brightest fiftieth, where stars are, cut to the same value."""
    return np.minimum(pixels.values, np.percentile(pixels.values[pixels.used], 98))


def _start(
    pixels: Pixels, place: tuple[float, float], thickness: float, profile: Profile, gradient: bool, scale: float
) -> Array:
    """A shell with the image's second moments."""
    values, used = _capped(pixels), pixels.used
    y, x = np.nonzero(used)
    level = float(np.percentile(values[used], 20))
    weight = np.maximum(values[used] - level - scale, 0.0)
    if not weight.sum() > 0:
        weight = np.maximum(values[used] - level, 0.0)
    dx, dy = x - place[0], place[1] - y
    xx, yy, xy = ((weight * m).sum() / weight.sum() for m in (dx * dx, dy * dy, dx * dy))
    # The half-trace and the difference of the moments' eigenvalues; for a position angle p the major axis is along
    # (-sin p, cos p), so that cos 2p goes with yy - xx and sin 2p with -2 xy.
    mean, c2, s2 = 0.5 * (xx + yy), 0.5 * (yy - xx), -xy
    size = np.hypot(c2, s2)
    e = 0.5 * np.log((mean + 0.95 * size) / max(mean - 0.95 * size, 1e-3 * mean))
    turn = np.array([c2, s2]) / max(size, 1e-300) * e
    q = np.linspace(0, 1 + _CUT * thickness, 400)
    column = shell_column(q, thickness, profile)
    own = (column * q**3).sum() / (column * q).sum()  # mean q^2 over the image is twice a coordinate's
    radius = np.sqrt(max(2 * np.sqrt(max(mean**2 - (0.95 * size) ** 2, 1e-6)) / own, 4.0))
    bright = (values[used].max() - level) / column.max() / scale
    return np.array([*place, np.log(radius), *turn, np.log(thickness), bright, level / scale, *([0.0, 0.0] * gradient)])


def _least_squares(
    pixels: Pixels, start: Array, profile: Profile, optics: dict[str, Any], scale: float, robust: bool, steps: int
) -> Any:
    from scipy.optimize import least_squares

    shape, used = pixels.values.shape, pixels.used
    noise = pixels.sigma[used] if pixels.known_noise else np.full(int(used.sum()), 0.1 * scale)

    def difference(v: Array) -> Array:
        model = shell_image(shape, _outer(v, scale), profile, **optics)
        return np.asarray((model[used] - pixels.values[used]) / noise)

    low, high = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    low[:2], high[:2] = -0.5, (shape[1] - 0.5, shape[0] - 0.5)
    low[2], high[2] = 0.0, np.log(2.0 * max(shape))
    low[3:5], high[3:5] = -2.5, 2.5
    low[5], high[5] = np.log(0.01), 0.0
    low[8:], high[8:] = -1.0, 1.0
    inside = np.clip(start, low + 1e-6, high - 1e-6)
    radius = np.exp(inside[2])

    def slopes(v: Array) -> Array:
        # Central differences over some 0.05 pixels: sub-pixels that cross a sharp edge make the model rough below that.
        h = np.array([0.05, 0.05, *[0.05 / radius] * 3, min(0.05 / radius / np.exp(v[5]), 0.3), 0.01, 0.01, 1e-4, 1e-4])
        shifts = np.diag(h[: len(v)])
        return np.stack([(difference(v + d) - difference(v - d)) / (2 * d.sum()) for d in shifts], axis=1)

    found = least_squares(
        difference, inside, jac=slopes, bounds=(low, high), x_scale=_scales(start),
        loss="soft_l1" if robust else "linear", max_nfev=steps, xtol=1e-6, ftol=1e-8, gtol=None,
    )  # fmt: skip
    return found


def _is_shell(found: Any, shape: tuple[int, int]) -> bool:
    """Whether a fit came to an end, with a bright shell of more than a pixel within the image."""
    reach = border_distance(shape, (float(found.x[0]), float(found.x[1])))
    return bool(found.status > 0 and found.x[6] > 0 and reach > 0 and np.exp(found.x[2]) > 1.5)


def _scales(start: Array) -> Array:
    scales = np.array([1.0, 1.0, 0.05, 0.05, 0.05, 0.2, max(abs(start[6]), 0.1) * 0.1, 0.1, 1e-3, 1e-3])
    return scales[: len(start)]


def _fit_result(
    pixels: Pixels, found: Any, profile: Profile, optics: dict[str, Any], scale: float, pixel_size: float
) -> ShellFit:
    shape, used = pixels.values.shape, pixels.used
    inner = _outer(found.x, scale)
    fitted = shell_image(shape, inner, profile, **optics)
    residual = np.where(used, pixels.values - fitted, np.nan)
    covariance = np.linalg.pinv(found.jac.T @ found.jac)
    noise = float(np.sqrt(np.nanmean((residual / pixels.sigma) ** 2)))
    if not pixels.known_noise:
        freedoms = max(int(used.sum()) - len(found.x), 1)
        covariance = covariance * 2 * found.cost / freedoms
    units = np.array([1, 1, pixel_size, pixel_size, 1, 1, 1, 1, 1 / pixel_size, 1 / pixel_size])[: len(found.x)]
    slope = _slopes(found.x, scale) * units[:, None]
    outer = slope @ covariance @ slope.T
    values = {name: float(value * units[k]) for k, (name, value) in enumerate(inner.items())}
    errors = {name: float(np.sqrt(outer[k, k])) for k, name in enumerate(values)}
    return ShellFit(values, errors, outer, profile, fitted, residual, noise, pixel_size)


def _slopes(v: Array, scale: float) -> Array:
    """Derivatives of the outer parameters with respect to the inner ones."""
    e = max(float(np.hypot(v[3], v[4])), 1e-12)
    cosine, sine = v[3] / e, v[4] / e
    major, minor = np.exp(v[2] + 0.5 * e), np.exp(v[2] - 0.5 * e)
    slope = np.eye(len(v))
    slope[2, 2:5] = major * np.array([1.0, 0.5 * cosine, 0.5 * sine])
    slope[3, 2:5] = minor * np.array([1.0, -0.5 * cosine, -0.5 * sine])
    slope[4, 2:5] = np.degrees(0.5) * np.array([0.0, -sine, cosine]) / e
    slope[5, 5] = np.exp(v[5])
    slope[6, 6] = slope[7, 7] = scale
    return slope
