"""How the error of a deterministic solution is estimated: from a second, coarser one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.solvers.base import Array

#: Share of the difference that is reported: methods of second order on half the steps leave a third of it; the rest
#: is caution.  Beyond the second number of a tolerance steps are so long that all of it may be left.
ERROR_SHARE, ASSURED = 0.5, 0.01
#: The largest share, where forward peaks are cut off.
MOST_SHARE = 1.0
#: Share of the tolerance that is always reported: where both solutions happen to agree, neither is that good.
LEAST_ERROR = 0.4
#: Share of the level sunlight that delta-M takes for unscattered that is reported as error.
LEVEL_ERROR = 0.1
#: Zenith angles of the Sun [degree] between which sunlight begins to count as level.
LEVEL = 80.0, 90.0


def error_share(tolerance: float, cut: Array | None = None, cut_coarser: Array | None = None) -> Array:
    """Share of the difference between two solutions that is reported, where the finer one was made to a tolerance.

    Of what forward peaks do each solution misses as much as it cuts off, (wavelength,): where both cut off much alike,
    their difference is less than what is missing.
    """
    share = np.asarray(ERROR_SHARE if tolerance <= ASSURED else 1.0)
    if cut is None or cut_coarser is None:
        return share
    missing = cut / np.maximum(cut_coarser - cut, cut / MOST_SHARE + 1e-300)
    return np.maximum(share, missing)


def levelness(zenith: ArrayLike) -> Array:
    """How far sunlight from a zenith angle [rad] counts as level: 0 from high above, 1 from the horizontal on."""
    return np.asarray(np.clip((np.degrees(zenith) - LEVEL[0]) / (LEVEL[1] - LEVEL[0]), 0.0, 1.0))


def level_error(zenith: ArrayLike, peaks: Array) -> Array:
    """Relative error of what delta-M makes of level sunlight, in which a coarser solution has its part.

    Parameters
    ----------
    zenith : array_like, shape (...)
        Of the Sun [rad].
    peaks : (wavelength,)
        Share of level sunlight that the cut peaks scatter.

    Returns
    -------
    ndarray, shape (..., wavelength)
    """
    return np.asarray(LEVEL_ERROR * levelness(zenith)[..., None] * peaks)


def stated_error(fine: Array, coarse: Array, tolerance: float) -> Array:
    """Estimated error of a value from that of a coarser solution, of one shape."""
    return np.asarray(error_share(tolerance) * np.abs(fine - coarse) + LEAST_ERROR * tolerance * np.abs(fine))


def relative_error(fine: Array, coarse: Array, tolerance: float, own: int, share: Array) -> Array:
    """Estimated relative error of the rays of a bundle, (wavelength,), from some that were compared, (ray, wavelength).

    The worst of its own rays, of which there are the first so many; and no less than the root mean square of all.
    `share` is as from `error_share`.
    """
    size = np.maximum(np.maximum(np.abs(fine), np.abs(coarse)), 1e-300)
    difference = np.abs(coarse - fine) / size
    typical = np.sqrt(np.mean(difference**2, axis=0))
    worst = np.maximum(difference[:own].max(axis=0), typical)
    return np.asarray(share * worst + LEAST_ERROR * tolerance)


def lowest_point(origin: Array, direction: Array, radius: float) -> Array:
    """Point of a ray that is nearest to a planet of that radius: where it starts, its tangent point, or the ground."""
    along = float(origin @ direction)
    if along >= 0:
        return origin
    tangent = origin - along * direction
    depth = max(radius**2 - float(tangent @ tangent), 0.0)
    return np.asarray(tangent - np.sqrt(depth) * direction)


def turned(origin: Array, direction: Array, radius: float, count: int) -> tuple[Array, Array]:
    """Copies of a ray, turned by equal steps about the vertical at its lowest point: (ray, 3) each.

    There the Sun stands for all of them as high as for the ray itself, wherever they are seen from.
    """
    if count <= 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    from scipy.spatial.transform import Rotation

    lowest = lowest_point(origin, direction, radius)
    angle = 2 * np.pi * np.arange(1, count + 1) / (count + 1)
    turns = Rotation.from_rotvec(angle[:, None] * lowest / np.linalg.norm(lowest))
    return lowest + turns.apply(origin - lowest), turns.apply(direction)
