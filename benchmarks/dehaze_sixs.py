"""The forward model of a satellite's pixel beside 6SV 1.1: the tables of docs/validation-dehaze.md.

Every row of the reference is computed twice: as dehazing does it, on a round Earth and with our own optical depth of
the air, and as 6S does, flat and with the air of 6S.  What the first has and the second has not is the Earth's
roundness and the depth of the air; what the second still has is the solvers and, with aerosol, the aerosols.
"""

from __future__ import annotations

import csv
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, report, table, versions
from numpy.typing import NDArray

from skyscatter.dehaze.bands import load_sensor
from skyscatter.dehaze.forward import BACK, DIFFUSE, DIRECT, PATH, Atmosphere, BandAverage, SolvedAir
from skyscatter.dehaze.gases import gas_transmittance
from skyscatter.media.medium import Medium
from skyscatter.optics.particles import Particles
from skyscatter.optics.rayleigh import RayleighAir
from skyscatter.spectra.table import SpectralTable

Array = NDArray[np.float64]

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "validation-dehaze.md"
FLAT = 6371e6  #: radius of a planet that is as good as flat [m]: 1e-5 of air mass at 60 degrees
ROUND = 6371e3
MOLECULAR_BAR = 0.01  #: of the path reflectance
AEROSOL_BAR, AEROSOL_LEAST = 0.03, 0.001  #: relative, and in reflectance; the larger counts
#: Columns of the US Standard Atmosphere 1962 as 6S has them: ozone [Dobson units], water vapour [g cm-2].
OZONE, WATER = 344.0, 1.424
GAS_BANDS = {"B2": "B02", "B3": "B03", "B4": "B04", "B8": "B08"}  #: of Sentinel-2A


@dataclass(frozen=True)
class Row:
    """One line of the reference."""

    spectral: str
    gas: bool
    aerosol: str
    aod: float
    angles: tuple[float, float, float]  #: Sun's and view's zenith angle, relative azimuth [degree]
    path: float  #: with the gases, in rows that have them
    up_and_down: float
    back: float
    t_gas: float
    tau_air: float


@dataclass
class Compared:
    """A row and our terms for it in each setting, with the gases' transmittance where there are any."""

    row: Row
    terms: dict[str, Array] = field(default_factory=dict)

    def path(self, setting: str) -> float:
        """Difference of the path reflectances."""
        return float(self.terms[setting][PATH]) - self.row.path

    def through(self, setting: str) -> float:
        """Relative difference of T_down T_up."""
        ours = self.terms[setting]
        return float(ours[DIRECT] + ours[DIFFUSE]) / self.row.up_and_down - 1

    def back(self, setting: str) -> float:
        """Relative difference of the spherical albedos."""
        return float(self.terms[setting][BACK]) / self.row.back - 1

    def met(self, setting: str) -> bool:
        """Whether the path reflectance is within its bar."""
        off = abs(self.path(setting))
        if self.row.aerosol == "none":
            return off <= MOLECULAR_BAR * self.row.path
        return off <= max(AEROSOL_BAR * self.row.path, AEROSOL_LEAST)


class SixsAir(Atmosphere):
    """Air of the optical depth that 6S gives it, and our phase function; flat when nothing else is said."""

    wavelengths: tuple[float, ...]
    depths: tuple[float, ...]
    planet_radius: float = FLAT

    def medium(self, aod: float) -> Medium:
        """As of `Atmosphere`, with other air."""
        own = super().medium(aod)
        depth: Any = SpectralTable(wavelengths=self.wavelengths, values=self.depths)
        optics = Particles(optical_depth=depth, phase=RayleighAir().phase_function(self.wavelengths))
        air = own.components[0].model_copy(update={"optics": optics})
        return own.model_copy(update={"components": (air, *own.components[1:])})


class Single(BandAverage):
    """Wavelengths that stand for themselves."""

    def __init__(self, wavelengths: Sequence[float]) -> None:
        self.wavelengths, self.weights = np.asarray(wavelengths, float), np.eye(len(wavelengths))


