"""Landsat 8 and 9 Collection 2 Level-1 products: a folder (or .tar) with MTL metadata and one file a band.

Reflectance after the Landsat 8 (L8) Data Users Handbook, LSDS-1574, version 5 (USGS 2019), section 5.2:
(REFLECTANCE_MULT * number + REFLECTANCE_ADD) / sin(Sun's elevation), here with the elevation at the pixel where the
product has angle bands.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from datetime import datetime
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.flags import Flag
from skyscatter.dehaze.geometry import SceneGeometry
from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.angles import angle_bands_geometry
from skyscatter.dehaze.rasters.base import RasterBand, RasterProfile, finite_number
from skyscatter.dehaze.rasters.containers import Container
from skyscatter.dehaze.rasters.handles import DatasetPool, quiet
from skyscatter.dehaze.rasters.layers import BandFile, LayeredSource, Quality, refuse_calibration
from skyscatter.dehaze.rasters.names import LANDSAT_BANDS, choose_bands
from skyscatter.errors import DomainError, MissingDataError

_ENDINGS = ("_MTL.txt", "_MTL.json", "_MTL.xml")
_ANGLES = ("SZA", "SAA", "VZA", "VAA")
#: Bands that are read unless others are asked for; the panchromatic one has a grid of its own.
_GRID_BANDS = tuple(name for name in LANDSAT_BANDS if name != "B8")


#: Bits of QA_PIXEL (L8 Data Users Handbook, table 6-2): clouds and what lies beside them, and their shadows.
_CLOUD_BITS, _SHADOW_BITS = (1 << 1) | (1 << 3), 1 << 4


def _qa_pixel(numbers: NDArray[Any]) -> dict[Flag, NDArray[np.bool_]]:
    """What QA_PIXEL means."""
    return {Flag.CLOUD: (numbers & _CLOUD_BITS) != 0, Flag.SHADOW: (numbers & _SHADOW_BITS) != 0}


class LandsatSource(LayeredSource):
    """A Level-1 product, its reflective bands of 30 m; with the clouds and shadows of its QA_PIXEL where it has one.

    `scale` and `offset` of the bands are those of the metadata; the values that `read` gives are divided by the cosine
    of the Sun's zenith angle as well.

    Parameters
    ----------
    path : str
        Folder, .tar or .zip, or the MTL file (.txt, .json, .xml).
    options : SourceOptions
        Bands; quantity radiance [W m-2 sr-1 um-1] in place of reflectance; angles in place of those of the product.

    Raises
    ------
    MissingDataError
        If a file or a value is missing or damaged.
    DomainError
        If the product is not of Level 1, the Sun is too low, or an option contradicts the product.
    """

    def __init__(self, path: str, options: SourceOptions) -> None:
        self.name = str(path)
        box = Container(path)
        metadata = Mtl(box)
        self.sensor = metadata.text("SPACECRAFT_ID").lower().replace("_", "-")
        if self.sensor not in ("landsat-8", "landsat-9"):
            raise DomainError("sensor", self.sensor, "the bands of Landsat 8 and 9 are known")
        if not metadata.text("PROCESSING_LEVEL", "L1TP").startswith("L1"):
            raise DomainError(
                "product", self.name, "is not of Level 1; reflectance of the surface has no haze to take off"
            )
        refuse_calibration(options, self.sensor, "a Landsat product", ("reflectance", "radiance"))
        if options.resolution not in (None, 30.0):
            raise DomainError("resolution", options.resolution, "the bands of Landsat are read at 30 m; leave it out")
        self.quantity = "radiance" if options.quantity == "radiance" else "reflectance"
        every = _describe_bands(metadata, self.quantity)
        _refuse_other_grids(options.bands)
        chosen = choose_bands(every, options.bands)
        self.bands = tuple(band for _, band in chosen)
        codes = [every[place].name for place, _ in chosen]
        self.files = _open(box, metadata, codes)
        try:
            self._place(codes, metadata)
            if found := box.find("_QA_PIXEL.TIF"):
                quality = Quality(BandFile(DatasetPool(box.raster(found[0]), box.show(found[0]))), _qa_pixel)
                self._heed(quality, "clouds and their shadows are those of QA_PIXEL besides our own")
            self.geometry = options.geometry() or self._geometry(box, metadata)
        except BaseException:
            self.close()
            raise
        self.acquired = _time(metadata.text("DATE_ACQUIRED", ""), metadata.text("SCENE_CENTER_TIME", ""))
        self.sun_distance_au = finite_number(metadata.text("EARTH_SUN_DISTANCE", ""))

    def _place(self, codes: list[str], metadata: Mtl) -> None:
        with self.files[0].pool.reading() as dataset, quiet():
            self.height, self.width = dataset.height, dataset.width
            crs, transform, area = dataset.crs, dataset.transform, dataset.tags().get("AREA_OR_POINT", "Area")
        self._check_files(codes)
        keys = ("LANDSAT_PRODUCT_ID", "SPACECRAFT_ID", "DATE_ACQUIRED", "SCENE_CENTER_TIME", "PROCESSING_LEVEL")
        tags = {key: text for key in keys if (text := metadata.text(key, ""))}
        self.profile = RasterProfile(
            dtype="uint16",
            crs=crs,
            transform=transform,
            nodata=0.0,
            tags=MappingProxyType({**tags, "AREA_OR_POINT": area}),
            descriptions=tuple(band.name for band in self.bands),
            colours=tuple(band.role if band.role in ("red", "green", "blue") else "undefined" for band in self.bands),
            scaled=True,
        )

    def _geometry(self, box: Container, metadata: Mtl) -> SceneGeometry:
        found = {name: box.find(f"_{name}.TIF") for name in _ANGLES}
        if all(found.values()):
            pools: dict[str, DatasetPool] = {}
            try:
                for name, paths in found.items():
                    pools[name] = DatasetPool(box.raster(paths[0]), box.show(paths[0]))
                return angle_bands_geometry(pools, self.height, self.width)
            finally:
                for pool in pools.values():
                    pool.close()
        self.notes = (*self.notes, "no angle bands (SZA, SAA, VZA, VAA): one Sun for the scene, view from the zenith")
        return SceneGeometry.constant(
            90.0 - metadata.number("SUN_ELEVATION"), sun_azimuth_deg=metadata.number("SUN_AZIMUTH")
        )

    def _finish(self, values: NDArray[np.float32], rows: NDArray[Any], cols: NDArray[Any]) -> None:
        """Divide by the cosine of the Sun's zenith angle."""
        if self.quantity == "reflectance" and self.geometry is not None:
            values *= self.geometry.secant_of_sun(rows, cols).astype(np.float32)


