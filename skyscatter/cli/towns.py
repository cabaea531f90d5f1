"""Options of ``skyscatter sky`` for the lights of towns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skyscatter.errors import DomainError, SkyscatterError, UnitsError
from skyscatter.units import ANGLE, LENGTH, LUMENS, POWER

if TYPE_CHECKING:
    from skyscatter.models.sky import Model
    from skyscatter.surfaces.townmap import AnyTown

DEFAULT_LAMP = "high-pressure-sodium"
_PEOPLE = "people"
_REMEDY = (
    "give LAT,LON,POWER[,RADIUS][,LAMP] or DISTANCE,AZIMUTH,POWER[,RADIUS][,LAMP], such as 48.14,11.58,1.5e6people,10km"
)

Towns = Annotated[
    list[str] | None,
    typer.Option(
        "--town",
        metavar="LAT,LON,POWER[,RADIUS][,LAMP]",
        help="A town whose lamps the air is lit by: its middle in degrees, with --place, or as distance and azimuth "
        "from the observer, 20km,135,...; the light that leaves it upwards, 1.4e8lm or 400kW, or its inhabitants, "
        f"100000people (1000 lm each, 28 % of it upwards); its radius, else 1km; its lamps, else {DEFAULT_LAMP}. "
        "May be repeated.",
    ),
]
TownMaps = Annotated[
    list[str] | None,
    typer.Option(
        "--town-map",
        metavar="FILE[,LAMP]",
        help="A GeoTIFF of the radiance that satellites see at night, in nW cm-2 sr-1 (VIIRS), with --place: each "
        "pixel within 300 km is a source. Needs rasterio. May be repeated.",
    ),
]


def asked_towns(towns: list[str] | None, maps: list[str] | None, on_earth: bool) -> tuple[AnyTown, ...]:
    """The towns and maps of a command; `on_earth` says whether it has a place."""
    found: list[Any] = [parse_town(text, on_earth) for text in towns or ()]
    found += [parse_map(text, on_earth) for text in maps or ()]
    return tuple(found)


def with_towns(model: Model, towns: tuple[AnyTown, ...], lights: tuple[str, ...] | None) -> Model:
    """A model with these towns beside its own; `lights` are those that were asked for by name."""
    if lights is not None and towns and "towns" not in lights:
        raise DomainError("town", towns[0].name, "--lights leaves towns out; add towns to that list")
    if lights is not None and "towns" in lights and not (towns or model.towns):
        raise DomainError("lights", "towns", "there are none; give --town or --town-map, or a model with towns")
    return model.model_copy(update={"towns": (*(model.towns or ()), *towns)}) if towns else model


def parse_town(text: str, on_earth: bool) -> AnyTown:
    """A town by the text of its option."""
    from skyscatter.surfaces.towns import Town

    words = [word.strip() for word in text.split(",")]
    if not 3 <= len(words) <= 5 or not all(words):
        raise DomainError("town", text, _REMEDY)
    rest = words[3:]
    fields: dict[str, Any] = {"name": text, "spectrum": _lamp(rest)}
    if rest:
        fields["radius"] = _read(LENGTH, rest[0], text)
    if len(rest) > 1:
        raise DomainError("town", text, _REMEDY)
    if _is_number(words[0]):
        if not on_earth:
            rule = "latitude and longitude need --place and --time; or give distance and azimuth: 20km,135,..."
            raise DomainError("town", text, rule)
        fields |= {"latitude_deg": _read(ANGLE, words[0], text), "longitude_deg": _read(ANGLE, words[1], text)}
    else:
        fields |= {"distance": _read(LENGTH, words[0], text), "azimuth_deg": _read(ANGLE, words[1], text)}
    try:
        return _shining(Town, words[2], text, fields)
    except ValueError as error:
        if isinstance(error, SkyscatterError):
            raise
        raise DomainError("town", text, f"{_first(error)}; {_REMEDY}") from error


def _shining(cls: Any, power: str, text: str, fields: dict[str, Any]) -> AnyTown:
    """The town with its power as it is given."""
    town: AnyTown
    if power.endswith(_PEOPLE) and _is_number(power.removesuffix(_PEOPLE)):
        town = cls.of_people(float(power.removesuffix(_PEOPLE)), **fields)
    elif power.endswith("lm"):
        town = cls(lumens=_read(LUMENS, power, text), **fields)
    elif power.endswith("W"):
        town = cls(watts=_read(POWER, power, text), **fields)
    else:
        raise DomainError("town", text, f"power {power!r} has no unit; give 1.4e8lm, 400kW or 100000people")
    return town


def parse_map(text: str, on_earth: bool) -> AnyTown:
    """A map by the text of its option."""
    from skyscatter.surfaces.power import lamp_names
    from skyscatter.surfaces.townmap import TownMap

    if not on_earth:
        raise DomainError("town_map", text, "needs --place and --time: the pixels lie at places on Earth")
    file, comma, lamp = text.rpartition(",")
    if not comma or lamp.strip() not in lamp_names():
        file, lamp = text, DEFAULT_LAMP
    if not Path(file).is_file():
        raise DomainError("town_map", file, "there is no such file; check the path, and the lamp after a comma")
    return TownMap(name=file, file=str(Path(file).resolve()), spectrum=lamp.strip())


def _lamp(words: list[str]) -> str:
    """The lamp at the end of some words, which is taken from them."""
    from skyscatter.record import nearest
    from skyscatter.surfaces.power import lamp_names

    if not words or words[-1][0].isdigit() or words[-1][0] == ".":
        return DEFAULT_LAMP
    if words[-1] not in lamp_names():
        raise DomainError("town", words[-1], f"no such lamp; {nearest(words[-1], lamp_names())}")
    return words.pop()


def _read(measure: Any, word: str, text: str) -> float:
    try:
        return float(measure.read(word, "town"))
    except UnitsError as error:
        raise DomainError("town", text, f"{word!r} is no {measure.noun}; {_REMEDY}") from error


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _first(error: Exception) -> str:
    """What a complaint of pydantic says first."""
    from pydantic import ValidationError

    return str(error.errors()[0]["msg"] if isinstance(error, ValidationError) else error).splitlines()[0]
