"""The bands of a Sentinel-2 product by its own metadata: every unit's response, 2C and later ones too.

The main metadata file of a product (MTD_MSIL1C.xml, MTD_MSIL2A.xml) lists under Spectral_Information, for each band,
the response from Wavelength/MIN in steps of Spectral_Response/STEP.  A user's own file needs no licence to be read, and
is better than the shapes of `skyscatter.dehaze.bands`.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from skyscatter.dehaze.bands import Sensor, load_sensor
from skyscatter.dehaze.passband import Band
from skyscatter.errors import DomainError, MissingDataError


def sensor_from_metadata(path: str | Path) -> Sensor:
    """Sensor of the product that a Sentinel-2 metadata file describes.

    Parameters
    ----------
    path : path
        The product's main metadata file.

    Returns
    -------
    Sensor
        Named ``"sentinel-2a"`` and so on; bands B01 to B12 and B8A with measured responses, as far as they are listed.

    Raises
    ------
    MissingDataError
        If the file cannot be read, or lists no responses.
    """
    path = Path(path)
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise MissingDataError(path, f"cannot be read as XML ({error.__class__.__name__}); check the path") from error
    sensor = sensor_from_xml(root, path)
    if sensor is None:
        raise MissingDataError(path, "lists no spectral responses; name the sensor, for instance sentinel-2a")
    return sensor


def sensor_from_xml(root: ElementTree.Element, path: str | Path) -> Sensor | None:
    """As `sensor_from_metadata`, of a file that has been read; None if it lists no responses.

    Parameters
    ----------
    root : Element
    path : path
        Of the file, for messages.
    """
    roles = {band.name: band.role for band in load_sensor("sentinel-2a").bands}
    bands = []
    for entry in (element for element in root.iter() if _tag(element) == "Spectral_Information"):
        name = _name(entry.get("physicalBand", ""))
        values = _text(entry, "VALUES").split()
        if name not in roles or not values:
            continue
        try:
            low, step = float(_text(entry, "MIN")), float(_text(entry, "STEP"))
            response = np.maximum(np.array(values, dtype=float), 0.0)  # noise below zero far out on the slopes
            wavelengths = low + step * np.arange(response.size)
            note = "response listed in the product's metadata"
            bands.append(Band.from_table(name, wavelengths, response, roles[name], note))
        except (ValueError, DomainError) as error:
            raise MissingDataError(path, f"no response can be read for band {name} ({error})") from error
    return Sensor(name=_unit(root), bands=tuple(bands)) if bands else None


def _tag(element: ElementTree.Element) -> str:
    """Name of an element without its name space."""
    return element.tag.rpartition("}")[2]


def _text(element: ElementTree.Element, name: str) -> str:
    """Text of the first descendant of that name, empty if there is none."""
    return next((part.text or "" for part in element.iter() if _tag(part) == name), "")


def _name(physical: str) -> str:
    """B1 as the image files write it, B01."""
    return f"B0{physical[1:]}" if len(physical) == 2 else physical


def _unit(root: ElementTree.Element) -> str:
    """The spacecraft, as `load_sensor` writes it; sentinel-2 where the file does not say."""
    spacecraft = _text(root, "SPACECRAFT_NAME").strip().lower()
    return spacecraft if spacecraft.startswith("sentinel-2") else "sentinel-2"
