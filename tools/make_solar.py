"""Make data/solar_astm_g173.csv from pvlib's copy of ASTM G173-03 (BSD-3-Clause).  Needs: pip install pvlib."""

from __future__ import annotations

from _table import package_file, write_table


def main() -> None:
    """Copy the extraterrestrial column, with its own sampling (0.5 nm to 400 nm, 1 nm to 1700 nm, then 5 nm)."""
    lines = package_file("pvlib", "data/ASTMG173.csv").decode("utf-8").splitlines()
    cells = [line.split(",") for line in lines]
    start = next(i for i, row in enumerate(cells) if row[0].lower().startswith("wavelength")) + 1
    rows = [(f"{float(row[0]):g}", f"{float(row[1]):.6g}") for row in cells[start:] if row[0].strip()]
    write_table(
        "solar_astm_g173.csv",
        [
            "Extraterrestrial solar spectral irradiance at 1 au, ASTM G173-03 (2003), after Gueymard (SMARTS 2.9.2).",
            "Origin: pvlib, data/ASTMG173.csv (BSD-3-Clause). Units: nm, W m-2 nm-1. Script: tools/make_solar.py",
        ],
        ["wavelength_nm", "irradiance"],
        rows,
    )


if __name__ == "__main__":
    main()
