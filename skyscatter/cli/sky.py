"""``skyscatter sky``: one sky, from a model file to pictures and data files."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from skyscatter.cli import common, parse, pictures, polarised, sequence
from skyscatter.cli.composed import DEFAULT_ALTITUDE, composed
from skyscatter.cli.lights import LightChoice, Lights, SolarFlux, Stars, Without, centre_of, light_choice
from skyscatter.cli.solver_options import given, option
from skyscatter.cli.towns import TownMaps, Towns, asked_towns, with_towns
from skyscatter.errors import DomainError, ModelFileError
from skyscatter.units import metres

DEFAULT_WAVELENGTHS = "380:780:10"
DEFAULT_SUN_ELEVATION = 30.0
DEFAULT_SUN_AZIMUTH = 180.0
SOLVERS = ("orders", "path", "single")


@dataclass(frozen=True)
class Request(common.RunRequest):
    """What the command line asks for, checked as far as that goes without a model."""

    place: tuple[float, float] | None
    time: str | None
    sun_elevation: float
    sun_azimuth: float
    altitude: float
    #: None for the one that suits the observer; the size is (0, 0) then, unless it was given.
    view: str | None
    sun_disk: bool
    scene_for: str | None
    png: dict[str, Any]
    stokes: bool
    subpixels: int | None
    show: str
    shown_wavelength: float | None
    shown_filter: str | None
    lights: LightChoice
    towns: tuple[Any, ...]
    marks: dict[str, bool]


def sky(
    context: typer.Context,
    model: Annotated[
        str,
        typer.Argument(
            help="Name of a shipped model (see: skyscatter models) or a TOML file; several with commas between them "
            "are the frames of a sequence."
        ),
    ] = "earth",
    place: common.Place = None,
    time: common.Moment = None,
    sun_elevation: Annotated[
        str | None,
        typer.Option(metavar="DEG", help=f"Sun's elevation [degree], {DEFAULT_SUN_ELEVATION:g} if nothing is said."),
    ] = None,
    times: Annotated[
        str | None,
        typer.Option(metavar="START:END:STEP", help="A frame for each time: 2026-06-21T04:00:2026-06-21T22:00:15min."),
    ] = None,
    sun_elevations: Annotated[
        str | None, typer.Option(metavar="START:END:STEP", help="A frame for each elevation of the Sun, or a list.")
    ] = None,
    exposure_step: Annotated[
        str | None, typer.Option(metavar="EV", help="Most that the exposure changes from frame to frame, else 0.1.")
    ] = None,
    frame_rate: Annotated[str | None, typer.Option(metavar="N", help="Frames a second of a film, else 24.")] = None,
    sun_azimuth: Annotated[
        str | None,
        typer.Option(
            metavar="DEG", help=f"Sun's azimuth [degree] from north through east, else {DEFAULT_SUN_AZIMUTH:g}."
        ),
    ] = None,
    lights: Lights = None,
    without: Without = None,
    solar_flux: SolarFlux = None,
    stars: Stars = None,
    town: Towns = None,
    town_map: TownMaps = None,
    altitude: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH", help=f"Observer's height, such as 400km; else 0m, and {DEFAULT_ALTITUDE} without --view."
        ),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            metavar="VIEW",
            help="landscape (the default: the horizon on the Sun's side), panorama (the whole sphere), panorama-upper, "
            "fisheye, fisheye-equisolid, perspective:AZIMUTH,ELEVATION,FOV or planet (the default from far above). "
            "Landscapes and panoramas are centred on the Sun, or on an azimuth: panorama:90.",
        ),
    ] = None,
    north: Annotated[bool, typer.Option("--north", help="A panorama centred on north, wherever the Sun is.")] = False,
    no_sun: Annotated[
        bool,
        typer.Option(
            "--no-sun",
            help="Leave out the Sun's disk; its direction and irradiance go into the files and, beside .exr and .hdr, "
            "into FILE.sun.json.",
        ),
    ] = False,
    scene_for: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="PROGRAM",
            help="With --no-sun: also write a scene file with the dome and its Sun, for mitsuba (FILE.mitsuba.xml) or "
            "radiance (FILE.rad and FILE.cal).",
        ),
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Picture size [pixel]; by default one that suits the view.")
    ] = None,
    wavelengths: common.Wavelengths = DEFAULT_WAVELENGTHS,
    solver: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="orders (all orders, no noise; the default), path (the same by Monte Carlo; the default for models "
            "with bodies, fields, lamps or a ground of some material) or single.",
        ),
    ] = None,
    samples: Annotated[str | None, option("samples", SOLVERS)] = None,
    noise: Annotated[str | None, option("noise", SOLVERS)] = None,
    tolerance: Annotated[str | None, option("tolerance", SOLVERS)] = None,
    max_order: Annotated[str | None, option("max_order", SOLVERS)] = None,
    stokes: polarised.Stokes = False,
    subpixels: Annotated[
        str | None,
        typer.Option(metavar="N", help="N x N rays through each pixel, for smooth edges of bodies and clouds (path)."),
    ] = None,
    seed: Annotated[str | None, option("seed", SOLVERS)] = None,
    denoise: common.Denoise = False,
    threads: common.Threads = None,
    workers: common.WorkerCount = None,
    worker_memory: common.WorkerMemory = None,
    scheduler: common.Scheduler = None,
    store: common.StoreFolder = None,
    look: pictures.Look = None,
    exposure: common.Exposure = None,
    tone: common.Tone = None,
    glare: pictures.Glare = None,
    space: common.Space = None,
    bits: common.Bits = None,
    show: Annotated[
        str | None,
        typer.Option(
            metavar="WHAT",
            help="For PNG: colour (the default); magnitudes, a map in V mag arcsec-2 with contours (or magnitudes:B); "
            "or degree or angle of linear polarisation, which imply --stokes, of all wavelengths weighted by luminous "
            "efficiency, or of one [nm]: degree:550.",
        ),
    ] = None,
    label: Annotated[
        bool, typer.Option("--label", help="For PNG: names of the Moon, planets and bright stars, with --place.")
    ] = False,
    lines: Annotated[bool, typer.Option("--lines", help="For PNG: lines of the constellations, with --place.")] = False,
    scale: common.Scale = None,
    half: common.Half = False,
    no_spectra: common.NoSpectra = False,
    float32: common.Float32 = False,
    compress: common.Compress = False,
    filters: common.Filters = None,
    unit: common.Unit = None,
    output: common.Output = None,
    as_json: common.AsJson = False,
    resume: common.Resume = None,
    every: common.Every = None,
    no_clobber: common.NoClobber = False,
    quiet: common.Quiet = False,
    verbose: common.Verbose = False,
    progress: common.ProgressMode = "auto",
    preview: common.Previewed = False,
) -> int:
    """Render the sky of a model.

    The Sun stands where --place and --time put it, or at --sun-elevation and --sun-azimuth.  With a place and a time
    the Moon, planets, stars, the Milky Way, zodiacal light and airglow shine too, where they matter,
    and eclipses are seen.  Ctrl-C keeps what is finished, a picture as NAME.partial.EXT, and says how to go on.

    --times, --sun-elevations and lists of models make a sequence from one solved field: numbered files, or a film
    where the output is .mp4, .webm or .gif.  Its exposure follows smoothly.  Repeat the command to go on with one;
    --store keeps the solution, too.
    """
    frames = sequence.asked(model, times, sun_elevations, exposure_step, frame_rate)
    if frames is not None:
        meaningless = {"resume": resume, "subpixels": subpixels, "denoise": denoise or None}
        meaningless |= {"preview": preview or None}
        _check_sequence(frames, place, time, sun_elevation, sun_azimuth, meaningless)
    elevation, azimuth = _sun_choice(place, time, sun_elevation, sun_azimuth, bool(times))
    outputs = parse.check_outputs(output or [], no_clobber, parse.FILMS if frames else ())
    if frames is not None:
        sequence.check_output(outputs)
    parse.check_new(lamp_files(outputs) if no_clobber and no_sun else ())
    shown, shown_wavelength, shown_filter = parse.parse_show(show)
    development = {"exposure": exposure, "tone": tone, "space": space, "glare": glare}
    marks = {"label": label or None, "lines": lines or None}
    common.check_png_options(outputs, {"look": look, **development, **marks, "bits": bits, "show": show})
    _check_marks(marks, place, shown)
    _check_development(shown, {"look": look, **development})
    view = _view(view, north, no_sun)
    chosen = solver or default_solver(model)
    request = Request(
        model=model,
        place=None if place is None else parse.parse_place(place),
        time=time,
        sun_elevation=elevation,
        sun_azimuth=azimuth,
        altitude=metres(altitude or (DEFAULT_ALTITUDE if view is None else "0m"), "altitude"),
        view=view,
        sun_disk=not no_sun,
        scene_for=_scene_for(scene_for, outputs, no_sun and frames is None, no_clobber),
        size=(0, 0) if size is None and view is None else parse.parse_size(size, view or ""),
        solver=chosen,
        given=given(chosen, SOLVERS, samples=samples, noise=noise, tolerance=tolerance, max_order=max_order, seed=seed),
        png=pictures.natural_options(look, development),
        stokes=stokes or shown in ("degree", "angle"),
        subpixels=parse.parse_integer(
            subpixels, "subpixels", 1, "give a number of rays along each side of a pixel, 1 or more"
        ),
        show=shown,
        shown_wavelength=shown_wavelength,
        shown_filter=shown_filter,
        lights=light_choice(place, lights, without, solar_flux, stars),
        towns=asked_towns(town, town_map, place is not None),
        marks={name: True for name, wanted in (("labels", label), ("lines", lines)) if wanted},
        outputs=outputs,
        file_options=common.file_options(
            outputs,
            scale=scale,
            half=half,
            no_spectra=no_spectra,
            float32=float32,
            compress=compress,
            unit=unit,
            filters=filters,
        ),
        **common.run_options(
            wavelengths=wavelengths,
            denoise=denoise,
            threads=threads,
            workers=workers,
            worker_memory=worker_memory,
            scheduler=scheduler,
            store=store,
            bits=bits,
            as_json=as_json,
            quiet=quiet,
            verbose=verbose,
            progress=progress,
            every=every,
            resume=resume,
            preview=preview,
        ),
    )
    common.check_solver(request, SOLVERS)
    _check_picture(request)
    if frames is not None:
        asked = frames
        kept = "repeat the command to go on with the frames that are missing"
        shown_as = _png_options(request, 0.0)
        exposed = request.png["exposure"] if shown_as.pop("exposure", None) is not None else None
        return common.stoppable(lambda: sequence.run(request, asked, shown_as, exposed), kept)
    return common.stoppable(lambda: run(request, list(context.obj or [])))


def _check_sequence(
    frames: sequence.FrameList, place: str | None, time: str | None, elevation: str | None, azimuth: str | None,
    meaningless: dict[str, Any],
) -> None:  # fmt: skip
    """Refuse options that a sequence has no use for."""
    if frames.times and place is None:
        raise DomainError("times", f"{frames.times[0]} ...", "needs --place as well")
    for name, value in {"time": time if frames.times else None, **meaningless}.items():
        if value is not None:
            raise DomainError(name, str(value), "means nothing to a sequence; leave it out")
    if frames.elevations and (elevation is not None or place is not None):
        given = "place" if elevation is None else "sun_elevation"
        raise DomainError(given, elevation or place, "--sun-elevations settles where the Sun is; leave it out")


def _sun_choice(
    place: str | None, time: str | None, elevation: str | None, azimuth: str | None, times: bool = False
) -> tuple[float, float]:
    common.check_place(place, time or (place if times else None), {"sun_elevation": elevation, "sun_azimuth": azimuth})
    return (
        parse.parse_degrees(elevation, "sun_elevation", 90.0, DEFAULT_SUN_ELEVATION),
        parse.parse_degrees(azimuth, "sun_azimuth", 360.0, DEFAULT_SUN_AZIMUTH),
    )


def _view(view: str | None, north: bool, no_sun: bool) -> str | None:
    if view is None and (north or no_sun):
        view = "panorama"  # a dome to light something with
    if not north or view is None:
        return view
    if view not in ("panorama", "panorama-upper"):
        raise DomainError("north", view, "is for --view panorama and panorama-upper; fisheyes have north on top anyway")
    return f"{view}:0"


def _scene_for(program: str | None, outputs: list[Path], dome: bool, no_clobber: bool) -> str | None:
    """The program for which scene files are written, checked."""
    if program is None:
        return None
    files = _scene_files(program, outputs)
    if not dome or not files:
        raise DomainError("for", program, "is for one dome without its Sun: --no-sun, and -o FILE.exr or FILE.hdr")
    parse.check_new(files if no_clobber else ())
    return program


def _scene_files(program: str | None, outputs: list[Path]) -> list[Path]:
    """Scene files of a program beside the domes among the outputs."""
    if program is None:
        return []
    from skyscatter.image.scenefiles import scene_files

    return [file for path in outputs if lamp_files([path]) for file in scene_files(path, program)]


def _check_development(show: str, options: dict[str, Any]) -> None:
    """The colours of the degree and the angle of polarisation are fixed."""
    if show == "colour":
        return
    for name, value in options.items():
        if value is not None:
            raise DomainError(name, value, f"means nothing to --show {show}; leave it out")


def _check_marks(marks: Mapping[str, bool | None], place: str | None, show: str) -> None:
    """Names and lines are for pictures of the sky of a place."""
    for name, value in marks.items():
        if value is not None and place is None:
            raise DomainError(name, value, "needs --place and --time: the sky of a place at a moment")
        if value is not None and show in ("degree", "angle"):
            raise DomainError(name, value, f"means nothing to --show {show}; leave it out")


def _check_picture(request: Request) -> None:
    common.check_development(request.png["space"], request.png["tone"], request.bits)
    common.check_brightness(request.file_options, request.wavelengths)
    if request.show == "magnitudes":
        from skyscatter.image.filters import filter_curve

        filter_curve(request.shown_filter or "V").weights(request.wavelengths)  # refuses wavelengths that miss it
    elif request.show != "colour":
        from skyscatter.image.polarisation import band_weights

        band_weights(request.wavelengths, request.shown_wavelength)  # refuses what the picture could not show


def default_solver(name: str) -> str:
    """The solver for a model when nobody says: that which takes all that it holds."""
    from skyscatter.models.files import read_model
    from skyscatter.scene import HELD

    try:
        content, _ = read_model(name)
    except ModelFileError:  # or a list of models; of what is wrong the run speaks
        return "orders"
    ground = content.get("ground")
    held = isinstance(ground, dict) and ground.get("material")
    return "path" if held or any(content.get(table) for table in HELD) else "orders"


def build_scene(request: Request) -> tuple[Any, Any]:
    """The model, and its scene with Sun and observer."""
    import skyscatter

    model: Any = skyscatter.load_model(request.model)
    common.check_command(model, request.model, "sky")
    model = with_towns(model, request.towns, request.lights.lights)
    if request.place is None or request.time is None:
        return model, model.scene(
            sun_elevation_deg=request.sun_elevation, sun_azimuth_deg=request.sun_azimuth, altitude=request.altitude
        )
    return model, model.scene_at(*request.place, request.time, request.altitude, request.lights)


def run(request: Request, arguments: list[str]) -> int:
    """Render, write, report; returns the exit status."""
    from skyscatter.memory import check_picture

    started = clock.monotonic()
    model, scene = build_scene(request)
    request, camera = composed(request, scene.observer, centre_of(scene))
    check_picture(*request.size, request.wavelengths.size)
    camera.through(0, 0, scene.observer)  # refuses a view that this observer cannot have, before any time is spent
    if request.scene_for is not None:
        from skyscatter.image.scenefiles import check_dome

        check_dome(request.scene_for, camera.model_dump())
    more: dict[str, Any] = {"stokes": True} if request.stokes else {}
    more |= {} if request.sun_disk else {"sun_disk": False}
    more |= {} if request.subpixels is None else {"subpixels": request.subpixels}
    rendered = common.render_request(request, scene, camera, f"{model.name} sky", arguments, **more)
    with rendered.writing() as outputs:
        image = rendered.image
        stated = request.png["exposure"]
        exposure = image.auto_exposure() if stated == "auto" else float(stated)
        for path in outputs:
            _save(request, image, path, exposure)
    if not request.sun_disk:
        written = [*lamp_files(rendered.outputs), *_scene_files(request.scene_for, rendered.outputs)]
        rendered = replace(rendered, outputs=[*rendered.outputs, *written])
    summary = summarise(request, model, scene, rendered, exposure, clock.monotonic() - started)
    return common.report(request, summary, describe)


def _save(request: Request, image: Any, path: Path, exposure: float) -> None:
    """Write one file, and beside a dome without its Sun the lamp."""
    suffix = path.suffix.lower()
    options = request.file_options.get(suffix, {})
    image.save(path, **(_png_options(request, exposure) if suffix == ".png" else options))
    for beside in () if request.sun_disk else lamp_files([path]):
        from skyscatter.image.dome import write_lamp

        write_lamp(image, beside, options.get("scale", 1.0))
        if request.scene_for is not None:
            from skyscatter.image.scenefiles import write_scene

            write_scene(image, path, request.scene_for, options.get("scale", 1.0))


def lamp_files(outputs: list[Path]) -> list[Path]:
    """Files with the Sun as a lamp, beside the domes among the outputs that leave it out."""
    files = (path.with_suffix(".sun.json") for path in outputs if path.suffix.lower() in (".exr", ".hdr"))
    return list(dict.fromkeys(files))


def _png_options(request: Request, exposure: float) -> dict[str, Any]:
    if request.show == "colour":
        return {**request.png, "exposure": exposure, "bits": request.bits, **request.marks}
    if request.show == "magnitudes":
        return {"show": request.show, "filters": request.shown_filter, "bits": request.bits, **request.marks}
    return {"show": request.show, "wavelength": request.shown_wavelength, "bits": request.bits}


def summarise(
    request: Request, model: Any, scene: Any, rendered: common.Rendered, exposure: float, seconds: float
) -> dict[str, Any]:
    """What ``--json`` prints."""
    from skyscatter.scene import AU

    error = common.median_error(rendered.raw)
    return {
        **common.summary_of_run(request, model, seconds, rendered),
        "sun": {
            "elevation_deg": float(scene.sun.elevation_deg),
            "azimuth_deg": float(scene.sun.azimuth_deg),
            "distance_au": float(scene.star_distance) / AU,
        },
        "lights": [] if scene.lights is None else list(scene.lights.shine),
        "altitude_m": float(scene.observer.altitude),
        "view": request.view,
        # Chance and what a grid misses are not the same thing, and `single` states neither.
        "noise": error if request.solver == "path" else None,
        "estimated_error": error if request.solver == "orders" else None,
        "polarisation": polarised.summary(rendered.image, request.shown_wavelength),
        "exposure_ev": float(exposure),
    }


def describe(summary: dict[str, Any]) -> str:
    """The summary for people."""
    from skyscatter.progress import format_seconds

    sun, noise, error = summary["sun"], summary["noise"], summary["estimated_error"]
    accuracy = "" if noise is None else f", median noise {common.percent(noise)}"
    accuracy += common.describe_denoising(summary)
    accuracy += "" if error is None else f", median estimated error {common.percent(error)}"
    accuracy += common.missed(error, summary["tolerance"])
    accuracy += polarised.described(summary["polarisation"])
    others = [name for name in summary["lights"] if name != "sun"]
    return (
        f"{common.describe_part(summary)}{summary['model']}: "
        f"Sun at elevation {sun['elevation_deg']:.2f}°, azimuth {sun['azimuth_deg']:.2f}°; "
        f"{'with ' + ', '.join(others) + '; ' if others else ''}"
        f"solver {summary['solver']}{accuracy}; EV {summary['exposure_ev']:.1f}; {format_seconds(summary['seconds'])}; "
        f"wrote {', '.join(summary['outputs']) or 'nothing'}"
    )
