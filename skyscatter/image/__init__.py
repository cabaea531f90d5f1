"""Pictures with a spectrum in every pixel: colour, tone, and files that say how to make them again."""

from __future__ import annotations

from skyscatter.image.filterimage import FilterImage
from skyscatter.image.filters import FilterCurve
from skyscatter.image.instrument import observe
from skyscatter.image.photometry import Counts, photometric
from skyscatter.image.skyframe import SkyFrame
from skyscatter.image.spectral import SpectralImage

__all__ = ["Counts", "FilterCurve", "FilterImage", "SkyFrame", "SpectralImage", "observe", "photometric"]
