"""FITS files: one cube for the radiance, one for its error, one for each layer, with a spectral axis.

- Axes in astropy's order are (wavelength, y, x).  FITS counts rows from the bottom and our first row is the top: rows
  are turned over on writing and on reading.
- Stokes parameters of a polarised image stand in extensions ``Q``, ``U``, ``V``, their standard errors in ``Q_STDERR``
  and so on, with the frame in ``STOKES``, ``POLCCONV``, ``POLFRAME`` and in words; other layers in ``LAYER1``, ...
- Of a denoised image the radiance as it was computed stands in ``RAW``, its standard error in ``RAW_STDERR``, and
  ``DENOISED`` is true in the primary header.
- The error stands in ``STDERR`` where it is a standard error, in ``ESTERR`` where it is an estimated one (``orders``
  and denoised images).
- The third world axis is ``WAVE`` (vacuum) in nm: linear where the grid is uniform, else a look-up table, ``WAVE-TAB``
  (Greisen et al. 2006, A&A 446, 747, section 6), which `astropy.wcs` reads when it is given the file.
- Extension ``WCS-TABLE`` holds that table for either kind of grid: the wavelengths to the last digit.
- An image with a celestial frame (`SkyFrame`) has RA---TAN and DEC--TAN as first two axes in every image extension, the
  reference pixel in the middle of the picture, ``RADESYS``, ``OBJECT`` and ``DISTANCE`` (pc).
- A sky with a camera in its recipe has azimuth and elevation there, ``ALON`` and ``ALAT`` in the projection of the
  camera: ``CAR`` (panorama), ``ARC``, ``ZEA`` (fisheye) or ``TAN``; ``SUNAZIM`` and ``SUNELEV``, ``ALT-OBS`` and, where
  place and time are known, ``OBSGEO-B/L/H`` (and ``X/Y/Z``), ``DATE-OBS`` and ``MJD-OBS``.
- Compressed files (tiles, GZIP_2, without loss) have an empty primary array and the radiance in ``RADIANCE``.
- Extension ``RECIPE`` holds the recipe as JSON in a table of one cell, where length and characters are free.
"""

from __future__ import annotations

import json
import warnings
import zlib
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError
from skyscatter.image.dataset import RAW_LAYERS, UNITS
from skyscatter.image.filterimage import through
from skyscatter.image.polarisation import FRAME, STOKES, STOKES_ERRORS
from skyscatter.image.spectral import SpectralImage
from skyscatter.image.wcs import Card, axes_cards, read_celestial

if TYPE_CHECKING:
    from astropy.io import fits

    from skyscatter.image.filterimage import FilterImage
    from skyscatter.image.photometry import Counts

_TABLE = "WCS-TABLE"
_COLUMN = "WAVELENGTH"
_MAIN = "RADIANCE"
DTYPES = ("float32", "float64")


def _is_uniform(wavelengths: NDArray[np.float64]) -> bool:
    if wavelengths.size == 1:
        return True
    line = np.linspace(wavelengths[0], wavelengths[-1], wavelengths.size)
    return bool(np.allclose(wavelengths, line, rtol=1e-12, atol=0.0))


def _axes(wavelengths: NDArray[np.float64]) -> list[tuple[str, Any, str]]:
    """Header cards of the spectral axis."""
    n = wavelengths.size
    cards: list[tuple[str, Any, str]] = [("WCSAXES", 3, "x, y, wavelength"), ("CUNIT3", "nm", "vacuum wavelength")]
    if _is_uniform(wavelengths):
        step = (wavelengths[-1] - wavelengths[0]) / (n - 1) if n > 1 else 1.0
        start = float(wavelengths[0])
        return [*cards, ("CTYPE3", "WAVE", "linear"), ("CRPIX3", 1.0, ""), ("CRVAL3", start, ""), ("CDELT3", step, "")]
    return [
        *cards,
        ("CTYPE3", "WAVE-TAB", "look-up table"),
        ("CRPIX3", 1.0, ""),
        ("CRVAL3", 1.0, "index into the table"),
        ("CDELT3", 1.0, ""),
        ("PS3_0", _TABLE, "extension with the table"),
        ("PS3_1", _COLUMN, "its column"),
        ("PV3_1", 1, "version of that extension"),
        ("PV3_2", 1, "level of that extension"),
        ("PV3_3", 1, "axis of the table"),
    ]


