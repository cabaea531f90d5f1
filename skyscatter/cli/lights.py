"""Options of ``skyscatter sky`` for the lights of the night."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from skyscatter.cli import parse
from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from skyscatter.celestial.lights import SkyLights
    from skyscatter.scene import Scene

_NAMES = "sun, moon, planets, stars, starlight, zodiacal, airglow"
#: Elevation of the Sun [degree] below which a picture is centred on something else.
NIGHT_CENTRE = -12.0

Lights = Annotated[
    str | None,
    typer.Option(
        metavar="LIST",
        help=f"What shines, with --place and --time: {_NAMES}; if nothing is said, what matters at that time.",
    ),
]
Without = Annotated[str | None, typer.Option(metavar="LIST", help="Lights to leave out.")]
SolarFlux = Annotated[
    str | None,
    typer.Option(
        metavar="SFU", help="Radio flux of the Sun, 50 to 400, with which the airglow grows; else 100 (moderate)."
    ),
]
Stars = Annotated[
    Path | None, typer.Option(metavar="FILE", help="FITS or CSV table of fainter stars, V of 7 and more.")
]


@dataclass(frozen=True)
class LightChoice:
    """The lights that a command asks for."""

    lights: tuple[str, ...] | None
    without: tuple[str, ...]
    solar_flux: float | None
    stars: Path | None

    def __call__(self, sun_elevation_deg: float, body: str = "Earth") -> SkyLights:
        """The lights of a planet's sky while the Sun stands there."""
        from skyscatter.celestial.lights import SkyLights, chosen, shining

        names = chosen(shining(sun_elevation_deg, body) if self.lights is None else self.lights, "lights")
        names = tuple(name for name in names if name not in chosen(self.without, "without"))
        given: dict[str, Any] = {} if self.solar_flux is None else {"solar_flux": self.solar_flux}
        if self.stars is not None:
            given["catalogue"] = str(self.stars)
        return SkyLights(shine=names, **given)


def light_choice(
    place: str | None, lights: str | None, without: str | None, solar_flux: str | None, stars: Path | None
) -> LightChoice:
    """The choice, checked as far as that goes without a scene."""
    given = {"lights": lights, "without": without, "solar_flux": solar_flux, "stars": stars}
    for name, value in given.items():
        if value is not None and place is None:
            raise DomainError(name, str(value), "needs --place and --time: the sky of a place at a moment")
    flux = parse.parse_positive(solar_flux, "solar_flux")
    if flux is not None and not 50 <= flux <= 400:
        raise DomainError("solar_flux", flux, "give a radio flux of the Sun from 50 to 400")
    if stars is not None and not stars.is_file():
        raise DomainError("stars", str(stars), "there is no such file; check the path")
    return LightChoice(None if lights is None else _names(lights, "lights"), _names(without, "without"), flux, stars)


def _names(text: str | None, field: str) -> tuple[str, ...]:
    from skyscatter.celestial.lights import chosen

    return chosen([word.strip() for word in text.split(",") if word.strip()], field) if text else ()


def centre_of(scene: Scene) -> float:
    """Azimuth [degree] on which a picture of the scene is centred: of the Sun, at night of the Moon or the Milky Way.

    At night it is that of the Moon where it is up and shines, else of the middle of the Galaxy where that is up, else
    north.
    """
    sight = None if scene.lights is None or scene.sun.elevation_deg > NIGHT_CENTRE else scene.sight
    if scene.lights is None or sight is None:
        return scene.sun.azimuth_deg
    from skyscatter.celestial.heavens import moons_of

    # The middle of the Galaxy: Sagittarius A*.
    ra, dec = np.radians([266.417, -29.008])
    galaxy = sight.horizontal(np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)]))
    shining = [direction for _, direction in moons_of(sight)] if "moon" in scene.lights.shine else []
    for direction in [*shining, galaxy]:
        if direction[2] > 0:
            return float(np.degrees(np.arctan2(direction[0], direction[1])) % 360.0)
    return 0.0
