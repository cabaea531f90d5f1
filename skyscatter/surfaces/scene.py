"""A scene of surfaces: bodies, the media in and around them, lamps, and from where all that is seen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skyscatter.errors import DomainError
from skyscatter.media.fields import DensityField
from skyscatter.media.medium import Component
from skyscatter.record import Record, nearest
from skyscatter.spectra.table import Index
from skyscatter.surfaces.indices import check_index
from skyscatter.surfaces.lamps import AnyLamp, AreaLamp
from skyscatter.surfaces.materials import AnyMaterial
from skyscatter.surfaces.meshes import AnyShape
from skyscatter.units import Place, Triple, default

Array = NDArray[np.float64]


def _distinct(field: str, parts: Sequence[Any]) -> None:
    names = [part.name for part in parts]
    for name in names:
        if names.count(name) > 1:
            raise DomainError(field, name, "two of one name; rename one")


class SurfaceMedium(Record):
    """What fills the space in a body, or outside of all of them.

    Parameters
    ----------
    name : str
        By which bodies name it.
    components : tuple of Component
        What scatters and absorbs in it, with fields in three dimensions (in the frame of the scene); most often of the
        density "everywhere".  None at all: a vacuum, or something as clear.
    index : float or SpectralTable or str
        Refractive index; by name "water", "bk7" or "fused-silica", see `skyscatter.surfaces.indices`.
    priority : int
        Where bodies overlap, the medium of highest priority is the one that is there (of equals the one entered last).

    Examples
    --------
    Fog that scatters 30 times in a kilometre, in which one sees some 130 m (Koschmieder's 3.912 mean free paths).

    >>> import skyscatter
    >>> drops = skyscatter.Particles(extinction="30 km-1", phase={"kind": "henyey-greenstein", "g": 0.85})
    >>> fog = skyscatter.SurfaceMedium(
    ...     name="fog", components=(skyscatter.Component(name="drops", density={"kind": "everywhere"}, optics=drops),)
    ... )
    >>> round(3.912 / fog.components[0].optics.extinction)  # m
    130
    """

    name: str
    components: tuple[Component, ...] = ()
    index: Index = default(1.0)
    priority: Annotated[int, Field(ge=-1000, le=1000)] = 0

    @model_validator(mode="after")
    def _check(self) -> SurfaceMedium:
        check_index(self.index)
        for component in self.components:
            if isinstance(component.density, DensityField):
                rule = 'belongs to a planet; use "everywhere", "around-planet" or another field of three dimensions'
                raise DomainError("density", component.density.kind, rule)
        _distinct("components", self.components)
        return self


class Body(Record):
    """A shape made of a material; it may bound a medium, and may shine.

    Parameters
    ----------
    name : str
        How lists and errors call it.
    shape : shape
        Where its surface is, by kind.
    material : material
        What its surface does to light.
    inside : str, optional
        Name of the medium that fills it.
    lamp : AreaLamp, optional
        What makes it shine, outwards (a rectangle or a disk: to the side of its normal).

    Examples
    --------
    A ball of water, of which the scene's media say what it is, and a panel of 800 lumens that shines to the side of its
    normal, with its power at 550 nm [mW nm-1].

    >>> import skyscatter
    >>> from skyscatter.surfaces import AreaLamp, Dielectric, Lambert, Rectangle, Sphere
    >>> drop = skyscatter.Body(name="drop", shape=Sphere(radius="2 cm"), material=Dielectric(), inside="water")
    >>> panel = skyscatter.Body(
    ...     name="panel",
    ...     shape=Rectangle(position=(0, 0, 1), normal=(0, 0, -1), size=(0.5, 0.5)),
    ...     material=Lambert(albedo=0),
    ...     lamp=AreaLamp(lumens=800, spectrum="led-4000k"),
    ... )
    >>> (1e3 * panel.lamp.spectral_power([550], area=0.25)).round(1)
    array([11.4])
    """

    name: str = "body"
    shape: AnyShape
    material: AnyMaterial
    inside: str | None = None
    lamp: AreaLamp | None = None

    @model_validator(mode="after")
    def _check(self) -> Body:
        shape = self.shape.kind
        if self.inside is not None and not self.shape.holds_volume:
            rule = f"{self.name}: a {shape} holds no volume; give a sphere, box, plane or closed mesh"
            raise DomainError("inside", self.inside, rule)
        if self.lamp is not None and shape == "plane":
            raise DomainError("lamp", self.name, "a plane has no end, and so no power; use a rectangle or a disk")
        if self.lamp is not None and self.material.kind == "interface":
            rule = 'an interface is not there for light; make the lamp of { kind = "lambert", albedo = 0 }'
            raise DomainError("material", "interface", rule)
        if self.inside is None and self.material.kind in ("interface", "dielectric"):
            raise DomainError("inside", None, f"{self.name}: its material is a boundary; name the medium in it")
        return self


class Sight(NamedTuple):
    """Where one looks from, and the axes of the picture, as cameras ask for them; each of shape (3,)."""

    position: Array  #: [m]
    forward: Array  #: unit vector towards the middle of the picture
    right: Array  #: unit vector to the right
    up: Array  #: unit vector upwards, across the line of sight


class Viewpoint(Record):
    """From where, and whereto, one looks.

    Parameters
    ----------
    position, target : three lengths
        [m]; in the middle of a picture is the target.
    up : three floats
        The direction that is upwards in the picture, of any length, not along the line of sight.

    Examples
    --------
    From a height of 2 m one looks down on a target 10 m ahead.

    >>> import numpy as np
    >>> import skyscatter
    >>> sight = skyscatter.Viewpoint(position=(0, 0, "2 m"), target=(0, "10 m", 0)).sight
    >>> round(float(np.degrees(np.arcsin(sight.forward[2]))), 1)  # elevation of the middle of the picture [degree]
    -11.3
    """

    position: Place = default((0.0, 0.0, 0.0))
    target: Place = default((0.0, 1.0, 0.0))
    up: Triple = default((0.0, 0.0, 1.0))

    @model_validator(mode="after")
    def _check(self) -> Viewpoint:
        line = np.subtract(self.target, self.position)
        if not np.linalg.norm(line) > 0:
            raise DomainError("target", self.target, "is where the observer stands; name another point")
        if not np.linalg.norm(np.cross(line, self.up)) > 1e-9 * np.linalg.norm(line) * np.linalg.norm(self.up):
            raise DomainError("up", self.up, "must not be 0, nor along the line of sight; name another direction")
        return self

    @property
    def sight(self) -> Sight:
        """The same as cameras ask for it."""
        line = np.subtract(self.target, self.position)
        forward = line / np.linalg.norm(line)
        side = np.cross(forward, self.up)
        right = side / np.linalg.norm(side)
        return Sight(np.array(self.position), forward, right, np.cross(right, forward))


class SurfaceScene(Record):
    """Everything that decides what a ray of light sees among surfaces.

    Parameters
    ----------
    media : tuple of SurfaceMedium
        The first is what is outside of all bodies; a vacuum if there is none.
    bodies : tuple of Body
    lamps : tuple of lamps
        Beside those bodies that shine.
    viewpoint : Viewpoint

    Examples
    --------
    A white table under the Sun: its radiance is albedo times irradiance over pi, 0.8 x 1.5 x sin 30 deg / pi.

    >>> import skyscatter
    >>> from skyscatter.surfaces import Lambert, ParallelLamp, Plane
    >>> table = skyscatter.Body(name="table", shape=Plane(), material=Lambert(albedo=0.8))
    >>> sun = ParallelLamp(elevation_deg=30, azimuth_deg=180, irradiance=1.5)  # W m-2 nm-1
    >>> scene = skyscatter.SurfaceScene(bodies=(table,), lamps=(sun,))
    >>> seen = skyscatter.radiance(scene, [0, 0, 1], [0, 0, -1], [550], solver=skyscatter.Path(samples=16))
    >>> seen.radiance.round(3)  # W m-2 sr-1 nm-1
    array([0.191])
    """

    media: tuple[SurfaceMedium, ...] = (SurfaceMedium(name="outside"),)
    bodies: tuple[Body, ...] = ()
    lamps: tuple[AnyLamp, ...] = ()
    viewpoint: Viewpoint = Viewpoint()

    @model_validator(mode="after")
    def _check(self) -> SurfaceScene:
        if not self.media:
            raise DomainError("media", 0, "at least one, which is outside of all bodies")
        _distinct("media", self.media)
        names = [medium.name for medium in self.media]
        for body in self.bodies:
            if body.inside is not None and body.inside not in names:
                rule = f"body {body.name}: no such medium; {nearest(body.inside, names)}"
                raise DomainError("inside", body.inside, rule)
        for kind in ("surroundings", "environment"):
            if sum(lamp.kind == kind for lamp in self.lamps) > 1:
                raise DomainError("lamps", kind, "twice; add their radiances into one")
        return self

    @property
    def observer(self) -> Sight:
        """The observer as cameras see it."""
        return self.viewpoint.sight

    def check_origins(self, origins: Array) -> None:
        """Rays may start anywhere."""