def fill(hdu: Any, cards: list[Card], comment: str, unit: str = UNITS) -> None:
    """Unit, axes and remarks of an image extension."""
    hdu.header["BUNIT"] = unit
    for card in cards:
        hdu.header[card[0]] = card[1:]
    hdu.header["COMMENT"] = comment
    hdu.header["COMMENT"] = "FITS row 1 is the bottom of the picture. NaN is outside the field."


def _layer_place(image: SpectralImage, name: str, number: int) -> tuple[str, str]:
    """Extension of a layer, and a remark on it."""
    extension = f"{name.removesuffix('_error').upper()}{'_STDERR' if name.endswith('_error') else ''}"
    if image.is_denoised and name in RAW_LAYERS:
        return extension, RAW_LAYERS[name]
    if image.polarised and name in STOKES:
        return extension, f"Stokes {name}."
    if image.polarised and name in STOKES_ERRORS:
        return extension, f"Standard error of Stokes {name[0]} in the extension {name[0]}."
    return f"LAYER{number}", "A part of the radiance in the primary array."


def _fill_frame(hdu: Any, name: str) -> None:
    """Say to what Q, U and V refer.  FITS has no standard keyword for it; POLCCONV is the usual one for the sense."""
    hdu.header["STOKES"] = (name[0], "Stokes parameter; I is the primary array")
    hdu.header["POLCCONV"] = ("IAU", "angles grow anticlockwise as seen")
    hdu.header["POLFRAME"] = ("ZENITH", "angles start at the meridian plane")
    hdu.header["COMMENT"] = FRAME


def flipped(cube: NDArray[Any]) -> NDArray[Any]:
    """Array (plane, y, x) as FITS stores it: row 1 is the bottom of the picture."""
    return np.ascontiguousarray(np.moveaxis(cube, -1, 0)[:, ::-1, :])


