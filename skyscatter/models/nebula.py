"""Model files of nebulae: gas and dust in space, their stars, and where they stand in the sky."""

from __future__ import annotations

from typing import ClassVar

from pydantic import model_validator

from skyscatter.lights import ParallelLight, PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.models.base import ModelFile
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import Background
from skyscatter.starfield import StarField
from skyscatter.units import OptionalNumber, PositiveMetres, default


class NebulaModel(ModelFile):
    """What a nebula's model file says; `scene` turns it as it is to be seen.

    Parameters
    ----------
    name : str
        How the model is called.
    description : str
        What it is, in a sentence.
    sources : tuple of str
        Where the numbers come from.
    view : View
        Position, distance and orientation.
    components : tuple of Component
        Gas and dust; their densities are fields in three dimensions.
    stars : tuple of PointStar
        Stars as points, inside or outside.
    parallel : tuple of ParallelLight
        Lights from far away.
    background : float or SpectralTable or "interstellar"
        Uniform radiance from outside [W m-2 sr-1 nm-1].
    star_field : StarField, optional
        Stars behind everything, seen through the dust.
    picture_width : length, optional
        Width of a picture that shows it well, at its distance [m]; all of it when not given.

    Examples
    --------
    >>> import skyscatter
    >>> model = skyscatter.load_model("star-in-dust")  # or one read from a file, or made of its parts
    >>> star = model.stars[0]
    >>> star.temperature, star.luminosity  # K, and in units of the Sun's
    (8000.0, 150.0)
    >>> scene = model.scene(inclination_deg=90)  # seen from the side
    >>> towards = skyscatter.optical_depth(scene, star.position, scene.view.position, [550, 2200])
    >>> (1.0857 * towards).round(1)  # magnitudes of extinction to the star
    array([9.3, 1. ])
    """

    command: ClassVar[str] = "nebula"

    view: View
    components: tuple[Component, ...]
    stars: tuple[PointStar, ...] = ()
    parallel: tuple[ParallelLight, ...] = ()
    background: Background = default(0.0)
    star_field: StarField | None = None
    picture_width: OptionalNumber[PositiveMetres] = default(None)

    @model_validator(mode="after")
    def _check(self) -> NebulaModel:
        _ = self.scene()
        return self

    @property
    def medium(self) -> Medium:
        """Gas and dust."""
        return Medium(components=self.components)

    def scene(
        self,
        inclination_deg: float | None = None,
        azimuth_deg: float | None = None,
        position_angle_deg: float | None = None,
    ) -> SpaceScene:
        """The scene, turned as the model says or by other angles.

        Parameters
        ----------
        inclination_deg, azimuth_deg, position_angle_deg : float, optional
            [degree]; those of the model's view when not given.  See `View`.

        Returns
        -------
        SpaceScene

        Examples
        --------
        >>> import numpy as np
        >>> import skyscatter
        >>> model = skyscatter.load_model("dusty-disk")
        >>> scene = model.scene(inclination_deg=90)  # edge-on
        >>> west, north, towards_us = scene.view.matrix @ [0, 0, 1]  # the disk's axis, in the frame of the sky
        >>> round(float(np.degrees(np.arccos(towards_us))))  # between the axis and the line of sight [degree]
        90
        """
        given = {
            "inclination_deg": inclination_deg,
            "azimuth_deg": azimuth_deg,
            "position_angle_deg": position_angle_deg,
        }
        turned = {name: value for name, value in given.items() if value is not None}
        view = View(**{**self.view.model_dump(), **turned})
        return SpaceScene(
            medium=self.medium,
            stars=self.stars,
            parallel=self.parallel,
            background=self.background,
            star_field=self.star_field,
            view=view,
        )
