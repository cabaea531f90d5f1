"""What dehazing returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Summary:
    """What was found and done, for reports.

    Attributes
    ----------
    content : dict
        Names and numbers, as JSON can hold them.
    """

    content: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        """The content."""
        return dict(self.content)


@dataclass(frozen=True)
class DehazeResult:
    """An image without its haze, and what is known of the haze and of the result's errors.

    Arrays are like the image that was given: numpy arrays, or labelled ones with its coordinates.

    Attributes
    ----------
    reflectance : array, shape (band, y, x)
        Surface reflectance; of a plain picture display values (see `is_relative`).  NaN (nodata in pictures) where
        nothing was measured.
    sigma : array, shape (band, y, x)
        Standard deviation of it.
    haze_map : array, shape (1, y, x)
        Aerosol optical depth at 550 nm; of a plain picture the optical depth of the veil.
    mask : array of uint8, shape (1, y, x)
        Bits of `skyscatter.dehaze.Flag`.
    diagnostics : dict
        The haze's mean and uncertainty, the aerosol model, what was assumed.

    Examples
    --------
    A plain picture in three colours, with a veil that thickens from left to right:

    >>> import numpy as np
    >>> import skyscatter
    >>> ground = 0.6 * np.random.default_rng(0).random((3, 64, 64)) ** 2
    >>> picture = 0.7 + (ground - 0.7) * np.exp(-np.linspace(0, 1.2, 64))
    >>> result = skyscatter.dehaze(picture, quantity="display", bands=("red", "green", "blue"))
    >>> result.reflectance.shape, result.haze_map.shape, result.is_relative
    ((3, 64, 64), (1, 64, 64), True)
    >>> left, right = result.haze_map[..., :8].mean(), result.haze_map[..., -8:].mean()
    >>> bool(left < 0.1), bool(right > 0.7)  # optical depths; 0.08 and 1.12 were put in
    (True, True)
    """

    reflectance: Any
    sigma: Any
    haze_map: Any
    mask: NDArray[np.uint8] | Any
    diagnostics: dict[str, Any] = field(default_factory=dict)

    @property
    def is_relative(self) -> bool:
        """Whether the result is a picture without its veil rather than reflectance."""
        return bool(self.diagnostics.get("kind") != "surface reflectance")

    @property
    def aerosol(self) -> dict[str, Any] | None:
        """Amount and model of the aerosol; None for plain pictures."""
        if self.is_relative:
            return None
        return {"aod": self.diagnostics["aod"], **self.diagnostics["aerosol"]}
