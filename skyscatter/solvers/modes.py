"""The slowest mode of light in the depths of a medium, which random walks follow towards their source.

Far from boundaries and sources light falls as exp(-kappa tau) and keeps an angular shape phi(mu), mu being the cosine
to the direction from which it comes; they solve

    (1 - kappa mu) phi(mu) = (omega / 2) int p(mu, mu') phi(mu') dmu'

with the phase function averaged over azimuth (Case & Zweifel 1967, Linear Transport Theory, chapter 4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Gauss-Legendre directions, and moments of the phase function that are kept.
DIRECTIONS, MOMENTS = 64, 32
#: Cosines, uniform from -1 to 1, at which the shape is tabulated.
SHAPE_NODES = 129


def slowest_mode(omega: float, moments: Array) -> tuple[float, Array]:
    """Exponent and angular shape of the slowest mode.

    Parameters
    ----------
    omega : float
        Single-scattering albedo, 0 to 1.
    moments : ndarray, shape (degree,)
        Legendre moments of the phase function; the first is 1.

    Returns
    -------
    kappa : float
        From 0 (white) to 1 (black).
    shape : ndarray, shape (SHAPE_NODES,)
        phi at cosines from -1 to 1, with integral 1 over the sphere [sr-1].
    """
    mu, weight = np.polynomial.legendre.leggauss(DIRECTIONS)
    degree = np.arange(moments.size)
    plain = np.polynomial.legendre.legvander(mu, moments.size - 1)
    # Without any absorption the exponent is zero and twice so; a trace of it tells the two modes apart.
    source = 0.5 * min(omega, 0.9998) * (2 * degree + 1) * moments
    matrix = (np.eye(mu.size) - (plain * source) @ plain.T * weight) / mu[:, None]
    values, vectors = np.linalg.eig(matrix)
    real = np.abs(values.imag) < 1e-9
    values, vectors = values[real].real, vectors[:, real].real
    positive = np.flatnonzero(values > 1e-6)
    # The quadrature blurs modes next to the continuum at 1; there every direction but the straight one is lost anyway.
    best = positive[np.argmin(values[positive])] if positive.size else -1
    kappa = float(np.clip(values[best], 0.02, 0.98)) if best >= 0 else 0.02
    nodes = np.linspace(-1, 1, SHAPE_NODES)
    if best < 0 or not 0.02 < values[best] < 0.98:
        shape = 1 / (1 - kappa * nodes)
    else:
        phi = vectors[:, best] * np.sign(vectors[np.argmax(np.abs(vectors[:, best])), best])
        projected = plain.T @ (weight * phi)
        shape = np.polynomial.legendre.legvander(nodes, moments.size - 1) @ (source * projected) / (1 - kappa * nodes)
    shape = np.maximum(shape, 1e-3 * shape.max())
    return kappa, shape / (2 * np.pi * np.trapezoid(shape, nodes))
