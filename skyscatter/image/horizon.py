"""Where the pixels of a planet's sky look: azimuth, elevation and the Sun, from the recipe of a picture."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.geometry.camera import CAMERAS
from skyscatter.geometry.vectors import azimuth_elevation_from_direction
from skyscatter.scene import Scene

Array = NDArray[np.float64]


class SkyView(NamedTuple):
    """The camera of a picture of a sky, and the scene with its observer and its Sun."""

    camera: Any
    scene: Scene

    @property
    def directions(self) -> Array:
        """Unit vectors (east, north, up) through the pixel centres, shape (y, x, 3); NaN outside the field."""
        return np.asarray(self.camera.directions(self.scene.observer))

    def angles(self) -> tuple[Array, Array, Array]:
        """Azimuth from north through east, elevation, and scattering angle of sunlight [degree], each of (y, x).

        The scattering angle is that between the line of sight and the direction to the Sun's middle: 0 looks into it.
        """
        d, sun = self.directions, self.scene.sun.direction
        scattering = np.degrees(np.arctan2(np.linalg.norm(np.cross(d, sun), axis=-1), d @ sun))
        return *azimuth_elevation_from_direction(d), scattering

    def solid_angle(self) -> Array:
        """Solid angle of each pixel [sr], shape (y, x); 0 outside the field."""
        return np.asarray(self.camera.pixel_solid_angle(self.scene.observer))


def sky_view(image: Any) -> SkyView | None:
    """Camera and scene of a picture of a planet's sky, by its recipe; None for all other pictures.

    Parameters
    ----------
    image : SpectralImage or FilterImage
        One that was cut or made smaller no longer has the size of its camera, and so no view.
    """
    scene, camera = (image.recipe.get(name) for name in ("scene", "camera"))
    if not (isinstance(scene, dict) and isinstance(camera, dict) and isinstance(scene.get("medium"), dict)):
        return None
    if "planet_radius" not in scene["medium"] or camera.get("kind") not in CAMERAS:
        return None
    try:
        view = SkyView(CAMERAS[camera["kind"]](**camera), Scene.model_validate(scene))
        view.camera.through(0.0, 0.0, view.scene.observer)
    except (SkyscatterError, ValidationError):  # of another version, or a camera that this observer cannot have
        return None
    return view if (view.camera.height, view.camera.width) == tuple(image.radiance.shape[:2]) else None


def pixel_solid_angle(image: Any, purpose: str) -> Array:
    """Solid angle of each pixel [sr], shape (y, x), of an image with a celestial frame or of a planet's sky.

    Raises
    ------
    DomainError
        If the image says neither; `purpose` is what it was wanted for.
    """
    height, width = image.radiance.shape[:2]
    if image.sky is not None:
        return np.asarray(image.sky.pixel_solid_angle(width, height))
    view = sky_view(image)
    if view is None:
        raise DomainError("sky", None, f"{purpose} needs the pixel scale: give the image a SkyFrame")
    return view.solid_angle()
