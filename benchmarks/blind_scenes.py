"""Renders the blind scenes by which the taking off of haze is judged, into a folder of .npz files.

    python benchmarks/blind_scenes.py FOLDER [--size 64] [--walks 524288] [--only maritime]

A file that is there already is kept.  What a file holds, and how the scenes are made, is told in
`tests/dehaze_scenes.py`.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from dehaze_scenes import render, standard_set


def main() -> None:
    """Render what is missing, one line a scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--size", type=int, default=64, help="pixels along a side")
    parser.add_argument("--walks", type=int, default=1 << 19, help="random walks a scene")
    parser.add_argument("--only", default="", help="scenes whose name holds this")
    options = parser.parse_args()
    for blind in standard_set(options.size, options.walks):
        if options.only in blind.name:
            start = time.perf_counter()
            content = render(blind, options.folder)
            worst = content["standard_error"].max(axis=(1, 2))
            print(
                f"{blind.name}: {time.perf_counter() - start:.0f} s, standard error up to {worst.max():.5f}", flush=True
            )


if __name__ == "__main__":
    main()
