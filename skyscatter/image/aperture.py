"""Diffraction by the aperture of a telescope, integrated over pixels: Airy's rings, a hole in the middle, and spikes.

A clear circle of diameter D with a round obstruction ε D gathers within the angle θ, with x = π D θ / λ, all but

    S(x) = (J0²(x) + J1²(x) + ε² (J0²(εx) + J1²(εx)) - 4 ε ∫_x^∞ J1(t) J1(εt) / t dt) / (1 - ε²)

of a point's light (ε = 0: Rayleigh 1881; the integral from 0 is ε / 2).  The rings are much finer than the pixels of
most pictures, and so no pixel is sampled: the light of a pixel is the flow of ``-S / (2 π r)`` out of its four edges,
by Gauss's theorem, and 1 more in the middle; S has hardly any ripples.

Vanes that hold the secondary mirror are told from the rest by Babinet's principle: each casts the pattern of a slit of
its width w and half length, ``sinc²(w θ / λ)`` across it, with as much light as it covers; the interference with the
rings, which pixels average away, is left out.  Two crossed vanes stand along the picture's sides.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.record import Record

Array = NDArray[np.float64]

ARCSEC = np.pi / 180.0 / 3600.0
#: Table of S over x: fine where it has ripples; beyond its end they are less than 1e-3 of it, and it falls as 1 / x.
_END = 2000.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class Aperture(Record):
    """A round mirror: its diameter [m], the share of that which is hidden, and the width of two crossed vanes [m]."""

    diameter_m: float
    obstruction: float = 0.0
    vane_m: float = 0.0

    def outside(self, radius_arcsec: ArrayLike, wavelength_nm: float) -> Array:
        """Share of the light further from the centre than an angle, without the vanes."""
        x = np.pi * self.diameter_m * ARCSEC / (wavelength_nm * 1e-9) * np.asarray(radius_arcsec, dtype=float)
        return _outside(x, self.obstruction)

    @property
    def spiked(self) -> float:
        """Share of the light in the spikes of each of the two vanes."""
        covered = self.vane_m * self.diameter_m * (1.0 - self.obstruction)
        free = np.pi / 4.0 * self.diameter_m**2 * (1.0 - self.obstruction**2)
        return covered / (free - 2.0 * covered)

    def kernel(self, pixel_scale_arcsec: float, largest: int, wavelength_nm: float) -> Array:
        """Share of a point's light, at the middle of a pixel, that falls into each pixel around it.

        Parameters
        ----------
        pixel_scale_arcsec : float
        largest : int
            Longest side of the picture [pixel]; what falls further out is lost.
        wavelength_nm : float

        Returns
        -------
        ndarray, shape (2 largest + 1, 2 largest + 1)
            Its sum is the share that falls within.
        """
        share = self.spiked
        quarter = (1.0 - 2.0 * share) * self._rings(pixel_scale_arcsec, largest, wavelength_nm)
        if share > 0.0:
            edges = (np.arange(largest + 2) - 0.5) * pixel_scale_arcsec * ARCSEC / (wavelength_nm * 1e-9)
            long, thin = (np.diff(_slit(width * edges)) for width in (self.vane_m, self._half_vane))
            quarter += share * (long[:, None] * thin[None, :] + thin[:, None] * long[None, :])
        half = np.concatenate([quarter[:0:-1], quarter])
        return np.concatenate([half[:, :0:-1], half], axis=1)

    @property
    def _half_vane(self) -> float:
        return self.diameter_m * (1.0 - self.obstruction) / 2.0

    def _rings(self, pixel: float, largest: int, wavelength_nm: float) -> Array:
        """Light of the pixels (y, x) from the middle to the lower right."""
        along = np.arange(largest + 1, dtype=float)
        flow = np.zeros((largest + 1, largest + 1))  # through the right edge of each pixel, outwards
        for node, weight in zip(_NODES / 2.0, _WEIGHTS / 2.0, strict=True):
            square = (along + 0.5) ** 2 + (along[:, None] + node) ** 2
            flow -= weight * self.outside(pixel * np.sqrt(square), wavelength_nm) * (along + 0.5) / (2 * np.pi * square)
        gained = flow - np.concatenate([-flow[:, :1], flow[:, :-1]], axis=1)
        light = gained + gained.T
        light[0, 0] += 1.0
        return np.maximum(light, 0.0)  # far out it is the difference of numbers that are nearly the same


def _slit(width: NDArray[np.floating]) -> Array:
    """Light of a slit's pattern from the middle to an angle, 1/2 in all; `width` is that of the slit times θ / λ."""
    from scipy.special import sici

    u = np.pi * width
    return np.asarray((sici(2.0 * u)[0] - np.sin(u) * np.sinc(width)) / np.pi)


def _outside(x: Array, obstruction: float) -> Array:
    """S of the module's text."""
    nodes, values = _table(obstruction)
    return np.asarray(np.interp(x, nodes, values) / np.maximum(x, 1.0))


@lru_cache(maxsize=8)
def _table(obstruction: float) -> tuple[Array, Array]:
    """Nodes of x, and S there, times x beyond 1."""
    from scipy.integrate import cumulative_simpson
    from scipy.special import j0, j1

    x = np.concatenate([np.arange(0.0, 200.0, 0.01), np.arange(200.0, _END, 0.05)])
    light = j0(x) ** 2 + j1(x) ** 2
    if obstruction > 0.0:
        small = obstruction * x
        bound = np.divide(j1(x) * j1(small), x, out=np.zeros_like(x), where=x > 0.0)
        rest = obstruction / 2.0 - cumulative_simpson(bound, x=x, initial=0.0)
        light += obstruction**2 * (j0(small) ** 2 + j1(small) ** 2) - 4.0 * obstruction * rest
    limit = 2.0 / (np.pi * (1.0 - obstruction))
    values = np.append(light / (1.0 - obstruction**2) * np.maximum(x, 1.0), limit)
    return np.append(x, 1.001 * _END), values
