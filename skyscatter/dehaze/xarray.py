"""The accessor ``DataArray.skyscatter``, registered when this module is imported."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import xarray


@xarray.register_dataarray_accessor("skyscatter")
class SkyscatterAccessor:
    """What skyscatter can do with a labelled array of (band, y, x).

    Parameters
    ----------
    array : xarray.DataArray
    """

    def __init__(self, array: xarray.DataArray) -> None:
        self._array = array

    def dehaze(self, **options: Any) -> Any:
        """Take the haze off; the same as ``skyscatter.dehaze.dehaze(array, **options)``."""
        return import_module("skyscatter.dehaze").dehaze(self._array, **options)
