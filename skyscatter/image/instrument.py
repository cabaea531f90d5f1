"""A picture as a telescope takes it: blurred by a point spread function, counted in photons."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.image.aperture import Aperture
from skyscatter.image.filters import cells
from skyscatter.image.horizon import pixel_solid_angle
from skyscatter.image.psf import PointSpread, blurred, kernels, point_spread
from skyscatter.image.skyframe import SkyFrame
from skyscatter.image.spectral import SpectralImage
from skyscatter.spectra.table import Spectral, evaluate

Array = NDArray[np.float64]

# Exact SI constants (2019).
_PLANCK, _LIGHT = 6.62607015e-34, 299792458.0
#: Above this many photons a normal deviate stands for the Poisson draw, from which it cannot be told.
_MANY = 1e15


def photons_per_radiance(
    image: SpectralImage, collecting_area_m2: float, exposure_s: float, throughput: Spectral = 1.0
) -> Array:
    """Photons that unit radiance brings into each pixel and wavelength cell, shape (y, x, wavelength).

    ``A t η Ω Δλ λ / (h c)``: collecting area, exposure time, throughput, solid angle of the pixel, width of the cell
    (see `skyscatter.image.filters`), over the energy of a photon.

    Raises
    ------
    DomainError
        For an image that does not say how large its pixels are, and for values out of range.
    """
    for name, value in (("collecting_area_m2", collecting_area_m2), ("exposure_s", exposure_s)):
        if not 0.0 < value < np.inf:
            raise DomainError(name, value, "a number above 0")
    shares = evaluate(throughput, image.wavelengths)
    if not (np.all(shares > 0.0) and np.all(shares <= 1.0)):
        raise DomainError("throughput", (shares.min(), shares.max()), "above 0 and at most 1 at every wavelength")
    omega = pixel_solid_angle(image, "photon noise")
    low, high = cells(image.wavelengths)
    energy = _PLANCK * _LIGHT / (image.wavelengths * 1e-9)
    per_steradian = shares * (high - low) / energy
    return np.asarray(collecting_area_m2 * exposure_s * omega[..., None] * per_steradian)


def _sky(image: SpectralImage, purpose: str) -> SkyFrame:
    if image.sky is None:
        raise DomainError("sky", None, f"{purpose} needs the pixel scale: give the image a SkyFrame")
    return image.sky


def observe(
    image: SpectralImage,
    psf: str | PointSpread | Aperture | None = None,
    *,
    photon_noise: bool = False,
    collecting_area_m2: float | None = None,
    exposure_s: float | None = None,
    throughput: Spectral = 1.0,
    seed: int = 0,
) -> SpectralImage:
    """Blur a picture and draw its photons.

    Parameters
    ----------
    image : SpectralImage
        With a celestial frame, which gives the pixel scale.
    psf : str, PointSpread or Aperture, optional
        ``"gaussian:2.0"`` or ``"moffat:2.0:2.5"``: full width at half maximum [arc second], and β; or diffraction at
        each wavelength, by a clear mirror, ``"airy:2.4m"``, or ``"hubble"`` with its rings and spikes (see
        `skyscatter.image.psf.point_spread`).  Light carried over the picture's edge is lost and none comes in: within
        one kernel of a bright edge the result is too dark.
    photon_noise : bool
        Replace each value by a Poisson draw of the photons in its pixel and wavelength cell, back in radiance.  Values
        below zero, which a noisy estimate may have, count as dark.
    collecting_area_m2, exposure_s : float, optional
        Of the telescope [m2] and the picture [s]; needed for photon noise and refused without.
    throughput : float or SpectralTable
        Share of the photons that are counted.
    seed : int
        Same seed, same noise.

    Returns
    -------
    SpectralImage
        Its standard error is that of the picture, carried through the blur as independent between pixels, and that of
        the photons (the root of the expected number), added in squares.  Layers are blurred but not drawn.  The recipe
        says what was done under ``observation``.

    Raises
    ------
    DomainError
        For an image without a frame, options out of range or without purpose, negative radiance where photons are to
        be counted, and more photons than can be drawn (1e18 in a pixel).

    Examples
    --------
    A point of light behind a blur of two pixels: its peak falls, its light stays.  A telescope of 1 m2 then counts
    photons for a second, which brings noise [%].

    >>> import numpy as np
    >>> import skyscatter
    >>> cube = np.zeros((15, 15, 1))
    >>> cube[7, 7] = 1e-6  # W m-2 sr-1 nm-1
    >>> sky = skyscatter.SkyFrame(ra_deg=84.0, dec_deg=-2.0, pixel_scale_deg=1 / 3600)
    >>> seen = skyscatter.observe(skyscatter.SpectralImage(cube, [550], sky=sky), "gaussian:2.0")
    >>> round(float(seen.radiance.max() / 1e-6), 1), round(float(seen.radiance.sum() / 1e-6), 3)
    (0.2, 1.0)
    >>> counted = skyscatter.observe(seen, photon_noise=True, collecting_area_m2=1.0, exposure_s=1.0)
    >>> round(100 * float(counted.standard_error[7, 7, 0] / seen.radiance[7, 7, 0]))
    28
    """
    if psf is None and not photon_noise:
        raise DomainError("psf", None, "nothing to do: name a point spread function or ask for photon noise")
    given = {"collecting_area_m2": collecting_area_m2, "exposure_s": exposure_s}
    for name, value in given.items():
        if photon_noise and value is None:
            raise DomainError(name, value, "photon noise needs it")
        if not photon_noise and value is not None:
            raise DomainError(name, value, "is for photon noise only; leave it out or ask for that")
    done: dict[str, Any] = {}
    if psf is not None:
        spread = point_spread(psf)
        image = _blurred_image(image, spread)
        done["psf"] = spread.model_dump(exclude_none=True)
    if photon_noise:
        assert collecting_area_m2 is not None  # checked above
        assert exposure_s is not None
        image = _counted(image, photons_per_radiance(image, collecting_area_m2, exposure_s, throughput), seed)
        table = throughput if isinstance(throughput, (int, float)) else throughput.model_dump(mode="json")
        done |= {**given, "throughput": table, "seed": seed}
    return _like(image, image.radiance, image.standard_error, {**image.recipe, "observation": done}, image.layers)


def _like(
    image: SpectralImage, radiance: Any, error: Any, recipe: dict[str, Any], layers: dict[str, NDArray[Any]]
) -> SpectralImage:
    return SpectralImage(radiance, image.wavelengths, error, recipe=recipe, layers=layers, sky=image.sky)


def _blurred_image(image: SpectralImage, spread: PointSpread | Aperture) -> SpectralImage:
    scale = 3600.0 * _sky(image, "a point spread function").pixel_scale_deg

    def blur(cube: NDArray[Any], power: int = 1) -> Array:
        each = kernels(spread, scale, max(image.shape[:2]), image.wavelengths)
        return blurred(cube, each if power == 1 else (kernel**power for kernel in each))

    def spread_error(values: NDArray[Any]) -> Array:
        return np.sqrt(blur(np.square(values, dtype=float), 2))

    layers = {
        name: spread_error(cube) if name.endswith("_error") else blur(cube) for name, cube in image.layers.items()
    }
    error = None if image.standard_error is None else spread_error(image.standard_error)
    return _like(image, blur(image.radiance), error, image.recipe, layers)


def glared(image: SpectralImage, psf: str | PointSpread | Aperture) -> SpectralImage:
    """The light of a picture, to be looked at, blurred as `observe` does it; without errors and layers."""
    bare = SpectralImage(image.radiance, image.wavelengths, recipe=image.recipe, sky=image.sky)
    seen = _blurred_image(bare, point_spread(psf))
    return _like(image, seen.radiance, None, image.recipe, {})


def _counted(image: SpectralImage, photons: Array, seed: int) -> SpectralImage:
    inside = np.isfinite(image.radiance)
    expected = np.where(inside, np.maximum(image.radiance, 0.0), 0.0) * photons
    generator = np.random.Generator(np.random.PCG64(seed))
    draws = generator.poisson(np.minimum(expected, _MANY)).astype(float)
    many = expected > _MANY
    draws[many] = expected[many] + np.sqrt(expected[many]) * generator.standard_normal(int(many.sum()))
    square = expected / photons**2
    if image.standard_error is not None:
        square = square + np.where(inside, image.standard_error, 0.0) ** 2
    radiance, error = np.where(inside, draws / photons, np.nan), np.where(inside, np.sqrt(square), np.nan)
    return _like(image, radiance, error, image.recipe, image.layers)
