"""A million particles and a voxel grid with a star within, as pictures: seconds of the whole command, and of its parts.

The particles are drawn from the turbulent cloud of `clouds.py`, with smoothing lengths from their 32 neighbours and
everything else as it comes.  `skyscatter nebula MODEL -o picture.png` is run in a process of its own, once to compile
what is missing and then timed; then the parts of the work are timed within this process.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from clouds import particles_of, turbulent_cloud
from common import machine, median_seconds, parser, processors, report, seconds, show, table, versions

GOAL = 60.0  #: for a million particles at 512x512 [s]
MODEL = """
name = "{name}"
[view]
distance = "400 pc"
[[stars]]
position = ["0.15 pc", "0.2 pc", "0.1 pc"]
temperature = 18000
luminosity = 2000
[[components]]
name = "dust"
density = {density}
optics = {{ kind = "particles", optical_depth = 3.0, angstrom_exponent = 1.0, single_scattering_albedo = 0.6, \
phase = {{ kind = "henyey-greenstein", g = 0.5 }} }}
"""
DENSITIES = {
    "particles": '{{ kind = "sph-particles", file = "{file}", length_unit = "1 pc" }}',
    "voxels": '{{ kind = "voxels", file = "{file}", spacing = "{spacing} pc" }}',
}


def write_model(folder: Path, name: str, given: Any) -> Path:
    """Write a model and its data; the path of the model."""
    density = turbulent_cloud(given.cells)
    data = folder / ("cloud.npz" if name == "particles" else "cloud.npy")
    if name == "particles":
        np.savez(data, positions=particles_of(density, given.particles))
    else:
        np.save(data, density)
    model = folder / f"{name}.toml"
    text = DENSITIES[name].format(file=data.as_posix(), spacing=2 / given.cells)
    model.write_text(MODEL.format(name=name, density=text), encoding="utf-8")
    return model


def parts(model: Path, given: Any) -> list[list[Any]]:
    """Seconds of building and of rendering, kernels warm."""
    import skyscatter
    from skyscatter.geometry.telescope import Telescope
    from skyscatter.solvers.volume import compile_volume
    from skyscatter.space import MARGIN

    wavelengths = np.arange(380.0, 781.0, 10.0)
    scene: Any
    read, scene = seconds(lambda: skyscatter.load_model(str(model)).scene())
    field = scene.medium.components[0].density
    rows: list[list[Any]] = [["model, file; of particles, neighbours and smoothing lengths", read]]
    if hasattr(field, "particles"):
        rows[0][1] += seconds(lambda: field.particles)[0]
        if field.cells:
            rows.append([f"grid of {field.cells} cells along its longest side", seconds(lambda: field.grid)[0]])
    rows.append(["tables of the medium", seconds(lambda: compile_volume(scene, tuple(wavelengths.tolist())))[0]])
    low, high = (np.asarray(edge) for edge in field.bounds)
    across = 2 * MARGIN * float(np.abs([low, high]).max())
    camera = Telescope.from_length(given.size, given.size, across, scene.view.distance)
    took, image = seconds(
        lambda: skyscatter.render(
            scene, camera, wavelengths, solver=skyscatter.Path(samples=given.samples), threads=given.threads
        )
    )
    rows.append(["rendering", took])
    value, error = np.asarray(image.radiance), np.asarray(image.standard_error)
    lit = (value > 1e-3 * np.median(value[value > 0])) & (error > 0)
    noise = 100 * float(np.median(error[lit] / value[lit]))
    rows.append([f"median noise of a pixel at one wavelength, {given.samples} walks [%]", noise])
    return rows


def measure(name: str, given: Any) -> list[str]:
    """The blocks of one scene."""
    with tempfile.TemporaryDirectory() as folder:
        model = write_model(Path(folder), name, given)
        command = [sys.executable, "-m", "skyscatter.cli.main", "nebula", str(model), "-q"]
        more = ["-o", str(model.with_suffix(".png")), "--samples", str(given.samples), "--threads", str(given.threads)]

        def run(size: int) -> None:
            subprocess.run([*command, *more, "--size", f"{size}x{size}"], check=True)

        run(16)  # compiles
        whole, _ = median_seconds(lambda: run(given.size), given.repeats)
        rows = parts(model, given)
    what = f"{given.particles:,} particles" if name == "particles" else f"{given.cells}^3 voxels"
    goal = f" Goal: below {GOAL:g} s." if name == "particles" else ""
    return [
        f"**{what}**, {given.size}x{given.size} pixels, 41 wavelengths, {given.samples} walks a pixel, {given.threads} "
        f"threads: the whole command takes {show(whole)} s.{goal}",
        table(["part, kernels warm", "seconds"], rows),
    ]


def main() -> None:
    options = parser(__doc__, repeats=1)
    options.add_argument("--quick", action="store_true", help="20 000 particles, 64^3 voxels, 64x64 pixels")
    options.add_argument("--scenes", default=",".join(DENSITIES), help="by commas")
    options.add_argument("--particles", type=int, default=1_000_000)
    options.add_argument("--cells", type=int, default=256, help="voxels along a side")
    options.add_argument("--size", type=int, default=512, help="pixels along a side")
    options.add_argument("--samples", type=int, default=4, help="walks per pixel")
    options.add_argument("--threads", type=int, default=min(2, processors()))
    given = options.parse_args()
    if given.quick:
        given.particles, given.cells, given.size = 20_000, 64, 64
    if set(given.scenes.split(",")) - set(DENSITIES):
        raise SystemExit(f"--scenes from {', '.join(DENSITIES)}")
    where, started = machine(), time.perf_counter()
    blocks = [block for name in given.scenes.split(",") for block in measure(name, given)]
    blocks.append(f"Benchmark itself: {time.perf_counter() - started:.0f} s.")
    packages = versions("skyscatter", "numba", "numpy")
    report("particles", where, packages, blocks, ["particles.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
