"""Images under hazes of 6SV 1.1, of kinds that dehazing solves for and of others: do its standard deviations hold?

    python benchmarks/dehaze_sixs_blind.py --write

Amount and kind are found by itself.  The tables of six geometries take a quarter of an hour when they are not kept
yet, the 720 images five minutes more.  `benchmarks/sixs_terms.py` makes the hazes, `tests/sixs_scenes.py` the images.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from common import machine, parser, report, rms, table, versions

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from dehaze_judged import Judged  # noqa: E402
from sixs_scenes import INSIDE, OUTSIDE, SixsScene, all_scenes, covered, judged  # noqa: E402

PAGE = ROOT / "docs" / "validation-dehaze-blind.md"
#: Deviations within which a normal law has 68, 90 and 95 %.
INTERVALS = (1.0, 1.645, 1.96)

Found = Sequence[tuple[SixsScene, Judged]]


def cells(found: Found) -> list[str]:
    """Coverage of every band, then of the optical depth."""
    off = np.array([(j.aod - s.aod) / j.aod_sigma for s, j in found])
    return [
        str(len(found)), *(f"{100 * share:.0f}" for share in covered(j for _, j in found)),
        *(f"{100 * np.mean(np.abs(off) <= limit):.0f}" for limit in INTERVALS), f"{off.mean():+.2f}",
    ]  # fmt: skip


def error_cells(found: Found) -> list[str]:
    """Root mean square of errors over that of the deviations that were said, in 1e-4."""
    error, sigma = (np.stack([part(j) for _, j in found]) for part in (lambda j: j.error, lambda j: j.sigma))
    return [f"{1e4 * rms(error[:, b]):.0f} / {1e4 * rms(sigma[:, b]):.0f}" for b in range(error.shape[1])]


def groups(found: Found) -> list[tuple[str, Found]]:
    """By aerosol, geometry, landscape and depth, and all."""
    made: list[tuple[str, Found]] = []
    for name in (*INSIDE, *OUTSIDE):
        made.append((name, [f for f in found if f[0].aerosol == name]))
    made.append(("solved for", [f for f in found if f[0].aerosol in INSIDE]))
    made.append(("not solved for", [f for f in found if f[0].aerosol in OUTSIDE]))
    for sun in sorted({s.geometry[0] for s, _ in found}):
        made.append((f"Sun at {sun:g}°", [f for f in found if f[0].geometry[0] == sun]))
    for landscape in sorted({s.landscape for s, _ in found}):
        made.append((f"over {landscape}", [f for f in found if f[0].landscape == landscape]))
    for aod in sorted({s.aod for s, _ in found}):
        made.append((f"AOD {aod:g}", [f for f in found if f[0].aod == aod]))
    return [*made, ("**all**", found)]


def main() -> None:
    """Judge all, print the tables and write them where that is asked for."""
    given = parser(__doc__).parse_args()
    where, found = machine(), [(scene, judged(scene)) for scene in all_scenes()]
    head = ["AOD 68 %", "90 %", "95 %", "mean"]
    bands = [f"{wl:.0f}" for wl in (442.7, 492.4, 559.8, 664.6, 740.5, 832.8, 1613.7, 2202.4)]
    blocks = [
        "Share of pixels [%] whose true reflectance is within one σ, by band [nm]; share of scenes whose true AOD is "
        "within the interval of 68, 90 and 95 %; mean of the AOD's error over its σ.",
        table(["hazes", "scenes", *bands, *head], [[n, *cells(f)] for n, f in groups(found)]),
        "Root mean square of the errors / of the σ, 1e-4:",
        table(["hazes", *bands], [[n, *error_cells(f)] for n, f in groups(found)]),
    ]  # fmt: skip
    report("sixs-blind", where, versions("skyscatter", "numpy"), blocks, sys.argv, given.write, PAGE)


if __name__ == "__main__":
    main()
