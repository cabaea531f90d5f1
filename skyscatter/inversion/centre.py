"""Where the middle of a round cloud is, from one image of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import ConvergenceError, DomainError

Array = NDArray[np.float64]

#: Rings per pixel of radius, between which the profile is linear.
RINGS = 1.0
#: Grid on which the start is sought, along each side.
LOOKS = 9


class Centre(NamedTuple):
    """Middle of a round image.

    Examples
    --------
    Columns are counted from the left, rows from the top, from the middle of the first pixel; it unpacks as a tuple.

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y, x = np.mgrid[:16, :16]
    >>> column, row, deviation = inversion.find_centre(np.exp(-((x - 9) ** 2 + (y - 6) ** 2) / 20), 0.01)
    >>> f"{column:.1f}, {row:.1f}"
    '9.0, 6.0'
    >>> deviation < 0.05  # pixel
    True
    """

    x: float  #: column, the first pixel's middle being 0
    y: float  #: row
    deviation: float  #: standard deviation along the worse direction [pixel]


def find_centre(image: ArrayLike, sigma: ArrayLike | float | None = None) -> Centre:
    """Middle of a cloud whose image is round, from one view.

    The middle is where one profile over the distance explains the image best: for every trial the profile, linear
    between rings, is fitted, and what it leaves over is brought down.  Clouds cut by the edge of the image are
    allowed, and so are shells and profiles of any form.

    Parameters
    ----------
    image : array_like, shape (y, x)
        NaN where there are no data.
    sigma : array_like or float, optional
        Standard deviation of the pixels; found from the residual when not given.

    Returns
    -------
    Centre

    Raises
    ------
    ConvergenceError
        If the image has no middle: it is flat, or the middle lies far outside.

    Examples
    --------
    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y, x = np.mgrid[:24, :32]
    >>> shell = np.exp(-((np.hypot(x - 18.3, y - 9.6) - 6) ** 2) / 4)  # dark in the middle
    >>> centre = inversion.find_centre(shell, 0.01)
    >>> f"{centre.x:.1f}, {centre.y:.1f}"
    '18.3, 9.6'
    """
    from scipy.optimize import minimize

    data = np.asarray(image, float)
    if data.ndim != 2 or min(data.shape) < 8:
        raise DomainError("image", data.shape, "needs the shape (y, x) with at least 8 pixels a side")
    error = np.broadcast_to(np.asarray(1.0 if sigma is None else sigma, float), data.shape)
    if np.any(error <= 0):
        raise DomainError("sigma", float(error.min()), "standard deviations are positive")
    rows, columns = np.nonzero(np.isfinite(data) & np.isfinite(error))
    if np.ptp(data[rows, columns]) == 0.0:
        raise ConvergenceError("centre: all pixels are equal; there is no middle")
    values, weights = data[rows, columns], 1 / error[rows, columns] ** 2

    def left_over(at: Array) -> float:
        return _left_over(values, weights, np.hypot(columns - at[0], rows - at[1]))

    height, width = data.shape
    trials = [np.array([x, y]) for x in np.linspace(0, width - 1, LOOKS) for y in np.linspace(0, height - 1, LOOKS)]
    start = min(trials, key=left_over)
    step = max(width, height) / (LOOKS - 1)
    simplex = start + step * np.array([[0.0, 0.0], [0.6, 0.1], [-0.1, 0.6]])
    options = {"initial_simplex": simplex, "xatol": 1e-3, "fatol": 0.0, "maxfev": 400}
    found = minimize(left_over, start, method="Nelder-Mead", options=options)
    deviation = _deviation(left_over, found.x, sigma is None, values.size, max(data.shape))
    return Centre(float(found.x[0]), float(found.x[1]), deviation)


def _left_over(values: Array, weights: Array, distance: Array) -> float:
    """Weighted sum of squares about the best profile, piecewise linear in the distance."""
    place = distance * RINGS
    ring = place.astype(int)
    share = place - ring
    size = int(ring.max()) + 2
    diagonal = np.bincount(ring, weights * (1 - share) ** 2, size) + np.bincount(ring + 1, weights * share**2, size)
    beside = np.bincount(ring, weights * share * (1 - share), size)[:-1]
    right = np.bincount(ring, weights * (1 - share) * values, size) + np.bincount(
        ring + 1, weights * share * values, size
    )
    from scipy.linalg import solveh_banded

    bands = np.zeros((2, size))
    bands[0, 1:] = beside
    bands[1] = diagonal + 1e-9 * diagonal.mean()  # rings without pixels
    profile = solveh_banded(bands, right)
    miss = values - (1 - share) * profile[ring] - share * profile[ring + 1]
    return float(np.sum(weights * miss**2))


def _deviation(left_over: Callable[[Array], float], at: Array, unknown: bool, count: int, size: int) -> float:
    """Along the worse direction, from the curvature of the misfit; scaled to the residual where noise is not known."""
    h = 0.5 * np.eye(2)
    bend = np.empty((2, 2))
    for a in range(2):
        for b in range(2):
            corners = [left_over(at + s * h[a] + t * h[b]) * s * t for s in (1, -1) for t in (1, -1)]
            bend[a, b] = sum(corners)  # over (2 * 0.5)^2
    scale = left_over(at) / max(count - 2, 1) if unknown else 1.0
    least = float(np.linalg.eigvalsh(bend)[0])
    deviation = np.sqrt(2 * scale / least) if least > 0 else np.inf
    if not deviation < size:
        raise ConvergenceError("centre: the image is as round about any point; it has no middle, or lies outside")
    return float(deviation)
