"""FITS files with a plane for each filter: cube (filter, y, x), celestial axes as in spectral files.

- The third axis counts the planes (``CTYPE3 = 'FILTER'``, linear); ``FILTER1``, ``FILTER2``, ... name them in the
  headers of the radiance and of its standard error (extension ``STDERR``).
- Extension ``FILTERS`` has a row for each: name, mean wavelength, weighting, the share of the filter that the computed
  wavelengths covered, and the curve as JSON.
- Layers stand in ``LAYER1``, ..., named by the card ``LAYER``; extension ``RECIPE`` as in spectral files.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError
from skyscatter.image.filterimage import FilterImage
from skyscatter.image.filters import FilterCurve, filter_curves
from skyscatter.image.fits import (
    brightness,
    cube_of,
    fill,
    flipped,
    main_image,
    open_fits,
    pack,
    radiance_factors,
    read_recipe,
    recipe_table,
    stamp,
)
from skyscatter.image.wcs import Card, axes_cards, read_celestial

if TYPE_CHECKING:
    from astropy.io import fits

    from skyscatter.image.photometry import Counts

_TABLE = "FILTERS"
#: Extensions with the standard error: ours, and those in use for pictures of telescopes.
_ERRORS = ("STDERR", "ERR", "ERROR", "UNCERT")


def _cards(image: FilterImage) -> list[Card]:
    """Axes, and the names of the planes."""
    cards: list[Card] = [
        ("WCSAXES", 3, "x, y, filter"),
        ("CTYPE3", "FILTER", "number of the filter"),
        ("CRPIX3", 1.0, ""),
        ("CRVAL3", 1.0, ""),
        ("CDELT3", 1.0, ""),
        *axes_cards(image),
    ]
    for number, curve in enumerate(image.filters, start=1):
        cards.append((f"FILTER{number}", curve.name, f"plane {number}, about {curve.centre:.6g} nm"))
    return cards


def _filter_table(image: FilterImage) -> Any:
    from astropy.io import fits

    texts: dict[str, list[str]] = {
        "NAME": list(image.names),
        "WEIGHTING": [curve.weighting for curve in image.filters],
        "CURVE": [curve.model_dump_json() for curve in image.filters],
    }
    columns = [
        fits.Column(name, f"{max(len(word) for word in words)}A", array=np.array(words))
        for name, words in texts.items()
    ]
    columns.append(fits.Column("CENTRE", "D", unit="nm", array=np.array([curve.centre for curve in image.filters])))
    columns.append(fits.Column("COVERAGE", "D", array=np.array(image.coverage)))
    return fits.BinTableHDU.from_columns(columns, name=_TABLE)


def write(
    image: FilterImage,
    path: Path,
    dtype: str | None = None,
    compress: bool = False,
    unit: str | Counts | None = None,
) -> None:
    """Write a FITS file with checksums."""
    cards = _cards(image)
    images = _images(image, cards) if unit is None else brightness(image, cards, unit, "STDERR")
    hdus = pack(images, dtype, compress)
    hdus.append(_filter_table(image))
    hdus.append(recipe_table(image.recipe))
    with atomic_path(path) as temporary:
        hdus.writeto(temporary, overwrite=True, checksum=True)


def _images(image: FilterImage, cards: list[Card]) -> list[Any]:
    """Radiance, its error and the layers."""
    from astropy.io import fits

    primary = fits.PrimaryHDU(flipped(image.radiance))
    fill(primary, cards, "Spectral radiance, averaged over the band of each filter.")
    stamp(primary, image.recipe)
    images = [primary]
    if image.standard_error is not None:
        images.append(fits.ImageHDU(flipped(image.standard_error), name="STDERR"))
        fill(images[-1], cards, "Standard error of the radiance in the primary array.")
    for number, (name, cube) in enumerate(image.layers.items(), start=1):
        images.append(fits.ImageHDU(flipped(cube), name=f"LAYER{number}"))
        images[-1].header["LAYER"] = (name, "name of the layer")
        fill(images[-1], cards, "A part of the radiance in the primary array.")
    return images


def _image(hdus: fits.HDUList, path: Path, filters: str | Iterable[Any] | None) -> FilterImage:
    main = main_image(hdus, path)
    if filters is None and _TABLE not in hdus and main.header["NAXIS"] == 2:
        filters = _named_filter(main.header, path)
    if filters is None and (_TABLE not in hdus or main.header["NAXIS"] != 3):
        raise DomainError(
            "image file", str(path), "holds no planes of filters; spectra are read with SpectralImage.load"
        )
    if filters is not None:
        curves = filter_curves(filters)
        coverage = None
    else:
        table = hdus[_TABLE].data
        curves = tuple(FilterCurve(**json.loads(str(text))) for text in table["CURVE"])
        coverage = [float(share) for share in table["COVERAGE"]]
    factors = radiance_factors(main.header, np.array([curve.pivot for curve in curves]), path)

    def cube(hdu: Any) -> Any:
        values = cube_of(hdu)
        if values.shape[2] != factors.size:
            raise DomainError("filters", [curve.name for curve in curves], f"{path} has {values.shape[2]} planes")
        return values if np.all(factors == 1.0) else values * factors

    return FilterImage(
        cube(main),
        curves,
        next((cube(hdus[name]) for name in _ERRORS if name in hdus), None),
        coverage=coverage,
        sky=read_celestial(main.header),
        recipe=read_recipe(hdus),
        layers={hdu.header["LAYER"]: cube(hdu) for hdu in hdus[1:] if hdu.is_image and "LAYER" in hdu.header},
    )


def _named_filter(header: Any, path: Path) -> str:
    """The filter of a picture of one plane, which its header names."""
    name = str(header.get("FILTER", header.get("FILTER1", ""))).strip()
    if not name:
        raise DomainError("image file", str(path), "is one plane and names no filter; add FILTER to its header")
    try:
        filter_curves(name)
    except DomainError as error:
        remedy = f"{error.allowed}; in Python FilterImage.load(path, filters='my.csv') takes a curve of your own"
        raise DomainError("FILTER", name, remedy) from error
    return name


def read(path: Path, filters: str | Iterable[Any] | None = None) -> FilterImage:
    """Read a file that `write` wrote, or a picture through one filter, which the header or `filters` names."""
    image: FilterImage = open_fits(path, lambda hdus, name: _image(hdus, name, filters))
    return image
