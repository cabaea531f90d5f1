"""A scene: a medium, its light and its ground, and where the observer stands."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import SerializerFunctionWrapHandler, model_serializer, model_validator

from skyscatter.celestial.frames import Sight, SkyFrame
from skyscatter.celestial.lights import SkyLights
from skyscatter.celestial.marssight import MarsSight
from skyscatter.errors import DomainError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.ground import Ground
from skyscatter.media.everywhere import Everywhere
from skyscatter.media.medium import Component, Medium
from skyscatter.media.space import SpatialField
from skyscatter.record import Record
from skyscatter.spectra.solar import SOLAR_RADIUS, blackbody_irradiance, disk_mean, limb_darkening, solar_irradiance
from skyscatter.spectra.table import Radiance, StarSpectrum, evaluate
from skyscatter.surfaces.lamps import AnyLamp
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene
from skyscatter.surfaces.townmap import AnyTown
from skyscatter.units import (
    AstronomicalUnits,
    Degrees,
    Elevation,
    Kelvin,
    Metres,
    NonNegativeMetres,
    OptionalNumber,
    default,
)

AU = 149597870700.0  #: astronomical unit [m], IAU 2012 resolution B2


#: Names that bodies and media of a sky cannot have: what the planet and its air are called.
TAKEN = ("ground", "air")


#: Fields of what a sky holds beside its shells.
HELD = ("fields", "bodies", "media", "lamps")


class Holding(Record):
    """What scenes and models of skies share that may hold `HELD`: checks, plain data, and whether they do."""

    @model_validator(mode="after")
    def _check_world(self) -> Self:
        check_world(self)
        return self

    @model_serializer(mode="wrap")
    def _plain(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # Files and recipes of plain skies do not speak of what these do not hold.
        return {name: value for name, value in write(self).items() if value or name not in HELD}

    @property
    def world(self) -> str:
        """The field because of which it is more than air in shells over Lambertian ground; empty where it is not."""
        sky: Any = self
        held = (name for name in HELD if getattr(sky, name))
        return next(held, "" if sky.ground.material is None else "ground.material")


def check_world(sky: Any) -> None:
    """Refuse what a sky cannot hold."""
    names = [component.name for component in (*sky.medium.components, *sky.fields)]
    for component in sky.fields:
        if not isinstance(component.density, SpatialField) or isinstance(component.density, Everywhere):
            rule = "is no field in three dimensions with an end; shells of air belong to components"
            raise DomainError("fields", component.density.kind, rule)
        if names.count(component.name) > 1:
            raise DomainError("fields", component.name, "two components of one name; rename one")
    for field in ("bodies", "media"):
        for part in getattr(sky, field):
            if part.name in TAKEN:
                raise DomainError(field, part.name, "is what the planet has already; choose another name")
    for lamp in sky.lamps:
        if lamp.kind in ("surroundings", "environment"):
            raise DomainError("lamps", lamp.kind, "are for rooms; light from all around a planet is the background")
    SurfaceScene(media=(SurfaceMedium(name="air"), *sky.media), bodies=sky.bodies, lamps=sky.lamps)


#: Half the radius of a neutron star [m]: what is smaller was not meant in metres.
LEAST_RADIUS = 5e3


class Star(Record):
    """The light of a scene: a limb-darkened disk with a spectrum.

    Parameters
    ----------
    spectrum : {"astm-g173", "blackbody"} or float or SpectralTable
        Irradiance at `distance` outside the atmosphere: the measured Sun, a black body of `temperature`, or numbers
        [W m-2 nm-1] valid at `distance`.
    temperature : float
        Of the black body [K].
    radius, distance : length
        Of the star, and of its centre from the planet; a Sun position with its own distance overrides the latter.
    limb_darkening : bool
        Darken the disk as the Sun's (Neckel & Labs 1994); a uniform disk otherwise.

    Examples
    --------
    A red dwarf of 3000 K and a seventh of the Sun's radius as a planet at 0.05 au has it, and the Sun as the Earth
    has it: blue light and near infrared [W m-2 nm-1].

    >>> import skyscatter
    >>> star = skyscatter.Star(spectrum="blackbody", temperature=3000, radius="0.14 Rsun", distance="0.05 au")
    >>> [round(float(star.irradiance([nm], star.distance)[0]), 2) for nm in (450, 1000)]
    [0.08, 0.53]
    >>> sun = skyscatter.Star()
    >>> [round(float(sun.irradiance([nm], sun.distance)[0]), 2) for nm in (450, 1000)]  # alone: not means over cells
    [2.07, 0.74]
    """

    spectrum: StarSpectrum = default("astm-g173")
    temperature: Kelvin = default(5772.0)
    radius: NonNegativeMetres = default(SOLAR_RADIUS)
    distance: Metres = default(AU)
    limb_darkening: bool = True

    @model_validator(mode="after")
    def _check(self) -> Star:
        if 0 < self.radius < LEAST_RADIUS:
            remedy = f"is in metres: a star has {LEAST_RADIUS:g} at least, a point 0; or give '0.7 Rsun'"
            raise DomainError("radius", self.radius, remedy)
        if not self.distance > self.radius:
            remedy = "is in metres and must exceed the star's radius; or give '0.3 au'"
            raise DomainError("distance", self.distance, remedy)
        return self

    def irradiance(self, wavelengths_nm: ArrayLike, distance: float) -> NDArray[np.float64]:
        """Irradiance on a surface that faces the star at `distance` [m]; W m-2 nm-1, shape (wavelength,)."""
        if self.spectrum == "blackbody":
            return blackbody_irradiance(wavelengths_nm, self.temperature, self.radius, distance)
        if self.spectrum == "astm-g173":
            return solar_irradiance(wavelengths_nm) * (AU / distance) ** 2
        return evaluate(self.spectrum, wavelengths_nm) * (self.distance / distance) ** 2

    def limb(self, mu: ArrayLike, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
        """Radiance of the disk relative to its mean, over the cosine `mu` of the angle at the surface; (mu, wl)."""
        if not self.limb_darkening:
            return np.ones((np.size(mu), np.size(wavelengths_nm)))
        return limb_darkening(mu, wavelengths_nm) / disk_mean(wavelengths_nm)


class Site(Record):
    """The place on a planet and the time that a Sun position was computed for: files say it, the sky's other lights and
    eclipses follow from it.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        Geodetic on Earth, planetocentric on Mars; north and east positive [degree].
    time : str
        UTC, ISO 8601.
    body : {"Earth", "Mars"}
        The planet.
    """

    latitude_deg: float
    longitude_deg: float
    time: str
    body: Literal["Earth", "Mars"] = "Earth"

    def sight(self, altitude: float) -> SkyFrame:
        """Frames of the sky for an observer at a height [m]."""
        kind = Sight if self.body == "Earth" else MarsSight
        return kind(self.latitude_deg, self.longitude_deg, self.time, altitude)


class Sun(Record):
    """Where the star stands in the observer's sky.

    Parameters
    ----------
    elevation_deg : float
        Above the horizontal plane, -90 to 90 [degree]; not refracted.
    azimuth_deg : float
        From north through east [degree].
    distance_au : float, optional
        Distance [au]; the model's when not given.
    site : Site, optional
        Place and time for which the Sun stands there, where they are known.

    Examples
    --------
    >>> import skyscatter
    >>> east, north, up = skyscatter.Sun(elevation_deg=30, azimuth_deg=270).direction
    >>> round(float(east), 3), round(float(up), 3)
    (-0.866, 0.5)
    """

    elevation_deg: Elevation = default(30.0)
    azimuth_deg: Degrees = default(180.0)
    distance_au: OptionalNumber[AstronomicalUnits] = default(None)
    site: Site | None = None

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector towards the star (east, north, up)."""
        return direction_from_azimuth_elevation(self.azimuth_deg, self.elevation_deg)


