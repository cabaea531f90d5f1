"""Make data/dust_draine2003.csv from Draine's tables as shipped by dust_extinction (BSD-3-Clause).

Needs: pip install dust_extinction (or --wheel FILE to read a downloaded wheel without installing it).
"""

from __future__ import annotations

import argparse

from _table import package_file, write_table

#: Name of the columns -> Draine's file of 17 December 2003.
SOURCES = {
    "3.1": "kext_albedo_WD_MW_3.1_60_D03.dat",
    "4.0": "kext_albedo_WD_MW_4.0A_40_D03.dat",
    "5.5": "kext_albedo_WD_MW_5.5A_30_D03.dat",
}
SHORTEST, LONGEST = 0.09, 10.0  # [micron]


def read(member: str, wheel: str | None) -> list[list[str]]:
    """Rows lambda [micron], albedo, <cos>, C_ext/H [cm2], K_abs [cm2/g], <cos^2>, as written; longest first."""
    lines = package_file("dust_extinction", f"data/{member}", wheel).decode("ascii").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("-----------"))
    rows = [line.split()[:6] for line in lines[start + 1 :] if line.strip()]
    return [row for row in rows if SHORTEST <= float(row[0]) <= LONGEST]


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wheel", help="a dust_extinction wheel to read instead of the installed package")
    wheel = parser.parse_args().wheel
    tables = [sorted(read(member, wheel), key=lambda row: float(row[0])) for member in SOURCES.values()]
    rows = []
    for together in zip(*tables, strict=True):
        assert len({row[0] for row in together}) == 1, "the three tables must stand on the same wavelengths"
        cells = [f"{float(together[0][0]) * 1e3:.6g}"]
        for _, albedo, cosine, extinction, _, square in together:
            cells += [f"{float(extinction) * 1e-4:.3e}", albedo, cosine, square]
        rows.append(cells)
    write_table(
        "dust_draine2003.csv",
        [
            "Interstellar dust of the Milky Way for R_V = 3.1, 4.0 and 5.5: extinction cross section per hydrogen",
            "nucleon [m2], albedo, mean cosine and mean squared cosine of the scattering angle.",
            "Weingartner & Draine 2001, ApJ 548, 296 (case A, 60, 40 and 30 ppm of carbon in small grains), abundances",
            "renormalised by Draine 2003, ARA&A 41, 241; grains of Draine 2003, ApJ 598, 1017. B. T. Draine's tables",
            "of 17 December 2003, all their rows from 0.09 to 10 micron and all their digits, as shipped by",
            "dust_extinction (BSD-3-Clause, K. Gordon). Units: nm, m2, 1, 1, 1. Script: tools/make_dust.py",
        ],
        ["wavelength_nm"] + [f"{what}_{name}" for name in SOURCES for what in ("extinction", "albedo", "g", "cos2")],
        rows,
    )


if __name__ == "__main__":
    main()
