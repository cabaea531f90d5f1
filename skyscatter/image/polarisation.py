"""What the Stokes layers of an image say: degree and angle of polarisation, per wavelength and over a band.

The frame and the signs are those of docs/conventions.md ("Polarisation"): Q and U refer to the meridian plane through
the line of sight and the zenith, U and V grow with an anticlockwise turn as the observer sees it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.image import colour

if TYPE_CHECKING:
    from skyscatter.image.spectral import SpectralImage

Array = NDArray[np.float64]

#: Layers of a polarised image, in the order of the Stokes vector after I, and their standard errors.
STOKES = ("Q", "U", "V")
STOKES_ERRORS = ("Q_error", "U_error", "V_error")

#: The reference frame in one line, for the headers of files.
FRAME = (
    "Reference plane: meridian plane through the line of sight and the local zenith (at the exact zenith and nadir the "
    "north-south plane). Q > 0: electric field in that plane; U > 0: turned by 45 degrees from it, anticlockwise as "
    "the observer sees it; V > 0: electric vector turns anticlockwise as the observer sees it (IAU 1974)."
)

#: What a picture may show.
SHOWN = ("colour", "degree", "angle", "magnitudes")


class Band(NamedTuple):
    """Stokes I, Q, U, V of one wavelength or averaged over a band, each of shape (y, x) [W m-2 sr-1 nm-1]."""

    i: Array
    q: Array
    u: Array
    v: Array


def degree(i: ArrayLike, *components: ArrayLike) -> Array:
    """Root of the sum of squares of `components` over I; NaN where I is not positive.

    With Q and U the degree of linear polarisation, with Q, U and V the degree of polarisation (Chandrasekhar 1950,
    Radiative Transfer, section 15).
    """
    light = np.asarray(i, dtype=float)
    squares = sum(np.square(np.asarray(c, dtype=float)) for c in components)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(squares) / np.where(light > 0.0, light, np.nan))


def angle(i: ArrayLike, q: ArrayLike, u: ArrayLike) -> Array:
    """Angle of linear polarisation [degree], 0 to below 180; NaN where there is no light or Q = U = 0.

    Half the angle of the vector (Q, U): from the meridian plane, anticlockwise as the observer sees it.  Of the two
    usual ranges, this one has its seam at 0, light that vibrates in the meridian plane, which is rarer in skies than
    light that vibrates across it (90): noise seldom crosses the seam.
    """
    light, q, u = (np.asarray(values, dtype=float) for values in (i, q, u))
    with np.errstate(invalid="ignore"):
        chi = np.degrees(0.5 * np.arctan2(u, q)) % 180.0
        # An angle a rounding error below zero becomes 180 in the remainder, which is outside the stated range.
        chi = np.where(chi == 180.0, 0.0, chi)
        return np.asarray(np.where((light > 0.0) & ((q != 0.0) | (u != 0.0)), chi, np.nan))


def stokes(image: SpectralImage) -> tuple[NDArray[Any], ...]:
    """I, Q, U and V of an image, each of shape (y, x, wavelength).

    Raises
    ------
    DomainError
        If the image lacks one of the layers Q, U, V.
    """
    missing = [name for name in STOKES if name not in image.layers]
    if missing:
        have = ", ".join(image.layers) or "none"
        raise DomainError("layers", have, "polarisation needs Q, U and V; render with stokes=True (--stokes)")
    return image.radiance, *(image.layers[name] for name in STOKES)


def band_weights(wavelengths: ArrayLike, wavelength: float | None) -> Array:
    """Share of each wavelength in a picture of the polarisation, shape (wavelength,), sum 1.

    Parameters
    ----------
    wavelengths : array_like, shape (wavelength,)
        [nm].
    wavelength : float, optional
        One of them [nm]; by default all, weighted by luminous efficiency (the observer's Y, as pictures in colour are).

    Raises
    ------
    DomainError
        If `wavelength` is none of them, or none of them is visible.
    """
    wl = np.asarray(wavelengths, dtype=float)
    if wavelength is None:
        weights = colour.xyz_weights(wl)[:, 1]
        if not weights.sum() > 0.0:
            raise DomainError("wavelengths", _span(wl), f"none is visible: name the one to show, such as {wl[0]:g}")
        return np.asarray(weights / weights.sum())
    same = np.isclose(wl, wavelength, rtol=1e-9, atol=0.0)
    if not same.any():
        nearest = wl[np.argmin(np.abs(wl - wavelength))]
        raise DomainError("wavelength", wavelength, f"the image has {_span(wl)}; the nearest is {nearest:g} nm")
    return same.astype(float)


def _span(wl: Array) -> str:
    return f"{wl[0]:g} nm" if wl.size == 1 else f"{wl.size} wavelengths from {wl[0]:g} to {wl[-1]:g} nm"


def band(image: SpectralImage, wavelength: float | None = None) -> Band:
    """Stokes vector of one wavelength, or averaged over the image's band; see `band_weights`."""
    cubes = stokes(image)
    weights = band_weights(image.wavelengths, wavelength)
    if wavelength is None:
        return Band(*(np.asarray(cube @ weights, dtype=float) for cube in cubes))
    number = int(np.argmax(weights))  # not a product: NaN at another wavelength would spread
    return Band(*(np.asarray(cube[..., number], dtype=float) for cube in cubes))


def band_degree(image: SpectralImage, wavelength: float | None = None) -> Array:
    """Degree of linear polarisation of `band`, shape (y, x)."""
    light = band(image, wavelength)
    return degree(light.i, light.q, light.u)


def band_angle(image: SpectralImage, wavelength: float | None = None) -> Array:
    """Angle of linear polarisation of `band` [degree], shape (y, x)."""
    light = band(image, wavelength)
    return angle(light.i, light.q, light.u)


class Scale(NamedTuple):
    """How a quantity becomes colour: what it is called, its ends, and the name of the colour map (matplotlib)."""

    label: str
    low: float
    high: float
    colours: str


#: Both maps are perceptually uniform; twilight is cyclic, as angles of linear polarisation are.
SCALES = {
    "degree": Scale("degree of linear polarisation", 0.0, 1.0, "viridis"),
    "angle": Scale("angle of linear polarisation [degree]", 0.0, 180.0, "twilight"),
}


def check_shown(show: str) -> None:
    """Refuse what no picture shows."""
    if show not in SHOWN:
        raise DomainError("show", show, f"one of {', '.join(SHOWN)}")


def band_values(image: SpectralImage, show: str, wavelength: float | None = None) -> Array:
    """``"degree"`` or ``"angle"`` of the linear polarisation, shape (y, x); see `band_degree` and `band_angle`."""
    if show not in SCALES:
        raise DomainError("show", show, f"one of {', '.join(SCALES)}")
    return band_degree(image, wavelength) if show == "degree" else band_angle(image, wavelength)


def painted(image: SpectralImage, show: str, wavelength: float | None = None) -> tuple[Array, NDArray[np.bool_]]:
    """Degree or angle of linear polarisation as colours.

    Returns
    -------
    picture : ndarray, shape (y, x, 3)
        sRGB in [0, 1] by the colour map of `SCALES`; black where the quantity is undefined.
    defined : ndarray of bool, shape (y, x)
    """
    from matplotlib import colormaps

    values = band_values(image, show, wavelength)
    scale = SCALES[show]
    defined = np.isfinite(values)
    # Noise can make the estimated degree greater than 1.
    share = np.clip((np.where(defined, values, scale.low) - scale.low) / (scale.high - scale.low), 0.0, 1.0)
    picture = np.asarray(colormaps[scale.colours](share), dtype=float)[..., :3]
    return np.where(defined[..., None], picture, 0.0), defined
