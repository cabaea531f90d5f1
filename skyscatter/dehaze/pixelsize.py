"""How large a pixel is on the ground, by the georeference of an image."""

from __future__ import annotations

from typing import Any

import numpy as np

from skyscatter.dehaze.rasters.base import RasterSource

METRES_PER_DEGREE = 111195.0  #: of a great circle on a sphere of 6371 km


def pixel_size(source: RasterSource) -> float | None:
    """Side of a square of a pixel's area [m]; None where the image does not say."""
    transform, crs = source.profile.transform, source.profile.crs
    if transform is None or crs is None or transform.is_identity:
        return None
    area = abs(transform.a * transform.e - transform.b * transform.d)
    unit = _metres_per_unit(crs)
    if unit is not None:
        return float(unit * np.sqrt(area))
    _, latitude = transform * (0.5 * source.width, 0.5 * source.height)
    return float(METRES_PER_DEGREE * np.sqrt(area * max(np.cos(np.radians(latitude)), 0.0)))


def _metres_per_unit(crs: Any) -> float | None:
    """Metres in the unit of a projection; None for longitude and latitude."""
    from rasterio.crs import CRS

    known = crs if isinstance(crs, CRS) else CRS.from_user_input(crs)
    if known.is_geographic:
        return None
    return float(known.linear_units_factor[1])
