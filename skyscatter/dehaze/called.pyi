"""What a type checker takes ``skyscatter.dehaze`` for: a package that can be called, which no module can say."""

from collections.abc import Callable
from typing import Any, TypeAlias

from skyscatter.dehaze import aerosols, bands, engine, flags, forward, geometry, options, passband, result, table
from skyscatter.dehaze.rasters import opening

class dehaze(result.DehazeResult):  # noqa: N801
    """Take the haze off an image; see `skyscatter.dehaze.engine.dehaze`, which this calls and whose result it is."""

    def __init__(self, image: Any, *, progress: Callable[[float], None] | None = None, **options: Any) -> None: ...

    Atmosphere: TypeAlias = forward.Atmosphere
    Band: TypeAlias = passband.Band
    DehazeOptions: TypeAlias = options.DehazeOptions
    DehazeResult: TypeAlias = result.DehazeResult
    Flag: TypeAlias = flags.Flag
    SceneGeometry: TypeAlias = geometry.SceneGeometry
    Sensor: TypeAlias = bands.Sensor
    SourceOptions: TypeAlias = options.SourceOptions
    TermsTable: TypeAlias = table.TermsTable
    aerosol_names = staticmethod(aerosols.aerosol_names)
    build_table = staticmethod(table.build_table)
    dehaze = staticmethod(engine.dehaze)
    dehaze_raster = staticmethod(engine.dehaze_raster)
    load_sensor = staticmethod(bands.load_sensor)
    open_raster = staticmethod(opening.open_raster)
    sensor_names = staticmethod(bands.sensor_names)
