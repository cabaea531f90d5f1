"""Cameras: which direction each pixel looks in, and in which pixel a direction is seen.

Every camera is a frozen record with a width and a height [pixel].  `directions` gives the line of sight through each
pixel's centre as a unit vector in the observer's frame (x east, y north, z up); it is NaN outside the field.  `pixel`
is the inverse.  Pixel coordinates are array indices: the pixel in row j and column i has its centre at (x, y) = (i, j),
and the picture spans -0.5 to width - 0.5.

With offsets from the picture's centre, a to the right and b upwards in pixels,

    a = x - (width - 1) / 2,      b = (height - 1) / 2 - y,

each class states its mapping as an equation.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from skyscatter.errors import DomainError
from skyscatter.geometry.pinhole import Array, CameraBase, ObserverLike, Pinhole
from skyscatter.geometry.telescope import Telescope
from skyscatter.geometry.vectors import azimuth_elevation_from_direction, camera_frame, direction_from_azimuth_elevation
from skyscatter.units import ANGLE, Elevation, HighElevation, LowElevation, OptionalNumber, Turn, default


class Panorama(CameraBase):
    """Equirectangular panorama: azimuth to the right, elevation upwards, all around or a part of that.

    ``A = centre_azimuth + fov a / width`` and ``e = (min + max) / 2 + (max - min) b / height``.  A lowest elevation of
    -90 gives the full sphere, 0 the upper half.

    Parameters
    ----------
    elevation_min_deg, elevation_max_deg : float
        Lower and upper edge of the picture [degree].
    centre_azimuth_deg : float
        In the middle of the picture [degree], from north through east.
    fov_deg : float
        Azimuth from the left edge to the right one [degree].

    Examples
    --------
    South is in the middle, the horizon half-way up, and the pixels together see the whole sphere, 4 pi.

    >>> import numpy as np
    >>> import skyscatter
    >>> camera = skyscatter.Panorama(width=360, height=180)
    >>> x, y = camera.pixel([0, -1, 0])  # the direction of the southern horizon
    >>> round(float(x), 1), round(float(y), 1)
    (179.5, 89.5)
    >>> camera.directions().shape, round(float(camera.pixel_solid_angle().sum() / np.pi), 6)
    ((180, 360, 3), 4.0)
    """

    kind: Literal["panorama"] = "panorama"
    elevation_min_deg: LowElevation = default(-90.0)
    elevation_max_deg: HighElevation = default(90.0)
    centre_azimuth_deg: Turn = default(180.0)
    fov_deg: Annotated[float, ANGLE.within(0.0, 360.0, above=True)] = 360.0

    @model_validator(mode="after")
    def _check(self) -> Panorama:
        if self.elevation_min_deg >= self.elevation_max_deg:
            raise ValueError("elevation_min_deg must be below elevation_max_deg")
        return self

    def _elevation(self, b: ArrayLike) -> Array:
        low, high = self.elevation_min_deg, self.elevation_max_deg
        return np.clip((low + high) / 2 + (high - low) * np.asarray(b) / self.height, low, high)

    def through(self, x: ArrayLike, y: ArrayLike, observer: ObserverLike | None = None) -> Array:
        """Unit vectors (east, north, up) through points of the picture's plane, shape (..., 3)."""
        a, b = self._offsets(x, y)
        azimuth = self.centre_azimuth_deg + self.fov_deg * a / self.width
        return direction_from_azimuth_elevation(azimuth, self._elevation(b))

    def pixel(self, direction: ArrayLike, observer: ObserverLike | None = None) -> tuple[Array, Array]:
        """Fractional pixel coordinates (x, y); NaN beyond the ranges of azimuth and elevation."""
        azimuth, elevation = azimuth_elevation_from_direction(direction)
        low, high = self.elevation_min_deg, self.elevation_max_deg
        from_centre = (azimuth - self.centre_azimuth_deg + 180.0) % 360.0 - 180.0
        b = (elevation - (low + high) / 2) * self.height / (high - low)
        return self._inside(from_centre / self.fov_deg * self.width, b, np.isfinite(elevation))

    def pixel_solid_angle(self, observer: ObserverLike | None = None) -> Array:
        """Solid angle [sr], exact: (fov / width) (sin e_upper - sin e_lower)."""
        edges = np.sin(np.radians(self._elevation(self.height / 2 - np.arange(self.height + 1))))
        return np.repeat(
            (np.radians(self.fov_deg) / self.width * (edges[:-1] - edges[1:]))[:, None], self.width, axis=1
        )


