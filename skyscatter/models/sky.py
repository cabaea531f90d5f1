"""Model files of skies: a planet with its air, its ground and its star."""

from __future__ import annotations

import warnings
from typing import Any, ClassVar

import numpy as np

from skyscatter.celestial.frames import Sight
from skyscatter.celestial.lights import SkyLights, chosen, shining
from skyscatter.errors import DomainError
from skyscatter.ground import Ground
from skyscatter.media.medium import Component, Medium
from skyscatter.models.base import ModelFile
from skyscatter.record import Record
from skyscatter.scene import AU, HELD, Holding, Scene, Site, Star, Sun
from skyscatter.surfaces.lamps import AnyLamp
from skyscatter.surfaces.scene import Body, SurfaceMedium
from skyscatter.surfaces.townmap import AnyTown
from skyscatter.units import PositiveMetres

#: In the totality of an eclipse lights matter as while the Sun stands there [degree]: planets and bright stars.
TOTALITY = -3.0
#: Elevation of the Sun [degree] below which most of the light is that of others: of a bright Moon, then of the night.
DARK = -10.0


class Planet(Record):
    """A sphere.

    Parameters
    ----------
    name : str
        How it is called.
    radius : length
        [m].

    Examples
    --------
    >>> import skyscatter
    >>> titan = skyscatter.Planet(name="Titan", radius="2575 km")
    >>> titan.radius  # m
    2575000.0
    """

    name: str
    radius: PositiveMetres


