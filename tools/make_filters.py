"""Make data/bessell_ubvri.csv from speclite's copy of Bessell (1990) (BSD-3-Clause).  Needs: pip install speclite."""

from __future__ import annotations

import argparse

import numpy as np
from _table import package_file, write_table

BANDS = ("U", "B", "V", "R", "I")


def curve(band: str, wheel: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm] and response of one band."""
    lines = package_file("speclite", f"data/filters/bessell-{band}.ecsv", wheel).decode("utf-8").splitlines()
    rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    wavelength, response = np.array(rows[1:], dtype=float).T
    return wavelength / 10.0, response


def main() -> None:
    """Put the five bands on the union of their nodes, which keeps each as it is: all are linear between nodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wheel", help="wheel file of speclite, if it is not installed")
    wheel = parser.parse_args().wheel
    curves = {band: curve(band, wheel) for band in BANDS}
    grid = np.unique(np.concatenate([wavelength for wavelength, _ in curves.values()]))
    columns = [np.interp(grid, *curves[band], left=0.0, right=0.0) for band in BANDS]
    write_table(
        "bessell_ubvri.csv",
        [
            "Johnson-Cousins passbands, highest value 1, for weighting by energy: Bessell (1990, PASP 102, 1181).",
            "Origin: speclite, data/filters/bessell-*.ecsv (BSD-3-Clause). Units: nm, 1. Script: tools/make_filters.py",
        ],
        ["wavelength_nm", *BANDS],
        [(f"{grid[i]:g}", *(f"{column[i]:.6g}" for column in columns)) for i in range(grid.size)],
    )


if __name__ == "__main__":
    main()
