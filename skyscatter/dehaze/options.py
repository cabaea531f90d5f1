"""What a user may ask for: how to read an image, and how to take the haze off it."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from skyscatter.dehaze.geometry import MAX_SUN_ZENITH, MAX_VIEW_ZENITH, SceneGeometry
from skyscatter.errors import DomainError
from skyscatter.record import Record, nearest

if TYPE_CHECKING:
    from skyscatter.dehaze.rasters.base import RasterSource

#: Options that only one of the two entrances has.
PHYSICAL = (
    "aod", "aod_sigma", "aod_map",
    "aerosol", "pressure_hpa", "ground_height_m", "ozone_du", "water_vapour_g_cm2", "pixel_size_m", "adjacency",
)  # fmt: skip
PLAIN = ("strength", "alpha", "transfer")
#: Above this the ground has left no trace in the light: exp(-5) of it arrives directly.
MAX_AOD = 5.0
#: A depth and its standard deviation.
_WITH_ERROR = re.compile(r"\s*([^±+]+?)\s*(?:±|\+/?-)\s*([^±+]+?)\s*")


def _bounded(name: str, low: float, high: float, unit: str) -> BeforeValidator:
    """Refuse what is not a number from low to high, with one line that says what would do."""

    def check(value: Any) -> Any:
        if value is None or value == "auto":
            return value
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = float("nan")
        if isinstance(value, bool) or not low <= number <= high:
            raise DomainError(name, value, f"give a number from {low:g} to {high:g}{unit}")
        return number

    return BeforeValidator(check)


def _number(name: str, low: float, high: float, unit: str = "") -> Any:
    return Annotated[float | None, _bounded(name, low, high, unit)]


def _automatic(name: str, low: float, high: float) -> Any:
    return Annotated[float | Literal["auto"], _bounded(name, low, high, ", or auto")]


class SourceOptions(Record):
    """How to read an image; None leaves a matter to its files.

    Parameters
    ----------
    sensor : str, optional
        ``sentinel-2a``, ``landsat-8``, ...: what a plain raster does not say itself.
    bands : tuple of str, optional
        Names, roles or numbers from 1 of the bands to take; ``red=3`` names a band.
    quantity : {'reflectance', 'radiance', 'display'}, optional
        What the numbers are once scale and offset are applied.
    scale, offset : float, optional
        value = scale * number + offset, in place of what the file says.
    sun_zenith_deg, view_zenith_deg, sun_azimuth_deg, view_azimuth_deg, relative_azimuth_deg : float, optional
        In place of the angles in the metadata.  A Sun without a view means nadir.
    resolution : float, optional
        Pixel [m] of the common grid of a Sentinel-2 product: 10, 20 or 60.

    Raises
    ------
    DomainError
        For angles that are missing or out of range, or a scale that is not above 0.

    Examples
    --------
    Angles that a plain raster does not say itself [degree]; relative azimuths are kept between 0 and 180.

    >>> from skyscatter.dehaze import SourceOptions
    >>> reading = SourceOptions(sensor="landsat-8", sun_zenith_deg=40, view_zenith_deg=8, relative_azimuth_deg=200)
    >>> reading.geometry().to_json()
    {'sun_zenith_deg': 40.0, 'view_zenith_deg': 8.0, 'relative_azimuth_deg': 160.0}
    """

    sensor: str | None = None
    bands: tuple[str, ...] | None = None
    quantity: Literal["reflectance", "radiance", "display"] | None = None
    scale: float | None = None
    offset: float | None = None
    sun_zenith_deg: float | None = None
    view_zenith_deg: float | None = None
    sun_azimuth_deg: float | None = None
    view_azimuth_deg: float | None = None
    relative_azimuth_deg: float | None = None
    resolution: float | None = None

    @model_validator(mode="after")
    def _consistent(self) -> SourceOptions:
        if self.scale is not None and not self.scale > 0.0:
            raise DomainError("scale", self.scale, "give a number above 0, such as 1e-4")
        for name in ("sun_azimuth_deg", "view_azimuth_deg", "relative_azimuth_deg"):
            value = getattr(self, name)
            if value is not None and not -360.0 <= value <= 360.0:
                raise DomainError(name, value, "give an angle between -360 and 360 degrees")
        if self.relative_azimuth_deg is not None and self.view_azimuth_deg is not None:
            raise DomainError("relative_azimuth_deg", self.relative_azimuth_deg, "give it or the azimuths, not both")
        self.geometry()
        return self

    def geometry(self) -> SceneGeometry | None:
        """The geometry that the angles say; None if there are none.

        Raises
        ------
        DomainError
            If some of the angles are missing, or out of the model's range.
        """
        if self.sun_zenith_deg is None:
            for name in ("view_zenith_deg", "sun_azimuth_deg", "view_azimuth_deg", "relative_azimuth_deg"):
                if getattr(self, name) is not None:
                    rule = f"needs the Sun as well: give sun_zenith_deg, from 0 to {MAX_SUN_ZENITH:g}"
                    raise DomainError(name, getattr(self, name), rule)
            return None
        view = self.view_zenith_deg or 0.0
        sun_azimuth, view_azimuth, relative = self.sun_azimuth_deg, self.view_azimuth_deg, self.relative_azimuth_deg
        if view > 0.0 and relative is None and (sun_azimuth is None or view_azimuth is None):
            rule = f"a view off nadir (up to {MAX_VIEW_ZENITH:g}) needs relative_azimuth_deg, or both azimuths"
            raise DomainError("view_zenith_deg", view, rule)
        return SceneGeometry.constant(
            self.sun_zenith_deg,
            view,
            relative or 0.0,
            sun_azimuth_deg=sun_azimuth,
            view_azimuth_deg=view_azimuth,
        )


class DehazeOptions(Record):
    """How to take the haze off.

    Parameters
    ----------
    aod : float, str or 'auto'
        Aerosol optical depth at 550 nm, vertical, from 0 to 5; ``"0.25±0.05"`` or ``"0.25+-0.05"`` with its standard
        deviation; the path of a map (``.tif``), as `aod_map`; auto estimates it.
    aod_sigma : float, optional
        Standard deviation of an optical depth that is given, the same over all of the image; of a map beside its own.
    aod_map : str, optional
        GeoTIFF of the optical depth, and in a second band of its standard deviation; it is resampled to the image.
    aerosol : str
        Name of an aerosol model, a file of one's own (``.csv``, ``.toml``: see `ownaerosol.read_aerosol`), or auto.
    pressure_hpa, ground_height_m : float, optional
        Pressure on the ground, or its height above the sea; one of them.
    ozone_du, water_vapour_g_cm2 : float, optional
        Columns of the gases [DU, g cm-2].
    pixel_size_m : float, optional
        Side of a pixel on the ground [m], where the georeference does not say it or is wrong.
    adjacency : bool
        Whether light from the surroundings of a pixel is taken off.
    strength : float
        Of plain pictures: 0 leaves them, 1 takes all of the veil.
    alpha : float or 'auto'
        Of plain pictures: exponent of the veil's colour, wavelength**-alpha, from 0 (grey) to 4 (blue).
    transfer : {'srgb', 'linear', 'gamma'}
        Of plain pictures: from light to numbers; satellite products shown as pictures are straight stretches as a
        rule, pictures of cameras follow sRGB.
    window : int, optional
        Pixels on a side of the windows that an image is worked through in; no influence on the result.
    threads : int, optional
        One per processor if not given.

    Examples
    --------
    An optical depth with its standard deviation may be typed as one word.

    >>> from skyscatter.dehaze import DehazeOptions
    >>> options = DehazeOptions(aod="0.25+-0.05", aerosol="urban")
    >>> options.aod, options.aod_sigma
    (0.25, 0.05)
    >>> DehazeOptions().aod  # estimated from the image
    'auto'
    """

    aod: _automatic("aod", 0.0, MAX_AOD) = "auto"  # type: ignore[valid-type]
    aod_sigma: _number("aod_sigma", 0.0, MAX_AOD) = None  # type: ignore[valid-type]
    aod_map: str | None = None
    aerosol: str = "auto"
    pressure_hpa: _number("pressure_hpa", 300.0, 1100.0, " hPa") = None  # type: ignore[valid-type]
    ground_height_m: _number("ground_height_m", -500.0, 9000.0, " m") = None  # type: ignore[valid-type]
    ozone_du: _number("ozone_du", 0.0, 1000.0, " DU") = None  # type: ignore[valid-type]
    water_vapour_g_cm2: _number("water_vapour_g_cm2", 0.0, 10.0, " g cm-2") = None  # type: ignore[valid-type]
    pixel_size_m: _number("pixel_size_m", 0.01, 1e5, " m") = None  # type: ignore[valid-type]
    adjacency: bool = True
    strength: Annotated[float, _bounded("strength", 0.0, 1.0, "")] = 1.0
    alpha: _automatic("alpha", 0.0, 4.0) = "auto"  # type: ignore[valid-type]
    transfer: Literal["srgb", "linear", "gamma"] = "linear"
    window: int | None = Field(None, ge=16, le=65536)
    threads: int | None = Field(None, ge=1, le=1024)

    @model_validator(mode="before")
    @classmethod
    def _depth(cls, values: Any) -> Any:
        """The optical depth with its deviation, or its map, out of the one option that people type."""
        given = values.get("aod") if isinstance(values, dict) else None
        text = os.fspath(given) if isinstance(given, os.PathLike) else given
        if not isinstance(text, str):
            return values
        if text.lower().endswith((".tif", ".tiff")):
            if values.get("aod_map") is not None:
                raise DomainError("aod_map", values["aod_map"], "aod names a map already; leave one of them out")
            return {**{k: v for k, v in values.items() if k != "aod"}, "aod_map": text}
        parts = _WITH_ERROR.fullmatch(text)
        if parts is None:
            return values
        if values.get("aod_sigma") is not None:
            raise DomainError("aod_sigma", values["aod_sigma"], f"aod = {text} says it already; leave one of them out")
        return {**values, "aod": parts[1], "aod_sigma": parts[2]}

    @model_validator(mode="after")
    def _consistent(self) -> DehazeOptions:
        if self.aod_map is not None and (self.aod != "auto" or self.aerosol == "none"):
            rule = "a map is given with a depth, or with no aerosol; leave one of them out"
            raise DomainError("aod_map", self.aod_map, rule)
        if self.aod_sigma is not None and self.aod == "auto" and self.aod_map is None:
            raise DomainError("aod_sigma", self.aod_sigma, "needs the depth as well, such as aod = '0.25±0.05'")
        if self.pressure_hpa is not None and self.ground_height_m is not None:
            raise DomainError("pressure_hpa", self.pressure_hpa, "give the pressure or the ground's height, not both")
        if self.aerosol not in ("auto", "none"):
            from skyscatter.dehaze.aerosols import aerosol_names, check_aerosol

            check_aerosol(self.aerosol, ("auto", "none", *aerosol_names()))
        if self.aerosol == "none" and self.aod not in ("auto", 0.0):
            raise DomainError("aod", self.aod, "there is no haze where aerosol is none; leave one of them out")
        return self


OptionsT = TypeVar("OptionsT", bound=Record)


def split_options(values: Mapping[str, Any]) -> tuple[SourceOptions, DehazeOptions]:
    """Options given by name in one go, as those of reading and those of dehazing.

    Raises
    ------
    DomainError
        If there is no such option, naming the most similar one.
    """
    known = (*SourceOptions.model_fields, *DehazeOptions.model_fields)
    for name, value in values.items():
        if name not in known:
            raise DomainError(name, value, f"no such option; {nearest(name, known)}")
    return _made(SourceOptions, values), _made(DehazeOptions, values)


def _made(kind: type[OptionsT], values: Mapping[str, Any]) -> OptionsT:
    """Options of a kind, out of those of all kinds; what is wrong with one is said in one line."""
    try:
        return kind(**{key: value for key, value in values.items() if key in kind.model_fields})
    except ValidationError as error:
        problem = error.errors()[0]
        said = problem.get("ctx", {}).get("error")
        if isinstance(said, DomainError):
            raise said from None
        raise DomainError(str(problem["loc"][0]), problem["input"], problem["msg"]) from None


def entrance(source: RasterSource, options: DehazeOptions) -> str:
    """Which of the two entrances an image takes: ``"plain"`` or ``"physical"``.

    Raises
    ------
    DomainError
        If it is reflectance or radiance of a scene whose Sun is unknown, or an option of the other entrance is given.
    """
    plain = source.quantity == "display"
    for name in PHYSICAL if plain else PLAIN:
        if name in options.model_fields_set and getattr(options, name) != type(options).model_fields[name].default:
            what = "a plain picture" if plain else f"an image of {source.quantity}"
            raise DomainError(name, getattr(options, name), f"means nothing to {what}; leave it out")
    if plain:
        return "plain"
    if source.geometry is None:
        rule = f"{source.name} does not say where the Sun was; give sun_zenith_deg, or quantity='display' for a picture"
        raise DomainError("sun_zenith_deg", None, rule)
    return "physical"
