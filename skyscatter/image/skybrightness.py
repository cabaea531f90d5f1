"""Maps of the brightness of the sky in magnitudes per square arcsecond, as colours with contours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from skyscatter.image.spectral import SpectralImage

Array = NDArray[np.float64]

#: Colour map, dark where the sky is dark.
COLOURS = "inferno"
#: Steps between contours [mag arcsec-2]: the first with which there are no more than `MOST_CONTOURS`.
STEPS, MOST_CONTOURS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0), 12
#: Share of the pixels that may lie beyond either end of the colours: stars, and what is next to black.
BEYOND = 0.01


def magnitudes(image: SpectralImage, name: str = "V") -> Array:
    """Brightness of each pixel in a filter, shape (y, x) [Vega mag arcsec-2]; NaN where there is no light.

    Parameters
    ----------
    image : SpectralImage
    name : {"V", "U", "B", "R", "I"}

    Raises
    ------
    DomainError
        For other filters, and where the wavelengths do not cover the filter.

    Examples
    --------
    A radiance that is that of a star of magnitude 21 spread over a square arcsecond.

    >>> import numpy as np
    >>> import skyscatter
    >>> from skyscatter.image.skybrightness import magnitudes
    >>> arcsec2 = np.radians(1 / 3600) ** 2
    >>> cube = np.full((1, 1, 41), 3.631e-11 * 10 ** (-0.4 * 21) / arcsec2)
    >>> float(magnitudes(skyscatter.SpectralImage(cube, np.arange(380, 781, 10)))[0, 0].round(3))
    21.0
    """
    from skyscatter.image.photometry import VEGA_ZERO, conversion

    if name not in VEGA_ZERO:
        raise DomainError("filters", name, f"magnitudes are those of one of {', '.join(VEGA_ZERO)}")
    band = image.through(name)
    return np.asarray(conversion(band, "Vegamag arcsec-2").value(band.radiance)[..., 0])


def painted(image: SpectralImage, name: str = "V") -> tuple[Array, NDArray[np.bool_], dict[str, Any]]:
    """Magnitudes as colours, with contours.

    Returns
    -------
    picture : ndarray, shape (y, x, 3)
        sRGB in [0, 1], bright where the sky is bright; black where there is no light.
    defined : ndarray of bool, shape (y, x)
    made : dict
        What stands for what: the filter, the ends of the colours and the step between contours [mag arcsec-2].
    """
    from matplotlib import colormaps

    values = magnitudes(image, name)
    defined = np.isfinite(values)
    if not defined.any():
        raise DomainError("show", "magnitudes", "there is no light in this picture")
    bright, dark = np.quantile(values[defined], [BEYOND, 1 - BEYOND])
    step = next((s for s in STEPS if (dark - bright) / s <= MOST_CONTOURS), STEPS[-1])
    bright, dark = step * np.floor(bright / step), step * np.ceil(dark / step + 1e-9)
    share = np.clip((dark - np.where(defined, values, dark)) / max(dark - bright, step), 0.0, 1.0)
    picture = np.asarray(colormaps[COLOURS](share), dtype=float)[..., :3]
    lines = contours(_evened(values), step) & defined
    picture[lines] = 0.5 * picture[lines] + 0.5 * np.where(share[lines] < 0.5, 1.0, 0.0)[:, None]
    made = {"filter": name, "brightest": float(bright), "darkest": float(dark), "contours": step, "colours": COLOURS}
    return np.where(defined[..., None], picture, 0.0), defined, made


def _evened(values: Array) -> Array:
    """Medians of 5 by 5 pixels: contours shall go around the sky's light, not around stars."""
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(np.where(np.isfinite(values), values, 99.0), size=5, mode="nearest"))


def contours(values: Array, step: float) -> NDArray[np.bool_]:
    """Pixels that lie on the brighter side of a multiple of `step` between them and a neighbour, shape (y, x)."""
    number = np.floor(values / step)
    lines = np.zeros(values.shape, bool)
    for one, other in (((slice(None, -1),), (slice(1, None),)), (np.s_[:, :-1], np.s_[:, 1:])):
        lines[one] |= number[one] < number[other]
        lines[other] |= number[other] < number[one]
    return lines
