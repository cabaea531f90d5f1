"""A scene in space: a medium of three dimensions, its lights, and from where it is seen.

The model's frame has its origin anywhere in the nebula and its z axis along whatever symmetry there is.  On the sky x
points west (to the right), y north (up) and z towards the observer; `View` says how the one is turned into the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.lights import ParallelLight, PointStar
from skyscatter.media.medium import Medium
from skyscatter.record import Record
from skyscatter.spectra.table import Background, evaluate
from skyscatter.starfield import StarField
from skyscatter.units import PARSEC, Elevation, PositiveMetres, RightAscension, Turn, default

Array = NDArray[np.float64]

#: Room around a nebula of finite extent whose picture has no stated width.
MARGIN = 1.05


class View(Record):
    """Where the nebula stands in the sky, and how it is turned.

    The model is turned by `azimuth_deg` about its z axis, tilted by `inclination_deg` so that its +z axis, seen along
    it at first, leans towards north, and turned by `position_angle_deg` from north through east:
    M = Rz(position angle) Rx(-inclination) Rz(azimuth) takes model into sky coordinates.

    Parameters
    ----------
    ra_deg, dec_deg : float
        ICRS position of the model's origin [degree].
    distance : length
        From the observer [m].
    inclination_deg, azimuth_deg, position_angle_deg : float
        [degree]

    Examples
    --------
    The axis of a disk that is tilted by 60 degrees leans towards north, and less towards the observer.

    >>> import skyscatter
    >>> view = skyscatter.View(ra_deg=84.0, dec_deg=-2.0, distance="400 pc", inclination_deg=60)
    >>> _, north, towards_us = view.matrix @ [0, 0, 1]
    >>> round(float(north), 2), round(float(towards_us), 2)
    (0.87, 0.5)
    """

    ra_deg: RightAscension = default(0.0)
    dec_deg: Elevation = default(0.0)
    distance: PositiveMetres = default(1000 * PARSEC)
    inclination_deg: Turn = default(0.0)
    azimuth_deg: Turn = default(0.0)
    position_angle_deg: Turn = default(0.0)

    @property
    def matrix(self) -> Array:
        """Rotation (3, 3) from the model's frame to that of the sky (x west, y north, z towards the observer)."""
        angles = (self.position_angle_deg, self.inclination_deg, self.azimuth_deg)
        (cp, ci, ca), (sp, si, sa) = np.cos(np.radians(angles)), np.sin(np.radians(angles))
        turn = np.array([[cp, -sp, 0.0], [sp, cp, 0.0], [0.0, 0.0, 1.0]])
        tilt = np.array([[1.0, 0.0, 0.0], [0.0, ci, si], [0.0, -si, ci]])
        spin = np.array([[ca, -sa, 0.0], [sa, ca, 0.0], [0.0, 0.0, 1.0]])
        return turn @ tilt @ spin

    @property
    def right(self) -> Array:
        """Unit vector (3,) towards west, in the model's frame."""
        return self.matrix[0]

    @property
    def up(self) -> Array:
        """Unit vector (3,) towards north, in the model's frame."""
        return self.matrix[1]

    @property
    def forward(self) -> Array:
        """Unit vector (3,) from the observer to the nebula, in the model's frame."""
        return -self.matrix[2]

    @property
    def position(self) -> Array:
        """Where the observer is, in the model's frame (3,) [m]."""
        return -self.distance * self.forward


class SpaceScene(Record):
    """Everything that decides what a ray of light sees in a nebula.

    Parameters
    ----------
    medium : Medium
        Of density fields in three dimensions.
    stars : tuple of PointStar
        Inside the medium or outside; they light it, and are seen.
    parallel : tuple of ParallelLight
        Lights so distant that their rays are parallel.
    background : float or SpectralTable or "interstellar"
        Uniform radiance from outside [W m-2 sr-1 nm-1]; the last is that of the Galaxy near the Sun.
    star_field : StarField, optional
        Stars behind everything: seen through the dust, they do not light it.
    view : View

    Examples
    --------
    A star in the middle of a ball of dust, and how many magnitudes it loses on the way to the observer.

    >>> import skyscatter
    >>> from skyscatter import fields
    >>> ball = skyscatter.Component(
    ...     name="ball", density=fields.Sphere(radius="0.1 pc"), optics=skyscatter.Dust(visual_extinction=6.0)
    ... )
    >>> star = skyscatter.PointStar(temperature=10000, luminosity=50)
    >>> scene = skyscatter.SpaceScene(medium=skyscatter.Medium(components=(ball,)), stars=(star,))
    >>> depth = skyscatter.optical_depth(scene, star.position, scene.observer.position, [450, 550])
    >>> (1.0857 * depth).round(2)
    array([3.86, 3.  ])
    """

    medium: Medium
    stars: tuple[PointStar, ...] = ()
    parallel: tuple[ParallelLight, ...] = ()
    background: Background = default(0.0)
    star_field: StarField | None = None
    view: View = View()

    @model_validator(mode="after")
    def _check(self) -> SpaceScene:
        if self.medium.planet_radius is not None:
            raise DomainError("medium", "planet_radius", "a scene in space has no planet; leave it out")
        for component in self.medium.components:
            if component.density.kind == "everywhere":
                rule = "has no end; it is for scenes with surfaces, give this component a field that ends"
                raise DomainError("density", "everywhere", rule)
        return self

    @property
    def observer(self) -> View:
        """The observer as cameras see it."""
        return self.view

    def background_radiance(self, wavelengths_nm: ArrayLike) -> Array:
        """Uniform radiance from outside [W m-2 sr-1 nm-1], shape (wavelength,)."""
        if self.background == "interstellar":
            from skyscatter.lights import interstellar_radiation

            return interstellar_radiation(wavelengths_nm)
        return evaluate(self.background, wavelengths_nm)

    def check_origins(self, origins: Array) -> None:
        """Rays may start anywhere."""


def width_of_all(scene: Any, ratio: float) -> float:
    """Width [m] of a picture that holds all components, seen along the line of sight, with a little room around.

    Parameters
    ----------
    scene : SpaceScene
    ratio : float
        The picture's width over its height.

    Raises
    ------
    DomainError
        If a component has no end.

    Examples
    --------
    >>> import skyscatter
    >>> from skyscatter import fields
    >>> from skyscatter.space import width_of_all
    >>> ball = skyscatter.Component(
    ...     name="ball", density=fields.Sphere(radius="10 m"), optics=skyscatter.Dust(visual_extinction=1.0)
    ... )
    >>> scene = skyscatter.SpaceScene(medium=skyscatter.Medium(components=(ball,)))
    >>> round(width_of_all(scene, 1.0), 3)
    21.0
    """
    half = np.zeros(2)
    axes = np.stack([scene.view.right, scene.view.up])
    for component in scene.medium.components:
        field: Any = component.density
        low, high = (np.asarray(edge, dtype=float) for edge in field.bounds)
        corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1)
        with np.errstate(invalid="ignore"):  # an endless field: infinity times zero
            half = np.maximum(half, np.abs(axes @ corners).max(axis=1))
    if not np.all(np.isfinite(half)) or not half.max() > 0.0:
        rule = "the nebula has no finite extent; give --field-of-view or --pixel-scale"
        raise DomainError("field_of_view", None, rule)
    return float(2.0 * MARGIN * max(half[0], half[1] * ratio))