class Fisheye(CameraBase):
    """Circular fisheye; by default it looks at the zenith, north at the top and east on the left.

    The circle of radius ``R = min(width, height) / 2`` pixels holds the field.  With ``ρ = hypot(a, b) / R`` the angle
    from the axis is ``θ = ρ fov / 2`` (equidistant) or ``sin(θ / 2) = ρ sin(fov / 4)`` (equisolid, equal solid angle
    per pixel).  ``east_left=True`` shows the sky as it looks from below (and every picture the right way round);
    ``east_left=False`` mirrors it, as if laid over a map.

    Parameters
    ----------
    projection : {"equidistant", "equisolid"}
        How the angle from the axis becomes a distance from the middle.
    fov_deg : float
        Angle across the circle [degree].
    azimuth_deg, elevation_deg : float
        Where it looks [degree].
    roll_deg : float
        Rotation about the line of sight [degree].
    east_left : bool
        Whether a view of the zenith has east on the left, as the sky looks from below.

    Examples
    --------
    The zenith is in the middle, and half-way to the right edge is the sky 45 degrees high in the west; the corners see
    nothing.

    >>> import numpy as np
    >>> import skyscatter
    >>> camera = skyscatter.Fisheye(width=101, height=101)
    >>> x, y = camera.pixel(np.array([[0, 0, 1], [-1, 0, 1] / np.sqrt(2)]))
    >>> x.round(2), y.round(2)
    (array([50.  , 75.25]), array([50., 50.]))
    >>> bool(np.isnan(camera.directions()[0, 0]).all())
    True
    """

    kind: Literal["fisheye"] = "fisheye"
    projection: Literal["equidistant", "equisolid"] = "equidistant"
    fov_deg: Annotated[float, ANGLE.within(0.0, 360.0, above=True)] = 180.0
    # A camera that faces south and is tilted up to the zenith has north at the top.
    azimuth_deg: Turn = default(180.0)
    elevation_deg: Elevation = default(90.0)
    roll_deg: Turn = default(0.0)
    east_left: bool = True

    def _radius_and_half_field(self) -> tuple[float, float]:
        return min(self.width, self.height) / 2, np.radians(self.fov_deg) / 2

    def _angle(self, length: Array) -> Array:
        """Angle from the axis [rad] at a distance from the picture's middle [pixel]; it ends at pi."""
        radius, half = self._radius_and_half_field()
        rho = length / radius
        if self.projection == "equidistant":
            return np.minimum(rho * half, np.pi)
        return np.asarray(2 * np.arcsin(np.minimum(rho * np.sin(half / 2), 1.0)))

    def _outside(self) -> NDArray[np.bool_]:
        """Pixels whose centres lie outside the circle, shape (height, width)."""
        return np.asarray(np.hypot(*self._offsets()) > self._radius_and_half_field()[0])

    def through(self, x: ArrayLike, y: ArrayLike, observer: ObserverLike | None = None) -> Array:
        """Unit vectors (east, north, up) through points of the picture's plane, shape (..., 3)."""
        a, b = self._offsets(x, y)
        length = np.hypot(a, b)
        theta, safe = self._angle(length), np.where(length > 0, length, 1.0)
        forward, right, up = camera_frame(self.azimuth_deg, self.elevation_deg, self.roll_deg)
        across = ((a if self.east_left else -a) / safe)[..., None] * right + (b / safe)[..., None] * up
        return np.cos(theta)[..., None] * forward + np.sin(theta)[..., None] * across

    def directions(self, observer: ObserverLike | None = None) -> Array:
        """Unit vectors (east, north, up), shape (height, width, 3); NaN outside the circle."""
        return np.where(self._outside()[..., None], np.nan, super().directions(observer))

    def pixel(self, direction: ArrayLike, observer: ObserverLike | None = None) -> tuple[Array, Array]:
        """Fractional pixel coordinates (x, y); NaN outside the circle."""
        forward, right, up = camera_frame(self.azimuth_deg, self.elevation_deg, self.roll_deg)
        d = np.asarray(direction, dtype=float)
        ahead, a, b = d @ forward, d @ right, d @ up
        theta = np.arctan2(np.hypot(a, b), ahead)
        radius, half = self._radius_and_half_field()
        rho = theta / half if self.projection == "equidistant" else np.sin(theta / 2) / np.sin(half / 2)
        length = np.hypot(a, b)
        scale = radius * rho / np.where(length > 0, length, 1.0)
        seen = np.asarray(rho <= 1.0)
        return self._inside((a if self.east_left else -a) * scale, b * scale, seen)

    def pixel_solid_angle(self, observer: ObserverLike | None = None) -> Array:
        """Solid angle [sr] by the mapping's Jacobian at the pixel centre; 0 where that is outside the circle."""
        theta = self._angle(np.hypot(*self._offsets()))
        radius, half = self._radius_and_half_field()
        if self.projection == "equidistant":
            omega = (half / radius) ** 2 * np.sinc(theta / np.pi)
        else:
            omega = (2 * np.sin(half / 2) / radius) ** 2 * np.ones_like(theta)
        return np.where(self._outside(), 0.0, omega)


