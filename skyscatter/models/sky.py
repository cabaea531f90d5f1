"""Model files of skies: a planet with its air, its ground and its star."""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import model_validator

from skyscatter.ground import Ground
from skyscatter.media.medium import Component, Medium
from skyscatter.models.base import ModelFile
from skyscatter.record import Record
from skyscatter.scene import Scene, Site, Star, Sun
from skyscatter.units import PositiveMetres


class Planet(Record):
    """A sphere.

    Parameters
    ----------
    name : str
        How it is called.
    radius : length
        [m].
    """

    name: str
    radius: PositiveMetres


class Model(ModelFile):
    """What a model file says; `scene` puts an observer and a Sun into it.

    Parameters
    ----------
    name : str
        How the model is called.
    description : str
        What it is, in a sentence.
    sources : tuple of str
        Where the numbers come from.
    planet : Planet
        The sphere that carries the air.
    ground : Ground
        Its surface; black when not given.
    star : Star
        Its light; the Sun when not given.
    components : tuple of Component
        The atmosphere.
    """

    command: ClassVar[str] = "sky"

    planet: Planet
    ground: Ground = Ground()
    star: Star = Star()
    components: tuple[Component, ...]

    @model_validator(mode="after")
    def _check(self) -> Model:
        _ = self.medium
        return self

    @property
    def medium(self) -> Medium:
        """The atmosphere around the planet."""
        return Medium(components=self.components, planet_radius=self.planet.radius)

    @property
    def top(self) -> float:
        """Altitude of the top of the atmosphere [m]."""
        return self.medium.top

    def scene(
        self,
        sun_elevation_deg: float = 30.0,
        sun_azimuth_deg: float = 180.0,
        sun_distance_au: float | None = None,
        altitude: Any = 0.0,
    ) -> Scene:
        """A scene with the Sun at an elevation and azimuth [degree] and the observer at an altitude [m]."""
        sun = Sun(elevation_deg=sun_elevation_deg, azimuth_deg=sun_azimuth_deg, distance_au=sun_distance_au)
        return Scene(medium=self.medium, ground=self.ground, star=self.star, sun=sun, altitude=altitude)

    def scene_at(self, latitude_deg: float, longitude_deg: float, time: Any, altitude: Any = 0.0) -> Scene:
        """A scene for a place on Earth [degree] and a time (ISO 8601 text, UTC; or a datetime)."""
        from skyscatter.geometry.sun import iso_utc, sun_position

        scene = self.scene(altitude=altitude)
        sun = sun_position(latitude_deg, longitude_deg, time, scene.altitude)
        site = Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg, time=iso_utc(time))
        return scene.model_copy(update={"sun": Sun(**sun._asdict(), site=site)})
