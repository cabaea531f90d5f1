"""Speed and memory of dehazing: what a processor corrects in a second, and a raster of the largest usual size.

The work behind a table that exists already is timed in memory (read from an array, written into one) and for files (a
GeoTIFF in, a Cloud-Optimised GeoTIFF out) with 3 and 12 bands on 1 and 2 threads; pictures likewise.  The dark-channel
prior of He, Sun & Tang (2009) is the peer.  `--large` makes a raster of 10980 x 10980 pixels and 12 bands and corrects
it in a process of its own, whose peak memory is told.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, report, table, versions

BANDS = ("B01", "B02", "B03", "B04", "B05", "B06", "B07", "B08", "B8A", "B09", "B11", "B12")
SUN, VIEW, AZIMUTH = 35.0, 5.0, 100.0
SCALE, OFFSET = 1e-4, -0.1


def scene(bands: int, size: int, seed: int = 1) -> np.ndarray:
    """Numbers of a made-up landscape, (band, y, x): dark and bright patches with texture."""
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(0.02, 0.4, (bands, size // 32 + 1, size // 32 + 1)).astype(np.float32)
    fine = np.repeat(np.repeat(coarse, 32, axis=1), 32, axis=2)[:, :size, :size]
    values = fine * rng.uniform(0.9, 1.1, fine.shape).astype(np.float32) + 0.06
    return np.clip((values - OFFSET) / SCALE, 1, 65535).astype(np.uint16)


def write_raster(path: Path, bands: int, width: int, height: int) -> None:
    """A tiled GeoTIFF of such numbers, a row of blocks at a time."""
    import rasterio
    from rasterio.transform import from_origin

    block = 512
    tile = scene(bands, 2048)
    profile = {
        "driver": "GTiff", "width": width, "height": height, "count": bands, "dtype": "uint16", "tiled": True,
        "blockxsize": block, "blockysize": block, "crs": "EPSG:32633", "transform": from_origin(4e5, 5e6, 10, 10),
        "compress": "deflate", "zlevel": 1, "BIGTIFF": "IF_SAFER",
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as file:
        file.scales, file.offsets = (SCALE,) * bands, (OFFSET,) * bands
        for band, name in enumerate(BANDS[:bands] if bands > 3 else ("B02", "B03", "B04"), 1):
            file.set_band_description(band, name)
        for row in range(0, height, block):
            high = min(block, height - row)
            start = row % (2048 - block)
            for col in range(0, width, 2048):
                wide = min(2048, width - col)
                part = tile[:, start : start + high, :wide]
                file.write(part, window=rasterio.windows.Window(col, row, wide, high))


def source_options(bands: int) -> Any:
    """How the made-up images are read."""
    from skyscatter.dehaze import SourceOptions

    return SourceOptions(
        sensor="sentinel-2a", sun_zenith_deg=SUN, view_zenith_deg=VIEW, relative_azimuth_deg=AZIMUTH, scale=SCALE,
        offset=OFFSET, quantity="reflectance",
    )  # fmt: skip


def in_memory(bands: int, size: int, threads: int, sigma: bool) -> tuple[float, float]:
    """Seconds by the clock and of the processor for an image in memory whose table is kept; the first run warms up."""
    from skyscatter.dehaze import DehazeOptions
    from skyscatter.dehaze.engine import dehaze_raster
    from skyscatter.dehaze.rasters.arrays import ArraySource
    from skyscatter.dehaze.rasters.sinks import ArraySink

    names = BANDS[:bands] if bands > 3 else ("B02", "B03", "B04")
    image = scene(bands, size)
    options = DehazeOptions(aerosol="continental", threads=threads, pixel_size_m=10)
    best = (np.inf, np.inf)
    for _ in range(2):
        source = ArraySource(image, source_options(bands), names=names)
        sinks = {"result": ArraySink(size, size, bands)}
        if sigma:
            sinks["sigma"] = ArraySink(size, size, bands)
        clock, cpu = time.perf_counter(), time.process_time()
        dehaze_raster(source, sinks, options)
        best = min(best, (time.perf_counter() - clock, time.process_time() - cpu))
    return best


def picture(size: int, threads: int) -> tuple[float, float]:
    """The same for a plain picture of three bands."""
    from skyscatter.dehaze import DehazeOptions
    from skyscatter.dehaze.engine import dehaze_raster
    from skyscatter.dehaze.rasters.arrays import ArraySource
    from skyscatter.dehaze.rasters.sinks import ArraySink

    image = (scene(3, size) / 24).clip(1, 255).astype(np.uint8)
    best = (np.inf, np.inf)
    for _ in range(3):
        source = ArraySource(image, names=("red", "green", "blue"))
        sinks = {"result": ArraySink(size, size, 3)}
        clock, cpu = time.perf_counter(), time.process_time()
        dehaze_raster(source, sinks, DehazeOptions(threads=threads))
        best = min(best, (time.perf_counter() - clock, time.process_time() - cpu))
    return best


def dark_channel(size: int) -> float:
    """Seconds of the processor that the peer takes."""
    sys.path.insert(0, str(Path(__file__).parent))
    from dehaze_pictures import dark_channel_prior

    image = (scene(3, size) / 6000).clip(0, 1).astype(float)
    start = time.process_time()
    dark_channel_prior(image)
    return time.process_time() - start


def tables() -> list[list[Any]]:
    """Seconds to solve a table, for a search and for a known amount of haze."""
    from skyscatter.dehaze import Atmosphere, build_table, load_sensor
    from skyscatter.dehaze.table import Angles

    sensor = load_sensor("sentinel-2a")
    rows = []
    for names in (("B02", "B03", "B04"), BANDS):
        print(f"tables of {len(names)} bands", file=sys.stderr)
        bands = [sensor.band(name) for name in names]
        for aod in (0.2, None):
            for label, angles in (("one direction", Angles.spanned(SUN, VIEW, AZIMUTH)),):
                clock, cpu = time.perf_counter(), time.process_time()
                made = build_table(Atmosphere(), bands, angles, aod=aod, keep=False)
                seconds = time.perf_counter() - clock, time.process_time() - cpu
                known = "known" if aod is not None else "searched"
                rows.append(
                    [len(names), label, known, len(made.aod), *(f"{s:.1f}" for s in seconds), f"{made.error:.5f}"]
                )
    return rows


def large(folder: Path, width: int, height: int, *more: str) -> dict[str, Any]:
    """A raster of that size through the command, in a process of its own: seconds and peak memory, its workers' too."""
    raster = folder / "large.tif"
    write_raster(raster, 12, width, height)
    code = (
        "import sys, resource, json, time\n"
        "from skyscatter.cli.main import main\n"
        "clock, cpu = time.perf_counter(), time.process_time()\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit as end:\n    assert not end.code, end.code\n"
        "both = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN\n"
        "used = [resource.getrusage(who).ru_maxrss / 1024 for who in both]\n"
        "print(json.dumps([time.perf_counter() - clock, time.process_time() - cpu, *used]))\n"
    )
    arguments = [
        "dehaze", str(raster), "-o", str(folder / "out.tif"), "--sensor", "sentinel-2a", "--sun-zenith", str(SUN),
        "--view-zenith", str(VIEW), "--relative-azimuth", str(AZIMUTH), "--aerosol", "continental",
        "--compression", "none", "-q", *more,
    ]  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    seconds, cpu, megabytes, worker = json.loads(done.stdout.splitlines()[-1])
    return {"seconds": seconds, "cpu": cpu, "MB": megabytes, "worker": worker}


