"""Angles of Sun and view from the metadata of products."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.geometry import SceneGeometry
from skyscatter.dehaze.rasters.base import finite_number
from skyscatter.dehaze.rasters.handles import DatasetPool
from skyscatter.dehaze.rasters.xmltools import Metadata
from skyscatter.errors import DomainError, MissingDataError

Array = NDArray[np.float64]
#: Nodes across an image whose angles come pixel by pixel; angles of a scene are smooth over its hundredth part.
_NODES = 64


def s2_geometry(granule: Metadata, bands: Sequence[int], resolution: float) -> SceneGeometry:
    """Geometry of a Sentinel-2 granule; views as vectors averaged over the detectors and some of the bands.

    Parameters
    ----------
    granule : Metadata
        MTD_TL.xml.
    bands : sequence of int
        Identifiers, from 0.
    resolution : float
        Pixel of the grid [m].
    """
    grids = list(granule.all("Sun_Angles_Grid"))
    if not grids:
        raise MissingDataError(granule.shown, "has no Sun_Angles_Grid; get the product again, or give the angles")
    zenith, azimuth = (_table(granule, grids[0], part) for part in ("Zenith", "Azimuth"))
    if zenith.shape != azimuth.shape or not np.all(np.isfinite(zenith + azimuth)):
        raise MissingDataError(granule.shown, "has a Sun_Angles_Grid with gaps; get the product again")
    steps = [finite_number(grids[0].findtext(f"Zenith/{name}")) for name in ("ROW_STEP", "COL_STEP")]
    if None in steps or min(step or 0.0 for step in steps) <= 0.0:
        raise MissingDataError(granule.shown, "has a Sun_Angles_Grid without steps; get the product again")
    row_step, col_step = (float(step or 0.0) / resolution for step in steps)
    view = _s2_view(granule, bands, zenith.shape)
    if view is None:
        view = _s2_mean_view(granule, bands, zenith.shape)
    view_zenith, view_azimuth = view
    return SceneGeometry(
        row_step * np.arange(zenith.shape[0], dtype=np.float64),
        col_step * np.arange(zenith.shape[1], dtype=np.float64),
        zenith,
        view_zenith,
        view_azimuth - azimuth,
        azimuth,
        view_azimuth,
    )


def _table(granule: Metadata, grid: ElementTree.Element, part: str) -> Array:
    """Values of a grid, shape (ny, nx); NaN outside of the swath."""
    rows = [(element.text or "").split() for element in grid.iterfind(f"{part}/Values_List/VALUES")]
    try:
        values = np.array([[float(word) for word in row] for row in rows], dtype=np.float64)
    except ValueError as error:
        raise MissingDataError(granule.shown, f"has a broken {grid.tag}; get the product again") from error
    if values.ndim != 2 or values.size == 0:
        raise MissingDataError(granule.shown, f"has an empty {grid.tag}; get the product again")
    return values


def _s2_view(granule: Metadata, bands: Sequence[int], shape: tuple[int, ...]) -> tuple[Array, Array] | None:
    """Zenith and azimuth of the mean view; None if there are no grids for these bands."""
    wanted = {str(band) for band in bands}
    north, east, count = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for grid in granule.all("Viewing_Incidence_Angles_Grids"):
        if grid.get("bandId") not in wanted:
            continue
        zenith, azimuth = _table(granule, grid, "Zenith"), np.radians(_table(granule, grid, "Azimuth"))
        if zenith.shape != shape or azimuth.shape != shape:
            raise MissingDataError(granule.shown, "has grids of angles of different sizes; get the product again")
        seen = np.isfinite(zenith) & np.isfinite(azimuth)
        north[seen] += (zenith * np.cos(azimuth))[seen]
        east[seen] += (zenith * np.sin(azimuth))[seen]
        count += seen
    if not count.any():
        return None
    north, east = (_filled(np.where(count > 0, part / np.maximum(count, 1), np.nan)) for part in (north, east))
    return np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360.0


def _s2_mean_view(granule: Metadata, bands: Sequence[int], shape: tuple[int, ...]) -> tuple[Array, Array]:
    north, east = [], []
    for element in granule.all("Mean_Viewing_Incidence_Angle"):
        zenith = finite_number(element.findtext("ZENITH_ANGLE"))
        azimuth = finite_number(element.findtext("AZIMUTH_ANGLE"))
        if element.get("bandId") in {str(band) for band in bands} and zenith is not None and azimuth is not None:
            north.append(zenith * np.cos(np.radians(azimuth)))
            east.append(zenith * np.sin(np.radians(azimuth)))
    if not north:
        raise MissingDataError(granule.shown, "has no viewing angles; get the product again, or give the angles")
    ahead, aside = np.mean(north), np.mean(east)
    return np.full(shape, np.hypot(ahead, aside)), np.full(shape, np.degrees(np.arctan2(aside, ahead)) % 360.0)


def _filled(values: Array) -> Array:
    """Gaps take the value of the nearest node that has one."""
    seen = np.argwhere(np.isfinite(values))
    filled = values.copy()
    for row, col in np.argwhere(~np.isfinite(values)):
        distance = (seen[:, 0] - row) ** 2 + (seen[:, 1] - col) ** 2
        nearest = seen[int(np.argmin(distance))]
        filled[row, col] = values[nearest[0], nearest[1]]
    return filled


def angle_bands_geometry(pools: dict[str, DatasetPool], height: int, width: int) -> SceneGeometry:
    """Geometry from rasters of angles in hundredths of a degree.

    Parameters
    ----------
    pools : dict
        SZA, SAA, VZA, VAA.
    height, width : int
        Of the image, on the same grid.

    Raises
    ------
    MissingDataError
        If a raster has another size, or holds nothing.
    """
    rows, cols = (
        np.unique(np.linspace(0, size - 1, min(size, _NODES)).round().astype(int)) for size in (height, width)
    )
    tables = {name: _decimated(pool, rows, cols, (height, width)) for name, pool in pools.items()}
    # Outside of the swath all four are 0 or nodata.
    empty = np.isnan(sum(tables.values())) | ((tables["SZA"] == 0.0) & (tables["SAA"] == 0.0))
    if empty.all():
        raise MissingDataError(pools["SZA"].shown, "holds no angles; get the product again, or give the angles")

    def vector(zenith: str, azimuth: str, turn: Callable[[Array], Array]) -> Array:
        return _filled(np.where(empty, np.nan, tables[zenith] * turn(np.radians(tables[azimuth]))))

    sun_zenith = _filled(np.where(empty, np.nan, tables["SZA"]))
    sun_azimuth = np.degrees(np.arctan2(vector("SZA", "SAA", np.sin), vector("SZA", "SAA", np.cos)))
    east, north = vector("VZA", "VAA", np.sin), vector("VZA", "VAA", np.cos)
    view_azimuth = np.degrees(np.arctan2(east, north))
    return SceneGeometry(
        rows + 0.5,
        cols + 0.5,
        sun_zenith,
        np.hypot(north, east),
        view_azimuth - sun_azimuth,
        sun_azimuth,
        view_azimuth,
    )


def _decimated(pool: DatasetPool, rows: NDArray[np.int_], cols: NDArray[np.int_], shape: tuple[int, int]) -> Array:
    """Angles [degree] at some pixels, row by row so that no raster is read whole into memory."""
    with pool.reading() as dataset:
        if (dataset.height, dataset.width) != shape:
            found = f"{dataset.height} x {dataset.width}"
            raise MissingDataError(pool.shown, f"has {found} pixels instead of {shape[0]} x {shape[1]}; get it again")
        if dataset.dtypes[0] not in ("int16", "uint16"):
            raise DomainError("dtype", dataset.dtypes[0], f"{pool.shown} must hold int16, hundredths of a degree")
        lines = [dataset.read(1, window=((int(row), int(row) + 1), (0, shape[1])))[0, cols] for row in rows]
        numbers = np.array(lines, dtype=np.float64)
        if dataset.nodata is not None and dataset.nodata != 0:
            numbers[numbers == dataset.nodata] = np.nan
    return 0.01 * numbers