class Perspective(Pinhole):
    """Pinhole camera by pointing and horizontal field of view: ``f = (width / 2) / tan(fov / 2)`` pixels.

    Up in the picture is towards the zenith; roll turns the camera clockwise as seen from behind it.  Without azimuth
    and elevation it looks as the observer does, which is for observers that look somewhere: `skyscatter.Viewpoint`.

    Parameters
    ----------
    azimuth_deg, elevation_deg : float, optional
        Where it looks [degree]; as the observer does when not given.
    fov_deg : float
        Horizontal field of view [degree].
    roll_deg : float
        Rotation about the line of sight, clockwise as seen from behind [degree].

    Examples
    --------
    A camera that looks east and 10 degrees upwards has the horizon below the middle of its picture, row 239.5.

    >>> import skyscatter
    >>> camera = skyscatter.Perspective(width=640, height=480, azimuth_deg=90, elevation_deg=10, fov_deg=60)
    >>> x, y = camera.pixel([1, 0, 0])
    >>> round(float(x), 1), round(float(y), 1)
    (319.5, 337.2)
    >>> round(camera.focal_length(), 1)  # pixels
    554.3
    """

    kind: Literal["perspective"] = "perspective"
    azimuth_deg: OptionalNumber[Turn] = default(None)
    elevation_deg: Elevation = default(0.0)
    fov_deg: Annotated[float, ANGLE.within(0.0, 180.0, above=True, below=True)] = 60.0
    roll_deg: Turn = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> Perspective:
        if self.azimuth_deg is None and self.elevation_deg != 0.0:
            raise DomainError("elevation_deg", self.elevation_deg, "goes with azimuth_deg; give both or neither")
        return self

    def _view(self, observer: Any) -> tuple[float, Array, Array, Array]:
        focal = self.width / 2 / np.tan(np.radians(self.fov_deg) / 2)
        if self.azimuth_deg is not None:
            return focal, *camera_frame(self.azimuth_deg, self.elevation_deg, self.roll_deg)
        if not all(hasattr(observer, name) for name in ("forward", "right", "up")):
            raise DomainError("azimuth_deg", None, "this observer looks nowhere by itself; give azimuth_deg")
        forward, right, up = (np.asarray(getattr(observer, name), float) for name in ("forward", "right", "up"))
        cosine, sine = np.cos(np.radians(self.roll_deg)), np.sin(np.radians(self.roll_deg))
        return focal, forward, cosine * right - sine * up, cosine * up + sine * right


