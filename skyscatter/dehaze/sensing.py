"""Which bands of an image can be corrected, as what, and what gases take from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.bands import Band, load_sensor, sensor_names
from skyscatter.dehaze.forward import DIFFUSE, DIRECT, PATH, STANDARD_PRESSURE
from skyscatter.dehaze.gases import gas_transmittance
from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.errors import DomainError

Array = NDArray[np.float64]

#: Columns of the US Standard Atmosphere 1976's ozone [DU] and of its water vapour [g cm-2], where nobody knows better.
OZONE_DU, WATER_VAPOUR = 344.0, 1.42
#: Relative standard deviations of those columns as guesses: ozone varies by a tenth, water vapour by its half.
OZONE_GUESS, WATER_GUESS = 0.10, 0.5
#: The same where the user gave them.
COLUMN_KNOWN = 0.05
#: Full width at half maximum [nm] that is presumed of a band of which only the centre is known.
PRESUMED_WIDTH = 30.0
#: Bands in which the ground is out of sight, and those that are no good for finding haze.
NO_GROUND = ("cirrus",)
NOT_FOR_HAZE = ("cirrus", "water-vapour", "pan", "other")


@dataclass(frozen=True)
class Sensing:
    """The bands of an image and what is known of them.

    Attributes
    ----------
    bands : tuple of Band
        Those in which the ground is seen.
    places : tuple of int
        Where they are among the bands of the image.
    cirrus : int or None
        Place of the band at 1.38 micrometres.
    factors : ndarray, shape (image band,)
        From what the image holds to reflectance times the cosine of the Sun's zenith angle; None if it is reflectance.
    notes : tuple of str
    """

    bands: tuple[Band, ...]
    places: tuple[int, ...]
    cirrus: int | None
    factors: Array | None
    notes: tuple[str, ...]

    @property
    def for_haze(self) -> list[int]:
        """Among `bands`, those by which haze is judged."""
        chosen = [k for k, band in enumerate(self.bands) if band.role not in NOT_FOR_HAZE]
        return chosen or list(range(len(self.bands)))


def bands_of(source: RasterSource) -> tuple[list[Band], list[str]]:
    """A band with its response for each band of an image.

    Raises
    ------
    DomainError
        If the image does not say which bands it holds.
    """
    notes: list[str] = []
    if source.sensor is not None:
        sensor = _sensor(source)
        said = [" ".join(filter(None, (band.name,))) for band in source.bands]
        found = sensor.match(said, [band.role for band in source.bands])
        for have, band in zip(source.bands, found, strict=True):
            if band is None:
                rule = f"{sensor.name} has {', '.join(b.name for b in sensor.bands)}; name the bands with --bands"
                raise DomainError("bands", have.name, rule)
        bands = [band for band in found if band is not None]
    else:
        bands = []
        for have in source.bands:
            if have.wavelength_nm is None:
                rule = f"{source.name} does not say which sensor took it; give --sensor, or names of bands like 665 nm"
                raise DomainError("sensor", None, rule)
            bands.append(Band.from_shape(have.name, have.wavelength_nm, PRESUMED_WIDTH))
        notes.append(f"no sensor is named: bands are taken as {PRESUMED_WIDTH:g} nm wide")
    approximate = [band.name for band in bands if band.approximate]
    if approximate:
        notes.append(f"responses of {', '.join(approximate)} are shapes from their centres and widths")
    return bands, notes


def _sensor(source: RasterSource) -> Any:
    """The sensor of a source; by the product's own responses where it carries them."""
    responses = getattr(source, "responses", None)
    if responses is not None:
        return responses
    name = str(source.sensor).strip().lower()
    if name.startswith("sentinel-2") and name not in sensor_names():
        # A product names its unit itself; of other rasters the user does.
        rule = "its responses are not shipped: use the SAFE product, whose MTD_MSIL1C.xml lists them"
        if not hasattr(source, "responses"):
            rule += ", or name a unit with nearly the same bands, sentinel-2a or sentinel-2b"
        else:
            rule += "; this one's does not, get it again"
        raise DomainError("sensor", name, rule)
    return load_sensor(name)


