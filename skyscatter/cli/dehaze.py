"""``skyscatter dehaze``: an image without its haze, from files to files."""

from __future__ import annotations

import json
import time as clock
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from skyscatter.cli import common, parse
from skyscatter.errors import DomainError, MissingDataError

RASTERS = (".tif", ".tiff")
PICTURES = (".png", ".jpg", ".jpeg")
#: Options that only one of the two entrances has: images with a geometry, and plain pictures.
PHYSICAL = ("aod", "aerosol", "pressure", "ground_height", "ozone", "water_vapour", "pixel_size", "no_adjacency")
PLAIN = ("strength", "alpha", "transfer")


@dataclass(frozen=True)
class Request:
    """What the command line asks for, checked as far as that goes without the image."""

    image: Path
    output: Path | None
    haze_map: Path | None
    sigma: Path | None
    mask: Path | None
    quicklook: Path | None
    json: bool
    quiet: bool
    progress: str
    dtype: str | None
    compression: str
    #: Options of the entrances that were given, by name.
    given: dict[str, Any]
    source: Any
    options: Any
    workers: int | None
    worker_memory: int | None
    scheduler: str | None

    @property
    def files(self) -> dict[str, Path]:
        """Files that the run itself writes, by what they hold."""
        paths = {"result": self.output, "haze_map": self.haze_map, "sigma": self.sigma, "mask": self.mask}
        return {name: path for name, path in paths.items() if path is not None}


