"""Sentinel-2 Level-1C products (SAFE folders, or the same zipped).

Names and meaning of metadata after the Sentinel-2 Products Specification Document, S2-PDGS-TAS-DI-PSD (ESA):
reflectance = (number + RADIO_ADD_OFFSET) / QUANTIFICATION_VALUE, the offset since processing baseline 04.00.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import PurePosixPath
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.bands import Sensor
from skyscatter.dehaze.flags import Flag
from skyscatter.dehaze.msi import sensor_from_xml
from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.angles import s2_geometry
from skyscatter.dehaze.rasters.base import RasterBand, RasterProfile, finite_number
from skyscatter.dehaze.rasters.containers import Container
from skyscatter.dehaze.rasters.gml import Polygon, outlines
from skyscatter.dehaze.rasters.handles import DatasetPool
from skyscatter.dehaze.rasters.layers import BandFile, Drawn, LayeredSource, Quality, refuse_calibration
from skyscatter.dehaze.rasters.names import SENTINEL2_ROLES, choose_bands
from skyscatter.dehaze.rasters.xmltools import Metadata
from skyscatter.errors import DomainError, MissingDataError

#: Pixels [m] of each band, in the order of the band identifiers of the metadata.
RESOLUTIONS = dict(zip(SENTINEL2_ROLES, (60, 10, 10, 10, 20, 20, 20, 10, 20, 60, 60, 20, 20), strict=True))
GRIDS = (10, 20, 60)
#: Since this baseline numbers have an offset.
_OFFSET_BASELINE = 4.0
_SATURATED = 65535.0


class Tile(NamedTuple):
    """Where a granule lies, on one of its grids."""

    crs: str
    left: float
    top: float
    height: int
    width: int


class Sentinel2Source(LayeredSource):
    """A Level-1C product of one granule.

    All 13 bands, or those asked for, on the grid of 10 m, or of 20 or 60 m.  The geometry is that of the angle grids
    in the metadata, views averaged over detectors and bands.  Opaque clouds are those of the product's mask besides
    those found here: MSK_CLASSI_B00, a raster of 60 m since processing baseline 04.00, or the outlines of
    MSK_CLOUDS_B00 before.  Products of this level hold no mask of cloud shadows.

    Parameters
    ----------
    path : str
        SAFE folder, .zip, or its MTD_MSIL1C.xml.
    options : SourceOptions
        Bands and resolution; angles in place of those of the metadata.

    Attributes
    ----------
    responses : Sensor or None
        The bands with the responses that the product lists; None if it lists none.

    Raises
    ------
    MissingDataError
        If a file is missing or damaged.
    DomainError
        If the product is not of Level 1C, or an option contradicts it.
    """

    def __init__(self, path: str, options: SourceOptions) -> None:
        self.name = str(path)
        box = Container(path)
        product = Metadata(box, _product_file(box))
        self.sensor = product.text("SPACECRAFT_NAME").lower()
        self.responses: Sensor | None = sensor_from_xml(product.root, product.shown)
        refuse_calibration(options, self.sensor, "a Sentinel-2 product", ("reflectance",))
        if product.text("PROCESSING_LEVEL", "Level-1C") != "Level-1C":
            raise DomainError(
                "product", self.name, "is not of Level 1C; reflectance of the surface has no haze to take off"
            )
        resolution = _resolution(options)
        granule = _granule(box, product)
        every = _describe_bands(product)
        chosen = choose_bands(every, options.bands)
        tile = _tile(granule, resolution)
        self.height, self.width = tile.height, tile.width
        self.bands, self.quantity = tuple(band for _, band in chosen), "reflectance"
        codes = [every[place].name for place, _ in chosen]
        self.files = _open(box, granule.name, codes, resolution)
        try:
            self._check_files(codes)
            clouds = _clouds(box, granule, resolution)
            if clouds is not None:
                self._heed(*clouds)
            places = [place for place, _ in chosen]
            self.geometry = options.geometry() or s2_geometry(granule, places, resolution)
        except BaseException:
            self.close()
            raise
        self.acquired = _time(product.text("PRODUCT_START_TIME", ""))
        # U is the inverse square of the distance to the Sun [au].
        nearness = product.number("U", default=None)
        self.sun_distance_au = None if nearness is None else nearness**-0.5
        self.profile = _profile(product, self.bands, tile, resolution)


def _clouds(box: Container, granule: Metadata, resolution: int) -> tuple[Quality, str] | None:
    """The product's mask of clouds and a note on it; None if it has none."""
    below, coarser = f"{PurePosixPath(granule.name).parent}/QI_DATA/", GRIDS[-1] // resolution
    found = box.find("MSK_CLASSI_B00.jp2", below=below)
    if found:
        pool = DatasetPool(box.raster(found[0]), box.show(found[0]))
        return Quality(BandFile(pool, coarser), _opaque_clouds), "clouds are those of MSK_CLASSI besides our own"
    found = box.find("MSK_CLOUDS_B00.gml", below=below)
    if found:
        drawn = _drawn(outlines(Metadata(box, found[0]), "OPAQUE"), _tile(granule, GRIDS[-1]))
        return Quality(Drawn(drawn, coarser), _opaque_clouds), "clouds are those of MSK_CLOUDS besides our own"
    return None


def _opaque_clouds(numbers: NDArray[Any]) -> dict[Flag, NDArray[np.bool_]]:
    """What the first layer of MSK_CLASSI means.  The second, cirrus, is left to the band at 1.38 um: it measures it."""
    return {Flag.CLOUD: numbers != 0}