class Observer(NamedTuple):
    """What a camera needs to know of where it stands.

    Attributes
    ----------
    altitude : float
        Height above the ground [m].
    planet_radius : float
        Radius of the ground [m].
    atmosphere_top : float
        Altitude above which there is vacuum [m].

    Examples
    --------
    From an aeroplane the horizon lies 3 degrees below the horizontal.

    >>> import numpy as np
    >>> import skyscatter
    >>> observer = skyscatter.load_model("earth").scene(altitude="10 km").observer
    >>> distance = observer.position[2]  # from the planet's centre [m]
    >>> round(float(np.degrees(np.arccos(observer.planet_radius / distance))), 1)
    3.2
    """

    altitude: float
    planet_radius: float
    atmosphere_top: float

    @property
    def position(self) -> NDArray[np.float64]:
        """Position from the planet's centre [m] in the observer's frame (east, north, up)."""
        return np.array([0.0, 0.0, self.planet_radius + self.altitude])


class Scene(Holding):
    """Everything that decides what a ray of light sees.

    The frame is the observer's: origin in the planet's centre, x east, y north, z up through the observer.

    Parameters
    ----------
    medium : Medium
    ground : Ground
    star : Star
    sun : Sun
    altitude : length
        Height of the observer above the ground [m].
    background : float or SpectralTable
        Uniform radiance from outside the atmosphere [W m-2 sr-1 nm-1].
    lights : SkyLights, optional
        Moon, planets, stars and the rest of the sky's light, for pictures of a place and a time (`site` of the
        Sun); the Sun alone when not given.
    towns : tuple of Town or TownMap, optional
        Lamps on the ground, whose light the air scatters, for pictures; with `lights` they shine where these name
        towns.
    fields : tuple of Component
        What the air holds beside its shells, with densities in three dimensions: clouds, plumes, fog in a valley.
    bodies : tuple of Body
        What stands on the ground or hangs in the air.
    media : tuple of SurfaceMedium
        What fills the bodies that name it.
    lamps : tuple of lamps
        What shines beside the star and bodies that do.

    Notes
    -----
    Places of fields, bodies and lamps are in metres from the point of the ground below the observer: x east, y north,
    z up.  The ground falls away from that plane by d^2 / 2 R at a distance d.  Scenes with any of them, or with a
    ground of another material than Lambert's, are for the solver ``path``, see `skyscatter.solvers.world`.

    Examples
    --------
    How much of the light of a low Sun arrives: a third of the red, and little blue.

    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth").scene(sun_elevation_deg=5)
    >>> start = scene.observer.position
    >>> end = start + 3000e3 * scene.sun.direction  # above the air
    >>> skyscatter.transmittance(scene, start, end, [450, 550, 650]).round(2)
    array([0.05, 0.17, 0.33])

    The shadow of a wall of 2 m that stands south of the observer, under the midday Sun: the ground before it is lit by
    the blue sky alone.

    >>> from skyscatter.surfaces import Body, Box, Lambert
    >>> wall = Body(shape=Box(position=(0, "-1 m", "1 m"), size=("9 m", "10 cm", "2 m")), material=Lambert())
    >>> model = skyscatter.load_model("earth-simple")
    >>> scene = model.model_copy(update={"bodies": (wall,)}).scene(sun_elevation_deg=45, altitude="2 m")
    >>> down = scene.observer.position, [0, 0, -1], [450, 650]
    >>> seen = skyscatter.radiance(scene, *down, solver=skyscatter.Path(samples=64))
    >>> bool(seen.radiance[0] > 2 * seen.radiance[1])
    True
    """

    medium: Medium
    ground: Ground = Ground()
    star: Star = Star()
    sun: Sun = Sun()
    altitude: NonNegativeMetres = default(0.0)
    background: Radiance = default(0.0)
    lights: SkyLights | None = None
    towns: tuple[AnyTown, ...] | None = None
    fields: tuple[Component, ...] = ()
    bodies: tuple[Body, ...] = ()
    media: tuple[SurfaceMedium, ...] = ()
    lamps: tuple[AnyLamp, ...] = ()

    @model_validator(mode="after")
    def _check_lights(self) -> Scene:
        for town in self.towns or ():
            if town.on_earth and self.sun.site is None:
                rule = "lies somewhere on Earth, so the observer must too: give a place and a time"
                raise DomainError("towns", town.name, rule)
        if self.lights is not None and self.sun.site is None:
            raise DomainError("lights", ", ".join(self.lights.shine), "need a place and a time; see Model.scene_at")
        return self

    @property
    def observer(self) -> Observer:
        """The observer as cameras see it."""
        return Observer(self.altitude, self.medium.radius, self.medium.top)

    def check_origins(self, origins: NDArray[np.float64]) -> None:
        """Refuse rays (..., 3) [m] that start inside the planet."""
        # Rounding may put a point on the ground a hair below it; more is inside the planet.
        radius = self.medium.radius
        low = np.linalg.norm(origins, axis=-1).min(initial=np.inf) - radius
        if low < -1e-6 * radius:
            raise DomainError("origins", f"altitude {low:.6g} m", "inside the planet; start on the ground or above")

    @property
    def sight(self) -> SkyFrame | None:
        """Frames of the sky for the observer; None where the Sun stands at no known place and time."""
        return None if self.sun.site is None else self.sun.site.sight(self.altitude)

    @property
    def star_distance(self) -> float:
        """Distance of the star [m]."""
        return self.star.distance if self.sun.distance_au is None else self.sun.distance_au * AU