def capped(size: str) -> str:
    """A line about a raster whose workers may take a gigabyte each."""
    width, height = (int(word) for word in size.split("x"))
    with tempfile.TemporaryDirectory() as folder:
        found = large(Path(folder), width, height, "--workers", "2", "--worker-memory", "1GB")
    speed = f"{found['seconds']:.0f} s, {12e-6 * width * height / found['seconds']:.0f} Mpx-bands/s"
    return (
        f"A raster of {size} pixels and 12 bands, 2 workers with a gigabyte each at most, the table kept from before: "
        f"{speed}; peak memory {found['MB']:.0f} MB of the program, {found['worker']:.0f} MB of a worker."
    )


def main() -> None:
    made = parser(__doc__)
    made.add_argument("--size", type=int, default=2048, help="edge of the images in memory [pixel]")
    made.add_argument("--large", type=int, default=0, help="edge of a raster of 12 bands on disk, such as 10980")
    made.add_argument("--capped", metavar="WxH", help="do nothing but a raster of that size, such as 20000x10000")
    given = made.parse_args()
    where, lines, rows = machine(), [], []
    if given.capped:
        packages = versions("skyscatter", "numpy", "numba", "rasterio")
        lines = [capped(given.capped)]
        report("dehaze-capped", where, packages, lines, ["dehaze_speed.py", *sys.argv[1:]], given.write)
        return
    for bands in (3, 12):
        for threads in (1, 2):
            for sigma in (False, True) if threads == 1 else (False,):
                clock, cpu = in_memory(bands, given.size, threads, sigma)
                count = bands * given.size**2 / 1e6
                what = "surface and sigma" if sigma else "surface"
                rows.append(
                    [what, bands, threads, f"{clock:.2f}", f"{cpu:.2f}", f"{count / clock:.0f}", f"{count / cpu:.0f}"]
                )
    for threads in (1, 2):
        clock, cpu = picture(given.size, threads)
        count = 3 * given.size**2 / 1e6
        rows.append(
            ["plain picture", 3, threads, f"{clock:.2f}", f"{cpu:.2f}", f"{count / clock:.0f}", f"{count / cpu:.0f}"]
        )
    peer = dark_channel(1024)
    rows.append(["dark-channel prior", 3, 1, "", f"{peer:.2f} (1024²)", "", f"{3 * 1024**2 / 1e6 / peer:.1f}"])
    head = ["work", "bands", "threads", "s", "s of the processor", "Mpx-bands/s", "per s of the processor"]
    lines += [
        f"Images of {given.size}² in memory, all told: two looks, the estimate, the correction.",
        table(head, rows),
    ]
    head = ["bands", "angles", "haze", "solutions", "s", "s of the processor", "stated error"]
    lines += ["Tables, the continental model, nothing kept:", table(head, tables())]
    if given.large:
        with tempfile.TemporaryDirectory() as folder:
            found = large(Path(folder), given.large, given.large, "--threads", "2")
        count = 12 * given.large**2 / 1e6
        clock, cpu = found["seconds"], found["cpu"]
        speed = f"{clock:.0f} s, {cpu:.0f} s of the processor, {count / clock:.0f} Mpx-bands/s"
        lines.append(
            f"A raster of {given.large}² pixels and 12 bands, GeoTIFF to COG without compression, 2 threads, the table "
            f"kept from before: {speed}; peak memory {found['MB']:.0f} MB."
        )
    lines.append(f"This process: peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB.")
    packages = versions("skyscatter", "numpy", "numba", "rasterio")
    report("dehaze-speed", where, packages, lines, ["dehaze_speed.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
