"""The same by MPI: one process hands tiles out, all others solve them.

    pip install mpi4py
    mpiexec -n 33 python -m mpi4py.futures mpi.py
"""

from __future__ import annotations

import skyscatter


def main() -> None:
    from mpi4py.futures import MPIPoolExecutor

    scene = skyscatter.load_model("earth-hazy").scene(sun_elevation_deg=5)
    camera = skyscatter.Panorama(width=512, height=256)
    with MPIPoolExecutor() as pool:
        image = skyscatter.render(
            scene, camera, range(400, 701, 20), solver=skyscatter.Path(samples=256), executor=pool, store="sky.zarr"
        )
    image.save("sky.exr")


if __name__ == "__main__":
    main()
