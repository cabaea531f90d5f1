"""Make the table of the default sky that is shipped with the window: skyscatter/window/data/earth.sky.gz.

    python tools/make_sky_table.py

Anew when the model `earth` or the solver has changed: tests/system/test_window_table.py compares both with it.
"""

from __future__ import annotations

import gzip

from skyscatter.atomic import atomic_path
from skyscatter.window.table import DEFAULT, SkySettings, make_table


def main() -> None:
    table = make_table(SkySettings())
    with atomic_path(DEFAULT) as temporary:
        temporary.write_bytes(gzip.compress(table.to_bytes(), 9, mtime=0))
    print(f"{DEFAULT}: {DEFAULT.stat().st_size} bytes")


if __name__ == "__main__":
    main()
