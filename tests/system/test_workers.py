"""One job by everything that can run it: the same bits; and what is killed in the middle loses and repeats nothing."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked

import skyscatter
from skyscatter.cli.main import main
from skyscatter.solvers.render import picture_of

pytestmark = pytest.mark.slow

#: A picture of some twenty tiles of each solver.
CAMERA = skyscatter.Panorama(width=64, height=40)
WAVELENGTHS = [450, 550, 650]
JOBS: dict[str, dict[str, Any]] = {
    "path": {"solver": "path", "samples": 32, "stokes": True},
    "orders": {"solver": "orders"},
    "photons": {"solver": "photons", "samples": 6, "photons": 2000},
}
#: Where other programs find this file, and what it imports.
HERE = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

MPI = """
import sys
import numpy as np
sys.path[:0] = {here!r}
from test_workers import JOBS, made
if __name__ == "__main__":
    from mpi4py.futures import MPIPoolExecutor
    with MPIPoolExecutor(2) as pool:
        for name in JOBS:
            image = made(name, executor=pool)
            np.savez({there!r} + "/" + name + ".npz", radiance=image.radiance, error=image.standard_error)
"""


def made(name: str, **more: Any) -> Any:
    if name == "photons":
        scene: Any = skyscatter.load_model("fog-room").scene()
        camera: Any = scene_camera()
    else:
        scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30)
        camera = CAMERA
    return skyscatter.render(scene, camera, WAVELENGTHS, **asked(**JOBS[name], **more))


def scene_camera() -> Any:
    return skyscatter.load_model("fog-room").camera.model_copy(update={"width": 20, "height": 15})


@pytest.fixture(scope="module")
def plain() -> dict[str, Any]:
    return {name: made(name) for name in JOBS}


def same(image: Any, wanted: Any) -> None:
    np.testing.assert_array_equal(image.radiance, wanted.radiance)
    np.testing.assert_array_equal(image.standard_error, wanted.standard_error)
    for name in wanted.layers:
        np.testing.assert_array_equal(image.layers[name], wanted.layers[name])


@pytest.mark.parametrize("name", JOBS)
@pytest.mark.parametrize("kind", ["one thread", "four threads", "processes"])
def test_threads_and_processes(name: str, kind: str, plain: dict[str, Any]) -> None:
    more = {"one thread": {"threads": 1}, "four threads": {"threads": 4}, "processes": {"executor": 2}}[kind]
    same(made(name, **more), plain[name])


def test_dask_with_four_workers(plain: dict[str, Any]) -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=4, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        for name in JOBS:
            same(made(name, executor=client), plain[name])
            same(made(name, executor=client.get_executor()), plain[name])
        # One of them is killed in the middle: the others finish.
        victim = next(iter(client.scheduler_info(n_workers=-1)["workers"].values()))["id"]
        process = cluster.workers[victim].process.process.pid if victim in cluster.workers else None
        assert process is not None
        killer = subprocess.Popen([sys.executable, "-c", f"import os, time; time.sleep(0.3); os.kill({process}, 9)"])
        same(made("path", executor=client), plain["path"])
        killer.wait()


def test_mpi(plain: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("mpi4py")
    launcher = shutil.which("mpiexec", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    if launcher is None:
        pytest.skip("mpiexec is not installed")
    script = tmp_path / "job.py"
    script.write_text(MPI.format(here=HERE, there=str(tmp_path)))
    words = [launcher, "-n", "3", sys.executable, "-m", "mpi4py.futures", str(script)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr[-2000:]
    for name in JOBS:
        with np.load(tmp_path / f"{name}.npz") as found:
            np.testing.assert_array_equal(found["radiance"], plain[name].radiance)
            np.testing.assert_array_equal(found["error"], plain[name].standard_error)


def test_a_worker_process_is_killed(plain: dict[str, Any]) -> None:
    import threading

    from skyscatter.tasks.processes import Processes

    with Processes(2) as engine:
        made("orders", executor=engine)  # they run
        pids = list(engine._executor._processes)  # type: ignore[attr-defined]
        killer = threading.Timer(0.3, os.kill, (pids[0], signal.SIGKILL))
        killer.start()
        same(made("path", executor=engine), plain["path"])
        killer.join()
        assert pids[0] not in list(engine._executor._processes)  # type: ignore[attr-defined]


#: A program that renders into a store and counts what it made and found.
CLIENT = """
import json, sys
sys.path[:0] = json.loads(sys.argv[1])
from test_workers import made
from skyscatter.tasks.store import Store
put, made_here = Store.put, []
def counted(self, task, amount, *rest):
    put(self, task, amount, *rest)
    with open(sys.argv[4], "a") as file:
        file.write(f"{task} {amount}\\n")
