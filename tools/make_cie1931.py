"""Re-tabulate the CIE 1931 2-degree standard observer from colour-science into data/cie1931.csv.

Run once by hand: ``python tools/make_cie1931.py``.  colour-science takes seconds to import, the table milliseconds.
"""

from __future__ import annotations

from pathlib import Path

import colour

OBSERVER = "CIE 1931 2 Degree Standard Observer"
TARGET = Path(__file__).resolve().parent.parent / "data" / "cie1931.csv"


def main() -> None:
    """Write one line for each nanometre from 360 to 830 nm, with every digit that colour-science has."""
    observer = colour.MSDS_CMFS[OBSERVER]
    lines = ["wavelength_nm,x_bar,y_bar,z_bar"]
    for wavelength, (x, y, z) in zip(observer.wavelengths, observer.values, strict=True):
        lines.append(f"{wavelength:.0f},{x:.12g},{y:.12g},{z:.12g}")
    TARGET.parent.mkdir(exist_ok=True)
    TARGET.write_text("\n".join(lines) + "\n", encoding="ascii")


if __name__ == "__main__":
    main()
