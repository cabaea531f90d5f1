"""What a user may say about a picture and about the veil on it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator

from skyscatter.dehaze.picture.transfer import Transfer, check_transfer
from skyscatter.record import Record

CAMERA = (600.0, 545.0, 465.0)
"""Effective wavelengths of red, green and blue of a generic sRGB camera in daylight, nm."""


class PictureOptions(Record):
    """How a picture without metadata is read.

    Attributes
    ----------
    transfer : "linear", "srgb" or float
        The curve between light and the values of the picture.  The products that satellite images are shown from are
        as a rule straight stretches of counts, hence ``"linear"``; pictures of a camera are ``"srgb"``.
    wavelengths : tuple of float
        Effective wavelengths of the bands, nm.
    alpha : float or None
        Exponent of the veil's optical depth, 0 (fog) to 4 (air); None fits it.
    shape : "auto", "uniform"
        Whether the veil may differ from place to place where the picture shows that it does.
    levels : int
        Steps of the picture's scale, for the noise of quantisation: 256 for 8 bits.
    cells : int
        Cells of the lattice along the longer edge of the image, at most.
    """

    transfer: Transfer = "linear"
    wavelengths: tuple[float, ...] = CAMERA
    alpha: float | None = Field(default=None, ge=0.0, le=4.0)
    shape: Literal["auto", "uniform"] = "auto"
    levels: int = Field(default=256, ge=2)
    cells: int = Field(default=128, ge=16, le=512)

    @field_validator("transfer")
    @classmethod
    def _known_curve(cls, value: Transfer) -> Transfer:
        return check_transfer(value)

    @field_validator("wavelengths")
    @classmethod
    def _visible(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if len(value) not in (1, 3) or not all(300.0 <= nm <= 2500.0 for nm in value):
            raise ValueError("give one or three wavelengths from 300 to 2500 nm")
        return value
