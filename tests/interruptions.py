"""Commands that are ended at random moments: what was there before stays, and what goes on ends with the same bits.

    python tests/interruptions.py --moments 20 --job sky-path --job nebula-photons

ends every job at so many moments, by Ctrl-C (once or twice), SIGTERM and SIGKILL in turn, and goes on from what is
kept.  The moments are random and spread over the whole time that the job takes: loading, tables, solving, writing.  It
stops at the first thing that is wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

#: Ways to end a command: signals, the second one a moment after the first.
WAYS: dict[str, tuple[int, ...]] = {
    "Ctrl-C": (signal.SIGINT,),
    "SIGTERM": (signal.SIGTERM,),
    "SIGKILL": (signal.SIGKILL,),
    "Ctrl-C twice": (signal.SIGINT, signal.SIGINT),
    "SIGTERM, Ctrl-C": (signal.SIGTERM, signal.SIGINT),
}
STATUS = {"Ctrl-C": 130, "SIGTERM": 143, "SIGKILL": -9, "Ctrl-C twice": 130, "SIGTERM, Ctrl-C": 143}
#: Seconds within which a command has to answer, and after which the program has begun to listen.
ANSWER, BEGUN = 5.0, 0.4
#: The last moments lie this much after the time that a job has taken.
LONGER = 1.03
OLD = b"what was there before"


@dataclass(frozen=True)
class Job:
    """A command with its outputs; ``resumes`` where it keeps what is finished."""

    words: str
    outputs: tuple[str, ...]
    resumes: bool = True
    prepare: Callable[[Path], None] = field(default=lambda folder: None)
    #: Nothing is compiled before: it is ended while it compiles, and goes on with what compiled functions were kept.
    cold: bool = False

    @property
    def checkpoint(self) -> str:
        """Where it keeps what is finished."""
        return f"{self.outputs[0]}.partial.zarr"

    @property
    def partials(self) -> set[str]:
        """Names of unfinished outputs."""
        return {f"{Path(name).stem}.partial{Path(name).suffix}" for name in self.outputs}


@cache
def measured_sky() -> str:
    """A sky of the model that is fitted, in three directions, as a table."""
    import skyscatter
    from skyscatter.geometry.vectors import direction_from_azimuth_elevation

    model = skyscatter.load_model("earth-hazy")
    scene = model.scene(sun_elevation_deg=40.0)
    places = [(a, e) for a in (90.0, 180.0) for e in (30.0, 60.0)]
    wavelengths = (450.0, 550.0, 650.0)
    looks = direction_from_azimuth_elevation(*np.transpose(places))
    seen = skyscatter.radiance(scene, scene.observer.position, looks, wavelengths, "single").radiance
    lines = ["azimuth_deg,elevation_deg,wavelength_nm,radiance,sigma,sun_elevation_deg"]
    for (azimuth, elevation), row in zip(places, seen.tolist(), strict=True):
        lines += [f"{azimuth},{elevation},{w},{x},{0.02 * x},40" for w, x in zip(wavelengths, row, strict=True)]
    return "\n".join([*lines, ""])


def measured(folder: Path) -> None:
    """That sky as a file."""
    (folder / "sky.csv").write_text(measured_sky())


def cloud(folder: Path) -> None:
    """A star in a small cloud of dust."""
    (folder / "cloud.toml").write_text(CLOUD)


def hazy_picture(folder: Path) -> None:
    """A picture under a veil."""
    from PIL import Image

    rng = np.random.default_rng(1)
    pixels = 90 + 120 * rng.random((600, 800, 3)).repeat(2, 0)[:600]
    Image.fromarray(pixels.astype(np.uint8)).save(folder / "hazy.png")


CLOUD = """
name = "cloud"
description = "A star in a small cloud of dust."
view = { ra_deg = 67.9, dec_deg = 18.2, distance = "140 pc" }

[[stars]]
name = "star"
temperature = 5000
luminosity = 1

[[components]]
name = "dust"
optics = { kind = "dust", mixture = "milky-way-3.1", hydrogen_density = 3e9 }