class PlanetView(Pinhole):
    """The whole planet with its atmosphere, from above: looking straight down, north at the top, east on the right.

    The limb of the atmosphere stands ``ρ`` from the nadir, ``sin ρ = (R + top) / (R + altitude)``; the focal length is
    ``f = min(width, height) / 2 / ((1 + margin) tan ρ)`` pixels.

    Parameters
    ----------
    margin : float
        Free space around the planet, as a share of its size.

    Examples
    --------
    The Earth and its air from a geostationary orbit are 17 degrees wide, and fill the picture but for a margin.

    >>> import numpy as np
    >>> import skyscatter
    >>> observer = skyscatter.load_model("earth").scene(altitude="35786 km").observer
    >>> camera = skyscatter.PlanetView(width=200, height=200)
    >>> half_width = 100 / camera.focal_length(observer) / 1.05  # tangent of the angle to the rim
    >>> round(2 * float(np.degrees(np.arctan(half_width))), 1)
    17.7
    """

    kind: Literal["planet"] = "planet"
    margin: Annotated[float, Field(ge=0.0, le=10.0)] = 0.05

    def _view(self, observer: ObserverLike | None) -> tuple[float, Array, Array, Array]:
        if observer is None:
            raise DomainError("observer", None, "a view of the planet needs the observer's altitude")
        if not observer.altitude > observer.atmosphere_top:
            raise DomainError(
                "altitude",
                float(observer.altitude),
                f"the planet is seen whole only from above the atmosphere's top ({observer.atmosphere_top:g} m)",
            )
        rim, distance = observer.planet_radius + observer.atmosphere_top, observer.planet_radius + observer.altitude
        # tan of asin(rim / distance), written so that it keeps its digits close above the atmosphere
        tangent = rim / np.sqrt((distance - rim) * (distance + rim))
        focal = min(self.width, self.height) / 2 / ((1.0 + self.margin) * tangent)
        return focal, *camera_frame(0.0, -90.0)


#: Cameras by their kind, as recipes name them.
CAMERAS: dict[str, Any] = {
    "panorama": Panorama, "fisheye": Fisheye, "perspective": Perspective, "planet": PlanetView, "telescope": Telescope,
}  # fmt: skip

Camera = Annotated[Panorama | Fisheye | Perspective | PlanetView | Telescope, Field(discriminator="kind")]

VIEWS = (
    "landscape[:AZIMUTH[,FOV]], panorama[:AZIMUTH], panorama-upper[:AZIMUTH], fisheye, fisheye-equisolid, "
    "perspective:AZIMUTH,ELEVATION,FOV, planet"
)
#: Azimuth that a landscape takes in [degree], seen from within the air and from above it.
LANDSCAPE_FOV = (120.0, 40.0)
#: Share of a landscape that lies below the horizon, the same.
LANDSCAPE_GROUND = (1.0 / 6.0, 0.6)
#: A planet seen from above its air is shown whole where it takes up less than this from its middle to its rim [degree].
WHOLE_PLANET = 50.0


def landscape(
    width: int, height: int, observer: ObserverLike, centre_azimuth_deg: float = 180.0, fov_deg: float | None = None
) -> Panorama:
    """Part of a panorama with the horizon where a painter would put it, and equal degrees per pixel both ways.

    Within the air a sixth of the picture is ground, however deep the horizon lies for this observer; from above the air
    the limb runs below the upper edge, with space over it.

    Parameters
    ----------
    width, height : int
        Size of the picture [pixel].
    observer : Observer
        Its height settles where the horizon is: ``cos dip = R / (R + altitude)``.
    centre_azimuth_deg : float
        In the middle of the picture [degree].
    fov_deg : float, optional
        Azimuth from the left edge to the right one [degree]; 120, and 40 from above the air.

    Examples
    --------
    From 1 km the horizon lies 1 degree below the horizontal, in the row above the lowest sixth of the picture.

    >>> import skyscatter
    >>> from skyscatter.geometry.camera import landscape
    >>> observer = skyscatter.load_model("earth").scene(altitude="1 km").observer
    >>> camera = landscape(1200, 480, observer)
    >>> round(camera.elevation_min_deg, 2), round(camera.elevation_max_deg, 2)
    (-9.02, 38.98)
    """
    above = int(observer.altitude > observer.atmosphere_top)
    fov = LANDSCAPE_FOV[above] if fov_deg is None else fov_deg
    dip = np.degrees(np.arccos(observer.planet_radius / (observer.planet_radius + max(observer.altitude, 0.0))))
    high = fov * height / width
    low = -float(dip) - LANDSCAPE_GROUND[above] * high
    return Panorama(
        width=width, height=height, centre_azimuth_deg=centre_azimuth_deg, fov_deg=fov,
        elevation_min_deg=max(low, -90.0), elevation_max_deg=min(low + high, 90.0),
    )  # fmt: skip


