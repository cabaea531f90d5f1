"""Air above a black ground, round and flat, by random walks: which of 6SV 1.1 (flat) and ours (round) is right.

    python benchmarks/dehaze_round.py --write

The walks of `skyscatter.dehaze.simulate` (solver `path`, polarised, all orders) share neither grid nor expansion with
`orders`, by which dehazing solves, and know the planet only by its radius.  All have 6S's optical depth of the air at
443 nm.  Azimuth 0 is backscatter.
"""

from __future__ import annotations

import csv
import os
import sys
from pathlib import Path

import numpy as np
from common import machine, parser, report, table, versions
from dehaze_sixs import FLAT, ROUND, Single, SixsAir

from skyscatter.dehaze.forward import PATH, SolvedAir
from skyscatter.dehaze.simulate import simulate
from skyscatter.ground import Ground, GroundMap
from skyscatter.scene import Scene, Sun

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "validation-dehaze.md"
WAVELENGTH = 443.0
#: Zenith angles of Sun and view, relative azimuth [degree]; 6S has rows for 30 and 60.
GEOMETRIES = tuple((sun, view, 0.0) for view in (0.0, 50.0) for sun in (30.0, 45.0, 60.0, 70.0, 75.0))

Angles = tuple[float, float, float]


def sixs(folder: Path) -> tuple[float, dict[Angles, float]]:
    """Optical depth of air, and path reflectances by geometry."""
    with (folder / "sixs" / "sixs_dev.csv").open(encoding="utf-8") as file:
        rows = [r for r in csv.DictReader(file) if r["spectral"] == f"{WAVELENGTH:g}nm" and r["aerosol"] == "none"]
    found = {(float(r["sza"]), float(r["vza"]), float(r["raa"])): float(r["rho_toa"]) for r in rows}
    return float(rows[0]["tau_ray"]), found


def walked(air: SixsAir, angles: Angles, walks: int) -> tuple[float, float]:
    """Path reflectance and its standard error."""
    sun, view, azimuth = angles
    black = GroundMap(classes=np.zeros((4, 4), int), albedos=(0.0,), cell_size=1000.0)
    scene = Scene(
        medium=air.medium(0.0), ground=Ground(albedo=0.0, map=black), sun=Sun(elevation_deg=90 - sun, azimuth_deg=0.0)
    )
    image = simulate(
        scene, [WAVELENGTH], (2, 2), view_zenith_deg=view, view_azimuth_deg=azimuth, walks=walks, seed=int(sun + view)
    )
    return float(image.reflectance.mean()), float(image.standard_error.max())


def main() -> None:
    """Walk, solve, compare."""
    options = parser(__doc__)
    options.add_argument(
        "--reference", type=Path, default=Path(os.environ.get("SKYSCATTER_REFERENCE", ROOT.parent / "shared/reference"))
    )
    options.add_argument("--walks", type=int, default=1 << 17, help="for each number")
    given = options.parse_args()
    where, (depth, six) = machine(), sixs(given.reference)
    airs = {
        name: SixsAir(aerosol="none", wavelengths=(WAVELENGTH, 800.0), depths=(depth, 0.02), planet_radius=radius)
        for name, radius in (("flat", FLAT), ("round", ROUND))
    }
    solved = {name: SolvedAir(air, 0.0, Single([WAVELENGTH]), (30.0, 75.0)) for name, air in airs.items()}
    rows = []
    for angles in GEOMETRIES:
        walks = {name: walked(air, angles, given.walks) for name, air in airs.items()}
        orders = {name: float(s.monochromatic(*angles)[0, PATH]) for name, s in solved.items()}
        (flat, flat_error), (curved, curved_error) = walks["flat"], walks["round"]

        def off(value: float | None, judge: float) -> str:
            return "" if value is None else f"{100 * (value / judge - 1):+.2f}"

        rows.append([
            ", ".join(f"{a:g}" for a in angles), f"{flat:.5f}", f"{100 * flat_error / flat:.2f}",
            off(six.get(angles), flat), off(orders["flat"], flat), f"{curved:.5f}",
            f"{100 * curved_error / curved:.2f}", off(six.get(angles), curved), off(orders["round"], curved),
            off(curved, flat),
        ])  # fmt: skip
        print(rows[-1], flush=True)
    head = [
        "Sun, view, azimuth", "walks, flat", "± [%]", "6S [%]", "orders, flat [%]", "walks, round", "± [%]", "6S [%]",
        "orders, round [%]", "round less flat [%]",
    ]  # fmt: skip
    report("round", where, versions("skyscatter", "numpy"), [table(head, rows)], sys.argv, given.write, PAGE)


if __name__ == "__main__":
    main()
