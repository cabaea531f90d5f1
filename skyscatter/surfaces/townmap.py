"""A map of light as satellites see it at night: each of its pixels is a source of light on the ground."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.record import Record
from skyscatter.spectra.table import LampSpectrum, SpectralTable
from skyscatter.surfaces.lobes import AnyLobe, CityLobe
from skyscatter.surfaces.power import lamp_spectrum
from skyscatter.surfaces.towns import Town, check_lobe
from skyscatter.units import NonNegative, PositiveMetres, default

Array = NDArray[np.float64]

#: W m-2 sr-1 of 1 nW cm-2 sr-1, the unit of such maps.
NANOWATT = 1e-5
#: Ends of the band of the VIIRS day/night band [nm]: Miller et al. (2013), Remote Sensing 5, 6717, table 1.
BAND = 500.0, 900.0
#: Metres in a degree of a great circle on the Earth, by which a part of a map is chosen; a little too many.
DEGREE = 111_700.0


class TownMap(Record):
    """A GeoTIFF of the radiance at night as satellites see it from above, such as the annual composites of VIIRS.

    A pixel of radiance L and area A sends the intensity L A straight up; with the `lobe` this is its power in the
    satellite's band, 500 to 900 nm, and with the `spectrum` that at every wavelength.  The composites are as seen
    through the air, of which a tenth to a third may be missing: see `factor`.  For scenes of a place on Earth.

    Parameters
    ----------
    name : str
        How lists and errors call it.
    file : str
        GeoTIFF of radiances [nW cm-2 sr-1]; in a model file the path counts from its folder.  Negative ones and those
        without data are dark.  Needs rasterio.
    spectrum : SpectralTable or str
        Shape of the spectrum of all pixels: a table in any unit per nm, or the name of a shipped one.
    lobe : lobe
        How the light is spread over zenith angles, by kind; Garstang's city when not given.
    factor : float
        By which all radiances are multiplied.
    reach : length
        Pixels that are further away from the observer are left out [m].

    Examples
    --------
    >>> from skyscatter.surfaces import TownMap
    >>> lights = TownMap(file="VNL_2023.tif", spectrum="led-4000k", factor=1.2)
    >>> lights.reach / 1e3  # km
    300.0
    """

    kind: Literal["map"] = "map"
    name: str = "map"
    file: str
    spectrum: LampSpectrum = default("high-pressure-sodium")
    lobe: AnyLobe = CityLobe()
    factor: NonNegative = default(1.0)
    reach: PositiveMetres = default(300e3)

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_lobe(self.lobe)
        if not self.share_of_band > 0:
            raise DomainError("spectrum", str(self.spectrum), "is dark from 500 to 900 nm, where the satellite looks")
        if not self.lobe.value(1.0) > 0:
            raise DomainError("lobe", self.lobe.kind, "sends nothing straight up, where the satellite is; take another")
        return self

    @property
    def on_earth(self) -> bool:
        """Its places are given by latitude and longitude."""
        return True

    @property
    def spectrum_table(self) -> SpectralTable:
        """The spectrum of all pixels, in any unit per nm."""
        spectrum = self.spectrum
        return spectrum if isinstance(spectrum, SpectralTable) else lamp_spectrum(str(spectrum))

    @property
    def share_of_band(self) -> float:
        """Share of the light that the satellite sees, in its band."""
        table = self.spectrum_table
        nodes, values = np.asarray(table.wavelengths), np.asarray(table.values)
        ends = np.clip(BAND, nodes[0], nodes[-1])
        inside = np.union1d(nodes[(nodes > ends[0]) & (nodes < ends[1])], ends)
        seen = np.interp(inside, nodes, values)
        return float(np.trapezoid(seen, inside) / np.trapezoid(values, nodes))

    def read(self, latitude_deg: float, longitude_deg: float, planet_radius: float) -> tuple[Array, Array, Array]:
        """The pixels that shine near a place.

        Parameters
        ----------
        latitude_deg, longitude_deg : float
            Of the observer [degree].
        planet_radius : float
            [m]

        Returns
        -------
        latitude, longitude : ndarray, shape (pixel,)
            Of their middles [degree].
        watts : ndarray, shape (pixel,)
            Power of each, at all wavelengths and in all directions together.

        Raises
        ------
        SkyscatterError
            Where rasterio is missing, and for files that are no maps.
        """
        radiance, latitude, longitude, area = _near(self.file, latitude_deg, longitude_deg, self.reach, planet_radius)
        watts = NANOWATT * self.factor * radiance * area / float(self.lobe.value(1.0)) / self.share_of_band
        near = np.isfinite(watts) & (watts > 0)
        own, other = np.radians(latitude_deg), np.radians(latitude)
        turn = np.radians(longitude - longitude_deg)
        cosine = np.sin(own) * np.sin(other) + np.cos(own) * np.cos(other) * np.cos(turn)
        near &= planet_radius * np.arccos(np.clip(cosine, -1.0, 1.0)) <= self.reach
        return latitude[near], longitude[near], watts[near]


def _near(file: str, latitude: float, longitude: float, reach: float, radius: float) -> tuple[Array, ...]:
    """Radiances, latitudes, longitudes [degree] and areas [m2] of the pixels of a file around a place."""
    try:
        import rasterio
    except ImportError as error:
        raise SkyscatterError("rasterio is not installed: pip install rasterio") from error
    from rasterio.warp import transform

    if not Path(file).is_file():
        raise DomainError("file", file, "there is no such file; check the path")
    try:
        with rasterio.open(file) as dataset:
            if dataset.crs is None:
                raise DomainError("file", file, "says not where it lies; give a GeoTIFF with a coordinate system")
            window = _window(dataset, latitude, longitude, reach)
            values = dataset.read(1, window=window, masked=True).astype(float).filled(np.nan)
            row, column = np.nonzero(values > 0)
            shift = dataset.transform
            x, y = _places(shift, column + window.col_off, row + window.row_off)
            area = np.full(x.shape, abs(shift.a * shift.e - shift.b * shift.d))
            if dataset.crs.is_geographic:
                return values[row, column], y, x, area * np.radians(1.0) ** 2 * radius**2 * np.cos(np.radians(y))
            east, north = (np.array(v) for v in transform(dataset.crs, "EPSG:4326", x, y))
            return values[row, column], north, east, area * dataset.crs.linear_units_factor[1] ** 2
    except rasterio.errors.RasterioError as error:
        raise SkyscatterError(f"{file}: {str(error).splitlines()[0]}; give a GeoTIFF of radiances") from error


def _places(shift: Any, column: Any, row: Any) -> tuple[Array, Array]:
    """Coordinates of the middles of pixels."""
    across, down = column + 0.5, row + 0.5
    return shift.a * across + shift.b * down + shift.c, shift.d * across + shift.e * down + shift.f


def _window(dataset: Any, latitude: float, longitude: float, reach: float) -> Any:
    """The part of a file in which pixels near a place lie; all of it, where that is not plain."""
    from rasterio.windows import Window

    high, shift = reach / DEGREE, dataset.transform
    if not dataset.crs.is_geographic or abs(latitude) + high > 85 or shift.b != 0 or shift.d != 0:
        return Window(0, 0, dataset.width, dataset.height)
    wide = high / np.cos(np.radians(abs(latitude) + high))
    columns, rows = (
        np.clip([np.floor(min(ends)), np.ceil(max(ends))], 0, size).astype(int)
        for ends, size in (
            ([(longitude + side * wide - shift.c) / shift.a for side in (-1, 1)], dataset.width),
            ([(latitude + side * high - shift.f) / shift.e for side in (-1, 1)], dataset.height),
        )
    )
    if columns[0] == columns[1] or rows[0] == rows[1]:
        rule = f"does not reach {latitude:g}, {longitude:g}; take another map"
        raise DomainError("file", dataset.name, rule)
    return Window(int(columns[0]), int(rows[0]), int(np.diff(columns)[0]), int(np.diff(rows)[0]))


AnyTown = Annotated[Town | TownMap, Field(discriminator="kind")]
