"""Make data/constellation_lines.csv from the lines of d3-celestial.  Needs: npm pack d3-celestial, unpacked.

d3-celestial (Olaf Frohn, BSD-3-Clause) draws lines between places; here they join the stars of data/stars.npz that
stand there.  Run once by hand: ``python tools/make_constellations.py package/data/constellations.lines.json``.
"""

from __future__ import annotations

import argparse
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
from _table import DATA, write_table

#: A star is one of a line if it stands this close to its end [degree]; the nearest one is taken.
NEAR = 0.15


def main() -> None:
    """Read, find the stars, write pairs of their numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("lines", type=Path, help="constellations.lines.json of d3-celestial")
    with np.load(DATA / "stars.npz") as stars:
        number, places = stars["hip"], unit(1e-7 * stars["ra"], 1e-7 * stars["dec"])
    pairs: list[tuple[int, int]] = []
    for feature in json.loads(parser.parse_args().lines.read_text())["features"]:
        for line in feature["geometry"]["coordinates"]:
            ra, dec = np.array(line).T
            near = places @ unit(ra, dec).T
            best = np.argmax(near, axis=0)
            off = np.degrees(np.arccos(np.clip(near[best, np.arange(len(line))], -1.0, 1.0)))
            if off.max() > NEAR:  # Xi Ursae Majoris, a multiple star of which Hipparcos has no solution
                print(f"{feature['id']}: no star within {NEAR} degrees of {line[int(off.argmax())]}, left out")
            hips = number[best[off <= NEAR]].tolist()
            pairs += [(a, b) for a, b in pairwise(hips) if a != b]
    write_table(
        "constellation_lines.csv",
        [
            "Lines of the constellations, each between two stars by their numbers in Hipparcos.",
            "From d3-celestial, Copyright (c) 2015 Olaf Frohn, BSD-3-Clause, with the stars that stand at their ends.",
        ],
        ["line", "from_hip", "to_hip"],
        [(str(k), str(a), str(b)) for k, (a, b) in enumerate(dict.fromkeys(pairs), start=1)],
    )


def unit(ra: np.ndarray, dec: np.ndarray) -> np.ndarray:
    """Unit vectors of places [degree]."""
    a, d = np.radians(ra), np.radians(dec)
    return np.stack([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)], axis=-1)


if __name__ == "__main__":
    main()
