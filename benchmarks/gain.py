"""Time to equal error of the walks of this checkout beside those of an older one.

    git worktree add ../older COMMIT
    python benchmarks/gain.py --before ../older --write

Both render the older checkout's model files with the same walks and several seeds, in turns, on one thread; seconds are
the processor's.  The noise of a pixel is its standard deviation over the seeds: by the median over pixels that have
some, relative to each, and as the root mean square over them, relative to their mean light.  The gain is the ratio of
time times squared noise.  The light of both pictures is compared, in standard errors.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

Array = Any
WAVELENGTHS = [450.0, 500.8, 550.0, 600.0, 656.5]
#: Walks a pixel of each scene, for a second or more a picture: what a picture costs besides them, some 0.03 s, does not
#: count then.
WALKS = {
    "reflection-nebula": 64,
    "dark-globule": 256,
    "turbulent-pillar": 32,
    "hii-region": 32,
    "ring-nebula": 32,
    "star-in-dust": 64,
    "dusty-disk": 16,
    "fog-room": 256,
    "milk-and-water": 256,
    "light-guide": 1024,
    "searchlight": 128,
    "city-skyglow": 128,
}


def camera_of(model: Any, scene: Any, side: int, across: str) -> Any:
    """Of a square picture so wide, in any checkout."""
    import skyscatter

    if model.command == "nebula":
        return skyscatter.Telescope.from_length(side, side, across, scene.view.distance)
    return type(model.camera)(**{**model.camera.model_dump(), "width": side, "height": side})


def path_options(walks: int, seed: int) -> dict[str, Any]:
    """Of `render`, in any checkout."""
    import skyscatter

    record = getattr(skyscatter, "Path", None)
    loose = {"solver": "path", "samples": walks, "seed": seed, "threads": 1}
    return loose if record is None else {"solver": record(samples=walks, seed=seed), "threads": 1}


def render_seeds(file: str, side: int, across: str, walks: int, runs: int, out: str) -> None:
    """Pictures of a model file and the seconds of processor that each took, into a file."""
    import skyscatter

    warnings.simplefilter("ignore")
    model: Any = skyscatter.load_model(file)
    scene = model.scene()
    camera = camera_of(model, scene, side, across)
    skyscatter.render(scene, camera_of(model, scene, 2, across), WAVELENGTHS, **path_options(2, 0))
    light, seconds = [], []
    for seed in range(1, runs + 1):
        start = time.process_time()
        light.append(np.asarray(skyscatter.render(scene, camera, WAVELENGTHS, **path_options(walks, seed)).radiance))
        seconds.append(time.process_time() - start)
    np.savez(out, light=np.stack(light), seconds=seconds)


class Runs(NamedTuple):
    """Pictures (run, y, x, wavelength) and seconds of each."""

    light: Array
    seconds: Array

    def spread(self) -> Array:
        """Standard deviations of single pixels (y, x, wavelength)."""
        return np.asarray(self.light.std(axis=0, ddof=1))

    def total(self, noisy: Array) -> tuple[float, float]:
        """Mean light of some pixels, all wavelengths alike, and its standard error."""
        light = np.where(noisy, self.light, 0.0).mean(axis=(1, 2))
        each = (light / light.mean(axis=0).clip(1e-300)).mean(axis=1) * light.mean()
        return float(each.mean()), float(each.std(ddof=1) / np.sqrt(len(each)))


def noise(spread: Array, level: Array, noisy: Array) -> tuple[float, float]:
    """By the median of noisy pixels, relative to each, and as the root mean square, relative to their mean light."""
    mean = np.where(noisy, level, 0.0).sum(axis=(0, 1)) / noisy.sum(axis=(0, 1)).clip(1)
    return float(np.median((spread / level.clip(1e-300))[noisy])), float(np.sqrt(np.mean((spread / mean)[noisy] ** 2)))


def runs_of(checkout: Path, file: Path, across: Any, walks: int, given: Any) -> Runs:
    """Runs of a checkout: a process of its own, which finds its package there."""
    found: list[Any] = []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "runs.npz"
        words = [str(word) for word in (file.resolve(), given.side, across, walks, given.runs, out)]
        environment = {**os.environ, "PYTHONPATH": str(checkout), "NUMBA_NUM_THREADS": "1"}
        subprocess.run([sys.executable, __file__, "--render", *words], check=True, env=environment, cwd=folder)
        with np.load(out) as arrays:
            found = [arrays["light"], arrays["seconds"]]
    return Runs(*found)


def row_of(name: str, given: Any) -> list[Any]:
    """A row of the table."""
    import skyscatter
    from skyscatter.space import width_of_all

    file = given.before / "models" / f"{name}.toml"
    model: Any = skyscatter.load_model(name)
    across = (model.picture_width or width_of_all(model.scene(), 1.0)) if model.command == "nebula" else ""
    here = Path(__file__).resolve().parents[1]
    old, new = (runs_of(checkout, file, across, WALKS[name], given) for checkout in (given.before.resolve(), here))
    level = (old.light.mean(axis=0) + new.light.mean(axis=0)) / 2
    # Stars and space behind have no noise, and what is a thousand times darker than the mean shows none.
    noisy = (np.maximum(old.spread(), new.spread()) > 1e-6 * level) & (level > 1e-3 * level.mean(axis=(0, 1)))
    before, after = (noise(runs.spread(), level, noisy) for runs in (old, new))
    clock = [float(np.median(runs.seconds)) for runs in (old, new)]
    gains = [clock[0] * b**2 / (clock[1] * a**2) if a > 0 else float("nan") for b, a in zip(before, after, strict=True)]
    (was, was_error), (now, now_error) = old.total(noisy), new.total(noisy)
    off = (was - now) / np.hypot(was_error, now_error)
    percent = [f"{100 * value:.3g} %" for value in (before[0], after[0], before[1], after[1])]
    return [name, WALKS[name], *(f"{value:.2f}" for value in clock), *percent, *(f"{gain:.3g}" for gain in gains),
            f"{was / now:.4f}", f"{off:+.1f}"]  # fmt: skip


def main() -> None:
    """Render with both, compare and report."""
    from common import machine, parser, report, table, versions

    made = parser(__doc__)
    made.add_argument("--before", type=Path, required=True, metavar="DIR", help="the older checkout")
    made.add_argument("--scenes", nargs="+", choices=list(WALKS), default=list(WALKS), metavar="NAME")
    made.add_argument("--side", type=int, default=32, help="side of the pictures [pixel]")
    made.add_argument("--runs", type=int, default=12, help="seeds of each")
    given = made.parse_args()
    where, rows = machine(), []
    commit = subprocess.run(["git", "-C", str(given.before), "log", "-1", "--format=%h of %cs"], check=True,
                            capture_output=True, text=True).stdout.strip()  # fmt: skip
    for name in given.scenes:
        rows.append(row_of(name, given))
        print(rows[-1], flush=True)
    header = ["scene", "walks", "seconds before", "after", "median noise before", "after", "root mean square before",
              "after", "gain by the median", "by the root mean square", "light before over after",
              "standard errors off"]  # fmt: skip
    size = f"Pictures of {given.side}x{given.side} pixels, 5 wavelengths, {given.runs} seeds, one thread."
    words = f"Before: {commit}. {size}"
    report("gain", where, versions("skyscatter", "numba"), [words, table(header, rows)], sys.argv, given.write)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--render"]:
        file_, side_, across_, walks_, runs_, out_ = sys.argv[2:]
        render_seeds(file_, int(side_), across_, int(walks_), int(runs_), out_)
    else:
        main()
