"""Where a picture stands in the sky: the tangent point, the pixel scale and the distance."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from skyscatter.errors import DomainError
from skyscatter.record import Record
from skyscatter.units import Metres, OptionalNumber, default

Array = NDArray[np.float64]
Turn = Annotated[float, Field(ge=-360.0, le=360.0)]
TURNS = ("inclination_deg", "azimuth_deg", "position_angle_deg")


class SkyFrame(Record):
    """Celestial coordinates of a picture: gnomonic (TAN) about its centre, north up, east left, square pixels.

    The centre is that of the picture, ((width - 1) / 2, (height - 1) / 2) in array indices, a corner of four pixels
    where width and height are even.

    Parameters
    ----------
    ra_deg, dec_deg : float
        Of the picture's centre [degree].
    pixel_scale_deg : float
        Side of a pixel in the middle of the picture [degree].
    distance : length, optional
        Of the object [m].
    name : str
        Of the object; printable ASCII, 68 letters at most.
    frame : {"icrs"}
        Of the coordinates.
    inclination_deg, azimuth_deg, position_angle_deg : float, optional
        How the model is turned, for the record [degree]; see `skyscatter.View`.

    Examples
    --------
    >>> import skyscatter
    >>> sky = skyscatter.SkyFrame(ra_deg=83.63, dec_deg=22.01, pixel_scale_deg=10 / 3600)
    >>> ra, dec = sky.coordinates(width=5, height=3)  # of the pixels' centres [degree], each (y, x)
    >>> ra[1].round(3)  # east is left
    array([83.636, 83.633, 83.63 , 83.627, 83.624])
    >>> dec[:, 2].round(3)  # the first row is the northernmost
    array([22.013, 22.01 , 22.007])
    """

    ra_deg: Annotated[float, Field(ge=0.0, lt=360.0)]
    dec_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    pixel_scale_deg: Annotated[float, Field(gt=0.0, le=60.0)]
    distance: Annotated[Metres, Field(gt=0.0)] | None = None  #: [m]
    name: Annotated[str, Field(max_length=68, pattern=r"^[ -~]*$")] = ""  #: of the object; as FITS takes it
    frame: Literal["icrs"] = "icrs"
    #: How the model is turned (for the record: the picture itself always has north up).
    inclination_deg: OptionalNumber[Turn] = default(None)
    azimuth_deg: OptionalNumber[Turn] = default(None)
    position_angle_deg: OptionalNumber[Turn] = default(None)

    @classmethod
    def seen(cls, view: Any, camera: Any, name: str = "") -> SkyFrame:
        """Frame of a telescope's picture: of a view with ``ra_deg``, ``dec_deg``, ``distance`` [m] and its angles."""
        return cls(
            ra_deg=view.ra_deg,
            dec_deg=view.dec_deg,
            pixel_scale_deg=camera.pixel_scale_deg,
            distance=view.distance,
            name=name,
            **{turn: getattr(view, turn) for turn in TURNS},
        )

    def coordinates(self, width: int, height: int, rows: slice = slice(None)) -> tuple[Array, Array]:
        """Right ascension (0 to 360) and declination of the pixel centres [degree], each of shape (row, width).

        Of all rows of a picture of that size, or of some of them.
        Calabretta & Greisen (2002, A&A 395, 1077), equations 54 and 2, for LONPOLE = 180 degrees, written with vectors
        so that the pole is no exception.
        """
        east, north = (values[rows] for values in self._plane(width, height))
        d = np.radians(self.dec_deg)
        toward_pole = np.sin(d) + north * np.cos(d)
        outward = np.cos(d) - north * np.sin(d)
        ra = np.degrees(np.arctan2(east, outward)) + self.ra_deg
        dec = np.degrees(np.arctan2(toward_pole, np.hypot(outward, east)))
        return np.mod(ra, 360.0), dec

    def pixel_solid_angle(self, width: int, height: int, rows: slice = slice(None)) -> Array:
        """Solid angle of each pixel [sr], shape (row, width)."""
        east, north = (values[rows] for values in self._plane(width, height))
        # the area of a pixel of the tangent plane, seen obliquely from further away
        return np.radians(self.pixel_scale_deg) ** 2 / (1.0 + east**2 + north**2) ** 1.5

    def _plane(self, width: int, height: int) -> tuple[Array, Array]:
        """East and north of the centre in the tangent plane, in radii of the unit sphere."""
        step = np.radians(self.pixel_scale_deg)
        east = ((width - 1) / 2 - np.arange(width)) * step
        north = ((height - 1) / 2 - np.arange(height)) * step
        return np.broadcast_to(east, (height, width)), np.broadcast_to(north[:, None], (height, width))


def read_sky(text: str | None, path: Any) -> SkyFrame | None:
    """Frame from the JSON in a file; None from None."""
    if text is None:
        return None
    try:
        return SkyFrame.model_validate_json(text)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]["msg"]
        raise DomainError("sky", str(path), f"holds no celestial frame that can be read ({problem})") from error
