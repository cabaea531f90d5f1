"""``skyscatter sky``: one sky, from a model file to pictures and data files."""

from __future__ import annotations

import json
import shlex
import sys
import time as clock
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from skyscatter.cli import parse
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.units import metres

DEFAULT_WAVELENGTHS = "380:780:10"
DEFAULT_SUN_ELEVATION = 30.0
DEFAULT_SUN_AZIMUTH = 180.0
SOLVERS = ("orders", "path", "single")
#: Options that some solvers have no use for.
MEANINGLESS = {
    "orders": ("samples", "noise", "seed"),
    "path": ("tolerance",),
    "single": ("samples", "noise", "seed", "max_order", "tolerance"),
}
#: The solver to name with an option that the chosen one has no use for.
REMEDY = {"samples": "path", "noise": "path", "seed": "path", "max_order": "orders", "tolerance": "orders"}


@dataclass(frozen=True)
class Request:
    """What the command line asks for, checked as far as that goes without a model."""

    model: str
    place: tuple[float, float] | None
    time: str | None
    sun_elevation: float
    sun_azimuth: float
    altitude: float
    view: str
    size: tuple[int, int]
    wavelengths: NDArray[np.float64]
    solver: str
    samples: int | None
    noise: float | None
    tolerance: float | None
    max_order: int | None
    seed: int | None
    threads: int | None
    exposure: float | str
    tone: str
    space: str
    bits: int
    stokes: bool
    show: str
    shown_wavelength: float | None
    outputs: list[Path]
    json: bool
    quiet: bool
    resume: Path | None


