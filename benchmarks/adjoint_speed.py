"""What the gradient of an image with respect to all voxels costs, in forward renders.

A picture of 256x256 pixels of 64^3 voxels around a star; the gradient is that of a misfit of the picture, columns to
the star and their way back included.  The solver `single`, which is adaptive, is timed on the same rays.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import common
import numpy as np
from tomography import dusty_scene, random_blobs

from skyscatter import radiance
from skyscatter.inversion.voxelimage import VoxelModel
from skyscatter.inversion.voxelscene import VoxelFrame


def timed(function: Any, repeats: int) -> tuple[float, float]:
    """Median time on the clock and on the processors [s]."""
    clock, busy = [], []
    for _ in range(repeats):
        a, b = time.perf_counter(), time.process_time()
        function()
        clock.append(time.perf_counter() - a)
        busy.append(time.process_time() - b)
    return float(np.median(clock)), float(np.median(busy))


def main() -> None:
    """Command line."""
    parser = common.parser(__doc__, repeats=3)
    parser.add_argument("--cells", type=int, default=64)
    parser.add_argument("--pixels", type=int, default=256)
    given, where = parser.parse_args(), common.machine()
    frame = VoxelFrame.cube(given.cells, 1.0)
    density = random_blobs(frame, 3, column=1.0)
    a = ((np.arange(given.pixels) + 0.5) / given.pixels * 2 - 1) * 1.05
    origins = np.stack([*np.meshgrid(a, a), np.full((given.pixels,) * 2, 5.0)], axis=-1).reshape(-1, 3)
    directions = np.broadcast_to([0.0, 0.0, -1.0], origins.shape)
    scene, rows = dusty_scene(frame, density), []
    for wavelengths in ([550.0], list(np.linspace(400, 700, 8))):
        model = VoxelModel.from_scene(scene, wavelengths)
        few = (origins[:64], directions[:64])
        data = np.zeros((len(origins), len(wavelengths)))
        model.gradient(density, *few, 1.0, data=0.0)  # compiles
        model.tangent(density, density, *few)
        runs = {
            "forward": lambda m=model: m.image(density, origins, directions),
            "gradient of all voxels": lambda m=model, d=data: m.gradient(density, origins, directions, 1.0, data=d),
            "with optics and lights": lambda m=model, d=data: m.gradient(
                density, origins, directions, 1.0, data=d, optics=True
            ),
            "tangent": lambda m=model: m.tangent(density, density, origins, directions),
        }
        if len(wavelengths) == 1:
            radiance(scene, *few, wavelengths, "single")
            runs["solver single"] = lambda: radiance(scene, origins, directions, [550.0], "single")
        times = {name: timed(run, given.repeats if name != "solver single" else 1) for name, run in runs.items()}
        for name, (clock, busy) in times.items():
            rows.append([len(wavelengths), name, clock, busy, busy / times["forward"][1]])
    header = ["wavelengths", "what", "time [s]", "processor time [s]", "forward renders (processor time)"]
    words = [Path(sys.argv[0]).name, *sys.argv[1:]]
    title = f"{given.pixels}x{given.pixels} pixels, {given.cells}^3 voxels:\n\n"
    packages = common.versions("numpy", "numba")
    common.report("adjoint", where, packages, [title + common.table(header, rows)], words, given.write)


if __name__ == "__main__":
    main()
