"""What is known beforehand of dark ground, and what a dark pixel then says of the haze above it.

The darkest pixels of a region are leaves, water, or soil and streets that are no brighter than they must be.  Each such
cover has a mean spectrum, a brightness that is common to all bands and less well known, and deviations of its own in
each band.  Under a trial amount of haze the model of a pixel is inverted; how probable the surface spectrum is that
comes out, under any of the covers and not negative, is the likelihood of that amount.  So an upper bound (no band may
come out negative), dark vegetation (Kaufman et al. 1997, IEEE Trans. Geosci. Remote Sens. 35, 1286: blue and red follow
from 2.2 um) and dark water enter in one way, with whatever bands there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from skyscatter.dehaze.forward import BACK, DIFFUSE, DIRECT, PATH, surface_reflectance
from skyscatter.dehaze.passband import Band

Array = NDArray[np.float64]

#: Where the spectra of the covers below are given [nm].
NODES = (440.0, 490.0, 560.0, 665.0, 705.0, 740.0, 783.0, 842.0, 865.0, 1610.0, 2200.0)


class Cover(NamedTuple):
    """A kind of dark ground."""

    name: str
    weight: float  #: share among the darkest pixels of regions
    mean: tuple[float, ...]  #: spectrum, at `NODES`
    brightness: float  #: relative standard deviation common to all bands
    relative: tuple[float, float, float]  #: relative deviations of single bands: visible, near and short-wave infrared
    absolute: float  #: deviation of single bands in reflectance


# Round numbers after what the methods of Kaufman et al. 1997 and Levy et al. 2007 (J. Geophys. Res. 112, D13211) take
# for leaves (red 0.5 and blue 0.25 of the reflectance at 2.1 um, each to some 0.006), and after how deep and turbid
# water, soil and asphalt look in spectral libraries.
COVERS = (
    Cover(
        "leaves", 0.35, (0.020, 0.024, 0.048, 0.028, 0.080, 0.20, 0.27, 0.30, 0.30, 0.14, 0.060),
        0.35, (0.15, 0.50, 0.30), 0.004,
    ),
    Cover(
        "clear water", 0.15, (0.028, 0.025, 0.018, 0.007, 0.005, 0.003, 0.003, 0.002, 0.002, 0.001, 0.001),
        0.35, (0.20, 0.50, 0.50), 0.005,
    ),
    Cover(
        "turbid water", 0.10, (0.032, 0.042, 0.058, 0.042, 0.033, 0.015, 0.015, 0.012, 0.010, 0.002, 0.001),
        0.45, (0.25, 0.50, 0.50), 0.006,
    ),
    Cover(
        "sparse leaves", 0.15, (0.042, 0.050, 0.078, 0.080, 0.13, 0.22, 0.27, 0.285, 0.29, 0.27, 0.19),
        0.40, (0.25, 0.35, 0.35), 0.008,
    ),
    Cover(
        "bare ground", 0.15, (0.060, 0.072, 0.092, 0.115, 0.125, 0.135, 0.145, 0.15, 0.155, 0.19, 0.17),
        0.45, (0.20, 0.35, 0.40), 0.008,
    ),
    Cover(
        "anything", 0.10, (0.12, 0.13, 0.15, 0.17, 0.18, 0.20, 0.22, 0.22, 0.22, 0.22, 0.20),
        0.70, (0.40, 0.40, 0.50), 0.05,
    ),
)  # fmt: skip
#: The darkest pixels of a patch are darker than the patch: by one or two times the tenth by which leaves and water
#: vary within one or so.
DARKER = 0.85
#: Those whose spectra are known well enough to tell the colour of a haze by, and the last, which tells nothing.
TELLING = np.array([cover.name in ("leaves", "clear water", "turbid water") for cover in COVERS])
ANYTHING = len(COVERS) - 1
#: Noise of a mean of dark pixels in reflectance, and the part of the path's that the model may be wrong by.
NOISE, MODEL_ERROR = 0.0015, 0.01
#: Part of the light from the surroundings that is not known.
AROUND_ERROR = 0.15


class Spectra(NamedTuple):
    """The covers in the bands of a sensor."""

    log_weight: Array  #: (cover,)
    mean: Array  #: (cover, band)
    common: Array  #: (cover, band) standard deviation common to all bands
    own: Array  #: (cover, band) standard deviation of single bands


def cover_spectra(bands: Sequence[Band]) -> Spectra:
    """The covers' spectra in some bands."""
    centre = np.array([band.effective_wavelength for band in bands])
    region = np.where(centre < 720, 0, np.where(centre < 1200, 1, 2))
    mean = DARKER * np.array([np.interp(centre, NODES, cover.mean) for cover in COVERS])
    common = np.array([cover.brightness for cover in COVERS])[:, None] * mean
    own = np.array([np.hypot(np.array(c.relative)[region] * m, c.absolute) for c, m in zip(COVERS, mean, strict=True)])
    return Spectra(np.log([cover.weight for cover in COVERS]), mean, common, own)


