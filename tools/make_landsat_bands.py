"""Make data/bands/landsat_*.csv from pyrsr's copy of NASA's band averages.  Needs: pip install pyrsr.

The responses themselves are works of the United States government (NASA, measured by Ball Aerospace); pyrsr, which
carries them as text, is Apache-2.0.
"""

from __future__ import annotations

import argparse

import numpy as np
from _table import package_file, write_table

SENSORS = {
    "landsat_8_oli": ("Landsat-8", "Ball_BA_RSR.v1.2 (September 2014)", "OLI of Landsat 8"),
    "landsat_9_oli2": ("Landsat-9", "L9_OLI2_Ball_BA_RSR.v1.0 (October 2021)", "OLI-2 of Landsat 9"),
}
BANDS = tuple(range(1, 10))


def curve(platform: str, band: int, wheel: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm] and response of one band; a node of 0 at either end, negative noise becomes 0."""
    text = package_file("pyrsr", f"data/{platform}/OLI_TIRS/band_{band}", wheel).decode("utf-8")
    micrometre, response = np.array([line.split() for line in text.splitlines()[1:] if line.strip()], dtype=float).T
    wavelength = np.round(micrometre * 1000.0, 3)
    return np.r_[wavelength[0] - 1.0, wavelength, wavelength[-1] + 1.0], np.r_[0.0, np.maximum(response, 0.0), 0.0]


def main() -> None:
    """All bands of a sensor on the union of their nodes (1 nm apart); a band is 0 outside its own nodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wheel", help="wheel file of pyrsr, if it is not installed")
    wheel = parser.parse_args().wheel
    for name, (platform, workbook, title) in SENSORS.items():
        curves = [curve(platform, band, wheel) for band in BANDS]
        grid = np.unique(np.concatenate([wavelength for wavelength, _ in curves]))
        columns = [np.interp(grid, *c, left=0.0, right=0.0) for c in curves]
        write_table(
            f"bands/{name}.csv",
            [
                f"Band-average relative spectral responses of {title}, highest value about 1, for weighting by energy.",
                f"Origin: NASA, {workbook}, public domain (work of the United States government),",
                "as shipped by pyrsr, Apache-2.0. Units: nm, 1. Script: tools/make_landsat_bands.py",
            ],
            ["wavelength_nm", *(f"B{band}" for band in BANDS)],
            [(f"{grid[i]:g}", *(f"{column[i]:.5g}" for column in columns)) for i in range(grid.size)],
        )


if __name__ == "__main__":
    main()
