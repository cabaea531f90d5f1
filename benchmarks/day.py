"""A day as a sequence: seconds for all frames, and the greatest change of exposure from one to the next.

Frames of Munich's longest day, from before sunrise to after sunset, to numbered PNG files by the command; then the same
from the store that kept them, which is what a second film of them costs.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, report, table, versions

from skyscatter.image.png import read_png

#: Goals: minutes for the day, and the change of exposure that eyes do not see [EV].
MINUTES, CHANGE = 3.0, 0.1


def made(words: list[str]) -> float:
    """Seconds of a command."""
    began = time.monotonic()
    subprocess.run(words, check=True)
    return time.monotonic() - began


def exposures(folder: Path, name: str) -> Any:
    """Exposure of each frame [EV], as its file says."""
    pictures = [read_png(path).texts["skyscatter-picture"] for path in sorted(folder.glob(f"{name}-*.png"))]
    return np.array([json.loads(text)["ev100"] for text in pictures])


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--frames", type=int, default=96)
    arguments.add_argument("--size", default="1024x512")
    arguments.add_argument("--wavelengths", default="380:780:20")
    arguments.add_argument("--workers", type=int, help="processes in place of threads")
    given, where = arguments.parse_args(), machine()
    step = f"{int(18 * 60e4 / (given.frames - 1)) / 1e4:.4f}min"  # never longer, or the last frame would be lost
    words = [sys.executable, "-m", "skyscatter", "sky", "earth", "--place", "48.1,11.6", "-q"]
    words += ["--times", f"2026-06-21T02:30:2026-06-21T20:30:{step}", "--size", given.size]
    words += ["--wavelengths", given.wavelengths]
    workers = [] if given.workers is None else ["--workers", str(given.workers)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store = ["--store", str(folder / "day.zarr")]
        plain = made([*words, *workers, "-o", str(folder / "day.png")])
        kept = made([*words, *workers, *store, "-o", str(folder / "kept.png")])
        again = made([*words, *store, "-o", str(folder / "again.png")])
        found = exposures(folder, "day")
        if not np.array_equal(found, exposures(folder, "again")):
            raise SystemExit("the frames of the store are others")
        size = sum(path.stat().st_size for path in (folder / "day.zarr").rglob("*") if path.is_file())
    change = float(np.abs(np.diff(found)).max())
    rows = [
        ["frames", len(found)],
        [f"seconds (goal {60 * MINUTES:.0f} on two quiet processors)", f"{plain:.0f}"],
        ["seconds with a store", f"{kept:.0f}"],
        ["seconds for the frames of that store once more", f"{again:.1f}"],
        ["size of the store [MB]", f"{size / 1e6:.0f}"],
        [f"greatest change of exposure from frame to frame [EV] (goal {CHANGE:g})", f"{change:.3f}"],
        ["exposures from, to [EV]", f"{found.min():.1f}, {found.max():.1f}"],
    ]
    text = f"{given.size} pixels, {given.wavelengths} nm, {'threads' if not workers else ' '.join(workers)}."
    report("day", where, versions("numba", "numpy"), [text, table(["a day", "value"], rows)], sys.argv, given.write)


if __name__ == "__main__":
    main()
