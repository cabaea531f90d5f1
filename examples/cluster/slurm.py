"""A picture by walks on the nodes of a SLURM cluster, kept in a store from which the next job goes on.

    pip install 'skyscatter[cluster]' dask-jobqueue
    python slurm.py --queue batch --nodes 8
"""

from __future__ import annotations

import argparse

import skyscatter


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--queue", help="partition of the cluster")
    parser.add_argument("--nodes", type=int, default=2, help="jobs of 16 cores each")
    parser.add_argument("--samples", type=int, default=1024, help="walks a pixel")
    parser.add_argument("--store", default="sky.zarr", help="folder on a disk that this machine sees")
    parser.add_argument("--show", action="store_true", help="print the script that SLURM would get, and end")
    given = parser.parse_args()

    from dask_jobqueue import SLURMCluster
    from distributed import Client

    cluster = SLURMCluster(
        queue=given.queue,
        cores=16,
        processes=16,  # kernels run in one thread each
        memory="32GB",
        walltime="02:00:00",
        job_extra_directives=["--signal=B:TERM@120"],
        job_script_prologue=["export NUMBA_CACHE_DIR=$HOME/kernels-$(uname -m)", "skyscatter warm sky -q"],
        worker_extra_args=["--lifetime", "110m", "--lifetime-stagger", "4m"],  # they end by themselves, in time
    )
    if given.show:
        print(cluster.job_script())
        return
    cluster.scale(jobs=given.nodes)
    scene = skyscatter.load_model("earth-hazy").scene(sun_elevation_deg=5)
    camera = skyscatter.Panorama(width=2048, height=1024)
    walks = skyscatter.Path(samples=given.samples)
    with Client(cluster) as client:
        image = skyscatter.render(
            scene, camera, range(400, 701, 20), solver=walks, executor=client, store=given.store
        )
    image.save("sky.exr")


if __name__ == "__main__":
    main()