def sense(source: RasterSource) -> Sensing:
    """Sort out the bands of an image with a geometry."""
    every, notes = bands_of(source)
    places = [k for k, band in enumerate(every) if band.role not in NO_GROUND]
    if not places:
        raise DomainError("bands", ", ".join(b.name for b in source.bands), "the ground is seen in none of them")
    cirrus = next((k for k, band in enumerate(every) if band.role == "cirrus"), None)
    if cirrus is not None:
        notes.append(f"{source.bands[cirrus].name} shows no ground and is passed on as it is")
    factors = None
    if source.quantity == "radiance":
        distance = sun_distance(source, notes)
        # Radiance is per micrometre, the irradiance of a band per nanometre.
        factors = np.array([np.pi * distance**2 / (1e3 * band.solar_irradiance) for band in every])
    return Sensing(tuple(every[k] for k in places), tuple(places), cirrus, factors, tuple(notes))


def sun_distance(source: RasterSource, notes: list[str]) -> float:
    """Distance of the Sun [au] on the day of the image; 1 with a remark where the day is unknown."""
    if source.sun_distance_au is not None:
        return source.sun_distance_au
    if source.acquired is None:
        notes.append("the date is unknown: the Sun is taken to be 1 au away (off by up to 1.7 %, radiance only)")
        return 1.0
    day = source.acquired.timetuple().tm_yday
    # Eccentricity 0.0167, perihelion on 4 January: within 0.0003 au.
    return float(1 - 0.0167 * np.cos(2 * np.pi * (day - 4) / 365.25))


@dataclass(frozen=True)
class Gases:
    """Two-way transmittances on a grid of places, and how far they may be wrong.

    Attributes
    ----------
    above : ndarray, shape (place, band)
        Of ozone and mixed gases, over everything that scatters.
    water, half : ndarray, shape (place, band)
        Of water vapour on the way to the ground and back, and of half of it.
    relative : ndarray, shape (band,)
        Standard deviation of their product, relative.
    """

    above: Array
    water: Array
    half: Array
    relative: Array


def usual_water(pressure_hpa: float) -> float:
    """Column of water vapour above ground of that pressure [g cm-2]: its scale height is a quarter of the air's."""
    return WATER_VAPOUR * (pressure_hpa / STANDARD_PRESSURE) ** 4


def gases(
    bands: Sequence[Band],
    sun_zenith: Array,
    view_zenith: Array,
    pressure_hpa: float,
    ozone_du: float | None = None,
    water_vapour: float | None = None,
) -> Gases:
    """What gases leave of the light, at places (place,)."""
    ozone = OZONE_DU if ozone_du is None else ozone_du
    water = usual_water(pressure_hpa) if water_vapour is None else water_vapour
    doubts = (
        (OZONE_GUESS if ozone_du is None else COLUMN_KNOWN) * ozone,
        (WATER_GUESS if water_vapour is None else COLUMN_KNOWN) * water,
    )
    count = len(bands)
    above, through, half = (np.empty((sun_zenith.size, count)) for _ in range(3))
    relative = np.empty(count)
    middle = (float(np.median(sun_zenith)), float(np.median(view_zenith)))
    for k, band in enumerate(bands):
        found = gas_transmittance(
            band, sun_zenith, view_zenith, ozone_du=ozone, water_vapour=water, pressure_hpa=pressure_hpa
        )
        above[:, k], through[:, k], half[:, k] = found.ozone * found.other, found.water, found.water_half
        usual = gas_transmittance(band, *middle, ozone_du=ozone, water_vapour=water, pressure_hpa=pressure_hpa).total
        more = [
            gas_transmittance(band, *middle, ozone_du=o, water_vapour=w, pressure_hpa=pressure_hpa).total
            for o, w in ((ozone + doubts[0], water), (ozone, water + doubts[1]))
        ]
        relative[k] = np.sqrt(sum(float(m / usual - 1) ** 2 for m in more))
    return Gases(above, through, half, relative)


def with_water(terms: Sequence[Array], gas: Gases) -> list[Array]:
    """Terms (place, ..., band, term), or slopes of them, with the water vapour at those places in them.

    Light that the air scatters has crossed half of the water vapour, light from the ground all of it.
    """
    out = []
    for values in terms:
        between = (len(gas.half), *(1 for _ in values.shape[1:-2]), -1)
        scaled = values.copy()
        scaled[..., PATH] *= gas.half.reshape(between)
        scaled[..., DIRECT] *= gas.water.reshape(between)
        scaled[..., DIFFUSE] *= gas.water.reshape(between)
        out.append(scaled)
    return out
