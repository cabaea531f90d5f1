"""What a lens throws around lights that are far beyond white: a disk of a few pixels then is round, a star has a size.

The Sun is 100 000 times as bright as the sky beside it.  Every pixel that its disk touches is white, and so the disk is
a block of squares; on film it is not, for lenses scatter a hundredth or so of the light at their surfaces.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skyscatter.image.channels import largest
from skyscatter.kernels.processors import processors
from skyscatter.workers import Workers

Array = NDArray[np.float64]

SHARE = 0.01  #: of the light; veiling glare of good lenses is 0.5 to 3 % (ISO 9358 measures it)
CORE = 0.002  #: radius within which the veil is flat, as a share of the picture's width
WHITE = 8.0  #: exposed value beyond which light spills over: all curves are at white there


def with_glare(exposed: Array) -> Array:
    """Exposed linear RGB (y, x, 3) with the veil of its brightest lights.

    Of what exceeds `WHITE`, `SHARE` is spread as ``(1 + r² / r0²)^(-3/2)``, the fall of light that is scattered by
    surfaces that are almost smooth, with ``r0 = CORE width``.  The rest stays where it is, and pictures without such
    lights stay as they are.
    """
    peak = largest(exposed)
    if not (peak > WHITE).any():
        return exposed
    spilt = exposed * (np.maximum(peak - WHITE, 0.0) / np.maximum(peak, WHITE))
    height, width = exposed.shape[:2]
    # What leaves the picture on one side comes back on the other, but from a quarter of its size away, almost dark.
    shape = [_fast_length(side + side // 4 + 1) for side in (height, width)]
    y, x = (np.minimum(np.arange(side), side - np.arange(side)) for side in shape)
    radius = max(CORE * width, 1.0)
    away = 1.0 + (y[:, None] ** 2 + x[None, :] ** 2) / radius**2
    spread = SHARE / (2.0 * np.pi * radius**2) / (away * np.sqrt(away))  # the integral over the plane is SHARE
    with Workers(processors()) as pool:
        *lights, filtered = pool.map(lambda plane: np.fft.rfft2(plane, s=shape), [*np.moveaxis(spilt, 2, 0), spread])
        veil = list(pool.map(lambda light: np.fft.irfft2(light * filtered, s=shape)[:height, :width], lights))
    # Transforms leave rounding of the brightest light in the dark, some of it below zero.
    return np.asarray(exposed + np.maximum(np.stack(veil, axis=-1), 0.0))


def _fast_length(least: int) -> int:
    """The next number that has no prime factors but 2, 3 and 5: transforms of such lengths are quick."""
    length = least
    while not _is_smooth(length):
        length += 1
    return length


def _is_smooth(number: int) -> bool:
    for prime in (2, 3, 5):
        while number % prime == 0:
            number //= prime
    return number == 1