def _drawn(polygons: list[Polygon], tile: Tile) -> NDArray[np.uint8]:
    """1 where the centre of a pixel lies within a polygon, else 0."""
    from affine import Affine
    from rasterio.features import rasterize

    pixels = np.zeros((tile.height, tile.width), np.uint8)
    if polygons:
        size = float(GRIDS[-1])
        transform = Affine(size, 0.0, tile.left, 0.0, -size, tile.top)
        rasterize(({"type": "Polygon", "coordinates": p} for p in polygons), out=pixels, transform=transform)
    return pixels


def is_sentinel2(box: Container) -> bool:
    """Whether the files are those of a Sentinel-2 product, of whatever level."""
    return bool(box.find("MTD_MSIL1C.xml", "MTD_MSIL2A.xml"))


def _product_file(box: Container) -> str:
    found = box.find("MTD_MSIL1C.xml")
    if found:
        return found[0]
    if box.find("MTD_MSIL2A.xml"):
        raise DomainError("product", box.shown, "is of Level 2A, reflectance of the surface; give the Level 1C product")
    raise MissingDataError(box.shown, "has no MTD_MSIL1C.xml; get the product again")


def _resolution(options: SourceOptions) -> int:
    wanted = 10.0 if options.resolution is None else options.resolution
    if wanted not in GRIDS:
        raise DomainError("resolution", wanted, f"choose one of {', '.join(map(str, GRIDS))} m")
    return int(wanted)


def _granule(box: Container, product: Metadata) -> Metadata:
    """Metadata of the granule, of which there must be one."""
    folder = str(PurePosixPath(product.name).parent)
    below = "GRANULE/" if folder == "." else f"{folder}/GRANULE/"
    found = box.find("MTD_TL.xml", below=below)
    if len(found) != 1:
        raise MissingDataError(box.shown, f"has {len(found)} granules (MTD_TL.xml) where one is needed; get it again")
    return Metadata(box, found[0])


def _describe_bands(product: Metadata) -> list[RasterBand]:
    quantification = product.number("QUANTIFICATION_VALUE")
    offsets = product.numbers_by("RADIO_ADD_OFFSET", "band_id")
    baseline = product.number("PROCESSING_BASELINE")
    if not offsets and baseline >= _OFFSET_BASELINE:
        raise MissingDataError(
            product.shown, f"is of baseline {baseline:05.2f} and has no RADIO_ADD_OFFSET; get the product again"
        )
    irradiance = product.numbers_by("SOLAR_IRRADIANCE", "bandId")
    centres = {
        element.get("bandId", ""): finite_number(central.text)
        for element in product.all("Spectral_Information")
        for central in element.iter("CENTRAL")
    }
    bands = []
    for number, (name, role) in enumerate(SENTINEL2_ROLES.items()):
        key = str(number)
        if offsets and key not in offsets:
            raise MissingDataError(product.shown, f"has no RADIO_ADD_OFFSET for band {name}; get the product again")
        bands.append(
            RasterBand(
                name,
                name,
                centres.get(key),
                1.0 / quantification,
                offsets.get(key, 0.0) / quantification,
                role,
                float(RESOLUTIONS[name]),
                _SATURATED,
                irradiance.get(key),
            )
        )
    return bands


def _tile(granule: Metadata, resolution: int) -> Tile:
    corner, size = {}, {}
    for element in granule.all("Geoposition"):
        if element.get("resolution") == str(resolution):
            corner = {child.tag: finite_number(child.text) for child in element}
    for element in granule.all("Size"):
        if element.get("resolution") == str(resolution):
            size = {child.tag: finite_number(child.text) for child in element}
    numbers = [corner.get("ULX"), corner.get("ULY"), size.get("NROWS"), size.get("NCOLS")]
    if None in numbers:
        raise MissingDataError(granule.shown, f"does not say where the grid of {resolution} m lies; get it again")
    left, top, height, width = (float(number) for number in numbers if number is not None)
    return Tile(granule.text("HORIZONTAL_CS_CODE"), left, top, int(height), int(width))


def _open(box: Container, granule: str, codes: list[str], resolution: int) -> tuple[BandFile, ...]:
    folder = f"{PurePosixPath(granule).parent}/IMG_DATA/"
    files: list[BandFile] = []
    try:
        for code in codes:
            found = box.find(f"_{code}.jp2", below=folder)
            if not found:
                remedy = "is missing; get the product again, or choose other bands"
                raise MissingDataError(box.show(f"{folder}*_{code}.jp2"), remedy)
            native = RESOLUTIONS[code]
            ratio = {"coarser": max(1, native // resolution), "finer": max(1, resolution // native)}
            files.append(BandFile(DatasetPool(box.raster(found[0]), box.show(found[0])), **ratio))
    except BaseException:
        for file in files:
            file.pool.close()
        raise
    return tuple(files)


def _time(text: str) -> datetime | None:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return None


def _profile(product: Metadata, bands: tuple[RasterBand, ...], tile: Tile, resolution: int) -> RasterProfile:
    from affine import Affine

    keys = ("PRODUCT_URI", "SPACECRAFT_NAME", "PROCESSING_BASELINE", "PRODUCT_START_TIME")
    tags = {key: text for key in keys if (text := product.text(key, ""))}
    return RasterProfile(
        dtype=str(np.dtype("uint16")),
        crs=tile.crs,
        transform=Affine(resolution, 0.0, tile.left, 0.0, -resolution, tile.top),
        nodata=0.0,
        tags=MappingProxyType({**tags, "AREA_OR_POINT": "Area"}),
        descriptions=tuple(band.name for band in bands),
        colours=tuple(band.role if band.role in ("red", "green", "blue") else "undefined" for band in bands),
        scaled=True,
    )