def suitable_view(observer: ObserverLike) -> str:
    """The view that suits an observer: ``landscape``, or ``planet`` from so far that it is seen as a ball.

    Examples
    --------
    >>> import skyscatter
    >>> from skyscatter.geometry.camera import suitable_view
    >>> earth = skyscatter.load_model("earth")
    >>> [suitable_view(earth.scene(altitude=height).observer) for height in ("2 m", "400 km", "36000 km")]
    ['landscape', 'landscape', 'planet']
    """
    rim = (observer.planet_radius + observer.atmosphere_top) / (observer.planet_radius + observer.altitude)
    return "planet" if rim < np.sin(np.radians(WHOLE_PLANET)) else "landscape"


def camera_from_view(
    view: str, width: int, height: int, sun_azimuth_deg: float = 180.0, observer: ObserverLike | None = None
) -> Panorama | Fisheye | Perspective | PlanetView:
    """Camera from the short text that the command line takes.

    Parameters
    ----------
    view : str
        ``landscape``, which needs the observer (``landscape:90,60`` looks east, 60 degrees wide; see `landscape`),
        ``panorama`` and ``panorama-upper`` (centred on the Sun's azimuth, or on that after a colon: ``panorama:0`` has
        north in the middle), ``fisheye``, ``fisheye-equisolid``, ``perspective:AZIMUTH,ELEVATION,FOV`` [degree] or
        ``planet``.
    width, height : int
        Size of the picture [pixel].
    sun_azimuth_deg : float
        Azimuth [degree] of the Sun, the middle of panoramas and landscapes.
    observer : Observer, optional
        For ``landscape``.

    Raises
    ------
    DomainError
        When the text is none of these; the message lists them.
    """
    name, _, rest = view.strip().partition(":")
    size = {"width": width, "height": height}
    centre = float(sun_azimuth_deg) % 360.0
    if name == "perspective":
        try:
            azimuth, elevation, fov = (float(word) for word in rest.split(","))
        except ValueError:
            raise DomainError(
                "view", view, "give perspective:AZIMUTH,ELEVATION,FOV in degrees, for instance perspective:90,10,60"
            ) from None
        return Perspective(**size, azimuth_deg=azimuth, elevation_deg=elevation, fov_deg=fov)
    if name == "landscape":
        return _landscape_from(view, rest, width, height, centre, observer)
    if name in ("panorama", "panorama-upper"):
        try:
            centre = float(rest) % 360.0 if ":" in view else centre
        except ValueError:
            raise DomainError("view", view, f"give the azimuth in degrees, such as {name}:0, or {name} alone") from None
        return Panorama(**size, centre_azimuth_deg=centre, elevation_min_deg=0.0 if name == "panorama-upper" else -90.0)
    if ":" not in view:
        if name == "fisheye":
            return Fisheye(**size)
        if name == "fisheye-equisolid":
            return Fisheye(**size, projection="equisolid")
        if name == "planet":
            return PlanetView(**size)
    raise DomainError("view", view, f"choose one of {VIEWS}")


def _landscape_from(
    view: str, rest: str, width: int, height: int, centre: float, observer: ObserverLike | None
) -> Panorama:
    """The camera of ``landscape[:AZIMUTH[,FOV]]``."""
    if observer is None:
        raise DomainError("observer", None, "a landscape needs the observer's altitude")
    try:
        numbers = [float(word) for word in rest.split(",")] if ":" in view else []
        if len(numbers) > 2 or not np.all(np.isfinite(numbers)):
            raise ValueError
    except ValueError:
        remedy = "give the azimuth, and the width if you like, in degrees, such as landscape:90 or landscape:90,60"
        raise DomainError("view", view, remedy) from None
    azimuth = numbers[0] % 360.0 if numbers else centre
    return landscape(width, height, observer, azimuth, numbers[1] if len(numbers) > 1 else None)
