"""Which lights of the sky shine on a scene beside its Sun."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field, field_validator

from skyscatter.errors import DomainError
from skyscatter.record import Record, nearest

Light = Literal["sun", "moon", "planets", "stars", "starlight", "zodiacal", "airglow", "towns"]
#: All lights, in the order in which they are added up.
LIGHTS: tuple[Light, ...] = (
    "sun", "moon", "planets", "stars", "starlight", "zodiacal", "airglow", "towns",
)  # fmt: skip
#: Elevation of the Sun [degree] below which planets and stars are drawn, and below which the night's own light counts:
#: above it, it is less than a tenth of a per cent of twilight.
POINTS_BELOW, NIGHT_BELOW = 0.0, -6.0


class SkyLights(Record):
    """The lights of the sky that shine on a scene, at the place and time of its Sun.

    Parameters
    ----------
    shine : tuple of str
        Some of sun, moon, planets, stars (those of the catalogue, V < 7), starlight (of all fainter ones, the Milky
        Way), zodiacal, airglow and towns (those that the scene has).
    solar_flux : float
        Radio flux of the Sun at 10.7 cm [1e-22 W m-2 Hz-1], with which the airglow grows: 70 in quiet years, 200 and
        more in active ones.
    catalogue : str, optional
        FITS or CSV file of stars in place of the catalogue; see `skyscatter.celestial.stars.stars_at`.

    Examples
    --------
    >>> from skyscatter.celestial.lights import SkyLights
    >>> SkyLights(shine=["stars", "moon"]).shine
    ('moon', 'stars')
    """

    shine: tuple[Light, ...] = LIGHTS
    solar_flux: Annotated[float, Field(ge=50.0, le=400.0)] = 100.0
    catalogue: str | None = None

    @field_validator("shine", mode="after")
    @classmethod
    def _in_order(cls, shine: tuple[Light, ...]) -> tuple[Light, ...]:
        return tuple(name for name in LIGHTS if name in shine)


def shining(sun_elevation_deg: float, body: str = "Earth") -> tuple[Light, ...]:
    """The lights that matter in a planet's sky while the Sun stands there [degree].

    The airglow of planets other than the Earth is left out.

    Examples
    --------
    >>> from skyscatter.celestial.lights import shining
    >>> shining(30.0), shining(-3.0), len(shining(-30.0))
    (('sun', 'moon'), ('sun', 'moon', 'planets', 'stars'), 8)
    """
    last = 2 if sun_elevation_deg > POINTS_BELOW else 4 if sun_elevation_deg > NIGHT_BELOW else len(LIGHTS)
    return tuple(name for name in LIGHTS[:last] if body == "Earth" or name != "airglow")


def chosen(names: Iterable[str], field: str) -> tuple[Light, ...]:
    """Lights by their names, in order; `field` is what a mistake is told of."""
    asked = list(names)
    for name in asked:
        if name not in LIGHTS:
            raise DomainError(field, name, nearest(name, LIGHTS))
    return tuple(light for light in LIGHTS if light in asked)