def log_likelihood(observed: Array, around: Array, terms: Array, covers: Spectra) -> tuple[Array, Array]:
    """Logarithm of the probability density of dark spectra for trial amounts of haze.

    Parameters
    ----------
    observed : array, shape (cell, band)
        Mean reflectances of dark pixels, gases divided out.
    around : array, shape (cell, band)
        The same of their surroundings, from where light is scattered into them: dark pixels need it most.
    terms : array, shape (cell, trial, band, term)
        See `skyscatter.dehaze.forward`.
    covers : Spectra

    Returns
    -------
    likelihood : array, shape (cell, trial)
    covers : array, shape (cover, cell, trial)
        Probability of each of `COVERS`.
    """
    # Under more haze than there can be, surroundings darker than its path reflectance are black.
    environment = surface_reflectance(terms, np.maximum(around[:, None], terms[..., PATH]))
    rho = surface_reflectance(terms, observed[:, None], environment)
    slope = (1 - terms[..., BACK] * environment) / terms[..., DIRECT]  # of the surface over what is observed
    scattered_in = terms[..., DIFFUSE] / terms[..., DIRECT] * environment
    error = np.hypot(slope * np.hypot(NOISE, MODEL_ERROR * terms[..., PATH]), AROUND_ERROR * scattered_in)
    each = np.stack(
        [_gaussian(rho, error, covers, k) + _positive(rho, error, covers, k) for k in range(len(covers.log_weight))]
    )
    whole = logsumexp(each, axis=0)
    likelihood: Array = whole + np.log(slope).sum(axis=-1)
    return likelihood, np.exp(each - whole)


def _gaussian(rho: Array, error: Array, covers: Spectra, k: int) -> Array:
    """Weighted log density of one cover: a normal law whose covariance is a diagonal and a common factor.

    Inverse and determinant of such a matrix by Sherman & Morrison (1950, Annals of Math. Statistics 21, 124).
    """
    precision = 1 / (covers.own[k] ** 2 + error**2)
    off, common = rho - covers.mean[k], covers.common[k]
    joint = 1 + (common**2 * precision).sum(axis=-1)
    square = (off**2 * precision).sum(axis=-1) - ((off * common * precision).sum(axis=-1)) ** 2 / joint
    log_det = np.log(joint) - np.log(precision).sum(axis=-1)
    density: Array = covers.log_weight[k] - 0.5 * (square + log_det)
    return density


def _positive(rho: Array, error: Array, covers: Spectra, k: int) -> Array:
    """Logarithm of the share of a cover's law, given what is observed, that is not negative in any band.

    Of a band's normal law with the cover's mean and deviation times that of the observation's error, over the share of
    the former alone; the bands are taken one by one.
    """
    prior = np.hypot(covers.own[k], covers.common[k])
    precision = 1 / prior**2 + 1 / error**2
    middle = (covers.mean[k] / prior**2 + rho / error**2) / precision
    share: Array = (log_ndtr(middle * np.sqrt(precision)) - log_ndtr(covers.mean[k] / prior)).sum(axis=-1)
    return share
