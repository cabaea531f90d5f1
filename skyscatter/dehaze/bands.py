"""Sensors: which bands a satellite or a camera has, where their responses come from, and which band of a file is which.

Landsat 8 and 9 carry NASA's measured band averages.  The curves of Sentinel-2 are ESA's and may not be shipped here;
their published centres and widths stand in, as shapes that are flagged ``approximate`` (see `passband.SHAPE_EXPONENT`
for what that costs).  The camera is nobody's in particular.  Whoever has a better curve gives it as a table
(`Sensor.from_csv`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from skyscatter.datafiles import read_table
from skyscatter.dehaze.bandnames import find_band
from skyscatter.dehaze.passband import Band, Role
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.record import Record

__all__ = ["Band", "Role", "Sensor", "load_sensor", "sensor_names"]

_LANDSAT_ROLES: tuple[Role, ...] = (
    "coastal", "blue", "green", "red", "nir", "swir1", "swir2", "pan", "cirrus",
)  # fmt: skip
_LANDSAT = {"landsat-8": "bands/landsat_8_oli.csv", "landsat-9": "bands/landsat_9_oli2.csv"}
_LANDSAT_NOTE = "band average measured by Ball Aerospace for NASA, public domain"

_MSI_NAMES = ("B01", "B02", "B03", "B04", "B05", "B06", "B07", "B08", "B8A", "B09", "B10", "B11", "B12")
_MSI_ROLES: tuple[Role, ...] = (
    "coastal", "blue", "green", "red", "rededge", "rededge", "rededge", "nir", "nir-narrow", "water-vapour", "cirrus",
    "swir1", "swir2",
)  # fmt: skip
_MSI_NOTE = "shape from the central wavelength and bandwidth that ESA gives in the Sentinel-2 MSI User Guide"
#: Central wavelengths and bandwidths [nm] of the Sentinel-2 MSI User Guide (ESA), spatial and spectral resolution.
_MSI = {
    "sentinel-2a": (
        (442.7, 21), (492.4, 66), (559.8, 36), (664.6, 31), (704.1, 15), (740.5, 15), (782.8, 20), (832.8, 106),
        (864.7, 21), (945.1, 20), (1373.5, 31), (1613.7, 91), (2202.4, 175),
    ),
    "sentinel-2b": (
        (442.2, 21), (492.1, 66), (559.0, 36), (664.9, 31), (703.8, 16), (739.1, 15), (779.7, 20), (832.9, 106),
        (864.0, 22), (943.2, 21), (1376.9, 30), (1610.4, 94), (2185.7, 185),
    ),
}  # fmt: skip

#: Centre and full width at half maximum [nm] of Gaussians: rounded from where the sensitivities of colour cameras
#: lie (Jiang et al. 2013, IEEE Workshop on Applications of Computer Vision, 168: 28 cameras); single cameras are off by
#: 10 to 20 nm, and the matrix from their colours to sRGB moves the centres again.
_CAMERA: dict[str, tuple[float, float, Role]] = {
    "red": (600.0, 80.0, "red"),
    "green": (545.0, 95.0, "green"),
    "blue": (465.0, 80.0, "blue"),
}
_CAMERA_NOTE = "typical colour camera, a Gaussian; single cameras differ by 10 to 20 nm"

_OTHER_NAMES = {
    "s2a": "sentinel-2a", "s2b": "sentinel-2b", "sentinel2a": "sentinel-2a", "sentinel2b": "sentinel-2b",
    "landsat-8-oli": "landsat-8", "landsat-9-oli-2": "landsat-9", "landsat8": "landsat-8", "landsat9": "landsat-9",
    "landsat_8": "landsat-8", "landsat_9": "landsat-9", "srgb": "srgb-camera", "camera": "srgb-camera",
}  # fmt: skip


class Sensor(Record):
    """The bands of one instrument.

    Parameters
    ----------
    name : str
    bands : tuple of Band
        Of different names, in the instrument's order.

    Examples
    --------
    Which bands of Sentinel-2A the layers of a file are, by what it calls them:

    >>> from skyscatter.dehaze import Sensor, load_sensor
    >>> sensor = load_sensor("sentinel-2a")
    >>> [band.name for band in sensor.match(["B02", "665 nm", "near infrared"])]
    ['B02', 'B04', 'B08']

    A camera of one's own, by centre and width of its bands [nm]:

    >>> own = Sensor.from_shapes("drone", {"green": (560, 40), "nir": (840, 100)})
    >>> [band.role for band in own.bands]
    ['green', 'nir']
    """

    name: str = Field(min_length=1)
    bands: tuple[Band, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _check(self) -> Self:
        names = [band.name for band in self.bands]
        for name in names:
            if names.count(name) > 1:
                raise DomainError("bands", name, "two bands of one name; rename one")
        return self

    @classmethod
    def from_shapes(cls, name: str, bands: Mapping[str, tuple[float, float]]) -> Self:
        """Sensor of which centre and full width at half maximum [nm] of every band are known: approximate bands."""
        return cls(name=name, bands=tuple(Band.from_shape(band, *numbers) for band, numbers in bands.items()))

    @classmethod
    def from_csv(cls, path: str | Path) -> Self:
        """Sensor from a table of the user's own, named after the file.

        The header line reads ``wavelength_nm`` and one name for each band; wavelengths increase; responses are per
        energy and not negative; lines that start with ``#`` are remarks.

        Raises
        ------
        MissingDataError
            If the file cannot be read, or is no such table.
        """
        path = Path(path)
        header, rows = read_csv(path)
        try:
            table = np.array([[float(cell) for cell in row] for row in rows], dtype=float)
            if table.ndim != 2 or not np.all(np.isfinite(table)):
                raise ValueError("rows of finite numbers")
            columns = zip(header[1:], table.T[1:], strict=True)
            note = f"table {path.name}"
            return cls(name=path.stem, bands=tuple(Band.from_table(n, table[:, 0], c, note=note) for n, c in columns))
        except ValueError as error:  # of float, of numpy and of the records' own checks
            problem = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
            raise MissingDataError(path, f"not a table of band responses over wavelength ({problem})") from error

    def band(self, name: str) -> Band:
        """The band of that name.

        Raises
        ------
        DomainError
            If there is none.
        """
        for band in self.bands:
            if band.name == name:
                return band
        raise DomainError("band", name, f"{self.name} has {', '.join(band.name for band in self.bands)}")

    def with_role(self, role: Role) -> tuple[Band, ...]:
        """The bands of that role, in order."""
        return tuple(band for band in self.bands if band.role == role)

    def match(
        self, names: Sequence[str | None], colours: Sequence[str | None] | None = None
    ) -> tuple[Band | None, ...]:
        """Which band each band of a file is, by what the file says of it and never by its position.

        Parameters
        ----------
        names : sequence of str or None
            Names or descriptions: ``"B2"``, ``"B02"``, ``"band 2"``, ``"SR_B2"``, ``"..._B02_10m.jp2"``,
            ``"B4, central wavelength 665 nm"``, ``"blue"``, ``"near infrared"``, ``"rededge2"``, ``"665 nm"``.
        colours : sequence of str or None, optional
            Colour interpretations (``"red"``, ``"green"``, ``"blue"``, ``"nir"``; all else says nothing): used where
            the name tells nothing.

        Returns
        -------
        tuple of Band or None
            None where neither name nor colour says which band it is (masks, quality layers).

        Raises
        ------
        DomainError
            If two bands of the file claim to be the same, or name and colour contradict each other.
        """
        said = tuple(colours) if colours is not None else (None,) * len(names)
        if len(said) != len(names):
            raise DomainError("colours", len(said), f"one for each of the {len(names)} names")
        found = tuple(self._one(name, colour) for name, colour in zip(names, said, strict=True))
        for i, band in enumerate(found):
            if band is not None and band in found[:i]:
                both = f"{names[found.index(band)]!r} and {names[i]!r}"
                raise DomainError("bands", both, f"both are {band.name} of {self.name}; name the bands explicitly")
        return found

    def _one(self, name: str | None, colour: str | None) -> Band | None:
        by_name = find_band(self.bands, name) if name else None
        by_colour = find_band(self.bands, colour) if colour in {"red", "green", "blue", "nir"} else None
        if by_name is not None and by_colour is not None and by_name != by_colour:
            rule = f"its colour interpretation says {by_colour.name} of {self.name}; name the bands explicitly"
            raise DomainError("band", name, rule)
        return by_name or by_colour


def sensor_names() -> tuple[str, ...]:
    """Names that `load_sensor` knows.

    Returns
    -------
    tuple of str

    Examples
    --------
    Centres of the red bands [nm]:

    >>> from skyscatter.dehaze import load_sensor, sensor_names
    >>> {name: round(load_sensor(name).with_role("red")[0].centre_nm) for name in sensor_names()}
    {'sentinel-2a': 665, 'sentinel-2b': 665, 'landsat-8': 655, 'landsat-9': 654, 'srgb-camera': 600}
    """
    return (*_MSI, *_LANDSAT, "srgb-camera")


@lru_cache(maxsize=16)
def load_sensor(name: str) -> Sensor:
    """A sensor by its name (``"sentinel-2a"``, ``"landsat-9"``, ``"srgb-camera"``; also ``"S2A"`` and the like).

    Parameters
    ----------
    name : str
        One of `sensor_names`, or another spelling of it.

    Returns
    -------
    Sensor

    Raises
    ------
    DomainError
        For an unknown name.

    Examples
    --------
    >>> from skyscatter.dehaze import load_sensor
    >>> sensor = load_sensor("S2A")
    >>> sensor.name, len(sensor.bands), sensor.band("B04").centre_nm  # nm
    ('sentinel-2a', 13, 664.6)
    >>> [band.name for band in sensor.with_role("rededge")]
    ['B05', 'B06', 'B07']
    """
    key = name.strip().lower().replace(" ", "-")
    key = _OTHER_NAMES.get(key, key)
    if key in _MSI:
        rows = zip(_MSI_NAMES, _MSI[key], _MSI_ROLES, strict=True)
        return Sensor(name=key, bands=tuple(Band.from_shape(n, c, w, role, note=_MSI_NOTE) for n, (c, w), role in rows))
    if key in _LANDSAT:
        table = read_table(_LANDSAT[key])
        wl = table["wavelength_nm"]
        bands = (
            Band.from_table(f"B{i + 1}", wl, table[f"B{i + 1}"], role, note=_LANDSAT_NOTE)
            for i, role in enumerate(_LANDSAT_ROLES)
        )
        return Sensor(name=key, bands=tuple(bands))
    if key == "srgb-camera":
        shapes = (
            Band.from_shape(n, centre, width, role, exponent=2.0, note=_CAMERA_NOTE)
            for n, (centre, width, role) in _CAMERA.items()
        )
        return Sensor(name=key, bands=tuple(shapes))
    raise DomainError("sensor", name, f"there are {', '.join(sensor_names())}; give others as a table of responses")


def read_csv(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table of responses."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise MissingDataError(path, f"cannot be read as text ({error.__class__.__name__}); check the path") from error
    lines = [line.split(",") for line in text.splitlines() if line.strip() and not line.startswith("#")]
    header = [cell.strip() for cell in lines[0]] if lines else []
    if len(header) < 2 or header[0] != "wavelength_nm" or not all(header):
        raise MissingDataError(path, "needs the header wavelength_nm and one name for each band, split by commas")
    for row in lines[1:]:
        if len(row) != len(header):
            raise MissingDataError(path, f"a row of {len(row)} cells under {len(header)} names; give one for each")
    return header, lines[1:]