def stamp(primary: Any, recipe: dict[str, Any]) -> None:
    """When and by what the file was written."""
    from skyscatter import __version__

    header, camera = primary.header, recipe.get("camera")
    header["DATE"] = (datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S"), "when this file was written (UTC)")
    header["CREATOR"] = (f"skyscatter {__version__}", "program that wrote this file")
    header["TELESCOP"] = ("simulated", "computed, not observed")
    if isinstance(camera, dict) and camera.get("kind"):
        header["INSTRUME"] = (str(camera["kind"]), "camera")
    if recipe.get("solver"):
        header["SOLVER"] = (str(recipe["solver"]), "solver of radiative transfer")
    if "denoising" in recipe:
        header["DENOISED"] = (True, "not as computed: noise was taken off")
        header["COMMENT"] = f"Denoised by {recipe['denoising']['method']}: to be looked at, not measured."


def pack(hdus: list[Any], dtype: str | None, compress: bool) -> fits.HDUList:
    """Image extensions, the first of them the main one, as they go into a file.

    Parameters
    ----------
    hdus : list of HDU
        The first is a primary one.
    dtype : {"float32", "float64"}, optional
        Of all arrays; as they are when not given.
    compress : bool
        Tiles compressed without loss; the main array then stands in the first extension, for a primary one cannot be.
    """
    from astropy.io import fits

    images = [fits.ImageHDU(_cast(hdu.data, dtype), hdu.header) for hdu in hdus]
    if not compress:
        return fits.HDUList([fits.PrimaryHDU(images[0].data, hdus[0].header), *images[1:]])
    primary = fits.PrimaryHDU()
    for keyword in ("DATE", "CREATOR", "TELESCOP", "INSTRUME", "SOLVER", "DENOISED"):
        if keyword in hdus[0].header:
            primary.header[keyword] = (hdus[0].header[keyword], hdus[0].header.comments[keyword])
    images[0].name = _MAIN
    lossless = {"compression_type": "GZIP_2", "quantize_level": 0.0}
    return fits.HDUList([primary, *(fits.CompImageHDU(hdu.data, hdu.header, **lossless) for hdu in images)])


def _cast(cube: NDArray[Any], dtype: str | None) -> NDArray[Any]:
    if dtype is None:
        return cube
    if dtype not in DTYPES:
        raise DomainError("dtype", dtype, f"choose one of {', '.join(DTYPES)}")
    with np.errstate(over="ignore"):
        cast = cube.astype(dtype)
    if np.isinf(cast).any():
        raise DomainError("radiance", float(np.nanmax(np.abs(cube))), "is too large for float32")
    return cast


def recipe_table(recipe: dict[str, Any]) -> Any:
    """Extension with the recipe."""
    from astropy.io import fits

    text = json.dumps(recipe)  # ASCII: JSON escapes the rest
    cell = fits.Column("JSON", f"{len(text)}A", array=np.array([text.encode("ascii")]))
    return fits.BinTableHDU.from_columns([cell], name="RECIPE")


def read_recipe(hdus: fits.HDUList) -> dict[str, Any]:
    """Recipe from its extension; empty where there is none."""
    return json.loads(str(hdus["RECIPE"].data["JSON"][0])) if "RECIPE" in hdus else {}


def brightness(image: SpectralImage | FilterImage, cards: list[Card], unit: str | Counts, error: str) -> list[Any]:
    """Brightness in a unit of photometry and its error, the latter in an extension of the name `error`."""
    from astropy.io import fits

    from skyscatter.image.photometry import conversion

    made = conversion(image, unit)
    cards = [*cards, *([] if made.system is None else [("MAGSYS", made.system, "magnitude system")])]
    primary = fits.PrimaryHDU(flipped(made.value(image.radiance)))
    fill(primary, cards, "Brightness; magnitudes are NaN where there is no light.", made.unit)
    stamp(primary, image.recipe)
    if image.standard_error is None:
        return [primary]
    deviation = fits.ImageHDU(flipped(made.error(image.radiance, image.standard_error)), name=error)
    fill(deviation, cards, "Error of the brightness.", made.unit)
    return [primary, deviation]


def images(image: SpectralImage, unit: str | Counts | None, outline: Any = None) -> list[Any]:
    """Radiance, its error and the layers; in another unit brightness and its error.

    The headers say where the pixels of the image stand, or those of the `outline` of which it is a part.
    """
    from astropy.io import fits

    cards = [*_axes(image.wavelengths), *axes_cards(image if outline is None else outline)]
    if unit is not None:
        return brightness(image, cards, unit, "ESTERR" if image.error_kind == "estimated" else "STDERR")
    primary = fits.PrimaryHDU(flipped(image.radiance))
    fill(primary, cards, "Spectral radiance.")
    stamp(primary, image.recipe)
    hdus = [primary]
    if image.error is not None and image.error_kind != "none":
        name, sort = ("ESTERR", "Estimated") if image.error_kind == "estimated" else ("STDERR", "Standard")
        hdus.append(fits.ImageHDU(flipped(image.error), name=name))
        fill(hdus[-1], cards, f"{sort} error of the radiance in the primary array.")
    for number, (name, cube) in enumerate(image.layers.items(), start=1):
        extension, remark = _layer_place(image, name, number)
        hdus.append(fits.ImageHDU(flipped(cube), name=extension))
        hdus[-1].header["LAYER"] = (name, "name of the layer")
        fill(hdus[-1], cards, remark)
        if image.polarised and name in (*STOKES, *STOKES_ERRORS):
            _fill_frame(hdus[-1], name)
    return hdus


def _hdus(image: SpectralImage, dtype: str | None, compress: bool, unit: str | Counts | None) -> fits.HDUList:
    from astropy.io import fits

    return fits.HDUList([*pack(images(image, unit), dtype, compress), *tables(image)])


def tables(image: SpectralImage) -> list[Any]:
    """Extensions with the wavelengths and with the recipe."""
    from astropy.io import fits

    n = image.wavelengths.size
    column = fits.Column(_COLUMN, f"{n}D", unit="nm", dim=f"(1,{n})", array=image.wavelengths.reshape(1, n, 1))
    table = fits.BinTableHDU.from_columns([column], name=_TABLE)
    table.header["EXTVER"], table.header["EXTLEVEL"] = 1, 1
    return [table, recipe_table(image.recipe)]


def write(
    image: SpectralImage,
    path: Path,
    filters: str | Iterable[Any] | None = None,
    dtype: str | None = None,
    compress: bool = False,
    unit: str | Counts | None = None,
) -> None:
    """Write a FITS file with checksums; with `filters` a plane for each instead of the spectra."""
    if filters is not None:
        through(image, filters).save(path, dtype=dtype, compress=compress, unit=unit)
        return
    with atomic_path(path) as temporary:
        _hdus(image, dtype, compress, unit).writeto(temporary, overwrite=True, checksum=True)


def _wavelengths(hdus: fits.HDUList, path: Path) -> NDArray[np.float64]:
    """From our table if it is there, else from the linear axis of the header."""
    if _TABLE in hdus and _COLUMN in hdus[_TABLE].columns.names:
        return np.asarray(hdus[_TABLE].data[_COLUMN], dtype=np.float64).ravel()
    header = main_image(hdus, path).header
    if header.get("CTYPE3", "").strip() != "WAVE" or "CDELT3" not in header:
        raise DomainError("image file", str(path), "has no wavelength axis (CTYPE3 = 'WAVE', or a table WCS-TABLE)")
    scale = {"m": 1e9, "um": 1e3, "nm": 1.0, "angstrom": 0.1}.get(header.get("CUNIT3", "m").strip().lower())
    if scale is None:
        raise DomainError("CUNIT3", header["CUNIT3"], "must be m, um, nm or Angstrom")
    index = np.arange(1, header["NAXIS3"] + 1) - header.get("CRPIX3", 0.0)
    return np.asarray((header.get("CRVAL3", 0.0) + index * header["CDELT3"]) * scale, dtype=np.float64)


def main_image(hdus: fits.HDUList, path: Path) -> Any:
    """The first image of a file that has pixels: the primary one, or, where that is empty, an extension."""
    for hdu in hdus:
        if hdu.is_image and hdu.header.get("NAXIS", 0) > 0:
            return hdu
    raise DomainError("image file", str(path), "has no image")


def radiance_factors(header: Any, wavelengths: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    """What turns the unit of an image into W m-2 sr-1 nm-1 at wavelengths [nm], shape (wavelength,).

    A file that states no unit is taken to be in that one.
    """
    stated = str(header.get("BUNIT", "")).strip()
    if stated in ("", UNITS):
        return np.ones(len(wavelengths))
    from astropy import units

    at = units.spectral_density(wavelengths * units.nm)
    try:
        return np.asarray(units.Unit(stated).to(UNITS, np.ones(len(wavelengths)), equivalencies=at))
    except (ValueError, units.UnitConversionError) as error:
        remedy = f"pictures are read in spectral radiance: {UNITS}, MJy/sr, erg/(s cm2 Angstrom arcsec2) and the like"
        raise DomainError("BUNIT", stated, f"{path}: {remedy}") from error


def cube_of(hdu: Any) -> NDArray[Any]:
    """Array (y, x, plane) of an image of two or three axes, the first row on top, in this machine's byte order."""
    planes = hdu.data if hdu.data.ndim == 3 else hdu.data[None]
    values = np.moveaxis(planes[:, ::-1, :], 0, -1)
    return np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))


