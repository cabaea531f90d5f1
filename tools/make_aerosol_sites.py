"""Make data/aerosol_sites.csv: optics of the aerosols of twelve places, and of the models that dehazing solves for.

Mie theory at wavelengths 15 % apart; `skyscatter.dehaze.unsolved` reads it.  Takes half a minute.
"""

from __future__ import annotations

import numpy as np
from _table import write_table
from numpy.polynomial.legendre import legvander

from skyscatter.dehaze.aerosols import aerosol_optics
from skyscatter.dehaze.flat import DEGREE
from skyscatter.dehaze.unsolved import ANGLES, TOLD

WAVELENGTHS = np.geomspace(400.0, 2400.0, 14)
#: Cosines over which moments are integrated: fine where coarse particles scatter.
FINE = np.cos(np.radians(np.concatenate([np.linspace(0, 4, 801), np.linspace(4, 180, 1761)[1:]])))[::-1]


def main() -> None:
    """One row for each aerosol and wavelength."""
    rows = []
    for number, name in enumerate(TOLD):
        extinction, albedo, phase = aerosol_optics(name, WAVELENGTHS, np.append(FINE, np.cos(np.radians(ANGLES))))
        fine, at = phase[:, : FINE.size], phase[:, FINE.size :]
        moments = 0.5 * np.trapezoid(fine[:, None] * legvander(FINE, DEGREE).T, FINE, axis=-1)
        for k, wl in enumerate(WAVELENGTHS):
            values = [extinction[k], albedo[k], *(moments[k, 1:] / moments[k, 0]), *(at[k] / moments[k, 0])]
            rows.append([f"{len(rows)}", f"{number}", f"{wl:.6g}", *(f"{value:.4g}" for value in values)])
    write_table(
        "aerosol_sites.csv",
        [
            "Optical depth relative to 550 nm, single-scattering albedo, Legendre moments 1 to 12, phase function (1",
            "on the average over the sphere) at scattering angles in degrees, for the aerosols " + ", ".join(TOLD),
            "(0, 1, ...). By Mie theory from the sizes and indices in skyscatter/dehaze/aerosols.py; own work.",
            "Script: tools/make_aerosol_sites.py",
        ],
        ["row", "aerosol", "wavelength_nm", "extinction", "albedo", *(f"m{n}" for n in range(1, DEGREE + 1)),
         *(f"p{angle:g}" for angle in ANGLES)],
        rows,
    )  # fmt: skip


if __name__ == "__main__":
    main()