def read(folder: Path) -> list[Row]:
    """All rows of the reference."""
    with (folder / "sixs" / "sixs_dev.csv").open(encoding="utf-8") as file:
        return [
            Row(
                r["spectral"], r["gas"] == "1", r["aerosol"], float(r["aod550"]),
                (float(r["sza"]), float(r["vza"]), float(r["raa"])), float(r["rho_toa"]),
                float(r["t_down"]) * float(r["t_up"]), float(r["s_alb"]), float(r["t_gas"]), float(r["tau_ray"]),
            )
            for r in csv.DictReader(file)
        ]  # fmt: skip


def hazes(rows: Sequence[Row]) -> Iterator[tuple[str, float, list[Row]]]:
    """Rows of one aerosol and depth together."""
    for key in sorted({(r.aerosol, r.aod) for r in rows}, key=lambda k: ("ncm".index(k[0][0]), k[1])):
        yield *key, [r for r in rows if (r.aerosol, r.aod) == key]


def lines(rows: Sequence[Row], tolerance: float, threads: int | None) -> Iterator[Compared]:
    """Monochromatic rows compared."""
    depth = {float(r.spectral[:-2]): r.tau_air for r in rows}
    wavelengths = sorted(depth)
    span = (min(r.angles[0] for r in rows), max(r.angles[0] for r in rows))
    for aerosol, aod, mine in hazes(rows):
        flat = SixsAir(aerosol=aerosol, wavelengths=tuple(wavelengths), depths=tuple(depth[w] for w in wavelengths))
        settings = {"flat": flat, "round": Atmosphere(aerosol=aerosol)}
        if aerosol == "none":
            settings["round, air of 6S"] = flat.model_copy(update={"planet_radius": ROUND})
        solved = {
            name: SolvedAir(air, aod, Single(wavelengths), span, tolerance=tolerance, threads=threads)
            for name, air in settings.items()
        }
        for row in sorted(mine, key=lambda r: (r.angles, r.spectral)):
            at = wavelengths.index(float(row.spectral[:-2]))
            yield Compared(row, {name: s.monochromatic(*row.angles)[at] for name, s in solved.items()})
        print(aerosol, aod, file=sys.stderr, flush=True)


def with_gases(rows: Sequence[Row], tolerance: float, threads: int | None) -> Iterator[tuple[Compared, float]]:
    """Rows of bands compared, on the round Earth, and the transmittance of the gases."""
    sensor = load_sensor("sentinel-2a")
    bands = [sensor.band(GAS_BANDS[name]) for name in sorted({r.spectral for r in rows})]
    average = BandAverage(bands)
    span = (min(r.angles[0] for r in rows), max(r.angles[0] for r in rows))
    for aerosol, aod, mine in hazes(rows):
        solved = SolvedAir(Atmosphere(aerosol=aerosol), aod, average, span, tolerance=tolerance, threads=threads)
        for row in sorted(mine, key=lambda r: (r.angles, r.spectral)):
            at = sorted({r.spectral for r in rows}).index(row.spectral)
            gases = gas_transmittance(bands[at], *row.angles[:2], ozone_du=OZONE, water_vapour=WATER)
            terms = solved.terms(*row.angles)[at].copy()
            # Air scatters above the water vapour, aerosols in the midst of it.
            above = 1.0 if row.aerosol == "none" else gases.water_half
            terms[PATH] *= gases.ozone * gases.other * above
            yield Compared(row, {"round": terms}), float(gases.total)


def percent(value: float, digits: int = 2) -> str:
    """A signed share in per cent."""
    return f"{100 * value:+.{digits}f}"


def judged(c: Compared, setting: str) -> str:
    """Relative difference of the path reflectance, bold where the bar is missed."""
    cell = percent(c.path(setting) / c.row.path)
    return cell if c.met(setting) else f"**{cell}**"


def name_of(row: Row) -> list[str]:
    """First cells of a line."""
    return [row.spectral.removesuffix("nm"), f"{row.aod:g}", ", ".join(f"{a:g}" for a in row.angles)]


