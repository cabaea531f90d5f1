"""Pictures with a spectrum in every pixel: colour, tone, and files that say how to make them again."""

from __future__ import annotations

from skyscatter.image.spectral import SpectralImage

__all__ = ["SpectralImage"]