def sky(
    context: typer.Context,
    model: Annotated[
        str, typer.Argument(help="Name of a shipped model (see: skyscatter models) or a TOML file.")
    ] = "earth",
    place: Annotated[str | None, typer.Option(metavar="LAT,LON", help="Place on Earth [degree]; needs --time.")] = None,
    time: Annotated[
        str | None, typer.Option(metavar="ISO", help="Date and time, ISO 8601; no offset means UTC; needs --place.")
    ] = None,
    sun_elevation: Annotated[
        str | None,
        typer.Option(metavar="DEG", help=f"Sun's elevation [degree], {DEFAULT_SUN_ELEVATION:g} if nothing is said."),
    ] = None,
    sun_azimuth: Annotated[
        str | None,
        typer.Option(
            metavar="DEG", help=f"Sun's azimuth [degree] from north through east, else {DEFAULT_SUN_AZIMUTH:g}."
        ),
    ] = None,
    altitude: Annotated[str, typer.Option(metavar="LENGTH", help="Observer's height, such as 400km.")] = "0m",
    view: Annotated[
        str,
        typer.Option(
            metavar="VIEW",
            help="panorama, panorama-upper, fisheye, fisheye-equisolid, perspective:AZIMUTH,ELEVATION,FOV or planet. "
            "Panoramas are centred on the Sun.",
        ),
    ] = "panorama",
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Picture size [pixel]; by default one that suits the view.")
    ] = None,
    wavelengths: Annotated[
        str, typer.Option(metavar="START:STOP:STEP", help="Vacuum wavelengths [nm], ends included, or a list: 450,550.")
    ] = DEFAULT_WAVELENGTHS,
    solver: Annotated[
        str,
        typer.Option(metavar="NAME", help="orders (all orders, no noise), path (the same by Monte Carlo) or single."),
    ] = "orders",
    samples: Annotated[str | None, typer.Option(metavar="N", help="Walks per pixel (path).")] = None,
    noise: Annotated[
        str | None, typer.Option(metavar="REL", help="Stop at this relative standard error, such as 1% (path).")
    ] = None,
    tolerance: Annotated[
        str | None, typer.Option(metavar="REL", help="Relative accuracy to aim at (orders), 0.5% if nothing is said.")
    ] = None,
    max_order: Annotated[
        str | None,
        typer.Option("--max-order", "--order-limit", metavar="N", help="Highest order of scattering (orders, path)."),
    ] = None,
    stokes: Annotated[
        bool,
        typer.Option(
            "--stokes", help="Polarised light: Stokes Q, U, V in .exr, .fits, .nc; the summary has the degree."
        ),
    ] = False,
    seed: Annotated[
        str | None,
        typer.Option(
            metavar="N", help="Same seed, same picture; a whole number from 0 to 9223372036854775807, else 0 (path)."
        ),
    ] = None,
    threads: Annotated[str | None, typer.Option(metavar="N", help="Threads; by default one per processor.")] = None,
    exposure: Annotated[
        str | None, typer.Option(metavar="EV", help="For PNG: auto (the default) or an exposure value (ISO 100).")
    ] = None,
    tone: Annotated[str | None, typer.Option(metavar="NAME", help="For PNG: filmic (the default) or linear.")] = None,
    space: Annotated[
        str | None, typer.Option(metavar="NAME", help="For PNG: srgb (the default), display-p3 or rec2020.")
    ] = None,
    bits: Annotated[str | None, typer.Option(metavar="N", help="For PNG: 8 (the default) or 16.")] = None,
    show: Annotated[
        str | None,
        typer.Option(
            metavar="WHAT",
            help="For PNG: colour (the default), or degree or angle of linear polarisation, which imply --stokes; all "
            "wavelengths weighted by luminous efficiency, or one [nm]: degree:550.",
        ),
    ] = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File to write, by extension: .png, .exr, .fits, .nc; may be repeated; existing files are replaced.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as one JSON object on stdout.")] = False,
    resume: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Go on from the .partial.npz that an interrupted run left.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Nothing on stderr but errors.")] = False,
) -> int:
    """Render the sky of a model.

    The Sun stands where --place and --time put it, or at --sun-elevation and --sun-azimuth.  Ctrl-C writes what is
    finished and says how to go on.
    """
    elevation, azimuth = _sun_choice(place, time, sun_elevation, sun_azimuth)
    outputs = parse.check_outputs(output or [])
    shown, shown_wavelength = parse.parse_show(show)
    development = {"exposure": exposure, "tone": tone, "space": space}
    _check_png_options(outputs, {**development, "bits": bits, "show": show})
    _check_development(shown, development)
    request = Request(
        model=model,
        place=None if place is None else parse.parse_place(place),
        time=time,
        sun_elevation=elevation,
        sun_azimuth=azimuth,
        altitude=metres(altitude, "altitude"),
        view=view,
        size=parse.parse_size(size, view),
        wavelengths=parse.parse_wavelengths(wavelengths),
        solver=solver,
        samples=parse.parse_integer(samples, "samples", 1, "give a number of walks, 1 or more"),
        noise=parse.parse_noise(noise),
        tolerance=parse.parse_tolerance(tolerance),
        max_order=parse.parse_integer(max_order, "max_order", 1, "give an order of scattering, 1 or more"),
        seed=parse.parse_integer(seed, "seed", 0, "give a whole number from 0 to 9223372036854775807 (2^63 - 1)"),
        threads=parse.parse_integer(threads, "threads", 1, "give a number of threads, 1 or more"),
        exposure="auto" if exposure is None else parse.parse_exposure(exposure),
        tone="filmic" if tone is None else tone,
        space="srgb" if space is None else space,
        bits=parse.parse_integer(bits, "bits", 8, "choose 8 or 16") or 8,
        stokes=stokes or shown != "colour",
        show=shown,
        shown_wavelength=shown_wavelength,
        outputs=outputs,
        json=as_json,
        quiet=quiet,
        resume=None if resume is None else parse.check_input(resume, "checkpoint"),
    )
    _check_solver(request)
    _check_picture(request)
    try:
        return run(request, list(context.obj or []))
    except KeyboardInterrupt:
        print("skyscatter: interrupted", file=sys.stderr)
        return 130


def _sun_choice(place: str | None, time: str | None, elevation: str | None, azimuth: str | None) -> tuple[float, float]:
    if (place is None) != (time is None):
        given, missing = ("place", "time") if time is None else ("time", "place")
        raise DomainError(given, place or time, f"needs --{missing} as well")
    if place is not None and (elevation is not None or azimuth is not None):
        raise DomainError("place", place, "settles where the Sun is; leave out --sun-elevation and --sun-azimuth")
    return (
        parse.parse_degrees(elevation, "sun_elevation", 90.0, DEFAULT_SUN_ELEVATION),
        parse.parse_degrees(azimuth, "sun_azimuth", 360.0, DEFAULT_SUN_AZIMUTH),
    )


def _check_solver(request: Request) -> None:
    if request.solver not in SOLVERS:
        raise DomainError("solver", request.solver, f"choose one of {', '.join(SOLVERS)}")
    if request.samples is not None and request.noise is not None:
        raise DomainError("samples", request.samples, "give --samples or --noise, not both")
    for option in MEANINGLESS[request.solver]:
        value = getattr(request, option)
        if value is not None:
            rule = f"means nothing to the solver {request.solver}; leave it out, or add --solver {REMEDY[option]}"
            raise DomainError(option, value, rule)
    if not request.outputs and not request.json:
        raise DomainError("output", "", "nothing would be kept; name a file with -o, or ask for --json")


