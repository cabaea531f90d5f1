"""Point sources in pictures: each spread over the pixels around it, no light lost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.celestial.frames import Array
from skyscatter.errors import DomainError
from skyscatter.geometry.camera import Panorama

#: Share of a source's light beyond the edge of its image, which is given back to what is inside.
LOST = 1e-3
#: Widest point spread [pixel]: a source then covers 15 000 pixels.
WIDEST = 50.0


def draw_points(
    camera: Any, observer: Any, directions: ArrayLike, irradiance: ArrayLike, fwhm_pixels: float = 1.5
) -> Array:
    """Radiance of point sources in the pixels of a picture.

    Parameters
    ----------
    camera : Panorama, Fisheye, Perspective, ...
    observer : object or None
        As the camera takes it.
    directions : array_like, shape (source, 3)
        Unit vectors (east, north, up).
    irradiance : array_like, shape (source, wavelength)
        Of each source on a surface that faces it [W m-2 nm-1].
    fwhm_pixels : float
        Full width at half maximum of the Gaussian that a point becomes [pixel], up to 50; as wide over rows as over
        columns everywhere in the picture, also where pixels are not square on the sky.  0 puts all of the light into
        the pixel that it falls on.

    Returns
    -------
    ndarray, shape (height, width, wavelength)
        [W m-2 sr-1 nm-1]; 0 where no source is near, also outside the camera's field.

    Raises
    ------
    DomainError
        For shapes that do not fit and widths outside the range.

    Notes
    -----
    The Gaussian is integrated over each pixel and cut where 0.001 of the light is left.  What falls beyond the
    picture's edges, the poles of a panorama or the rim of a round field is given back to the pixels that there are;
    panoramas, which close around the horizon, go on at the other side.  So the sum over pixels of radiance times solid
    angle is the irradiance, to rounding, of every source inside the field.  Sources outside the field are left out,
    also where their image would reach into it.

    Examples
    --------
    >>> import numpy as np
    >>> import skyscatter
    >>> from skyscatter.celestial.points import draw_points
    >>> camera = skyscatter.Panorama(width=72, height=36)
    >>> cube = draw_points(camera, None, [[0.0, 0.6, 0.8]], [[2e-10, 3e-10]])
    >>> (cube * camera.pixel_solid_angle()[..., None]).sum(axis=(0, 1)).round(15)
    array([2.e-10, 3.e-10])
    """
    from scipy.sparse import csr_array

    towards, light = np.asarray(directions, dtype=float), np.asarray(irradiance, dtype=float)
    if towards.ndim != 2 or towards.shape[1] != 3:
        raise DomainError("directions", towards.shape, "an array of unit vectors of shape (source, 3)")
    if light.ndim != 2 or len(light) != len(towards):
        raise DomainError("irradiance", light.shape, f"an array of shape ({len(towards)}, wavelength)")
    if not 0.0 <= fwhm_pixels <= WIDEST:
        raise DomainError("fwhm_pixels", fwhm_pixels, f"a width from 0 to {WIDEST:g} pixels")
    x, y = camera.pixel(towards, observer)
    seen = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    solid_angle = np.asarray(camera.pixel_solid_angle(observer), dtype=float)
    shape = (*solid_angle.shape, light.shape[1])
    if not seen.size:
        return np.zeros(shape)
    pixel, source, share = _images(camera, solid_angle, x[seen], y[seen], fwhm_pixels)
    spread = csr_array((share / solid_angle.ravel()[pixel], (pixel, source)), shape=(solid_angle.size, seen.size))
    return np.asarray(spread @ light[seen]).reshape(shape)


def _images(
    camera: Any, solid_angle: Array, x: Array, y: Array, fwhm: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Pixels (as numbers, row by row) that sources at (x, y) fall on: pixel, source and share of its light."""
    height, width = solid_angle.shape
    around = isinstance(camera, Panorama)
    column, in_column = _line(x, fwhm, width, around)
    row, in_row = _line(y, fwhm, height, False)
    weight = in_row[:, :, None] * in_column[:, None, :]
    pixel = row[:, :, None] * width + column[:, None, :]
    weight = np.where(solid_angle.ravel()[pixel] > 0.0, weight, 0.0)
    total = weight.sum(axis=(1, 2), keepdims=True)
    share = weight / np.where(total > 0.0, total, 1.0)
    used = share > 0.0
    source = np.broadcast_to(np.arange(x.size)[:, None, None], share.shape)
    # At the rim of a round field a narrow source may meet only pixels whose middles are outside.
    lost = np.flatnonzero(total <= 0.0)
    pixels = np.concatenate([pixel[used], _inwards(solid_angle, x[lost], y[lost])])
    return pixels, np.concatenate([source[used], lost]), np.concatenate([share[used], np.ones(lost.size)])


def _inwards(solid_angle: Array, x: Array, y: Array) -> NDArray[np.intp]:
    """The pixel of the field that is nearest to each place, as a number."""
    if not x.size:
        return np.zeros(0, dtype=np.intp)
    rows, columns = np.nonzero(solid_angle > 0.0)
    width = solid_angle.shape[1]
    nearest = [int(np.argmin((columns - at) ** 2 + (rows - down) ** 2)) for at, down in zip(x, y, strict=True)]
    return np.asarray(rows[nearest] * width + columns[nearest], dtype=np.intp)


def _line(at: Array, fwhm: float, count: int, around: bool) -> tuple[NDArray[np.intp], Array]:
    """Along one side of the picture: the pixels around each source and the Gaussian's integrals over them.

    Both of shape (source, pixel); pixels beyond the ends have no weight, unless the side closes on itself.
    """
    from scipy.special import erf

    reach = math.ceil(fwhm * math.sqrt(-math.log(LOST) / (4.0 * math.log(2.0))))
    place = np.floor(at + 0.5).astype(int)[:, None] + np.arange(-reach, reach + 1)
    if fwhm > 0.0:
        scale = 2.0 * math.sqrt(math.log(2.0)) / fwhm
        weight = 0.5 * (erf((place + 0.5 - at[:, None]) * scale) - erf((place - 0.5 - at[:, None]) * scale))
    else:
        weight = np.ones(place.shape)
    if around:
        return place % count, weight
    # A source on the very edge rounds to a pixel beyond it.
    inside = (place >= 0) & (place < count)
    if reach == 0:
        return np.clip(place, 0, count - 1), weight
    return np.clip(place, 0, count - 1), np.where(inside, weight, 0.0)
