"""What it costs to have work done elsewhere: seconds a task, from one worker to two, and what a store takes.

The table for many workers is arithmetic with these numbers: a client hands tasks out one after the other, and a store
takes a chunk a task; with more workers than tasks that fit into one of them, more of them change nothing.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from common import machine, parser, report, table, versions

import skyscatter
from skyscatter.solvers.base import Rays
from skyscatter.tasks import Engine, Task, daskengine, engine_for
from skyscatter.tasks.store import Store

TASKS = 2000
#: Tasks that are longer than a group should take go one by one.
ALONE = f"dask, each by itself (as tasks longer than {daskengine.GROUP:g} s go)"
WAVELENGTHS = list(range(400, 701, 20))


def per_task(engine: Engine, tasks: int = TASKS) -> float:
    """Milliseconds that a task costs which does nothing, once the workers run."""
    list(engine.results(Task(abs, (k,), None, k) for k in range(50)))
    began = time.perf_counter()
    assert sum(1 for _ in engine.results(Task(abs, (k,), None, k) for k in range(tasks))) == tasks
    return 1e3 * (time.perf_counter() - began) / tasks


def engines(many: bool) -> dict[str, float]:
    """Milliseconds a task, by what runs it."""
    found = {}
    for name, given in {"threads": {"threads": 2}, "processes": {"executor": 2}}.items():
        with engine_for(**given) as engine:
            found[name] = per_task(engine)
    if many:
        from distributed import Client, LocalCluster

        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as c:
            found["dask"] = per_task(engine_for(c))
            most, daskengine.MOST = daskengine.MOST, 1
            found[ALONE] = per_task(engine_for(c), TASKS // 4)
            daskengine.MOST = most
    return found


def scene() -> Any:
    return skyscatter.load_model("earth-hazy").scene(sun_elevation_deg=20)


def picture(samples: int, **more: Any) -> float:
    """Seconds for a picture by walks."""
    camera = skyscatter.Panorama(width=128, height=64, elevation_min_deg=0.0)
    began = time.perf_counter()
    skyscatter.render(scene(), camera, WAVELENGTHS, solver=skyscatter.Path(samples=samples), **more)
    return time.perf_counter() - began


def scaling(samples: int) -> dict[str, tuple[float, float]]:
    """Seconds of the same picture with one worker and with two, once these run."""
    picture(16)
    found = {"threads": (picture(samples, threads=1), picture(samples, threads=2))}
    pair = []
    for workers in (1, 2):
        with engine_for(workers) as engine:
            picture(16, executor=engine)
            pair.append(picture(samples, executor=engine))
    found["processes"] = (pair[0], pair[1])
    return found


def stored(samples: int) -> tuple[float, float, float]:
    """Seconds with and without a store, and its megabytes."""
    plain = picture(samples)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run.zarr")
        kept = picture(samples, store=path)
        size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    return plain, kept, size / 1e6


def store_writes(tasks: int = 200) -> float:
    """Milliseconds to claim, write and look up a task of 128 rays with their sums."""
    import numpy as np

    rng = np.random.default_rng(1)
    values = {"radiance": rng.random((128, 16)), "sums": rng.random((128, 256))}
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder, "run.zarr"), {})
        store.put(0, 1, values, tasks, 128)
        began = time.perf_counter()
        for k in range(1, tasks):
            assert store.get(k, 128) is None
            store.claims.take(f"{k}")
            store.put(k, 1, values, tasks, 128)
            store.claims.give_back(f"{k}")
        store.close()
    return 1e3 * (time.perf_counter() - began) / (tasks - 1)


def task_seconds(samples: int) -> float:
    """Seconds of a tile of 128 rays."""
    import numpy as np

    from skyscatter.solvers.base import Asked
    from skyscatter.solvers.run import load_solver

    camera = skyscatter.Panorama(width=128, height=1, elevation_min_deg=20.0, elevation_max_deg=25.0)
    directions = camera.directions().reshape(-1, 3)
    rays = Rays(np.tile(scene().observer.position, (128, 1)), directions, np.arange(128))
    module, options = load_solver("path", scene()), Asked(skyscatter.Path(samples=samples))
    context = module.prepare(scene(), rays, np.array(WAVELENGTHS, float), options, 1, None)
    module.solve(context, rays, options)
    began = time.perf_counter()
    module.solve(context, rays, options)
    return time.perf_counter() - began


def model(task: float, handing: float, writing: float, tasks: int, workers: int) -> float:
    """Seconds for so many tasks: the workers' share, or what the client can hand out and keep, whichever is longer."""
    return max(-(-tasks // workers) * task, tasks * (handing + writing))


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--samples", type=int, default=192, help="walks a pixel of the picture that is timed")
    arguments.add_argument("--no-dask", action="store_true", help="leave dask out")
    given, where = arguments.parse_args(), machine()
    costs = engines(not given.no_dask)
    times = scaling(given.samples)
    plain, kept, size = stored(given.samples)
    writing, task = store_writes(), task_seconds(given.samples)
    handing = costs.get(ALONE if task > daskengine.GROUP else "dask", costs["processes"])
    tables = [
        table(["what runs tasks", "ms a task"], [[name, f"{ms:.2f}"] for name, ms in costs.items()]),
        table(
            ["picture by walks", "one worker [s]", "two [s]", "times faster"],
            [[name, f"{a:.1f}", f"{b:.1f}", f"{a / b:.2f}"] for name, (a, b) in times.items()],
        ),
        table(
            ["store", "value"],
            [
                ["the same picture without and with a store [s]", f"{plain:.1f}, {kept:.1f}"],
                ["its size [MB]", f"{size:.1f}"],
                ["to claim, write and look up a task [ms]", f"{writing:.1f}"],
            ],
        ),
        f"On paper: tiles of 128 rays that take {task:.2f} s each ({given.samples} walks a ray), handed out by one "
        f"client at {handing:.2f} ms and kept at {writing:.1f} ms each, in a picture of 2048x1024 pixels.",
        table(
            ["workers", "seconds", "busy"],
            [
                [n, f"{s:.0f}", f"{100 * 16384 * task / n / s:.0f} %"]
                for n in (1, 10, 100, 1000, 4000)
                for s in [model(task, handing / 1e3, writing / 1e3, 16384, n)]
            ],
        ),
        f"One client feeds {task / ((handing + writing) / 1e3):.0f} workers with such tiles; beyond that take more "
        "walks a ray, or several clients on one store, which share it by claims.  What limits it first is the writing "
        "of sums; a disk that is slower than this machine's limits it earlier.  Sending a solved field to each worker "
        "once, compiling or loading kernels there, and the tiles that are left when others are done come on top.",
    ]
    report("workers", where, versions("dask", "loky", "zarr"), tables, sys.argv, given.write)


if __name__ == "__main__":
    main()
