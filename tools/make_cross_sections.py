"""Make data/o3_cross_section.csv and data/no2_cross_section.csv from the TUV-x data in musica (Apache-2.0).

Needs: pip install musica h5py (or --wheel FILE to read a downloaded wheel without installing it).
"""

from __future__ import annotations

import argparse
import io

import numpy as np
from _table import package_file, write_table
from numpy.typing import NDArray

FOLDER = "configs/tuvx/data/cross_sections"
Array = NDArray[np.float64]


def read(member: str, wheel: str | None) -> tuple[Array, Array, Array]:
    """Wavelengths [nm], temperatures [K] and cross sections [cm2] of shape (temperature, wavelength)."""
    import h5py

    with h5py.File(io.BytesIO(package_file("musica", f"{FOLDER}/{member}", wheel))) as source:
        wavelength, temperature = np.asarray(source["wavelength"]), np.asarray(source["temperature"])
        return wavelength, temperature, np.asarray(source["cross_section_parameters"])


def cell_means(wavelengths: Array, values: Array, centres: Array, widths: Array) -> Array:
    """Mean of 0.01 nm samples over each cell; shape of `centres`."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    low = np.searchsorted(wavelengths, centres - widths / 2 - 1e-6)
    high = np.searchsorted(wavelengths, centres + widths / 2 + 1e-6)
    return (sums[high] - sums[low]) / (high - low)


def ozone(wheel: str | None) -> None:
    """Malicet et al. 1995 at four temperatures to 344.5 nm, Brion et al. 1998 at 295 K beyond."""
    cold_wl, cold_t, cold = read("O3_2.nc", wheel)
    warm_wl, _, warm = read("O3_1.nc", wheel)
    centres = np.concatenate([np.arange(250.0, 350.0, 0.5), np.arange(350.0, 830.0, 1.0)])
    widths = np.where(centres < 350.0, 0.5, 1.0)
    room = cell_means(warm_wl, warm[0], centres, widths)
    columns = []
    for temperature in (218.0, 228.0, 243.0):
        row = cold[int(np.flatnonzero(cold_t == temperature)[0])]
        column = room.copy()
        inside = centres <= 344.5
        column[inside] = cell_means(cold_wl, row, centres[inside], widths[inside])
        columns.append(column)
    columns.append(room)
    write_table(
        "o3_cross_section.csv",
        [
            "Ozone absorption cross section, means over cells of 0.5 nm (below 350 nm) and 1 nm.",
            "To 344.5 nm: Malicet et al. 1995, J. Atmos. Chem. 21, 263, at 218, 228, 243, 295 K.",
            "Beyond: Brion et al. 1998, J. Atmos. Chem. 30, 291, measured at 295 K only, repeated in every column.",
            "Wavelengths as published (the laboratories do not say vacuum or air; the two differ by 0.08-0.23 nm).",
            "Origin: musica, TUV-x data O3_1.nc and O3_2.nc (Apache-2.0). Units: nm, m2. "
            "Script: tools/make_cross_sections.py",
        ],
        ["wavelength_nm", "218K", "228K", "243K", "295K"],
        [(f"{w:g}", *(f"{v * 1e-4:.4e}" for v in row)) for w, row in zip(centres, np.stack(columns, -1), strict=True)],
    )


def nitrogen_dioxide(wheel: str | None) -> None:
    """JPL 2006 means at 220 and 294 K, as tabulated."""
    wavelengths, temperatures, values = read("NO2_1.nc", wheel)
    assert list(temperatures) == [220.0, 294.0]
    write_table(
        "no2_cross_section.csv",
        [
            "Nitrogen dioxide absorption cross section, means over the intervals of JPL Publication 06-2 (Sander et",
            "al. 2006), 220 and 294 K. The source holds no row between 440 and 485 nm.",
            "Origin: musica, TUV-x data NO2_1.nc (Apache-2.0). Units: nm, m2. Script: tools/make_cross_sections.py",
        ],
        ["wavelength_nm", "220K", "294K"],
        [
            (f"{w:g}", *(f"{v * 1e-4:.3e}" for v in row))
            for w, row in zip(wavelengths, values.T, strict=True)
            if w > 250.0
        ],
    )


def main() -> None:
    """Write both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wheel", help="a musica wheel to read instead of the installed package")
    wheel = parser.parse_args().wheel
    ozone(wheel)
    nitrogen_dioxide(wheel)


if __name__ == "__main__":
    main()
