"""How much light of a disk that is darkened towards its limb passes another disk in front of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial.frames import Array
from skyscatter.spectra.solar import disk_mean, limb_coefficients

#: Gauss-Legendre points over the rings that are partly covered.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_POWERS = np.arange(6)
_AT_ONCE = 50_000  # places: some 10 MB an array


def uncovered_area(separation: ArrayLike, ratio: ArrayLike) -> Array:
    """Share of the area of a disk that another one leaves free.

    Parameters
    ----------
    separation, ratio : array_like, any shapes that go together
        Distance of the middles and radius of the disk in front, both in radii of the disk behind.

    Returns
    -------
    ndarray
    """
    return _moments(separation, ratio)[..., 0]


def uncovered_light(separation: ArrayLike, ratio: ArrayLike, wavelengths: ArrayLike) -> Array:
    """Share of the Sun's light that passes the Moon, with the Sun's limb darkening.

    Parameters
    ----------
    separation, ratio : array_like, any shapes that go together
        Distance of the middles and radius of the Moon, both in radii of the Sun.
    wavelengths : array_like, shape (wavelength,)
        [nm]

    Returns
    -------
    ndarray, shape (..., wavelength)
        1 where the Moon stands beside the Sun, 0 where it covers all of it.

    Notes
    -----
    The darkening is a polynomial in the cosine mu (`skyscatter.spectra.solar.limb_darkening`), so that geometry and
    wavelength part: rings of the Sun at a radius r, each with the share of its circumference that is free, integrated
    with mu^n to mu^5 once for all wavelengths.  Where rings are partly covered 24 Gauss points in an angle that takes
    away the roots at both ends give 1e-6 of what passes, or better.

    Examples
    --------
    Half of the Sun's diameter is covered: what is left has lost more of the blue, which is brighter in the middle.

    >>> from skyscatter.celestial.coverage import uncovered_area, uncovered_light
    >>> round(float(uncovered_area(1.0, 1.0)), 4)
    0.609
    >>> uncovered_light(1.0, 1.0, [400.0, 800.0]).round(4)
    array([0.599 , 0.6044])
    """
    weighted = limb_coefficients(wavelengths) * (2.0 / (_POWERS + 2.0))[:, None] / disk_mean(wavelengths)
    return np.asarray(_moments(separation, ratio) @ weighted)


def _moments(separation: ArrayLike, ratio: ArrayLike) -> Array:
    """As `_some_moments`, for any number of places."""
    s, k = np.broadcast_arrays(np.asarray(separation, dtype=float), np.asarray(ratio, dtype=float))
    result = np.empty((s.size, _POWERS.size))
    flat_s, flat_k = s.ravel(), k.ravel()
    for start in range(0, s.size, _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        result[part] = _some_moments(flat_s[part], flat_k[part])
    return result.reshape(*s.shape, _POWERS.size)


def _some_moments(separation: Array, ratio: Array) -> Array:
    """Integrals of mu^n over what is free of the disk, each relative to the whole; shape (..., 6).

    A ring at r is free where r > s + k and where r < s - k, covered where r < k - s, and else partly so: the half angle
    that is covered has the cosine (r^2 + s^2 - k^2) / (2 r s).
    """
    s, k = separation[..., None], ratio[..., None]
    beyond = np.minimum(s + k, 1.0)  # free from here outwards
    near = np.minimum(np.abs(s - k), 1.0)  # free or covered up to here
    within = np.where(s > k, 1.0, 0.0)
    power = 0.5 * (_POWERS + 2.0)
    # With u = mu^2 the whole is the integral of u^(n / 2), and a circle of radius r cuts off 1 - u^(n / 2 + 1).
    moments = (1.0 - beyond**2) ** power + within * (1.0 - (1.0 - near**2) ** power)
    middle, half = 0.5 * (near + beyond), 0.5 * (beyond - near)
    turn = 0.5 * math.pi * _NODES
    r = middle + half * np.sin(turn)
    weight = 0.5 * math.pi * _WEIGHTS * half * np.cos(turn) * 2.0 * r
    across = 2.0 * r * s
    cosine = np.clip((r**2 + s**2 - k**2) / np.where(across > 0.0, across, 1.0), -1.0, 1.0)
    free = np.arccos(-cosine) / math.pi
    mu = np.sqrt(np.maximum(1.0 - r**2, 0.0))
    rings = np.stack([(weight * free * mu**n).sum(axis=-1) * (n + 2.0) / 2.0 for n in _POWERS], axis=-1)
    return np.asarray(moments + rings)
