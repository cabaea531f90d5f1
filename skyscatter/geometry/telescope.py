"""The camera of astronomers: gnomonic projection about a point of the sky, pixels given by their angle."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Protocol

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.geometry.pinhole import Array, Pinhole
from skyscatter.units import ANGLE, metres


class ViewLike(Protocol):
    """What a telescope asks of its observer: three orthogonal unit vectors of shape (3,) in the model's frame."""

    @property
    def right(self) -> Any:
        """Right in the picture; west where north is up."""

    @property
    def up(self) -> Any:
        """Up in the picture; north."""

    @property
    def forward(self) -> Any:
        """From the observer towards the middle of the picture."""


class Telescope(Pinhole):
    """Gnomonic (TAN) picture with square pixels about the observer's axis.

    A pixel at the centre spans ``pixel_scale_deg``, so that the focal length is ``f = 1 / radians(pixel_scale_deg)``
    pixels and a direction at the angle θ from the axis stands ``f tan θ`` pixels from the centre (Calabretta & Greisen
    2002, A&A 395, 1077, section 5.1.3).  The directions are in the frame in which the observer states its axes.

    Parameters
    ----------
    pixel_scale_deg : float
        Side of a pixel in the middle of the picture [degree].

    Examples
    --------
    A picture of 256 pixels that is 12 arc minutes wide.

    >>> import skyscatter
    >>> camera = skyscatter.Telescope.from_field_of_view(256, 256, 0.2)
    >>> round(3600 * camera.pixel_scale_deg, 2)  # arc seconds
    2.81
    >>> x, y = camera.pixel([0, 0, -1], skyscatter.View())  # the way from the observer to the nebula
    >>> round(float(x), 1), round(float(y), 1)
    (127.5, 127.5)
    """

    kind: Literal["telescope"] = "telescope"
    pixel_scale_deg: Annotated[float, ANGLE.within(0.0, 60.0, above=True)]

    @classmethod
    def from_field_of_view(cls, width: int, height: int, field_of_view_deg: float) -> Telescope:
        """Telescope whose picture spans an angle [degree] from its left to its right edge.

        Raises
        ------
        DomainError
            If the angle is not between 0 and 180 degrees.
        """
        if not 0.0 < field_of_view_deg < 180.0:
            raise DomainError("field_of_view_deg", field_of_view_deg, "an angle above 0 and below 180 degrees")
        scale = 2.0 * np.tan(np.radians(field_of_view_deg) / 2.0) / width
        return cls(width=width, height=height, pixel_scale_deg=float(np.degrees(scale)))

    @classmethod
    def from_length(cls, width: int, height: int, length: Any, distance: Any) -> Telescope:
        """Telescope whose picture is `length` wide at `distance`, in the plane through the nebula across the axis.

        Parameters
        ----------
        width, height : int
            Size of the picture [pixel].
        length, distance : float, str or Quantity
            Lengths, such as ``"2 pc"`` (numbers are metres).

        Raises
        ------
        DomainError
            If one of them is not positive.

        Examples
        --------
        >>> import skyscatter
        >>> camera = skyscatter.Telescope.from_length(256, 256, "2 pc", "400 pc")
        >>> round(3600 * camera.pixel_scale_deg, 2)  # arc seconds
        4.03
        """
        across, away = metres(length, "length"), metres(distance, "distance")
        for name, given, value in (("length", length, across), ("distance", distance, away)):
            if not 0.0 < value < np.inf:
                raise DomainError(name, given, "a length above 0")
        return cls(width=width, height=height, pixel_scale_deg=float(np.degrees(across / away / width)))

    def _view(self, observer: Any) -> tuple[float, Array, Array, Array]:
        if not all(hasattr(observer, name) for name in ("forward", "right", "up")):
            raise DomainError("observer", type(observer).__name__, "a telescope needs right, up and forward")
        axes = [np.asarray(getattr(observer, name), dtype=float) for name in ("forward", "right", "up")]
        return 1.0 / float(np.radians(self.pixel_scale_deg)), axes[0], axes[1], axes[2]
