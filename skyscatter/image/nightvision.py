"""Pictures of the night: as the dark-adapted eye sees them, and as a camera with automatic white balance does.

In dim light the rods take over from the cones: blue things look brighter than red ones, and colours go.  CIE 191:2010
describes what lies between both: with an adaptation m, from 0 (rods alone, below 0.005 cd m-2) to 1 (cones alone, from
5 cd m-2 on), the mesopic luminance is

    L_mes = (m L + (1 - m) L' V'(λ0)) / (m + (1 - m) V'(λ0)),      m = 0.7670 + 0.3334 lg L_mes                     (1)

with the photopic luminance L, the scotopic luminance L' and V'(λ0) = 683 / 1699.  What rods see has no colour; it is
shown in the blue grey that painters and films take for it, x = y = 0.25 (Jensen et al. 2001, SIGGRAPH, 399).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skyscatter.datafiles import read_table
from skyscatter.image.colour import adapted_white, sample_weights

Array = NDArray[np.float64]

SCOTOPIC_EFFICACY = 1699.0  #: [lm W-1], CIE 191:2010
RATIO = 683.0 / SCOTOPIC_EFFICACY
#: Constants of the adaptation in (1), and rounds in which it settles.
OFFSET, SLOPE, ROUNDS = 0.7670, 0.3334, 12
#: Exposures [EV] between which cameras begin to take the night's own colour for white, and how far they do.
BALANCE, DEGREE = (-2.0, -5.0), 0.75
#: Chromaticity in which rods' light is shown.
ROD_WHITE = (0.25, 0.25)


def scotopic_luminance(radiance: Array, wavelengths: Array) -> Array:
    """Scotopic luminance [cd m-2] of spectra (..., wavelength) [W m-2 sr-1 nm-1]."""
    table = read_table("scotopic.csv")
    nodes, efficiency = table["wavelength_nm"], table["efficiency"]
    if wavelengths.size == 1:  # of a flat spectrum, as its colour
        return np.asarray(radiance[..., 0] * SCOTOPIC_EFFICACY * np.trapezoid(efficiency, nodes))
    weights = SCOTOPIC_EFFICACY * sample_weights(wavelengths, nodes, efficiency[:, None])
    return np.asarray((radiance @ weights)[..., 0])


def adaptation(photopic: Array, scotopic: Array) -> tuple[Array, Array]:
    """The adaptation m of (1), 0 to 1, and the mesopic luminance [cd m-2].

    Examples
    --------
    By moonlight rods do most of it, in a lit street cones do.

    >>> import numpy as np
    >>> from skyscatter.image.nightvision import adaptation
    >>> adaptation(np.array([0.003, 0.5, 10.0]), np.array([0.006, 0.8, 20.0]))[0].round(2)
    array([0.  , 0.68, 1.  ])
    """
    m = np.full(np.shape(photopic), 0.5)
    mesopic = np.asarray(photopic, float)
    for _ in range(ROUNDS):
        mesopic = (m * photopic + (1 - m) * scotopic * RATIO) / (m + (1 - m) * RATIO)
        m = np.clip(OFFSET + SLOPE * np.log10(np.maximum(mesopic, 1e-12)), 0.0, 1.0)
    return m, mesopic


def as_the_eye(xyz: Array, scotopic: Array) -> Array:
    """Absolute XYZ (..., 3) of what an eye sees that is adapted to each part of a picture.

    Parameters
    ----------
    xyz : ndarray, shape (..., 3)
        Absolute; Y in cd m-2.
    scotopic : ndarray, shape (...)
        Scotopic luminance [cd m-2].
    """
    m, mesopic = adaptation(xyz[..., 1], scotopic)
    x, y = ROD_WHITE
    grey = np.array([x / y, 1.0, (1 - x - y) / y])
    # Cones see a share of the luminance, in its colour; rods the rest of it.
    cones = m[..., None] * xyz
    return np.asarray(cones + np.maximum(mesopic - cones[..., 1], 0.0)[..., None] * grey)


def balanced(xyz: Array, ev100: float) -> Array:
    """XYZ of a picture by night as a camera shows it whose white balance goes by the scene.

    By day and at dusk colours stay as they are.  As exposures fall from `BALANCE`[0] to `BALANCE`[1] the mean colour of
    the picture, without its brightest parts, is taken for white to a growing degree, at most `DEGREE`.
    """
    share = np.clip((BALANCE[0] - ev100) / (BALANCE[0] - BALANCE[1]), 0.0, 1.0)
    light = xyz[..., 1]
    seen = np.isfinite(light) & (light > 0)
    if share == 0.0 or not seen.any():
        return xyz
    low, high = np.percentile(light[seen], [5.0, 90.0])
    chosen = seen & (light >= low) & (light <= high)
    mean = np.mean(xyz[chosen] / light[chosen][:, None], axis=0)
    return adapted_white(xyz, mean, float(DEGREE * share * share * (3 - 2 * share)))