class Model(Holding, ModelFile):
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
    towns : tuple of Town or TownMap, optional
        Lamps on the ground, whose light the air scatters, for pictures.
    fields : tuple of Component
        What the air holds beside its shells, in three dimensions: clouds, plumes.
    bodies : tuple of Body
        What stands on the ground or hangs in the air.
    media : tuple of SurfaceMedium
        What fills the bodies that name it.
    lamps : tuple of lamps
        What shines beside the star.

    Examples
    --------
    The air of a planet of one's own, of one gas that scatters, and the height of its atmosphere.

    >>> import skyscatter
    >>> gas = skyscatter.Component(
    ...     name="gas",
    ...     density={"kind": "exponential", "scale_height": "11 km", "top": "110 km"},
    ...     optics={"kind": "rayleigh", "coefficient": 2e-6, "wavelength": "550 nm"},
    ... )
    >>> planet = skyscatter.Planet(name="Own", radius="3000 km")
    >>> model = skyscatter.Model(name="own", planet=planet, ground={"albedo": 0.2}, components=(gas,))
    >>> scene = model.scene(sun_elevation_deg=5)
    >>> model.top / 1e3, scene.observer.planet_radius / 1e3  # km
    (110.0, 3000.0)
    """

    command: ClassVar[str] = "sky"

    planet: Planet
    ground: Ground = Ground()
    star: Star = Star()
    components: tuple[Component, ...]
    towns: tuple[AnyTown, ...] | None = None
    fields: tuple[Component, ...] = ()
    bodies: tuple[Body, ...] = ()
    media: tuple[SurfaceMedium, ...] = ()
    lamps: tuple[AnyLamp, ...] = ()

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
        """A scene with a Sun and an observer.

        Parameters
        ----------
        sun_elevation_deg, sun_azimuth_deg : float
            Of the Sun in the observer's sky [degree]; azimuth from north through east.
        sun_distance_au : float, optional
            Distance of the star [au]; the model's when not given.
        altitude : float or str or Quantity
            Of the observer above the ground [m].

        Returns
        -------
        Scene

        Raises
        ------
        ValidationError
            For angles out of range and for an altitude that is negative or no length; it is a ValueError.

        Examples
        --------
        >>> import skyscatter
        >>> scene = skyscatter.load_model("mars").scene(sun_elevation_deg=20, sun_distance_au=1.38, altitude="2 km")
        >>> scene.altitude, scene.sun.elevation_deg
        (2000.0, 20.0)
        >>> round(float(scene.star.irradiance([550], scene.star_distance)[0]), 2)  # sunlight at perihelion [W m-2 nm-1]
        0.98
        """
        sun = Sun(elevation_deg=sun_elevation_deg, azimuth_deg=sun_azimuth_deg, distance_au=sun_distance_au)
        return self._seen(sun=sun, altitude=altitude, towns=self.towns)

    def _seen(self, **fields: Any) -> Scene:
        warn_of_size(self)
        held = {name: getattr(self, name) for name in HELD}
        return Scene(medium=self.medium, ground=self.ground, star=self.star, **held, **fields)

    def scene_at(
        self, latitude_deg: float, longitude_deg: float, time: Any, altitude: Any = 0.0, lights: Any = None
    ) -> Scene:
        """A scene for a place and a time on Earth, or on Mars if that is the model's planet.

        Parameters
        ----------
        latitude_deg, longitude_deg : float
            Geodetic on Earth, planetocentric on Mars; north and east positive [degree].
        time : str or datetime
            ISO 8601 text, UTC; or a datetime.
        altitude : float or str or Quantity
            Of the observer above the ground [m].
        lights : "auto", SkyLights, sequence of str or callable, optional
            What shines, see `skyscatter.SkyLights`; ``"auto"`` takes what matters at that time, a function is given the
            elevation of the Sun [degree] and the planet and returns `SkyLights`.  The Sun alone when not given, with
            a warning where it stands so low that most light is that of others.

        Returns
        -------
        Scene
            Its Sun has the place and the time as `site`.

        Raises
        ------
        DomainError
            For a place that is not on the planet, another planet, or a time that cannot be read.

        Examples
        --------
        Midsummer's evening in Paris: the Sun stands low in the north-west.

        >>> import skyscatter
        >>> scene = skyscatter.load_model("earth").scene_at(48.86, 2.35, "2026-06-21T19:15Z")
        >>> round(scene.sun.elevation_deg), round(scene.sun.azimuth_deg)
        (5, 300)
        """
        from skyscatter.geometry.sun import iso_utc

        scene, body = self._seen(altitude=altitude), self.planet.name.capitalize()
        if body not in ("Earth", "Mars"):
            rule = "a place and a time mean Earth or Mars; give the elevation of the Sun"
            raise DomainError("planet", self.planet.name, rule)
        site = Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg, time=iso_utc(time), body=body)
        sun = _sun_at(site, time, scene.altitude)
        elevation = sun.elevation_deg
        if lights is not None and _in_totality(site, scene.altitude):
            elevation = min(elevation, TOTALITY)
        if lights is None and elevation < DARK:
            _warn_of_night(elevation, body)
        lit = _lights(lights, elevation, body)
        if lit is not None and body != "Earth" and "airglow" in lit.shine:
            raise DomainError("lights", "airglow", f"that of {body} is not known; leave it out")
        if lit is not None and "towns" in lit.shine and not self.towns:
            if not (isinstance(lights, str) or callable(lights) or isinstance(lights, SkyLights)):
                raise DomainError("lights", "towns", "the model has none; give it towns, or leave them out")
            lit = lit.model_copy(update={"shine": tuple(name for name in lit.shine if name != "towns")})
        return scene.model_copy(update={"sun": sun, "lights": lit, "towns": self.towns})


def _sun_at(site: Site, time: Any, altitude: float) -> Sun:
    """The Sun over a place at a time."""
    if site.body == "Earth":
        from skyscatter.geometry.sun import sun_position

        return Sun(**sun_position(site.latitude_deg, site.longitude_deg, time, altitude)._asdict(), site=site)
    east, north, up = site.sight(altitude).sun.direction
    return Sun(
        elevation_deg=float(np.degrees(np.arcsin(up))),
        azimuth_deg=float(np.degrees(np.arctan2(east, north)) % 360.0),
        distance_au=site.sight(altitude).sun.distance / AU,
        site=site,
    )


def warn_of_size(model: Model) -> None:
    """Say that a planet is smaller than its air is high, as where kilometres were meant."""
    radius = model.planet.radius
    if radius < model.top:
        warnings.warn(
            f"planet.radius = {radius:g} m is less than the height of its air, {model.top:g} m; "
            f'if kilometres are meant, give "{radius:g} km"',
            stacklevel=2,
        )


def _warn_of_night(elevation: float, body: str) -> None:
    """Say that the Sun alone is not the sky of the night."""
    others = "Moon, stars and airglow" if body == "Earth" else "stars and zodiacal light"
    warnings.warn(
        f"lights = None with the Sun at {elevation:.1f} degrees: the scene has the Sun alone, and most light of such a "
        f'sky is that of {others}; give lights = "auto", or ("sun",) for the Sun alone',
        stacklevel=3,
    )


def _in_totality(site: Site, altitude: float) -> bool:
    """Whether the Moon covers all of the Sun there."""
    from skyscatter.celestial.eclipse import solar_eclipse

    sight = site.sight(altitude)
    eclipse = solar_eclipse(sight) if isinstance(sight, Sight) else None
    return eclipse is not None and eclipse.kind == "total"


def _lights(lights: Any, sun_elevation_deg: float, body: str) -> SkyLights | None:
    """The lights that are meant."""
    if lights is None or isinstance(lights, SkyLights):
        return lights
    if callable(lights):
        found: SkyLights = lights(sun_elevation_deg, body)
        return found
    if isinstance(lights, str) and lights == "auto":
        return SkyLights(shine=shining(sun_elevation_deg, body))
    return SkyLights(shine=chosen(lights, "lights"))
