"""Taking haze off images: the atmosphere run backwards.

``skyscatter.dehaze(image, ...)`` is `skyscatter.dehaze.engine.dehaze`: the package can be called.  Labelled arrays have
it as ``array.skyscatter.dehaze(...)`` where xarray was imported before this package, or after ``import
skyscatter.dehaze.xarray``; xarray is never imported without being asked for.

Examples
--------
A picture behind a grey veil: without it the contrast is larger.

>>> import numpy as np
>>> import skyscatter
>>> clear = 0.6 * np.random.default_rng(1).random((3, 8, 8)).repeat(6, axis=1).repeat(6, axis=2) ** 2
>>> light = 0.6 * clear + 0.4 * 0.7  # linear; the veil takes 40 % of it away, and shines by itself
>>> picture = (255 * light ** (1 / 2.2)).astype(np.uint8)  # red, green, blue
>>> result = skyscatter.dehaze(picture, bands=("red=1", "green=2", "blue=3"))
>>> result.reflectance.shape, result.is_relative  # a picture, not reflectance
((3, 48, 48), True)
>>> bool(result.reflectance.std() > picture.std() / 255)
True
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

_HOMES = {
    "Atmosphere": "skyscatter.dehaze.forward",
    "Band": "skyscatter.dehaze.passband",
    "DehazeOptions": "skyscatter.dehaze.options",
    "DehazeResult": "skyscatter.dehaze.result",
    "Flag": "skyscatter.dehaze.flags",
    "SceneGeometry": "skyscatter.dehaze.geometry",
    "Sensor": "skyscatter.dehaze.bands",
    "SourceOptions": "skyscatter.dehaze.options",
    "TermsTable": "skyscatter.dehaze.table",
    "aerosol_names": "skyscatter.dehaze.aerosols",
    "build_table": "skyscatter.dehaze.table",
    "dehaze": "skyscatter.dehaze.engine",
    "dehaze_raster": "skyscatter.dehaze.engine",
    "load_sensor": "skyscatter.dehaze.bands",
    "open_raster": "skyscatter.dehaze.rasters.opening",
    "sensor_names": "skyscatter.dehaze.bands",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from skyscatter.dehaze.aerosols import aerosol_names as aerosol_names
    from skyscatter.dehaze.bands import Sensor as Sensor
    from skyscatter.dehaze.bands import load_sensor as load_sensor
    from skyscatter.dehaze.bands import sensor_names as sensor_names
    from skyscatter.dehaze.engine import dehaze as dehaze
    from skyscatter.dehaze.engine import dehaze_raster as dehaze_raster
    from skyscatter.dehaze.flags import Flag as Flag
    from skyscatter.dehaze.forward import Atmosphere as Atmosphere
    from skyscatter.dehaze.geometry import SceneGeometry as SceneGeometry
    from skyscatter.dehaze.options import DehazeOptions as DehazeOptions
    from skyscatter.dehaze.options import SourceOptions as SourceOptions
    from skyscatter.dehaze.passband import Band as Band
    from skyscatter.dehaze.rasters.opening import open_raster as open_raster
    from skyscatter.dehaze.result import DehazeResult as DehazeResult
    from skyscatter.dehaze.table import TermsTable as TermsTable
    from skyscatter.dehaze.table import build_table as build_table


if not TYPE_CHECKING:  # it would accept any name

    def __getattr__(name: str) -> Any:
        if name in _HOMES:
            return getattr(import_module(_HOMES[name]), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


class _CallablePackage(ModuleType):
    """A package whose name is also that of its main function."""

    def __call__(self, image: Any, **options: Any) -> Any:
        return import_module("skyscatter.dehaze.engine").dehaze(image, **options)


sys.modules[__name__].__class__ = _CallablePackage

# Finished, for xarray itself may be what is being imported.
if hasattr(sys.modules.get("xarray"), "register_dataarray_accessor"):
    import_module("skyscatter.dehaze.xarray")
