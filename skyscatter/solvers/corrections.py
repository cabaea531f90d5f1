"""What is added to the light along the rays of a nebula's picture: its stars, and light right beside them.

All of it can be asked for some rows of a picture alone, with the same digits as for the whole.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from skyscatter.geometry.telescope import Telescope
from skyscatter.image.skyframe import SkyFrame
from skyscatter.solvers.base import Array
from skyscatter.solvers.checks import is_space
from skyscatter.solvers.run import load_solver

if TYPE_CHECKING:
    from skyscatter.solvers.starlight import StarLight


def seen(scene: Any, camera: Any) -> Array:
    """Directions of the pixels, NaN outside of the camera's field, shape (y, x, 3)."""
    return _moved(scene, camera, np.asarray(camera.directions(scene.observer)), 0)


def seen_rows(scene: Any, camera: Any, first: int, last: int) -> Array:
    """Directions of the rows from `first` on and before `last`, of cameras that see in every pixel."""
    rows = camera.through(np.arange(camera.width), np.arange(first, last)[:, None], scene.observer)
    return _moved(scene, camera, np.asarray(rows), first)


def _moved(scene: Any, camera: Any, grid: Array, first: int) -> Array:
    if not (isinstance(camera, Telescope) and is_space(scene)):
        return grid
    from skyscatter.solvers.starlight import beside_stars

    return beside_stars(scene, camera, grid, first)


class Corrections:
    """What is added to the rays of a picture of a nebula; nothing to those of other pictures.

    Parameters
    ----------
    scene : SpaceScene or SurfaceScene
    camera : Camera
    wl : ndarray, shape (wavelength,)
        [nm]
    """

    def __init__(self, scene: Any, camera: Any, wl: Array) -> None:
        self.scene, self.camera, self.wl = scene, camera, wl
        self._needed = isinstance(camera, Telescope) and is_space(scene)

    @property
    def sky(self) -> SkyFrame | None:
        """Where the picture stands in the sky."""
        return SkyFrame.seen(self.scene.view, self.camera) if self._needed else None

    @cached_property
    def _light(self) -> list[StarLight]:
        from skyscatter.solvers.starlight import star_light

        return star_light(self.scene, self.camera, self.wl)

    def add(self, grid: Array, cube: Array, layers: dict[str, Array], recipe: dict[str, Any], first: int = 0) -> None:
        """Add it to rows of a picture, in place.

        Parameters
        ----------
        grid : ndarray, shape (row, column, 3)
            Directions of the rays.
        cube : ndarray, shape (row, column, wavelength)
        layers : dict of str to ndarray, of the same shape
        recipe : mapping
            Of the picture.
        first : int
            Row of the whole picture at which these begin.
        """
        if not self._needed:
            return
        from skyscatter.solvers.starlight import close_correction, star_images

        usual = load_solver(recipe["solver"], self.scene).DEFAULT_TOLERANCE
        tolerance = recipe["options"].get("tolerance", usual)
        correction = close_correction(self.scene, self.camera, grid, self.wl, tolerance, first)
        stars = star_images(self.scene, self.camera, self.wl, slice(first, first + len(grid)), self._light)
        cube += stars
        for name in ("direct",) if "direct" in layers else ():
            layers[name] += stars
        if correction is not None:
            cube[correction[0]] += correction[1]
            for name in ("scattered", "order1"):
                if name in layers:
                    layers[name][correction[0]] += correction[1]
