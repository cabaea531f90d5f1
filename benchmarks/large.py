"""A nebula cube that memory does not hold: seconds and peak memory of the command that makes it, and what is in it.

The child process may not take more address space than it is told (numpy, compilers and libraries included), so that a
cube that is held anywhere ends it.  Light scattered once in a small cloud is cheap: what is measured is the way of the
numbers, not the light.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from common import machine, parser, report, table, versions

MODEL = """
name = "globe"

[view]
distance = "400 pc"

[[stars]]
name = "A"
position = ["0 pc", "0 pc", "1 pc"]
temperature = 15000
luminosity = 800

[[components]]
name = "dust"
[components.density]
kind = "sphere"
radius = "0.1 pc"
[components.optics]
kind = "dust"
hydrogen_density = 2e9
"""


def watched(words: list[str], cap: int) -> tuple[float, int]:
    """Seconds, and peak memory [byte], of a command with a capped address space, at 1 sight in 50 ms."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (cap, cap))

    began = time.monotonic()
    # Threads of the linear algebra have address space of their own that nobody uses.
    child = subprocess.Popen(
        words, preexec_fn=limit, env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
    )
    peak = [0]

    def look() -> None:
        while child.poll() is None:
            try:
                lines = Path(f"/proc/{child.pid}/status").read_text().splitlines()
            except OSError:
                return
            peak[0] = max([peak[0], *(1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM"))])
            time.sleep(0.05)

    threading.Thread(target=look, daemon=True).start()
    if child.wait():
        raise SystemExit(f"the command ended with status {child.returncode}")
    return time.monotonic() - began, peak[0]


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--size", type=int, default=4096, help="pixels along a side")
    arguments.add_argument("--wavelengths", type=int, default=64)
    arguments.add_argument("--cap", type=float, default=1.0, help="address space beyond that of an idle one [GB]")
    arguments.add_argument("--folder", type=Path, help="where the files go, else a temporary folder")
    given, where = arguments.parse_args(), machine()
    with tempfile.TemporaryDirectory(dir=given.folder) as name:
        folder = Path(name)
        (folder / "globe.toml").write_text(MODEL)
        rows: list[list[Any]] = []
        command = [sys.executable, "-m", "skyscatter"]
        step = 320 / max(given.wavelengths - 1, 1)
        grid = ",".join(f"{400 + k * step:.6f}" for k in range(given.wavelengths))
        size, store = f"{given.size}x{given.size}", folder / "run.zarr"
        cap = int(given.cap * 1e9)
        make = [*command, "nebula", str(folder / "globe.toml"), "--solver", "single", "--size", size]
        make += ["--wavelengths", grid, "--store", str(store), "-o", str(folder / "cube.fits"), "--progress", "log"]
        cube = 8 * given.size**2 * given.wavelengths / 1e9
        seconds, peak = watched(make, cap)
        rows.append(
            ["nebula --store run.zarr -o cube.fits", f"{seconds:.0f}", f"{peak / 1e6:.0f}", _size(folder / "cube.fits")]
        )
        for kind in (".exr", ".nc", ".zarr"):
            path = folder / f"cube{kind}"
            seconds, peak = watched([*command, "store", "export", str(store), "-o", str(path)], cap)
            rows.append([f"store export -o cube{kind}", f"{seconds:.0f}", f"{peak / 1e6:.0f}", _size(path)])
        rows.append(["(the store)", "", "", _size(store)])
    text = (
        f"A cube of {size} pixels and {given.wavelengths} wavelengths, {cube:.2f} GB in double precision, by commands "
        f"that may take {given.cap:g} GB of address space."
    )
    tables = [text, table(["command", "seconds", "peak memory [MB]", "on the disk [GB]"], rows)]
    report("large", where, versions("astropy", "OpenEXR", "h5netcdf", "zarr"), tables, sys.argv, given.write)


def _size(path: Path) -> str:
    files = [path] if path.is_file() else [p for p in path.rglob("*") if p.is_file()]
    return f"{sum(p.stat().st_size for p in files) / 1e9:.2f}"


if __name__ == "__main__":
    main()
