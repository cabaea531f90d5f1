"""What the bits of a dehazed image's mask say about a pixel."""

from __future__ import annotations

NODATA = 1
"""Nothing was measured here."""
SATURATED = 2
"""At least one band is at the end of its scale."""
CLOUD = 4
CIRRUS = 8
WATER = 16
SHADOW = 32
CLIPPED = 64
"""A result below zero was set to zero."""
UNCERTAIN = 128
"""The haze here is known from a prior only."""