Store.put = counted
made(sys.argv[3], store=sys.argv[2], threads=1)
print("done")
"""


def client(name: str, store: Path, log: Path) -> subprocess.Popen[str]:
    words = [sys.executable, "-c", CLIENT, json.dumps(HERE), str(store), name, str(log)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def lines(log: Path) -> list[str]:
    return log.read_text().splitlines() if log.exists() else []


@pytest.mark.parametrize("name", JOBS)
def test_a_client_is_killed_and_another_goes_on(name: str, plain: dict[str, Any], tmp_path: Path) -> None:
    store, log = tmp_path / "run.zarr", tmp_path / "log"
    first = client(name, store, log)
    until = time.monotonic() + 120
    while len(lines(log)) < (1 if name == "photons" else 3) and first.poll() is None and time.monotonic() < until:
        time.sleep(0.002)
    first.send_signal(signal.SIGKILL)
    first.communicate()
    before = lines(log)
    assert before
    second = client(name, store, log)
    out, err = second.communicate(timeout=200)
    assert "done" in out, err[-2000:]
    after = lines(log)
    # What was being kept when the first was killed may be there without having been counted.
    assert len(set(after)) == len(after), "nothing was done twice"
    same(picture_of(store), plain[name])


@pytest.mark.parametrize("name", ["path", "orders", "photons"])
def test_two_clients_on_one_store(name: str, plain: dict[str, Any], tmp_path: Path) -> None:
    store, log = tmp_path / "run.zarr", tmp_path / "log"
    both = [client(name, store, log) for _ in range(2)]
    for one in both:
        out, err = one.communicate(timeout=300)
        assert "done" in out, err[-2000:]
    assert len(set(lines(log))) == len(lines(log)), "nothing was done twice"
    same(picture_of(store), plain[name])


@contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[Path]:
    """A disk of its own; skips where it may not be mounted."""
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(words, capture_output=True).returncode:
        pytest.skip("a small disk cannot be mounted here: needs root")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=False)


def test_a_full_disk_is_waited_for(plain: dict[str, Any], tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 3000) as disk:
        (disk / "ballast").write_bytes(b"x" * 2_000_000)
        store, log = disk / "run.zarr", tmp_path / "log"
        run = client("path", store, log)
        until = time.monotonic() + 120
        while time.monotonic() < until and run.poll() is None:
            before = len(lines(log))
            time.sleep(4)
            if before and len(lines(log)) == before:
                break
        assert run.poll() is None, "it waits"
        assert shutil.disk_usage(disk).free < 60_000
        (disk / "ballast").unlink()
        out, err = run.communicate(timeout=200)
        assert "done" in out, err[-2000:]
        assert "the disk is full" in err
        assert len(set(lines(log))) == len(lines(log)), "nothing was done twice"
        same(picture_of(store), plain["path"])


def test_a_command_is_ended_and_repeated(tmp_path: Path) -> None:
    """Ctrl-C keeps what is finished in the store, says how to go on, and the repeated command gives the same files."""
    words = [sys.executable, "-m", "skyscatter", "sky", "earth-simple", "--solver", "path", "--samples", "256"]
    words += ["--size", "64x32", "--wavelengths", "450,550,650", "--store", str(tmp_path / "run.zarr")]
    run = subprocess.Popen([*words, "-o", str(tmp_path / "a.fits")], stderr=subprocess.PIPE, text=True)
    chunks = tmp_path / "run.zarr" / "values" / "c"
    until = time.monotonic() + 120
    while time.monotonic() < until and len(list(chunks.glob("*/0/0"))) < 3:
        time.sleep(0.05)
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert run.returncode == 130
    assert "go on with" in err
    listed = subprocess.run(
        [sys.executable, "-m", "skyscatter", "store", "list", str(tmp_path / "run.zarr"), "--json"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert 0 < json.loads(listed.stdout)["finished"] < json.loads(listed.stdout)["tasks"]
    for name, more in {"b.nc": [], "c.nc": ["--workers", "2"]}.items():
        store = words[: words.index("--store")] if name == "c.nc" else words
        subprocess.run([*store, *more, "-q", "-o", str(tmp_path / name)], check=True)
    one, two = (skyscatter.SpectralImage.load(tmp_path / name) for name in ("b.nc", "c.nc"))
    np.testing.assert_array_equal(one.radiance, two.radiance)
    np.testing.assert_array_equal(one.standard_error, two.standard_error)


def test_a_sequence_through_the_night_by_workers(tmp_path: Path) -> None:
    """What the air makes of the night's lights is found once a worker; the frames are those of one thread."""
    words = ["sky", "earth-simple", "--place", "48.1,11.6", "--times", "2026-06-21T20:00:2026-06-21T23:00:90min"]
    words += ["--size", "48x24", "--wavelengths", "450,550,650", "--tolerance", "2%", "-q"]
    ways = {"a": ["--threads", "1"], "b": ["--workers", "2"], "c": ["--store", str(tmp_path / "run.zarr")]}
    for name, more in ways.items():
        assert main([*words, *more, "-o", str(tmp_path / f"{name}.fits")]) == 0
    for k in (1, 2, 3):
        one, *others = (skyscatter.SpectralImage.load(tmp_path / f"{name}-000{k}.fits").radiance for name in ways)
        assert one.max() > 0, "there is light at night"
        for other in others:
            np.testing.assert_array_equal(other, one)