def _image(hdus: fits.HDUList, path: Path) -> SpectralImage:
    main = main_image(hdus, path)
    if main.header["NAXIS"] != 3:
        raise DomainError("image file", str(path), "its image is no cube (wavelength, y, x)")
    if "FILTERS" in hdus:
        raise DomainError("image file", str(path), "has a plane per filter, no spectra; read it with FilterImage.load")
    wavelengths = _wavelengths(hdus, path)
    factors = radiance_factors(main.header, wavelengths, path)

    def cube(hdu: Any) -> NDArray[Any]:
        values = cube_of(hdu)
        return values if np.all(factors == 1.0) else values * factors

    return SpectralImage(
        cube(main),
        wavelengths,
        next((cube(hdus[name]) for name in ("ESTERR", "STDERR") if name in hdus), None),
        recipe=read_recipe(hdus),
        layers={hdu.header["LAYER"]: cube(hdu) for hdu in hdus[1:] if hdu.is_image and "LAYER" in hdu.header},
        sky=read_celestial(main.header),
    )


def open_fits(path: Path, build: Callable[[fits.HDUList, Path], Any]) -> Any:
    """What `build` makes of an opened FITS file; damage becomes one clear line.

    Data that do not match their DATASUM are damage.  A header that does not match its CHECKSUM is none: programs edit
    headers without a thought for it.
    """
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyUserWarning

    with path.open("rb") as file:
        if file.read(6) != b"SIMPLE":
            raise DomainError("image file", str(path), "is not a FITS file")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", AstropyUserWarning)
        try:
            with fits.open(path, memmap=False, checksum=True) as hdus:
                made = build(hdus, path)
            problem: Exception | None = None
        except (OSError, ValueError, TypeError, KeyError, IndexError, zlib.error, fits.VerifyError) as error:
            problem = error
    if any("Datasum verification failed" in str(warning.message) for warning in said):
        remedy = "is damaged: its data do not match their checksum; take another copy, or make it again"
        raise DomainError("image file", str(path), remedy) from problem
    if isinstance(problem, DomainError):
        raise problem
    if problem is not None:
        raise DomainError("image file", str(path), f"is a damaged FITS file ({problem})") from problem
    for warning in said:
        if "Checksum verification failed" not in str(warning.message):
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    return made


def read(path: Path) -> SpectralImage:
    """Read a FITS file that `write` wrote, or another cube with a linear vacuum wavelength axis."""
    image: SpectralImage = open_fits(path, _image)
    return image