def dehaze(
    image: Annotated[
        Path,
        typer.Argument(
            metavar="IN", help="GeoTIFF, PNG or JPEG; Sentinel-2 L1C SAFE (folder, .zip) or Landsat folder (or .tar)."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="Result: .tif (Cloud-Optimised), or .png, .jpg of pictures."
        ),
    ] = None,
    aod: Annotated[
        str | None,
        typer.Option(
            metavar="VALUE",
            help="Aerosol optical depth at 550 nm, 0 to 5; with its error: 0.25+-0.05; a map: aod.tif (band 2: its "
            "error); else estimated: auto.",
        ),
    ] = None,
    aerosol: Annotated[
        str | None, typer.Option(metavar="NAME", help="Aerosol model, or your own: .csv, .toml; else: auto.")
    ] = None,
    haze_map: Annotated[Path | None, typer.Option(metavar="FILE", help="Also write the map of the haze: .tif.")] = None,
    sigma: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write the standard uncertainty of every band: .tif.")
    ] = None,
    mask: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Also write the mask, .tif; bits: 1 no data, 2 saturated, 4 cloud, 8 cirrus, 16 water, "
            "32 shadow, 64 negative and set to 0, 128 haze uncertain.",
        ),
    ] = None,
    quicklook: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a picture of before and after, side by side: .png.")
    ] = None,
    as_json: common.AsJson = False,
    sensor: Annotated[
        str | None, typer.Option(metavar="NAME", help="sentinel-2a, landsat-8, ..., if the file does not say.")
    ] = None,
    bands: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Bands by name, colour or number, with commas; red=3 says what band 3 is; one name for each band if "
            "the file names none.",
        ),
    ] = None,
    sun_zenith: Annotated[
        str | None,
        typer.Option(metavar="DEG", help="Sun's zenith angle, if the metadata do not say or in their place."),
    ] = None,
    sun_azimuth: Annotated[str | None, typer.Option(metavar="DEG", help="Sun's azimuth from north.")] = None,
    view_zenith: Annotated[
        str | None, typer.Option(metavar="DEG", help="Sensor's zenith angle; nadir (0) if only the Sun is given.")
    ] = None,
    view_azimuth: Annotated[
        str | None, typer.Option(metavar="DEG", help="Sensor's azimuth from north, as seen from the ground.")
    ] = None,
    relative_azimuth: Annotated[
        str | None, typer.Option(metavar="DEG", help="In place of both azimuths; 0 has Sun and sensor on one side.")
    ] = None,
    pressure: Annotated[str | None, typer.Option(metavar="HPA", help="Pressure on the ground.")] = None,
    ground_height: Annotated[str | None, typer.Option(metavar="METRES", help="Height of the ground, instead.")] = None,
    ozone: Annotated[str | None, typer.Option(metavar="DU", help="Column of ozone.")] = None,
    water_vapour: Annotated[str | None, typer.Option(metavar="G_CM2", help="Column of water vapour.")] = None,
    scale: Annotated[
        str | None, typer.Option(metavar="X", help="value = scale * number + offset, if the file does not say.")
    ] = None,
    offset: Annotated[str | None, typer.Option(metavar="X", help="See --scale.")] = None,
    quantity: Annotated[
        str | None, typer.Option(metavar="NAME", help="What the values are: reflectance, radiance or display.")
    ] = None,
    strength: Annotated[
        str | None, typer.Option(metavar="X", help="Plain pictures: share of the veil to take off, 1 if not said.")
    ] = None,
    alpha: Annotated[
        str | None, typer.Option(metavar="X", help="Plain pictures: colour of the veil, 0 grey to 4 blue, else auto.")
    ] = None,
    transfer: Annotated[
        str | None, typer.Option(metavar="NAME", help="Plain pictures: linear (the default), srgb (cameras) or gamma.")
    ] = None,
    pixel_size: Annotated[
        str | None, typer.Option(metavar="METRES", help="Side of a pixel on the ground, if the file does not say.")
    ] = None,
    no_adjacency: Annotated[
        bool, typer.Option("--no-adjacency", help="Leave light from the surroundings of a pixel in it.")
    ] = False,
    window: Annotated[str | None, typer.Option(metavar="N", help="Pixels on a side of a window; no influence.")] = None,
    threads: common.Threads = None,
    workers: common.WorkerCount = None,
    worker_memory: common.WorkerMemory = None,
    scheduler: common.Scheduler = None,
    resolution: Annotated[
        str | None, typer.Option(metavar="METRES", help="Grid of a Sentinel-2 product: 10 (the default), 20 or 60.")
    ] = None,
    dtype: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="uint8, uint16, int16, float32; by default that of the image where it is fine enough, else float32.",
        ),
    ] = None,
    compression: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of .tif: deflate (the default), zstd, lzw or none.")
    ] = None,
    no_clobber: common.NoClobber = False,
    quiet: common.Quiet = False,
    verbose: common.Verbose = False,
    progress: common.ProgressMode = "auto",
) -> int:
    """Take the haze off a satellite image.

    With a sensor and angles (from metadata or options) the result is reflectance of the surface; a plain picture
    becomes a picture without its veil.
    """
    given = {
        "aod": aod,
        "aerosol": aerosol,
        "pressure": pressure,
        "ground_height": ground_height,
        "ozone": ozone,
        "water_vapour": water_vapour,
        "pixel_size": pixel_size,
        "no_adjacency": no_adjacency or None,
        "strength": strength,
        "alpha": alpha,
        "transfer": transfer,
    }
    files = {"output": output, "haze_map": haze_map, "sigma": sigma, "mask": mask, "quicklook": quicklook}
    _check_files(image, files, as_json, dtype, compression)
    parse.check_new(files.values() if no_clobber else ())
    work: dict[str, Any] = common.worker_options(workers, scheduler, worker_memory)
    request = Request(
        image=image,
        **files,
        json=as_json,
        quiet=quiet,
        progress=common.talk(quiet, verbose, progress),
        dtype=dtype,
        compression=compression or "deflate",
        given={name: value for name, value in given.items() if value is not None},
        source=_source_options(
            sensor=sensor,
            bands=None if bands is None else tuple(word.strip() for word in bands.split(",") if word.strip()),
            quantity=quantity,
            scale=scale,
            offset=offset,
            sun_zenith_deg=sun_zenith,
            sun_azimuth_deg=sun_azimuth,
            view_zenith_deg=view_zenith,
            view_azimuth_deg=view_azimuth,
            relative_azimuth_deg=relative_azimuth,
            resolution=resolution,
        ),
        options=_dehaze_options(
            aod=aod,
            aerosol=aerosol,
            pressure_hpa=pressure,
            ground_height_m=ground_height,
            ozone_du=ozone,
            water_vapour_g_cm2=water_vapour,
            pixel_size_m=pixel_size,
            adjacency=False if no_adjacency else None,
            strength=strength,
            alpha=alpha,
            transfer=transfer,
            window=parse.parse_integer(window, "window", 16, "give a number of pixels, 16 or more"),
            threads=parse.parse_integer(threads, "threads", 1, "give a number of threads, 1 or more"),
        ),
        workers=work["workers"],
        worker_memory=work["worker_memory"],
        scheduler=work["scheduler"],
    )
    # No checkpoint: solving atmospheres takes long, and they are kept between runs; a Cloud-Optimised GeoTIFF is laid
    # out from its whole content, so that half of one could not be gone on with.
    return common.stoppable(lambda: run(request), "nothing is written; solved atmospheres are kept for the next run")


