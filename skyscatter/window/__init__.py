"""A sky in a window: tables of skies that are drawn at once for any Sun and view, and the page that draws them.

Examples
--------
A table of a sky, and its luminance at the zenith.

>>> from skyscatter import window
>>> table = window.make_table(window.SkySettings("earth-simple"), quick=True)
>>> xyz = table.xyz([0, 0, 1], sun_elevation_deg=30, sun_azimuth_deg=180)
>>> bool(1000 < xyz[1] < 5000)  # cd m-2
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyscatter.lazy import lazy_names

_HOME = {
    "default_table": "skyscatter.window.table",
    "make_table": "skyscatter.window.table",
    "SkySettings": "skyscatter.window.settings",
    "SkyWidget": "skyscatter.window.widget",
}

__all__ = [*_HOME]

if TYPE_CHECKING:
    from skyscatter.window.settings import SkySettings as SkySettings
    from skyscatter.window.table import default_table as default_table
    from skyscatter.window.table import make_table as make_table
    from skyscatter.window.widget import SkyWidget as SkyWidget


if not TYPE_CHECKING:  # it would accept any name
    __getattr__, __dir__ = lazy_names(globals(), _HOME)
