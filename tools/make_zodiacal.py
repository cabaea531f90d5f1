"""Make data/zodiacal.csv, table 17 of Leinert et al. 1998, from the package zodi (MIT).

Needs: pip install zodi, or the path of its wheel as the only argument.
"""

from __future__ import annotations

import sys
import types

import numpy as np
from _table import package_file, write_table


def main() -> None:
    """Write the table by longitude; what it leaves out near the Sun is 0."""
    tables = types.ModuleType("tables")  # this module alone: its package wants more that is not needed here
    exec(package_file("zodi", "tables.py", sys.argv[1] if len(sys.argv) > 1 else None), tables.__dict__)
    rows = [
        [f"{longitude:g}", *(f"{value:g}" for value in np.nan_to_num(row))]
        for longitude, row in zip(tables.LON_GRID_DEG, tables.TABLE17_RAW, strict=True)
    ]
    write_table(
        "zodiacal.csv",
        [
            "Zodiacal light at 500 nm over helioecliptic longitude (rows) and ecliptic latitude (columns), from 1 au.",
            "Leinert et al. 1998, A&AS 127, 1, table 17; 0 where it has no value, near the Sun.",
            "Origin: zodi, tables.py (MIT). Units: degree, 1e-8 W m-2 sr-1 um-1. Script: tools/make_zodiacal.py",
        ],
        ["longitude_deg", *(f"latitude_{latitude:g}" for latitude in tables.BETA_GRID_DEG)],
        rows,
    )


if __name__ == "__main__":
    main()
