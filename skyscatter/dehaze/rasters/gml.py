"""Outlines of masks in GML, as Sentinel-2 products had them before processing baseline 04.00."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from skyscatter.dehaze.rasters.base import finite_number
from skyscatter.dehaze.rasters.xmltools import Metadata
from skyscatter.errors import MissingDataError

#: Rings of points (x, y) [m], closed: the outer one, then holes.
Polygon = list[list[tuple[float, float]]]


def outlines(file: Metadata, kind: str) -> list[Polygon]:
    """Polygons of the features of a kind, in the product's own projection.

    Parameters
    ----------
    file : Metadata
    kind : str
        Value of maskType, for instance ``"OPAQUE"``.

    Raises
    ------
    MissingDataError
        If a ring is not one.
    """
    # Of whatever version of GML: names count, name spaces do not.
    features = (f for f in file.root.iterfind(".//{*}MaskFeature") if f.findtext("{*}maskType", "").strip() == kind)
    return [
        [_ring(file, ring) for ring in polygon.iterfind(".//{*}LinearRing")]
        for feature in features
        for polygon in feature.iterfind(".//{*}Polygon")
    ]


def _ring(file: Metadata, ring: Element) -> list[tuple[float, float]]:
    """Points of one ring, of two coordinates, or of three of which the last is a height."""
    listed = ring.find("{*}posList")
    texts = ((listed.text if listed is not None else None) or "").split()
    numbers = [number for text in texts if (number := finite_number(text)) is not None]
    size = 3 if listed is not None and listed.get("srsDimension") == "3" else 2
    if len(numbers) < len(texts) or len(numbers) < 4 * size or len(numbers) % size:
        raise MissingDataError(file.shown, "holds an outline that is no closed ring of points; get the product again")
    return list(zip(numbers[::size], numbers[1::size], strict=True))