def _check_png_options(outputs: list[Path], options: dict[str, Any]) -> None:
    """Options that only a picture for a display has would otherwise be ignored in silence."""
    if any(path.suffix.lower() == ".png" for path in outputs):
        return
    for name, value in options.items():
        if value is not None:
            raise DomainError(name, value, "is for PNG files; name one with -o, or leave this out")


def _check_development(show: str, options: dict[str, Any]) -> None:
    """The colours of the degree and the angle of polarisation are fixed."""
    if show == "colour":
        return
    for name, value in options.items():
        if value is not None:
            raise DomainError(name, value, f"means nothing to --show {show}; leave it out")


def _check_picture(request: Request) -> None:
    from skyscatter.image.colour import display_space
    from skyscatter.image.tone import TONES

    display_space(request.space)
    if request.tone not in TONES:
        raise DomainError("tone", request.tone, f"choose one of {', '.join(TONES)}")
    if request.bits not in (8, 16):
        raise DomainError("bits", request.bits, "choose 8 or 16")
    if request.show != "colour":
        from skyscatter.image.polarisation import band_weights

        band_weights(request.wavelengths, request.shown_wavelength)  # refuses what the picture could not show


def build_scene(request: Request) -> tuple[Any, Any]:
    """The model, and its scene with Sun and observer."""
    import skyscatter

    model = skyscatter.load_model(request.model)
    if request.place is None or request.time is None:
        return model, model.scene(
            sun_elevation_deg=request.sun_elevation, sun_azimuth_deg=request.sun_azimuth, altitude=request.altitude
        )
    if model.planet.name.lower() != "earth":
        raise DomainError("model", request.model, "place and time mean Earth; give --sun-elevation here")
    from skyscatter.geometry.sun import sun_position

    sun = sun_position(*request.place, request.time, request.altitude)
    return model, model.scene(
        sun_elevation_deg=sun.elevation_deg,
        sun_azimuth_deg=sun.azimuth_deg,
        sun_distance_au=sun.distance_au,
        altitude=request.altitude,
    )


def run(request: Request, arguments: list[str]) -> int:
    """Render, write, report; returns the exit status."""
    import skyscatter
    from skyscatter.geometry.camera import camera_from_view
    from skyscatter.progress import Progress
    from skyscatter.solvers.run import Interrupted

    started = clock.monotonic()
    model, scene = build_scene(request)
    camera = camera_from_view(request.view, *request.size, sun_azimuth_deg=scene.sun.azimuth_deg)
    camera.directions(scene.observer)  # refuses a view that this observer cannot have, before any time is spent
    interrupted = None
    try:
        with Progress(1.0, f"{model.name} sky", enabled=False if request.quiet else None) as progress:
            image = skyscatter.render(
                scene,
                camera,
                request.wavelengths,
                solver=request.solver,
                samples=request.samples,
                noise=request.noise,
                tolerance=request.tolerance,
                max_order=request.max_order,
                seed=request.seed or 0,
                threads=request.threads,
                progress=progress.to,
                resume=request.resume,
                **({"stokes": True} if request.stokes else {}),
            )
    except Interrupted as stop:
        interrupted, image = stop, stop.partial
    if interrupted is not None:
        _keep(interrupted, request, arguments)
    exposure = image.auto_exposure() if request.exposure == "auto" else float(request.exposure)
    for path in request.outputs:
        image.save(path, **(_png_options(request, exposure) if path.suffix.lower() == ".png" else {}))
    finished = 1.0 if interrupted is None else float(interrupted.state.done.mean())
    summary = summarise(request, model, scene, image, exposure, clock.monotonic() - started, finished)
    if request.json:
        typer.echo(json.dumps(summary, allow_nan=False))
    elif not request.quiet:
        typer.echo(describe(summary), err=True)
    return 0 if interrupted is None else 130


def _png_options(request: Request, exposure: float) -> dict[str, Any]:
    if request.show == "colour":
        return {"exposure": exposure, "tone": request.tone, "space": request.space, "bits": request.bits}
    return {"show": request.show, "wavelength": request.shown_wavelength, "bits": request.bits}


