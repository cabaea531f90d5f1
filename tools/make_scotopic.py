"""Re-tabulate the CIE 1951 scotopic observer from colour-science into data/scotopic.csv.

Run once by hand: ``python tools/make_scotopic.py``.
"""

from __future__ import annotations

from pathlib import Path

import colour

TARGET = Path(__file__).resolve().parent.parent / "data" / "scotopic.csv"
HEAD = """\
# Luminous efficiency of the dark-adapted eye V'(lambda), the CIE scotopic standard observer (CIE 1951; CIE S 010).
# wavelength [nm, air; taken as vacuum], efficiency [1]; as shipped by colour-science, BSD-3-Clause.
wavelength_nm,efficiency
"""


def main() -> None:
    """Write the table."""
    efficiency = colour.SDS_LEFS["CIE 1951 Scotopic Standard Observer"]
    rows = [f"{nm},{float(efficiency[nm]):.6g}\n" for nm in range(380, 781, 5)]
    TARGET.write_text(HEAD + "".join(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