[components.density]
kind = "sampled"
cells = [24, 24, 24]
low = ["-260 au", "-260 au", "-260 au"]
high = ["260 au", "260 au", "260 au"]
field = { kind = "sphere", radius = "240 au" }
"""
SKY = "sky earth-simple --sun-elevation 20 --wavelengths 450,550 --checkpoint 0.2s -o sky.fits -o sky.png"
NEBULA = "nebula cloud.toml --wavelengths 450,550 --checkpoint 0.2s -o nebula.fits"
ROOM = "render fog-room --wavelengths 450,550 --checkpoint 0.2s -o room.fits"
JOBS = {
    "sky-orders": Job(f"{SKY} --size 48x24", ("sky.fits", "sky.png")),
    "sky-path": Job(f"{SKY} --size 24x12 --solver path --samples 8", ("sky.fits", "sky.png")),
    "sky-single": Job(f"{SKY} --size 256x128 --solver single", ("sky.fits", "sky.png")),
    "nebula-path": Job(f"{NEBULA} --size 6x6 --solver path --samples 8", ("nebula.fits",), prepare=cloud),
    "nebula-single": Job(f"{NEBULA} --size 24x24 --solver single", ("nebula.fits",), prepare=cloud),
    "nebula-photons": Job(
        f"{NEBULA} --size 16x16 --solver photons --samples 12 --photons 1000", ("nebula.fits",), prepare=cloud,
    ),
    "render-path": Job(f"{ROOM} --size 8x8 --solver path --samples 16", ("room.fits",)),
    "render-photons": Job(f"{ROOM} --size 16x12 --solver photons --samples 20 --photons 1000", ("room.fits",)),
    "flux": Job(
        "flux earth-simple --altitude 0:20km:10km --sun-elevation 20,50 --wavelengths 450,550 --checkpoint 0.2s "
        "-o flux.nc -o flux.csv",
        ("flux.nc", "flux.csv"),
    ),
    "invert": Job(
        "invert earth-hazy --data sky.csv --solver single --free haze.optical_depth --free ground.grey_albedo "
        "-o fit.json", ("fit.json",), prepare=measured,
    ),
    "dehaze": Job("dehaze hazy.png -o clear.png", ("clear.png",), False, hazy_picture),
    "models": Job("models show earth-simple --plot earth.png", ("earth.png",), False),
    "cold-single": Job(f"{NEBULA} --size 8x8 --solver single", ("nebula.fits",), prepare=cloud, cold=True),
    # Passes and walks that take far longer than anyone would wait for.
    "long-pass": Job(f"{NEBULA} --size 32x32 --solver photons --photons 1000000000", ("nebula.fits",), prepare=cloud),
    "long-walk": Job(f"{SKY} --size 16x8 --solver path --noise 0.0001%", ("sky.fits", "sky.png")),
}  # fmt: skip
#: Those that do not come to an end, and after how many seconds they are ended at the latest.
ENDLESS, LATEST = ("long-pass", "long-walk"), 6.0


def command(job: Job, *more: str) -> list[str]:
    """The job as a process."""
    quiet = [] if job.words.startswith("models") else ["--quiet"]
    return [sys.executable, "-m", "skyscatter", *job.words.split(), *quiet, *more]


def content(path: Path) -> Any:
    """What a file holds, but for the time that it took."""
    if path.suffix == ".fits":
        from skyscatter.image.spectral import SpectralImage

        image = SpectralImage.load(path)
        return [np.asarray(image.radiance).tobytes(), np.asarray(image.standard_error).tobytes()]
    if path.suffix == ".nc":
        import xarray

        with xarray.open_dataset(path) as dataset:
            return {name: dataset[name].values.tobytes() for name in dataset.variables}
    if path.suffix == ".csv":
        return path.read_text()
    if path.suffix == ".json":
        return {name: value for name, value in json.loads(path.read_text()).items() if name != "seconds"}
    from PIL import Image

    with Image.open(path) as picture:
        return np.asarray(picture).tobytes()


@dataclass
class Judge:
    """A job, what it should make, and how long that takes."""

    job: Job
    ends: bool = True
    wanted: list[Any] = field(default_factory=list)
    seconds: float = LATEST
    seen: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0
    environment: dict[str, str] = field(default_factory=lambda: {**os.environ, "PYTHONFAULTHANDLER": "1"})

    def measure(self, warm: bool) -> None:
        """Run it to its end, before once more where it may compile."""
        if not self.ends:
            return
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            self.job.prepare(folder)
            took = []
            for _ in range(2 if warm else 1):
                began = time.monotonic()
                self._run(folder)
                took.append(time.monotonic() - began)
            self.seconds = min(took)  # others may have been at work
            self.wanted = [content(folder / output) for output in self.job.outputs]

    def _run(self, folder: Path, *more: str) -> None:
        words = command(self.job, *more)
        subprocess.run(words, cwd=folder, check=True, env=self.environment, stdout=subprocess.DEVNULL)

    def end(self, way: str, after: float) -> None:
        """End it after so many seconds, look at what is there, and go on."""
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            self.job.prepare(folder)
            given = {path.name for path in folder.iterdir()}
            for output in self.job.outputs:
                (folder / output).write_bytes(OLD)
            status = self._send(folder, way, after)
            self.seen[way] += 1
            there = {path.name for path in folder.iterdir()} - given
            if status == 0:
                self.seen["finished before"] += 1
                self._check_whole(folder, there, "finished")
                return
            assert status == STATUS[way], f"{way} after {after:.2f} s: exit status {status}"
            replaced = [output for output in self.job.outputs if (folder / output).read_bytes() != OLD]
            # It may have been struck between the last file and its end.
            for output in replaced:
                assert content(folder / output) == self.wanted[self.job.outputs.index(output)], f"{output} is damaged"
            hidden = {one for one in there if one.startswith(".")}
            assert not hidden or way == "SIGKILL", f"{way} after {after:.2f} s left {sorted(hidden)}"
            kept = {self.job.checkpoint, *self.job.partials} if self.job.resumes else set()
            strange = there - hidden - kept - set(self.job.outputs)
            assert not strange, f"{way} after {after:.2f} s left {sorted(strange)}"
            if self.job.checkpoint in there and self.ends:
                self.seen["gone on"] += 1
                self._run(folder, "--resume", self.job.checkpoint)
                left = {path.name for path in folder.iterdir()} - given - hidden
                self._check_whole(folder, left, f"{way} after {after:.2f} s, gone on")

    def _check_whole(self, folder: Path, there: set[str], when: str) -> None:
        assert there == set(self.job.outputs), f"{when}: left {sorted(there)}"
        for output, wanted in zip(self.job.outputs, self.wanted, strict=True):
            assert content(folder / output) == wanted, f"{when}: {output} is another"

    def _send(self, folder: Path, way: str, after: float) -> int:
        with open(folder.with_suffix(".err"), "w+b") as error:
            process = subprocess.Popen(
                command(self.job), cwd=folder, stdout=subprocess.DEVNULL, stderr=error, env=self.environment
            )
            try:
                process.wait(after)
            except subprocess.TimeoutExpired:
                began = time.monotonic()
                for number in WAYS[way]:
                    process.send_signal(number)
                    time.sleep(0.1)
                try:
                    process.wait(3 * ANSWER)
                except subprocess.TimeoutExpired:
                    process.send_signal(signal.SIGABRT)  # it says where its threads are
                    process.wait(ANSWER)
                    error.seek(0)
                    raise AssertionError(f"{way} after {after:.2f} s: no end\n{error.read().decode()}") from None
                finally:
                    process.kill()
                    process.wait()
                took = time.monotonic() - began
                self.slowest = max(self.slowest, took)
                assert took < ANSWER + 1.0, f"{way} after {after:.2f} s: ended only {took:.1f} s later"
            error.seek(0)
            said = error.read().decode()
            assert "Traceback" not in said, said
        folder.with_suffix(".err").unlink()
        return process.returncode

    def report(self) -> str:
        """One line."""
        counts = ", ".join(f"{name} {count}" for name, count in sorted(self.seen.items()))
        return f"takes {self.seconds:.1f} s; {counts}; slowest answer {self.slowest:.1f} s"


def judge(
    name: str, moments: int, seed: int = 1, ways: Sequence[str] = tuple(WAYS), earliest: float = 0.0, warm: bool = True
) -> Judge:
    """End a job at random moments, in all ways in turn.

    Parameters
    ----------
    name : str
        Of `JOBS`.
    moments : int
    seed : int
    ways : sequence of str
        Of `WAYS`.
    earliest : float
        No moment before this share of the time that the job takes.
    warm : bool
        Run it once before that time is taken.
    """
    found, draw = Judge(JOBS[name], name not in ENDLESS), random.Random(f"{name} {seed}")
    found.measure(warm)
    with tempfile.TemporaryDirectory() as empty:
        if found.job.cold:
            found.seconds, found.environment["NUMBA_CACHE_DIR"] = LATEST, empty
        first = max(BEGUN, earliest * found.seconds)
        for k, share in enumerate(spread(moments, draw)):
            found.end(ways[k % len(ways)], first + share * (LONGER * found.seconds - first))
    return found


def spread(count: int, draw: random.Random) -> list[float]:
    """Random numbers between 0 and 1 in random order, one in every one of so many equal parts."""
    shares = [(k + draw.random()) / count for k in range(count)]
    draw.shuffle(shares)
    return shares


def main() -> None:
    """Judge jobs and print what was found."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--moments", type=int, default=20)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--job", action="append", choices=list(JOBS), help="may be repeated; else all")
    given = options.parse_args()
    os.environ.setdefault("SKYSCATTER_TRACEBACK", "1")
    for name in given.job or JOBS:
        print(f"{name}: {judge(name, given.moments, given.seed).report()}", flush=True)


if __name__ == "__main__":
    main()
