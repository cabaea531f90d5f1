"""Images as inversion takes them: checked once, with their pixels that count, their noise, and a first centre.

Pixel coordinates are array indices, x the column and y the row, whole numbers at the middles of pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

Array = NDArray[np.float64]


class Pixels(NamedTuple):
    """An image with what is known of it; each of shape (y, x)."""

    values: Array
    sigma: Array  #: ones where the noise is to be estimated
    used: NDArray[np.bool_]
    known_noise: bool


def checked_image(
    image: ArrayLike, sigma: ArrayLike | float | None = None, mask: ArrayLike | None = None, least: int = 8
) -> Pixels:
    """An image whose pixels that count are finite.

    Parameters
    ----------
    image : array_like, shape (y, x)
        NaN where there is no value.
    sigma : array_like or float, optional
        Standard deviation of each pixel, or of all.
    mask : array_like of bool, shape (y, x), optional
        True for pixels that are left out (stars, edges).
    least : int
        Pixels that each side has at least.

    Returns
    -------
    Pixels

    Raises
    ------
    DomainError
        For another shape, infinite values, a sigma of 0 or below, or an image without pixels that count.
    """
    values = np.asarray(image, float)
    if values.ndim != 2 or min(values.shape) < least:
        raise DomainError("image", values.shape, f"must be two-dimensional, {least} pixels or more along each side")
    if np.isinf(values).any():
        raise DomainError("image", float(values[np.isinf(values)][0]), "must be finite, or NaN where there is no value")
    used = ~np.isnan(values)
    if mask is not None:
        out = np.asarray(mask)
        if out.shape != values.shape or out.dtype != bool:
            raise DomainError("mask", (out.dtype.name, out.shape), f"must be true or false of shape {values.shape}")
        used &= ~out
    if used.sum() < 64:
        raise DomainError("mask", int(used.sum()), "leaves too few pixels; 64 are needed")
    noise = np.ones(values.shape)
    if sigma is not None:
        noise = np.asarray(sigma, float) * noise if np.ndim(sigma) == 0 else np.asarray(sigma, float)
        if noise.shape != values.shape:
            raise DomainError("sigma", noise.shape, f"must be one number or of the image's shape {values.shape}")
        wrong = used & ~(np.isfinite(noise) & (noise > 0))
        if wrong.any():
            raise DomainError("sigma", float(noise[wrong][0]), "must be finite and above 0 wherever a pixel counts")
    return Pixels(np.where(used, values, 0.0), np.where(used, noise, 1.0), used, sigma is not None)


def symmetric_centre(pixels: Pixels) -> tuple[float, float]:
    """Centre (x, y) about which half a turn changes the image least, to about half a pixel.

    The image less its border's median, correlated with itself turned by half a turn; its brightest hundredth, where
    stars are, is cut to the same value.
    """
    used = pixels.used
    values = np.minimum(pixels.values, np.percentile(pixels.values[used], 99))
    border = np.concatenate([values[e][used[e]] for e in (0, -1)] + [values[:, e][used[:, e]] for e in (0, -1)])
    level = float(np.median(border)) if border.size else float(np.median(values[used]))
    signal = np.where(used, values - level, 0.0)
    rows, columns = values.shape
    shape = (2 * rows, 2 * columns)
    twice = np.fft.irfft2(np.fft.rfft2(signal, shape) ** 2, shape)  # signal convolved with itself
    y, x = np.unravel_index(int(np.argmax(twice)), shape)
    return 0.5 * float(x), 0.5 * float(y)


def border_distance(shape: tuple[int, int], centre: tuple[float, float]) -> float:
    """Distance [pixel] from a point (x, y) to the nearest side of the image."""
    x, y = centre
    return float(min(x + 0.5, y + 0.5, shape[1] - 0.5 - x, shape[0] - 0.5 - y))


def check_centre(name: str, value: ArrayLike, shape: tuple[int, int]) -> tuple[float, float]:
    """A point (x, y) within the image."""
    point = np.asarray(value, float)
    if point.shape != (2,) or not np.isfinite(point).all() or border_distance(shape, (point[0], point[1])) <= 0:
        raise DomainError(name, value, f"must be a point (x, y) within the image of shape (y, x) = {shape}")
    return float(point[0]), float(point[1])
