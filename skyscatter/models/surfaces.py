"""Model files of scenes with surfaces: media, bodies, lamps, and the camera that looks at them."""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.geometry.camera import Camera, Perspective
from skyscatter.models.base import ModelFile
from skyscatter.surfaces.lamps import AnyLamp
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene, Viewpoint


class SurfaceModel(ModelFile):
    """What a model file of surfaces says.

    Parameters
    ----------
    name : str
        How the model is called.
    description : str
        What it is, in a sentence.
    sources : tuple of str
        Where the numbers come from.
    viewpoint : Viewpoint
        From where, and whereto, one looks.
    camera : camera
        A `Perspective` without azimuth looks as the viewpoint says; a `Fisheye` or a `Panorama` stands at its position
        (z up).
    media : tuple of SurfaceMedium
        The first is outside of all bodies; a vacuum if there is none.
    bodies : tuple of Body
        What is there.
    lamps : tuple of lamps
        What shines beside bodies that do.

    Examples
    --------
    >>> import skyscatter
    >>> model = skyscatter.load_model("milk-and-water")
    >>> [(medium.name, medium.index) for medium in model.media]
    [('room', 1.0), ('glass', 1.52), ('water', 1.336), ('milk', 1.336)]
    >>> scene = model.scene(position=(0, "-1 m", "0.3 m"))  # seen from elsewhere
    >>> scene.observer.position
    array([ 0. , -1. ,  0.3])
    """

    command: ClassVar[str] = "render"

    viewpoint: Viewpoint
    camera: Camera = Perspective(width=320, height=240, fov_deg=60.0)
    media: tuple[SurfaceMedium, ...] = (SurfaceMedium(name="outside"),)
    bodies: tuple[Body, ...] = ()
    lamps: tuple[AnyLamp, ...] = ()

    @model_validator(mode="after")
    def _check(self) -> SurfaceModel:
        _ = self.scene()
        if self.camera.kind == "planet":
            raise DomainError("camera", "planet", "there is no planet to look at; choose perspective or fisheye")
        return self

    def scene(self, position: Any = None, target: Any = None, up: Any = None) -> SurfaceScene:
        """The scene, seen as the model says or from elsewhere.

        Parameters
        ----------
        position, target : three lengths, optional
            [m]; those of the model's viewpoint when not given.
        up : three floats, optional
            Direction that is upwards in the picture.

        Returns
        -------
        SurfaceScene

        Examples
        --------
        >>> import skyscatter
        >>> scene = skyscatter.load_model("fog-room").scene(position=("1 m", "-2 m", "1.5 m"))
        >>> scene.observer.position
        array([ 1. , -2. ,  1.5])
        """
        given = {"position": position, "target": target, "up": up}
        seen = {name: value for name, value in given.items() if value is not None}
        viewpoint = Viewpoint(**{**self.viewpoint.model_dump(), **seen})
        return SurfaceScene(media=self.media, bodies=self.bodies, lamps=self.lamps, viewpoint=viewpoint)
