"""The plane to which the polarisation of a line of sight is referred."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Sine of the distance from the zenith or nadir below which the meridian plane is not defined.
_VERTICAL = 1e-9


def meridian_frame(origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Unit vectors v (in the meridian plane, upwards) and l = v x d (to the left) across lines of sight d.

    The meridian plane holds the line of sight and the local vertical at its origin.  Straight up and down v is the
    projection of north (+y), and that of +z where north itself is vertical.  Light arrives along -d, and (v, l, -d) is
    right-handed: an angle from v towards l is anticlockwise to who looks along d.

    Parameters
    ----------
    origins : array_like, shape (..., 3)
        From the planet's centre.
    directions : array_like, shape (..., 3)
        Unit vectors in which to look; broadcast against the origins.

    Returns
    -------
    v, l : ndarray, shape (..., 3)
    """
    o, d = np.broadcast_arrays(np.asarray(origins, float), np.asarray(directions, float))
    up = o / np.linalg.norm(o, axis=-1, keepdims=True)
    v = _across(up, d)
    for other in ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        short = np.linalg.norm(v, axis=-1, keepdims=True) < _VERTICAL
        v = np.where(short, _across(np.array(other), d), v)
    v = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return v, np.cross(v, d)


def meridian_turns(origins: Array, directions: Array, star: Array) -> Array:
    """Q and U at the meridian plane of light that has Q = 1 and U = 0 at the plane of the ray and a star.

    Parameters
    ----------
    origins, directions : ndarray, shape (ray, 3)
        From the planet's centre; unit vectors.
    star : ndarray, shape (3,)
        Unit vector.

    Returns
    -------
    ndarray, shape (ray, 2)
        Of rays straight to the star 0, for what is scattered there is not polarised.
    """
    v, left = meridian_frame(origins, directions)
    p = star - (directions @ star)[:, None] * directions
    p /= np.maximum(np.linalg.norm(p, axis=1, keepdims=True), 1e-12)
    cosine, sine = np.sum(p * v, axis=1), np.sum(p * left, axis=1)
    return np.stack([cosine**2 - sine**2, 2 * cosine * sine], axis=1)


def _across(vector: Array, d: Array) -> Array:
    """The part of a vector that is perpendicular to d."""
    part: Array = vector - np.sum(vector * d, axis=-1, keepdims=True) * d
    return part