def is_landsat(box: Container) -> bool:
    """Whether the files are those of a Landsat product."""
    return bool(box.find(*_ENDINGS))


class Mtl:
    """Values of an MTL file by name: ``KEY = VALUE`` in groups, or the same as JSON or XML."""

    def __init__(self, box: Container) -> None:
        found = [name for ending in _ENDINGS for name in box.find(ending)]
        if not found:
            raise MissingDataError(box.shown, "has no MTL file (_MTL.txt, .json or .xml); get the product again")
        self.name, self.shown = found[0], box.show(found[0])
        content = box.read(self.name)
        self._values: dict[str, str] = {}
        try:
            if self.name.lower().endswith(".json"):
                self._gather(json.loads(content))
            elif self.name.lower().endswith(".xml"):
                for element in ElementTree.fromstring(content).iter():
                    if len(element) == 0:
                        self._values.setdefault(element.tag, (element.text or "").strip())
            else:
                self._parse(content.decode("utf-8", "replace"))
        except (ValueError, ElementTree.ParseError) as error:
            raise MissingDataError(self.shown, f"is damaged or cut short ({error}); get the product again") from error

    def _gather(self, tree: Any) -> None:
        for key, value in tree.items():
            if isinstance(value, dict):
                self._gather(value)
            else:
                # Groups about this product come before those about what it was made from.
                self._values.setdefault(key, str(value).strip())

    def _parse(self, text: str) -> None:
        ended = False
        for line in text.splitlines():
            key, equals, value = (part.strip() for part in line.partition("="))
            ended = ended or (key == "END" and not equals)
            if equals and key not in ("GROUP", "END_GROUP"):
                self._values.setdefault(key, value.strip('"'))
        if not ended:
            raise ValueError("no END")

    def text(self, key: str, default: str | None = None) -> str:
        """A value as text."""
        value = self._values.get(key, default)
        if value is None:
            raise MissingDataError(self.shown, f"has no {key}; get the product again")
        return value

    def number(self, key: str) -> float:
        """A value as a number."""
        value = finite_number(self.text(key))
        if value is None:
            raise MissingDataError(self.shown, f"{key} = {self.text(key)!r}: must be a number; get the product again")
        return value

    def has(self, key: str) -> bool:
        """Whether there is such a value."""
        return key in self._values


def _describe_bands(metadata: Mtl, quantity: str) -> list[RasterBand]:
    kind = quantity.upper()
    bands = []
    for name in _GRID_BANDS:
        number = name[1:]
        if not metadata.has(f"FILE_NAME_BAND_{number}"):
            continue
        role, centre = LANDSAT_BANDS[name]
        bands.append(
            RasterBand(
                name,
                name,
                centre,
                metadata.number(f"{kind}_MULT_BAND_{number}"),
                metadata.number(f"{kind}_ADD_BAND_{number}"),
                role,
                30.0,
                metadata.number(f"QUANTIZE_CAL_MAX_BAND_{number}"),
            )
        )
    if not bands:
        raise MissingDataError(
            metadata.shown, "names no reflective bands (FILE_NAME_BAND_1 ...); get the product again"
        )
    return bands


def _refuse_other_grids(wanted: tuple[str, ...] | None) -> None:
    for word in wanted or ():
        name = word.partition("=")[0].strip().upper()
        if name in ("B8", "PAN"):
            raise DomainError("bands", word, "the panchromatic band has a grid of 15 m of its own; leave it out")
        if name in ("B10", "B11"):
            raise DomainError("bands", word, "thermal bands have no reflectance; leave them out")


def _open(box: Container, metadata: Mtl, codes: list[str]) -> tuple[BandFile, ...]:
    files: list[BandFile] = []
    try:
        for code in codes:
            name = metadata.text(f"FILE_NAME_BAND_{code[1:]}")
            found = box.beside(metadata.name, name)
            if found is None:
                remedy = "is missing; get the product again, or choose other bands"
                raise MissingDataError(box.show(name), remedy)
            files.append(BandFile(DatasetPool(box.raster(found), box.show(found))))
    except BaseException:
        for file in files:
            file.pool.close()
        raise
    return tuple(files)


def _time(date: str, clock: str) -> datetime | None:
    text = f"{date}T{clock.rstrip('Z').partition('.')[0]}+00:00"
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return None