def _keep(interrupted: Any, request: Request, arguments: list[str]) -> None:
    """Save what is needed to go on, and say how."""
    first = request.outputs[0] if request.outputs else Path("skyscatter")
    checkpoint = first.with_name(first.name + ".partial.npz")
    try:
        interrupted.state.save(checkpoint)
    except SkyscatterError as error:
        print(f"skyscatter: the finished part could not be kept: {error}", file=sys.stderr)
        return
    command = shlex.join(["skyscatter", *without_resume(arguments), "--resume", str(checkpoint)])
    print(f"skyscatter: interrupted; the finished part is in {checkpoint}; go on with:\n  {command}", file=sys.stderr)


def without_resume(arguments: list[str]) -> list[str]:
    """The arguments without an earlier ``--resume FILE``."""
    kept: list[str] = []
    skip = False
    for word in arguments:
        if skip:
            skip = False
        elif word == "--resume":
            skip = True
        elif not word.startswith("--resume="):
            kept.append(word)
    return kept


def median_error(image: Any) -> float | None:
    """Median over pixels and wavelengths of the relative stated error, where there is light; None in the dark."""
    if image.standard_error is None:
        return None
    radiance, error = np.asarray(image.radiance), np.asarray(image.standard_error)
    lit = np.isfinite(radiance) & np.isfinite(error) & (radiance > 0)
    return float(np.median(error[lit] / radiance[lit])) if lit.any() else None


def polarisation_summary(image: Any, wavelength: float | None) -> dict[str, float | None] | None:
    """Mean and greatest degree of linear polarisation over the pixels that have light; None for unpolarised images.

    Of one wavelength [nm], or over all of them weighted by luminous efficiency; null if none of them is visible.
    """
    if not image.polarised:
        return None
    from skyscatter.image.polarisation import band_degree

    try:
        degree = band_degree(image, wavelength)
    except DomainError:
        degree = np.full(1, np.nan)
    lit = degree[np.isfinite(degree)]
    return {
        "mean_degree": float(lit.mean()) if lit.size else None,
        "maximum_degree": float(lit.max()) if lit.size else None,
        "wavelength_nm": wavelength,
    }


def summarise(
    request: Request, model: Any, scene: Any, image: Any, exposure: float, seconds: float, finished: float
) -> dict[str, Any]:
    """What ``--json`` prints."""
    import skyscatter
    from skyscatter.scene import AU

    walks, error = request.solver == "path", median_error(image)
    return {
        "skyscatter": skyscatter.__version__,
        "model": model.name,
        "sun": {
            "elevation_deg": float(scene.sun.elevation_deg),
            "azimuth_deg": float(scene.sun.azimuth_deg),
            "distance_au": float(scene.star_distance) / AU,
        },
        "altitude_m": float(scene.observer.altitude),
        "view": request.view,
        "size": list(request.size),
        "wavelengths_nm": request.wavelengths.tolist(),
        "solver": request.solver,
        "seed": (request.seed or 0) if walks else None,
        "tolerance": request.tolerance,
        # Chance and what a grid misses are not the same thing, and `single` states neither.
        "noise": error if walks else None,
        "estimated_error": error if request.solver == "orders" else None,
        "polarisation": polarisation_summary(image, request.shown_wavelength),
        "exposure_ev": float(exposure),
        "seconds": round(seconds, 3),
        "complete": finished >= 1.0,
        "finished": finished,
        "outputs": [str(path) for path in request.outputs],
    }


def percent(share: float) -> str:
    """Two digits in per cent, never with an exponent: ``0.034`` is ``3.4 %``, ``1`` is ``100 %``."""
    return f"{np.format_float_positional(float(f'{100 * share:.2g}'), trim='-')} %"


def describe(summary: dict[str, Any]) -> str:
    """The summary for people."""
    from skyscatter.progress import format_seconds

    sun, noise, error = summary["sun"], summary["noise"], summary["estimated_error"]
    accuracy = "" if noise is None else f", median noise {percent(noise)}"
    accuracy += "" if error is None else f", median estimated error {percent(error)}"
    polarised = summary["polarisation"]
    if polarised is not None and polarised["mean_degree"] is not None:
        accuracy += f"; degree of linear polarisation {percent(polarised['mean_degree'])} on average"
        accuracy += f", {percent(polarised['maximum_degree'])} at most"
    part = "" if summary["complete"] else f"interrupted with {100 * summary['finished']:.1f} % of the pixels finished; "
    return (
        f"{part}{summary['model']}: Sun at elevation {sun['elevation_deg']:.2f}°, azimuth {sun['azimuth_deg']:.2f}°; "
        f"solver {summary['solver']}{accuracy}; EV {summary['exposure_ev']:.1f}; {format_seconds(summary['seconds'])}; "
        f"wrote {', '.join(summary['outputs']) or 'nothing'}"
    )
