"""Names and roles of bands from what a file says of them; never from their position."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from skyscatter.dehaze.rasters.base import RasterBand, find_band, finite_number
from skyscatter.errors import DomainError

#: Role of each band of Sentinel-2's MSI; centres and resolutions stand in its metadata.
SENTINEL2_ROLES = {
    "B01": "coastal",
    "B02": "blue",
    "B03": "green",
    "B04": "red",
    "B05": "rededge1",
    "B06": "rededge2",
    "B07": "rededge3",
    "B08": "nir",
    "B8A": "nir-narrow",
    "B09": "water-vapour",
    "B10": "cirrus",
    "B11": "swir1",
    "B12": "swir2",
}

#: Role and centre [nm] of each reflective band of Landsat 8 and 9's OLI: the middles of the limits in table 2-1 of the
#: Landsat 8 (L8) Data Users Handbook, LSDS-1574, version 5 (USGS 2019), whose metadata do not have them.
LANDSAT_BANDS = {
    "B1": ("coastal", 443.0),
    "B2": ("blue", 482.0),
    "B3": ("green", 561.5),
    "B4": ("red", 654.5),
    "B5": ("nir", 865.0),
    "B6": ("swir1", 1608.5),
    "B7": ("swir2", 2200.5),
    "B8": ("pan", 589.5),
    "B9": ("cirrus", 1373.5),
}

_WORDS = {
    "red": "red",
    "r": "red",
    "green": "green",
    "g": "green",
    "blue": "blue",
    "b": "blue",
    "nir": "nir",
    "near infrared": "nir",
    "coastal": "coastal",
    "coastal aerosol": "coastal",
    "rededge": "rededge",
    "red edge": "rededge",
    "swir": "swir",
    "swir1": "swir1",
    "swir 1": "swir1",
    "swir2": "swir2",
    "swir 2": "swir2",
    "cirrus": "cirrus",
    "water vapour": "water-vapour",
    "water vapor": "water-vapour",
    "pan": "pan",
    "panchromatic": "pan",
    "grey": "grey",
    "gray": "grey",
    "grayscale": "grey",
    "alpha": "alpha",
}
_COLOURS = {
    "red": "red",
    "green": "green",
    "blue": "blue",
    "alpha": "alpha",
    "gray": "grey",
    "pan": "pan",
    "coastal": "coastal",
    "rededge": "rededge",
    "nir": "nir",
    "swir": "swir",
}
#: Colour interpretations that stand for something else than a sample of light.
LABELS = {"palette": "colours of a palette", "hue": "hue", "saturation": "saturation", "lightness": "lightness"}
_CODE = re.compile(r"(?<![A-Za-z0-9])B(?:and)?[ _-]?(8A|\d{1,2})(?![A-Za-z0-9])", re.IGNORECASE)


@dataclass(frozen=True)
class BandWords:
    """What a file says of one band."""

    description: str | None
    colour: str
    tags: Mapping[str, str]


def sensor_family(sensor: str | None) -> str | None:
    """``sentinel-2`` or ``landsat`` for the sensors whose bands are known by name."""
    name = (sensor or "").lower()
    if name.startswith("sentinel-2"):
        return "sentinel-2"
    return "landsat" if name.startswith("landsat") else None


def band_code(text: str, family: str | None) -> str | None:
    """``B02``, ``B8A`` (Sentinel-2) or ``B2`` (Landsat) if the text names a band so."""
    found = _CODE.search(text)
    if found is None:
        return None
    digits = found.group(1).upper()
    if family == "landsat":
        return f"B{int(digits)}" if digits.isdecimal() else None
    if family == "sentinel-2":
        return "B8A" if digits == "8A" else f"B{int(digits):02d}"
    return f"B{digits}"


def describe_bands(words: Sequence[BandWords], sensor: str | None) -> list[RasterBand]:
    """Name, role and centre of every band; alpha bands among them.

    The description goes first, then the colour interpretation.  A band of which nothing is said is called by its
    number: ``band3``.
    """
    family = sensor_family(sensor)
    bands = []
    for number, word in enumerate(words, start=1):
        text = (word.description or "").strip()
        code = band_code(text, family)
        role, centre = _known(code, family)
        plain = re.sub(r"[_\s]+", " ", _CODE.sub("", text)).strip(" ()-:,").lower()
        role = role or _WORDS.get(text.lower()) or _WORDS.get(plain) or _COLOURS.get(word.colour)
        name = code or text or role or f"band{number}"
        bands.append(RasterBand(name, word.description, _centre(word.tags) or centre, role=role))
    return _distinct(bands)


def _known(code: str | None, family: str | None) -> tuple[str | None, float | None]:
    if family == "sentinel-2":
        return SENTINEL2_ROLES.get(code or ""), None
    if family == "landsat":
        return LANDSAT_BANDS.get(code or "", (None, None))
    return None, None


def _centre(tags: Mapping[str, str]) -> float | None:
    """Centre [nm] from the tags that GDAL (IMAGERY domain) and ENVI files have."""
    micrometres = finite_number(tags.get("CENTRAL_WAVELENGTH_UM"))
    if micrometres is not None:
        return 1000.0 * micrometres
    centre = finite_number(tags.get("wavelength"))
    unit = tags.get("wavelength_units", "").lower()
    if centre is None or not unit:
        return None
    return {"nanometers": 1.0, "nm": 1.0, "micrometers": 1000.0, "um": 1000.0}.get(unit, float("nan")) * centre


def _distinct(bands: list[RasterBand]) -> list[RasterBand]:
    """Bands of the same name get their number behind it."""
    names = [band.name for band in bands]
    return [
        replace(band, name=f"{band.name}-{number}") if names.count(band.name) > 1 else band
        for number, band in enumerate(bands, start=1)
    ]


def choose_bands(bands: Sequence[RasterBand], wanted: Sequence[str] | None) -> list[tuple[int, RasterBand]]:
    """Place in the file (from 0) and description of the wanted bands.

    Parameters
    ----------
    bands : sequence of RasterBand
        All that there are.
    wanted : sequence of str, optional
        Names, roles or numbers from 1 of the bands to take, in that order; or ``name=number``, which says what a band
        is called: ``red=3``.  One name for each band of a file that names none of them says what all are called.  All
        bands but alpha if not given.
    """
    if wanted is None:
        return [(place, band) for place, band in enumerate(bands) if band.role != "alpha"]
    chosen: list[tuple[int, RasterBand]] = []
    if _names_of_all(bands, wanted):
        wanted = [f"{name}={number}" for number, name in enumerate(wanted, 1)]
    for word in wanted:
        name, equals, number = (part.strip() for part in word.partition("="))
        key = number if equals else name
        if key.isdecimal():
            if not 1 <= int(key) <= len(bands):
                raise DomainError("bands", word, f"bands are numbered from 1 to {len(bands)} here")
            place = int(key) - 1
        else:
            place = find_band(bands, key)
        band = bands[place]
        if equals:
            band = replace(band, name=name, role=_WORDS.get(name.lower(), band.role))
        if band.role == "alpha":
            raise DomainError("bands", word, "the alpha band is a mask and is kept as it is; leave it out")
        if any(place == other for other, _ in chosen):
            raise DomainError("bands", word, "is named twice; give each band once")
        chosen.append((place, band))
    if not chosen:
        raise DomainError("bands", "", "name at least one band")
    return chosen


def _names_of_all(bands: Sequence[RasterBand], words: Sequence[str]) -> bool:
    """Whether words are new names for all bands, in order, of a file that says nothing of them."""
    silent = all(band.description is None and band.wavelength_nm is None for band in bands)
    known = {band.name.lower() for band in bands} | {band.role for band in bands}
    new = all(not word.isdecimal() and "=" not in word and word.lower() not in known for word in words)
    return silent and new and len(words) == len(bands)