def _source_options(**values: Any) -> Any:
    from skyscatter.dehaze.options import SourceOptions

    return SourceOptions(**{name: value for name, value in values.items() if value is not None})


def _dehaze_options(**values: Any) -> Any:
    from skyscatter.dehaze.options import DehazeOptions

    return DehazeOptions(**{name: value for name, value in values.items() if value is not None})


def _check_files(
    image: Path, files: dict[str, Path | None], as_json: bool, dtype: str | None, compression: str | None
) -> None:
    """Refuse what cannot be written, what would be written twice, and runs of which nothing would be kept."""
    if not image.exists():
        raise MissingDataError(image, "there is no such image; check the path")
    known = {"output": RASTERS + PICTURES, "quicklook": (".png",)}
    seen = {image.resolve(): "the image itself"}
    written = {name: path for name, path in files.items() if path is not None}
    for name, path in written.items():
        parse.check_output(path, known.get(name, RASTERS))
        if path.resolve() in seen:
            raise DomainError(name, str(path), f"is {seen[path.resolve()]}; give another name")
        seen[path.resolve()] = f"the file of --{name.replace('_', '-')}"
    if not written and not as_json:
        raise DomainError("output", "", "nothing would be kept; name a file with -o, or ask for --json")
    if files["output"] is None:
        for name, value in (("quicklook", files["quicklook"]), ("dtype", dtype)):
            if value is not None:
                raise DomainError(name, str(value), "needs the result: name a file with -o")
    rasters = any(path.suffix.lower() in RASTERS for path in written.values())
    if compression is not None and not rasters:
        raise DomainError("compression", compression, "is for .tif files; leave it out")


def check_entrance(request: Request, source: Any) -> None:
    """Options of the other entrance would be ignored in silence."""
    plain = source.quantity == "display"
    if plain:
        remedy = "means nothing to a plain picture; leave it out, or give --sensor, --sun-zenith and a scale"
    else:
        remedy = f"is for plain pictures, and this is {source.quantity}; leave it out, or add --quantity display"
    for name in PHYSICAL if plain else PLAIN:
        if name in request.given:
            raise DomainError(name, request.given[name], remedy)
    if not plain and source.geometry is None:
        rule = f"{source.name} does not say where the Sun was; give --sun-zenith, or --quantity display"
        raise DomainError("sun_zenith", None, rule)


