"""Pictures in the units of photometry: janskys, magnitudes, counts.

A band average is what `skyscatter.image.filters` makes of a spectrum, L = ∫ L T λ dλ / ∫ T λ dλ with T the share of the
photons that the filter passes.  With the pivot wavelength λ_p² = ∫ T λ dλ / ∫ T / λ dλ the band average per frequency
is L λ_p² / c without any assumption on the spectrum (Koornneef et al. 1986, Highlights Astron. 7, 833), and

- AB magnitudes are -2.5 lg (f_ν / 3631 Jy) with a constant of -48.60 in cgs units (Oke & Gunn 1983, ApJ 266, 713);
- Vega magnitudes of U, B, V, R, I are -2.5 lg (f_λ / f_0), with the fluxes f_0 of a star of magnitude 0 by Bessell,
  Castelli & Plez (1998, A&A 333, 231, table A2), in which Vega itself has V = 0.03;
- counts are A t η Ω L / (h c) ∫ T λ dλ, with the collecting area A, the exposure t, a throughput η and the solid angle
  Ω of the pixel.  A response per energy is turned into one per photon that agrees with it at the pivot wavelength.

Planes of spectra count as filters so narrow that the pivot wavelength is their own; their counts are those of the cell
of each wavelength.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skyscatter.errors import DomainError
from skyscatter.image.filterimage import FilterImage
from skyscatter.image.horizon import pixel_solid_angle
from skyscatter.record import Record, nearest
from skyscatter.spectra.vega import VEGA_ZERO

if TYPE_CHECKING:
    import xarray

    from skyscatter.image.spectral import SpectralImage

Array = NDArray[np.float64]

# Exact SI constants (2019).
_LIGHT, _PLANCK = 299792458.0, 6.62607015e-34
_ARCSEC2 = (np.pi / 648000.0) ** 2  # [sr]
AB_ZERO = 10 ** (-48.60 / 2.5) * 1e23  #: [Jy], 3630.78
#: Units by name, with their magnitude system.
UNITS: dict[str, str | None] = {
    "W m-2 sr-1 nm-1": None, "Jy sr-1": None, "MJy sr-1": None, "Jy": None, "ABmag": "AB", "ABmag arcsec-2": "AB",
    "Vegamag": "Vega", "Vegamag arcsec-2": "Vega",
}  # fmt: skip


class Counts(Record):
    """The unit of a telescope's picture: photons counted in each pixel.

    Parameters
    ----------
    collecting_area_m2, exposure_s : float
        Of the telescope [m2] and the picture [s].
    throughput : float
        Share of the photons that are counted, above 0 and at most 1; the filter's own comes on top of it.
    """

    collecting_area_m2: float = Field(gt=0.0)
    exposure_s: float = Field(gt=0.0)
    throughput: float = Field(default=1.0, gt=0.0, le=1.0)


class Conversion(NamedTuple):
    """From radiance [W m-2 sr-1 nm-1] to another unit."""

    unit: str  #: as files state it
    system: str | None  #: of magnitudes
    factor: Array  #: linear brightness of unit radiance, (plane,) or (y, x, plane)

    def value(self, radiance: NDArray[Any]) -> NDArray[Any]:
        """Brightness; magnitudes are NaN where there is no light."""
        linear = radiance * self.factor
        if self.system is None:
            return np.asarray(linear)
        return np.asarray(-2.5 * np.log10(np.where(linear > 0.0, linear, np.nan)))

    def error(self, radiance: NDArray[Any], error: NDArray[Any]) -> NDArray[Any]:
        """Error of the brightness; of magnitudes to the first order."""
        if self.system is None:
            return np.asarray(error * self.factor)
        return np.asarray(2.5 / np.log(10.0) * error / np.where(radiance > 0.0, radiance, np.nan))


def conversion(image: SpectralImage | FilterImage, unit: str | Counts) -> Conversion:
    """What turns the radiance of an image into a unit.

    Parameters
    ----------
    image : SpectralImage or FilterImage
    unit : str or Counts
        One of `UNITS`, ``/sr`` and ``/arcsec2`` in place of ``sr-1`` and ``arcsec-2`` allowed; ``"Jy"``, ``"ABmag"``
        and ``"Vegamag"`` alone are those of whole pixels.

    Raises
    ------
    DomainError
        For an unknown unit, Vega magnitudes of others than U, B, V, R and I, and units of pixels where the image does
        not say how large they are.
    """
    if isinstance(unit, Counts):
        return Conversion("count", None, _counted(image, unit))
    name = " ".join(unit.replace("/sr", " sr-1").replace("/arcsec2", " arcsec-2").split())
    if name in ("count", "counts"):
        rule = "is of a telescope with an area and an exposure: nebula --aperture --exposure-time, or Counts in Python"
        raise DomainError("unit", unit, rule)
    if name not in UNITS:
        raise DomainError("unit", unit, f"no such unit; {nearest(name, UNITS)}")
    system, per_pixel = UNITS[name], name in ("Jy", "ABmag", "Vegamag")
    if name == "W m-2 sr-1 nm-1":
        return Conversion(name, None, np.ones(image.radiance.shape[2]))
    per_radiance = 1.0 / _vega_zeros(image) if system == "Vega" else per_frequency(_pivots(image))
    per_radiance = per_radiance / (AB_ZERO if system == "AB" else 1.0)
    if per_pixel:
        area: Any = pixel_solid_angle(image, f"{name} of whole pixels")[..., None]
    else:
        area = _ARCSEC2 if name.endswith("arcsec-2") else 1e-6 if name.startswith("MJy") else 1.0
    stated = f"mag{name.partition('mag')[2]}" if system else name
    return Conversion(f"{stated} pixel-1" if name == "Jy" else stated, system, per_radiance * area)


def per_frequency(wavelengths: Array) -> Array:
    """Jy of unit spectral flux per wavelength [W m-2 nm-1] at wavelengths [nm]: λ² / c."""
    return np.asarray(wavelengths**2 * 1e-9 / _LIGHT * 1e26)


def _pivots(image: SpectralImage | FilterImage) -> Array:
    if isinstance(image, FilterImage):
        return np.array([curve.pivot for curve in image.filters])
    return image.wavelengths


def _vega_zeros(image: SpectralImage | FilterImage) -> Array:
    from skyscatter.image.filters import filter_curve

    if not isinstance(image, FilterImage):
        raise DomainError("unit", "Vegamag", f"is for the filters {', '.join(VEGA_ZERO)}; for spectra take ABmag")
    for curve in image.filters:
        if curve.name not in VEGA_ZERO or curve != filter_curve(curve.name):
            raise DomainError("unit", "Vegamag", f"has no zero point for the filter {curve.name}; take ABmag")
    return np.array([VEGA_ZERO[name] for name in image.names])


def _counted(image: SpectralImage | FilterImage, unit: Counts) -> Array:
    light = unit.collecting_area_m2 * unit.exposure_s * unit.throughput * pixel_solid_angle(image, "counts")
    if isinstance(image, FilterImage):
        passed = np.array([curve.photon_width for curve in image.filters])
    else:
        from skyscatter.image.filters import cells

        low, high = cells(image.wavelengths)
        passed = image.wavelengths * (high - low)
    return np.asarray(light[..., None] * passed * 1e-9 / (_PLANCK * _LIGHT))


def photometric(image: SpectralImage | FilterImage, unit: str | Counts) -> xarray.Dataset:
    """Brightness in a unit of photometry, labelled.

    Parameters
    ----------
    image : SpectralImage or FilterImage
        Such as ``image.through("B,V")``.
    unit : str or Counts
        ``"Jy sr-1"``, ``"MJy sr-1"``, ``"ABmag arcsec-2"``, ``"Vegamag arcsec-2"``; of whole pixels ``"Jy"``,
        ``"ABmag"``, ``"Vegamag"`` and `Counts`.

    Returns
    -------
    xarray.Dataset
        ``brightness`` and, where the image has errors, ``brightness_error``, (y, x, wavelength or filter), with the
        coordinates of ``image.dataset``.  Magnitudes are NaN where there is no light.

    Raises
    ------
    DomainError
        As `conversion`.

    Examples
    --------
    >>> from skyscatter.image import SpectralImage
    >>> image = SpectralImage([[[1e-9, 1e-9]]], [500.0, 600.0])
    >>> photometric(image, "ABmag arcsec-2").brightness.values.round(2).tolist()
    [[[23.17, 22.77]]]
    """
    import xarray

    from skyscatter.image.dataset import coordinates

    made = conversion(image, unit)
    dims = ("y", "x", "filter" if isinstance(image, FilterImage) else "wavelength")
    attributes = {"units": made.unit, "long_name": "brightness"}
    attributes |= {} if made.system is None else {"magnitude_system": made.system}
    variables: dict[str, Any] = {"brightness": (dims, made.value(image.radiance), attributes)}
    if image.standard_error is not None:
        error = made.error(image.radiance, image.standard_error)
        variables["brightness_error"] = (dims, error, {**attributes, "long_name": "error of the brightness"})
        attributes["ancillary_variables"] = "brightness_error"
    coords, attrs = coordinates(image)
    return xarray.Dataset(variables, coords=coords, attrs={**attrs, "title": "Photometric image"})
