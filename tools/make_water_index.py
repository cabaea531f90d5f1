"""Make data/water_refractive_index.csv from miepython's table (MIT) of Segelstein 1981.  Needs: miepython."""

from __future__ import annotations

from _table import package_file, write_table


def main() -> None:
    """Keep the rows from 200 to 2500 nm as they are."""
    rows = []
    for line in package_file("miepython", "data/segelstein81_index.txt").decode("utf-8").splitlines():
        try:
            micron, real, imaginary = (float(cell) for cell in line.split())
        except ValueError:
            continue  # the title lines
        if 0.2 <= micron <= 2.5:
            rows.append((f"{micron * 1e3:g}", f"{real:g}", f"{imaginary:g}"))
    write_table(
        "water_refractive_index.csv",
        [
            "Complex refractive index n + ik of liquid water: Segelstein 1981, M.S. thesis, University of",
            "Missouri-Kansas City. Origin: miepython, data/segelstein81_index.txt (MIT). Units: nm, 1, 1.",
            "Script: tools/make_water_index.py",
        ],
        ["wavelength_nm", "real", "imaginary"],
        rows,
    )


if __name__ == "__main__":
    main()