def open_sinks(request: Request, source: Any) -> dict[str, Any]:
    """Sinks by what they hold: result, haze_map, sigma, mask; the files that are asked for."""
    from skyscatter.dehaze.rasters.outputs import open_layer, open_result

    common_options = {"compression": request.compression, "threads": request.options.threads}
    physical = source.quantity != "display"
    layers: dict[str, tuple[list[str], dict[str, Any]]] = {
        "haze_map": (["aod_550" if physical else "veil"], {"units": "1"}),
        "sigma": ([f"sigma_{band.name}" for band in source.bands], {"units": "1"}),
        "mask": (["flags"], {"dtype": "uint8"}),
    }
    sinks: dict[str, Any] = {}
    try:
        for name, path in request.files.items():
            if name == "result":
                sinks[name] = open_result(path, source, dtype=request.dtype, **common_options)
            else:
                names, options = layers[name]
                sinks[name] = open_layer(path, source, names, **options, **common_options)
    except BaseException:
        for sink in sinks.values():
            sink.abort()
        raise
    return sinks


def run(request: Request) -> int:
    """Dehaze, write, report; returns the exit status."""
    from skyscatter.dehaze.engine import dehaze_raster
    from skyscatter.dehaze.rasters.handles import environment
    from skyscatter.dehaze.rasters.opening import open_raster
    from skyscatter.dehaze.rasters.sinks import together
    from skyscatter.progress import Progress
    from skyscatter.tasks.cluster import executor_of

    started = clock.monotonic()
    with ExitStack() as stack:
        source = stack.enter_context(open_raster(request.image, request.source))
        check_entrance(request, source)
        if request.quicklook is not None:
            from skyscatter.dehaze.rasters.quicklook import shown_bands

            shown_bands(source)  # refuses what could not be shown, before any time is spent
        if any(path.suffix.lower() in RASTERS for path in request.files.values()):
            stack.enter_context(environment())
        progress = Progress(1.0, f"dehazing {request.image.name}", request.progress)
        workers = executor_of(request.workers, request.scheduler, request.worker_memory)
        with together(open_sinks(request, source)) as sinks, progress, workers as executor:
            summary = dehaze_raster(source, sinks, request.options, progress.to, executor)
        if request.quicklook is not None and request.output is not None:
            from skyscatter.dehaze.rasters.quicklook import write_quicklook

            write_quicklook(request.quicklook, source, request.output)
        return report(request, source, summary, clock.monotonic() - started)


def report(request: Request, source: Any, summary: Any, seconds: float) -> int:
    """Say what was done, for programs and for people; returns the exit status."""
    import skyscatter
    from skyscatter.progress import format_seconds

    outputs = [str(path) for path in (*request.files.values(), request.quicklook) if path is not None]
    whole = {
        "skyscatter": skyscatter.__version__,
        "image": str(request.image),
        "quantity": source.quantity,
        "sensor": source.sensor,
        "geometry": None if source.geometry is None else source.geometry.to_json(),
        "bands": [band.name for band in source.bands],
        "size": [source.width, source.height],
        "notes": list(source.notes),
        "seconds": round(seconds, 3),
        "outputs": outputs,
        **summary.to_json(),
    }
    if request.json:
        typer.echo(json.dumps(whole, allow_nan=False))
    elif not request.quiet:
        for note in source.notes:
            typer.echo(f"note: {note}", err=True)
        for note in whole.get("remarks", ()):
            typer.echo(f"note: {note}", err=True)
        wrote = ", ".join(outputs) or "nothing"
        took = format_seconds(seconds)
        typer.echo(f"{request.image.name}: {whole['kind']}; {in_words(whole)}; {took}; wrote {wrote}", err=True)
    return 0


def in_words(found: dict[str, Any]) -> str:
    """The haze that was found or given, for people."""
    if "aod" in found:
        aod = found["aod"]
        sure = f" ± {aod['sigma']:.3f}" if aod["sigma"] > 0 else ""
        sure += {"given": ", as given", "map": ", by the map"}.get(aod["source"], "")
        return f"aerosol optical depth {aod['mean']:.3f}{sure}, {found['aerosol']['model']}"
    return f"veil of optical depth {found['depth_mean']:.2f} ± {found['depth_sigma']:.2f}, alpha {found['alpha']:.1f}"