def long_table(found: Sequence[Compared]) -> str:
    """Every monochromatic row of one aerosol."""
    header = [
        "nm", "AOD", "Sun, view, azimuth", "path, 6S", "flat [%]", "round [%]", "flat", "round",
        "T↓T↑, 6S", "flat [%]", "round [%]", "S, 6S", "flat [%]", "round [%]",
    ]  # fmt: skip
    cells = [
        [
            *name_of(c.row), f"{c.row.path:.5f}", judged(c, "flat"), judged(c, "round"),
            f"{c.path('flat'):+.5f}", f"{c.path('round'):+.5f}",
            f"{c.row.up_and_down:.4f}", percent(c.through("flat")), percent(c.through("round")),
            f"{c.row.back:.4f}", percent(c.back("flat")), percent(c.back("round")),
        ]
        for c in found
    ]  # fmt: skip
    return table(header, cells)


def gas_table(found: Sequence[tuple[Compared, float]]) -> str:
    """Every row of bands with gases."""
    header = ["band", "aerosol, AOD", "Sun, view, azimuth", "T_gas, 6S", "ours less 6S", "ρ_toa, 6S", "[%]",
              "ours less 6S", "T↓T↑ [%]", "S [%]"]  # fmt: skip
    cells = []
    for c, total in found:
        band, aod, angles = name_of(c.row)
        cells.append([
            band, f"{c.row.aerosol}, {aod}", angles, f"{c.row.t_gas:.4f}", f"{total - c.row.t_gas:+.4f}",
            f"{c.row.path:.5f}", judged(c, "round"), f"{c.path('round'):+.5f}",
            percent(c.through("round")), percent(c.back("round")),
        ])  # fmt: skip
    return table(header, cells)


def summary(found: Sequence[Compared]) -> str:
    """Largest differences by aerosol, setting and Sun."""
    cells: list[list[Any]] = []
    for aerosol in dict.fromkeys(c.row.aerosol for c in found):
        of_it = [c for c in found if c.row.aerosol == aerosol]
        for setting in of_it[0].terms:
            for sun in sorted({c.row.angles[0] for c in of_it}):
                mine = [c for c in of_it if c.row.angles[0] == sun]
                off = [c.path(setting) for c in mine]
                share = [d / c.row.path for c, d in zip(mine, off, strict=True)]
                cells.append([
                    aerosol, setting, f"{sun:g}", len(mine), f"{percent(min(share))} to {percent(max(share))}",
                    f"{min(off):+.5f} to {max(off):+.5f}", sum(not c.met(setting) for c in mine),
                    f"{percent(min(c.through(setting) for c in mine))} to "
                    f"{percent(max(c.through(setting) for c in mine))}",
                    f"{percent(min(c.back(setting) for c in mine))} to {percent(max(c.back(setting) for c in mine))}",
                ])  # fmt: skip
    header = ["aerosol", "setting", "Sun [°]", "rows", "path [%]", "path", "outside the bar", "T↓T↑ [%]", "S [%]"]
    return table(header, cells)


def main() -> None:
    options = parser(__doc__)
    options.add_argument(
        "--reference", type=Path, default=Path(os.environ.get("SKYSCATTER_REFERENCE", ROOT.parent / "shared/reference"))
    )
    options.add_argument("--tolerance", type=float, default=0.01, help="of the solutions")
    options.add_argument("--threads", type=int)
    given = options.parse_args()
    where, rows = machine(), read(given.reference)
    found = list(lines([r for r in rows if not r.gas], given.tolerance, given.threads))
    gases = list(with_gases([r for r in rows if r.gas], given.tolerance, given.threads))
    blocks = ["### In short", summary(found)]
    for aerosol in dict.fromkeys(c.row.aerosol for c in found):
        blocks += ["### Air alone" if aerosol == "none" else f"### {aerosol.capitalize()}"]
        blocks += [long_table([c for c in found if c.row.aerosol == aerosol])]
    blocks += ["### Bands with gases", gas_table(gases)]
    report("sixs", where, versions("skyscatter", "numba", "numpy"), blocks, sys.argv, given.write, PAGE)


if __name__ == "__main__":
    main()
