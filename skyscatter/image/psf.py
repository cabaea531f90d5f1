"""Point spread functions: how a telescope and the air above it blur a point, integrated over pixels."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import repeat
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError, UnitsError
from skyscatter.image.aperture import Aperture
from skyscatter.record import Record
from skyscatter.units import metres

Array = NDArray[np.float64]

#: Share of the light beyond the edge of the kernel, which is given back to what is inside.
LOST = 1e-4
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
#: Apertures with a name.  The Hubble telescope's are those of its programs for point spread functions (Krist, Hook &
#: Stoehr 2011, Proc. SPIE 8127, 81270J): 0.33 and 0.022 of the mirror's radius; the eye's is a pupil in the dark.
APERTURES = {
    "hubble": Aperture(diameter_m=2.4, obstruction=0.33, vane_m=0.0264),
    "eye": Aperture(diameter_m=0.007),
}
_FORMS = "gaussian:FWHM or moffat:FWHM:BETA, FWHM in arc seconds, airy:DIAMETER, hubble or eye"


class PointSpread(Record):
    """Gaussian, or the profile of Moffat (1969, A&A 3, 455), whose wings are those of stars seen through air.

    With r the angle from the centre, ``exp(-4 ln 2 (r / fwhm)²)``, and ``(1 + (r / α)²)^-β`` with
    ``α = fwhm / (2 sqrt(2^(1 / β) - 1))``, both normalised to a volume of 1.
    """

    kind: Literal["gaussian", "moffat"]
    fwhm_arcsec: float
    beta: float | None = None

    def kernel(self, pixel_scale_arcsec: float, largest: int) -> Array:
        """Share of a point's light, at the middle of a pixel, that falls into each pixel around it; sum 1.

        Parameters
        ----------
        pixel_scale_arcsec : float
        largest : int
            Longest side of the picture [pixel]: wings further out than that meet no other pixel.

        Returns
        -------
        ndarray, shape (2 n + 1, 2 n + 1)
            n is as large as it takes for less than 1e-4 of the light to lie outside, or `largest`.
        """
        width = self.fwhm_arcsec / pixel_scale_arcsec
        reach = min(int(np.ceil(self._radius(width))) + 1, largest)
        offsets = np.arange(-reach, reach + 1, dtype=float)
        values = self._gaussian(offsets, width) if self.kind == "gaussian" else self._moffat(offsets, width)
        return values / values.sum()

    def _radius(self, width: float) -> float:
        """Radius [pixel] beyond which `LOST` of the light lies."""
        if self.beta is None:
            return width * float(np.sqrt(-np.log(LOST) / (4.0 * np.log(2.0))))
        return self._alpha(width) * float(np.sqrt(LOST ** (1.0 / (1.0 - self.beta)) - 1.0))

    def _alpha(self, width: float) -> float:
        assert self.beta is not None  # the parser gives every Moffat profile one
        return width / (2.0 * float(np.sqrt(2.0 ** (1.0 / self.beta) - 1.0)))

    @staticmethod
    def _gaussian(offsets: Array, width: float) -> Array:
        """Exact: the product of differences of error functions."""
        from scipy.special import erf

        scale = 2.0 * np.sqrt(np.log(2.0)) / width
        line = 0.5 * (erf((offsets + 0.5) * scale) - erf((offsets - 0.5) * scale))
        return np.asarray(line[:, None] * line[None, :])

    def _moffat(self, offsets: Array, width: float) -> Array:
        """Three Gauss-Legendre points a side in each sub-pixel; finer where the profile is narrow for its pixels."""
        alpha = self._alpha(width)
        values = self._sampled(offsets, alpha, 1)
        # Beyond four widths the profile is smooth on the scale of a pixel; inside, sub-pixels are a quarter of alpha.
        core = np.flatnonzero(np.abs(offsets) <= np.ceil(4.0 * width))
        parts = min(int(np.ceil(4.0 / alpha)), 200)
        values[np.ix_(core, core)] = self._sampled(offsets[core], alpha, parts)
        return values

    def _sampled(self, offsets: Array, alpha: float, parts: int) -> Array:
        assert self.beta is not None
        starts = np.arange(parts) / parts - 0.5
        points = (starts[:, None] + (_NODES + 1.0) / (2.0 * parts)).ravel()
        shares = np.tile(_WEIGHTS / (2.0 * parts), parts)
        total = np.zeros((offsets.size, offsets.size))
        for dy, share_y in zip(points, shares, strict=True):
            for dx, share_x in zip(points, shares, strict=True):
                squares = ((offsets[:, None] + dy) ** 2 + (offsets[None, :] + dx) ** 2) / alpha**2
                total += share_y * share_x * (1.0 + squares) ** -self.beta
        return total


def point_spread(given: Any) -> PointSpread | Aperture:
    """Point spread function from text.

    Parameters
    ----------
    given : str, PointSpread or Aperture
        ``"gaussian:FWHM"`` or ``"moffat:FWHM:BETA"``, FWHM in arc seconds; or diffraction by an aperture:
        ``"airy:DIAMETER"``, ``"airy:DIAMETER:OBSTRUCTION"`` (a share of the diameter),
        ``"airy:DIAMETER:OBSTRUCTION:VANE"`` (the width of two crossed vanes, a length), or one of `APERTURES`.

    Raises
    ------
    DomainError
        For another text, a width that is not above 0, a β outside 1.5 to 20 (below, the wings hold most of the light
        and have no end; above, the profile is a Gaussian), and an aperture of which nothing is left.
    """
    if isinstance(given, (PointSpread, Aperture)):
        return given
    if given in APERTURES:
        return APERTURES[given]
    words = str(given).split(":")
    if words[0] == "airy" and 2 <= len(words) <= 4:
        return _aperture(given, *words[1:])
    try:
        numbers = [float(word) for word in words[1:]]
    except ValueError:
        numbers = []
    if (words[0], len(numbers)) not in (("gaussian", 1), ("moffat", 2)):
        raise DomainError("psf", given, f"give {_FORMS}: gaussian:2.0")
    if not 0.0 < numbers[0] < np.inf:
        raise DomainError("psf", given, "the full width at half maximum must be above 0 arc seconds")
    if words[0] == "gaussian":
        return PointSpread(kind="gaussian", fwhm_arcsec=numbers[0])
    if not 1.5 <= numbers[1] <= 20.0:
        raise DomainError("psf", given, "the exponent of a Moffat profile must lie between 1.5 and 20")
    return PointSpread(kind="moffat", fwhm_arcsec=numbers[0], beta=numbers[1])


def _aperture(given: Any, diameter: str, obstruction: str = "0", vane: str = "0") -> Aperture:
    """The aperture that a text describes."""
    try:
        wide, hidden, width = metres(diameter, "psf"), float(obstruction), metres(vane, "psf")
    except (UnitsError, ValueError):
        raise DomainError("psf", given, "give airy:DIAMETER:OBSTRUCTION:VANE, such as airy:2.4m:0.33:26mm") from None
    if not 0.0 < wide < np.inf:
        raise DomainError("psf", given, "the diameter of the aperture must be above 0")
    if not 0.0 <= hidden <= 0.9:
        raise DomainError("psf", given, "the obstruction is a share of the diameter from 0 to 0.9")
    if not 0.0 <= width <= 0.1 * wide:
        raise DomainError("psf", given, "the vanes must be no wider than a tenth of the diameter")
    return Aperture(diameter_m=wide, obstruction=hidden, vane_m=width)


def kernels(spread: PointSpread | Aperture, pixel_scale_arcsec: float, largest: int, wavelengths: Array) -> Any:
    """The kernel of each wavelength [nm], one after the other; see `PointSpread.kernel` and `Aperture.kernel`."""
    if isinstance(spread, PointSpread):
        return repeat(spread.kernel(pixel_scale_arcsec, largest), len(wavelengths))
    return (spread.kernel(pixel_scale_arcsec, largest, float(wavelength)) for wavelength in wavelengths)


def blurred(cube: NDArray[Any], kernels: Iterable[Array]) -> Array:
    """Convolve the planes of (y, x, plane) with their kernels; dark outside the picture, NaN stays and counts as dark.

    Light that the kernel carries over the edge is lost, and none comes in from outside.
    """
    from scipy.signal import fftconvolve

    outside = np.isnan(cube)
    filled = np.where(outside, 0.0, cube).astype(float)
    result = np.empty(cube.shape)
    for plane, kernel in zip(range(cube.shape[2]), kernels, strict=False):
        # "same" would centre a kernel that is larger than the picture on itself
        full = fftconvolve(filled[..., plane], kernel, mode="full")
        reach_y, reach_x = kernel.shape[0] // 2, kernel.shape[1] // 2
        result[..., plane] = full[reach_y : reach_y + cube.shape[0], reach_x : reach_x + cube.shape[1]]
    # the transform leaves rounding errors of the brightest pixel everywhere, of both signs
    if np.all(filled >= 0.0):
        result = np.maximum(result, 0.0)
    return np.where(outside, np.nan, result)