def test_a_sequence_is_killed_and_two_programs_go_on(tmp_path: Path) -> None:
    """Frames that are there stay as they are, the others are made once, and all are those of a run without a break."""
    words = [sys.executable, "-m", "skyscatter", "sky", "earth-simple", "--sun-elevations", "20:1:-1", "-q"]
    words += ["--size", "192x96", "--wavelengths", "450,550,650", "--tolerance", "2%"]
    store = ["--store", str(tmp_path / "run.zarr"), "--threads", "1"]
    subprocess.run([*words, "-o", str(tmp_path / "plain.png")], check=True)
    first = subprocess.Popen([*words, *store, "-o", str(tmp_path / "a.png")])
    until = time.monotonic() + 120
    while time.monotonic() < until and len(kept := sorted(tmp_path.rglob("frame-*.npz"))) < 3:
        time.sleep(0.02)
    first.send_signal(signal.SIGKILL)
    first.wait()
    before = {path: path.stat().st_mtime_ns for path in kept}
    both = [subprocess.Popen([*words, *store, "-o", str(tmp_path / f"{name}.png")]) for name in "bc"]
    assert [one.wait(200) for one in both] == [0, 0]
    assert 3 <= len(before) < 20
    assert {path: path.stat().st_mtime_ns for path in before} == before, "what was there was not made again"
    for k in range(1, 21):
        wanted = (tmp_path / f"plain-{k:04d}.png").read_bytes()
        assert all((tmp_path / f"{name}-{k:04d}.png").read_bytes() == wanted for name in "bc")
