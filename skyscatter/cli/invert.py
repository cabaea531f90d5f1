"""``skyscatter invert``: parameters of a model from data, with their uncertainties."""

from __future__ import annotations

import json
import math
import sys
import time as clock
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from skyscatter.cli import common, parse, stopping
from skyscatter.cli.solver_options import given, option
from skyscatter.errors import DomainError
from skyscatter.solvers.options import record_of
from skyscatter.units import metres, nanometres

METHODS = {"optimal-estimation": "optimal_estimation", "posterior": "posterior"}
SOLVERS = ("orders", "path", "single")
#: Exit status of fits that are no answer.
NOT_CONVERGED = 3


@dataclass(frozen=True)
class Request:
    """What the command line asks for, checked as far as that goes without the data."""

    model: str
    data: list[Path]
    free: dict[str, Any]
    output: Path | None
    corner: Path | None
    residual: Path | None
    save_model: Path | None
    json: bool
    resume: Path | None
    quiet: bool
    progress: str
    #: Of `skyscatter.inversion.read_observation`: what files do not say, and what of them to use.
    place: dict[str, Any]
    #: Of `skyscatter.fit`.
    options: dict[str, Any]
    #: Of `skyscatter.tasks.cluster.executor_of`.
    work: dict[str, Any]

    @property
    def files(self) -> list[Path]:
        """What is written."""
        return [p for p in (self.output, self.corner, self.residual, self.save_model) if p is not None]


def invert(
    context: typer.Context,
    model: Annotated[str, typer.Argument(help="Name of a shipped model (see: skyscatter models) or a TOML file.")],
    data: Annotated[
        list[Path] | None,
        typer.Option(
            "--data",
            metavar="FILE",
            help="What was measured: a table .csv or .nc, or an image .nc, .exr, .fits; may be repeated.",
        ),
    ] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            "--free",
            metavar="NAME[=LOW:HIGH]",
            help="A free parameter, such as haze.optical_depth=0:2, and its bounds; may be repeated.",
        ),
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(
            "--prior", metavar="NAME=MEAN~SIGMA", help="A normal prior of a free parameter, or lognormal(MEDIAN,SIGMA)."
        ),
    ] = None,
    solver: Annotated[str, typer.Option(metavar="NAME", help="orders, path or single.")] = "orders",
    method: Annotated[
        str, typer.Option(metavar="NAME", help="optimal-estimation, or posterior: the whole of it, by sampling.")
    ] = "optimal-estimation",
    noise: Annotated[
        str | None, typer.Option(metavar="REL", help="Noise of data that do not state it, such as 2%.")
    ] = None,
    model_error: Annotated[
        str | None,
        typer.Option(metavar="REL", help="Error of the model, such as 0.3%, else as the solver states it."),
    ] = None,
    tolerance: Annotated[str | None, option("tolerance", SOLVERS)] = None,
    samples: Annotated[str | None, option("samples", SOLVERS, "256")] = None,
    max_order: Annotated[str | None, option("max_order", SOLVERS)] = None,
    max_iterations: Annotated[str | None, typer.Option(metavar="N", help="Iterations at most, else 20.")] = None,
    steps: Annotated[
        str | None, typer.Option(metavar="N", help="Steps of each walker (posterior), else 1000 or more.")
    ] = None,
    no_emulator: Annotated[
        bool, typer.Option("--no-emulator", help="Walk on the model itself, which takes long (posterior).")
    ] = False,
    sun_elevation: Annotated[
        str | None, typer.Option(metavar="DEG", help="Sun's elevation [degree], where the data do not say.")
    ] = None,
    sun_azimuth: Annotated[
        str | None, typer.Option(metavar="DEG", help="Sun's azimuth [degree], where the data do not say, else 180.")
    ] = None,
    altitude: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="Observer's height, where the data do not say, else 0.")
    ] = None,
    place: Annotated[
        str | None, typer.Option(metavar="LAT,LON", help="Place on Earth [degree], for fluxes by time.")
    ] = None,
    bandwidth: Annotated[
        str | None,
        typer.Option(metavar="NM", help="Width of the instrument's bands, else as far as half-way to the next."),
    ] = None,
    units: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            help="Of a table's radiances or fluxes, such as 'uW cm-2 sr-1 nm-1', else by the file, or W, m, sr, nm.",
        ),
    ] = None,
    pixels: Annotated[
        str | None, typer.Option(metavar="N", help="Pixels of an image to use at most, evenly spread, else 400.")
    ] = None,
    wavelengths: Annotated[
        str | None, typer.Option(metavar="LIST", help="Those of an image's wavelengths [nm] to use, else all.")
    ] = None,
    seed: Annotated[str | None, typer.Option(metavar="N", help="Same seed, same numbers; else 0.")] = None,
    threads: common.Threads = None,
    workers: common.WorkerCount = None,
    worker_memory: common.WorkerMemory = None,
    scheduler: common.Scheduler = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="The result: .json; replaced if it exists.")
    ] = None,
    corner: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Corner plot of the posterior: .png, .svg, .pdf.")
    ] = None,
    residual: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Data beside model, and the residual: .png, .svg, .pdf.")
    ] = None,
    save_model: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The model with the estimate in it: .toml.")
    ] = None,
    as_json: common.AsJson = False,
    resume: common.Resume = None,
    no_clobber: common.NoClobber = False,
    quiet: common.Quiet = False,
    verbose: common.Verbose = False,
    progress: common.ProgressMode = "auto",
) -> int:
    """Find parameters of a model from what was measured.

    Prints a table of estimates with their uncertainties.  Names are those of the model file, such as
    haze.density.scale_height, or what they add up to: COMPONENT.optical_depth, .asymmetry, .single_scattering_albedo,
    .effective_radius, .extinction (A_V), ozone.column_du, ground.albedo, star.temperature; calibration is a factor on
    the data's scale; ground.grey_albedo, a grey ground in the place of the model's.  Ctrl-C keeps the state and says
    how to go on.  Exit status 3: the fit has not converged, or misses the data by far; what was found is written.
    """
    request = Request(
        model=model,
        data=[parse.check_input(path, "data file") for path in data or []],
        free=_free(free or [], prior or []),
        output=_file(output, (".json",)),
        corner=_file(corner, parse.PLOT_SUFFIXES),
        residual=_file(residual, parse.PLOT_SUFFIXES),
        save_model=_file(save_model, (".toml",)),
        json=as_json,
        resume=None if resume is None else parse.check_checkpoint(resume),
        quiet=quiet,
        progress=common.talk(quiet, verbose, progress),
        place=_place(
            sun_elevation, sun_azimuth, altitude, place=place, bandwidth=bandwidth, pixels=pixels,
            wavelengths=wavelengths, units=units,
        ),
        options=_options(
            solver=solver, method=method, noise=noise, model_error=model_error, tolerance=tolerance, samples=samples,
            max_order=max_order, max_iterations=max_iterations, seed=seed, threads=threads, steps=steps,
            no_emulator=no_emulator,
        ),
        work=common.worker_options(workers, scheduler, worker_memory),
    )  # fmt: skip
    if not request.data:
        raise DomainError("data", "", "name a file with measurements: --data FILE")
    if quiet and not as_json and output is None and save_model is None:
        raise DomainError("quiet", True, "the result would be lost; name a file with -o, ask for --json, or drop -q")
    parse.check_new(request.files if no_clobber else ())
    if request.files != list(dict.fromkeys(request.files)):
        raise DomainError("output", str(request.files[0]), "two outputs have one name; give each its own")
    return common.stoppable(lambda: run(request, list(context.obj or [])))


def _file(path: Path | None, suffixes: tuple[str, ...]) -> Path | None:
    return None if path is None else parse.check_output(path, suffixes)


def _free(free: list[str], prior: list[str]) -> dict[str, Any]:
    """Names and priors; each once."""
    from skyscatter.inversion.parameters import parse_free

    if not free:
        raise DomainError("free", "", "name at least one parameter: --free haze.optical_depth")
    found: dict[str, Any] = {}
    for text in free:
        name, value = parse_free(text)
        if name in found:
            raise DomainError("free", name, "is named twice; give each parameter once")
        found[name] = value
    for text in prior:
        name, value = parse_free(text)
        if name not in found:
            raise DomainError("prior", text, f"{name} is not free; add --free {name}")
        if value is None:
            raise DomainError("prior", text, f"give it as {name}=MEAN~SIGMA")
        if found[name] is not None:
            raise DomainError("prior", text, f"{name} has bounds already; give --free {name} without them")
        found[name] = value
    return found


def _place(elevation: str | None, azimuth: str | None, altitude: str | None, **texts: str | None) -> dict[str, Any]:
    bandwidth, place, wavelengths = texts["bandwidth"], texts["place"], texts["wavelengths"]
    given: dict[str, Any] = {
        "sun_elevation_deg": None if elevation is None else parse.parse_degrees(elevation, "sun_elevation", 90.0, 0.0),
        "sun_azimuth_deg": None if azimuth is None else parse.parse_degrees(azimuth, "sun_azimuth", 360.0, 0.0),
        "altitude": None if altitude is None else metres(altitude, "altitude"),
        "place": None if place is None else parse.parse_place(place),
        "bandwidth_nm": None if bandwidth is None else nanometres(bandwidth, "bandwidth"),
        "units": texts["units"],
        "pixels": parse.parse_integer(texts["pixels"], "pixels", 1, "give a number of pixels, 1 or more"),
        "wavelengths": None if wavelengths is None else parse.parse_wavelengths(wavelengths),
    }
    if given["bandwidth_nm"] is not None and not given["bandwidth_nm"] > 0:
        raise DomainError("bandwidth", bandwidth, "give a width above 0 in nm")
    return {name: value for name, value in given.items() if value is not None}


def _options(no_emulator: bool, **texts: str | None) -> dict[str, Any]:
    """Options of `skyscatter.fit` from what was typed."""
    solver, method = str(texts["solver"]), str(texts["method"])
    of_solver = {name: texts[name] for name in ("tolerance", "samples", "max_order")}
    of_solver |= {"seed": texts["seed"]} if solver == "path" else {}
    how = record_of(solver, **given(solver, SOLVERS, **of_solver))
    if method not in METHODS:
        raise DomainError("method", method, f"choose one of {', '.join(METHODS)}")
    if method != "posterior" and (no_emulator or texts["steps"] is not None):
        name = "no_emulator" if no_emulator else "steps"
        raise DomainError(name, texts.get(name, True), "belongs to the posterior; add --method posterior")
    integer = parse.parse_integer
    options: dict[str, Any] = {
        "noise": parse.parse_noise(texts["noise"]),
        "model_error": _share(texts["model_error"]),
        "max_iterations": integer(texts["max_iterations"], "max_iterations", 1, "give a number, 1 or more"),
        "steps": integer(texts["steps"], "steps", 10, "give a number of steps, 10 or more"),
        "emulator": False if no_emulator else None,
        "seed": integer(texts["seed"], "seed", 0, "give a whole number from 0 to 9223372036854775807 (2^63 - 1)"),
        "threads": integer(texts["threads"], "threads", 1, "give a number of threads, 1 or more"),
    }
    said = {name: value for name, value in options.items() if value is not None}
    return {"solver": how, "method": METHODS[method], **said}


def _share(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        value = float(text.strip()[:-1]) / 100 if text.strip().endswith("%") else float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value < 1:
        raise DomainError("model_error", text, "give a relative error from 0 to below 100 %, for instance 0.3%")
    return value


def run(request: Request, arguments: list[str]) -> int:
    """Read, fit, write, report; returns the exit status."""
    import skyscatter
    from skyscatter.inversion.readers import read_observation
    from skyscatter.progress import Progress
    from skyscatter.tasks.cluster import executor_of
    from skyscatter.tasks.store import discard

    started = clock.monotonic()
    model = skyscatter.load_model(request.model)
    options = dict(request.options)
    noise = options.pop("noise", None)
    observations = [read_observation(path, noise=noise, **request.place) for path in request.data]
    state = request.resume or common.checkpoint_path(request.files, "skyscatter-invert")
    if request.resume is None:
        discard(state)
    try:
        with (
            stopping.keeping(lambda: _say_how_to_go_on(state, arguments)),
            Progress(1.0, f"{model.name} fit", request.progress) as progress,
            executor_of(request.work["workers"], request.work["scheduler"], request.work["worker_memory"]) as executor,
        ):
            result = skyscatter.fit(
                model, observations, request.free, executor=executor, progress=progress.to, resume=state, **options
            )  # fmt: skip
        _write(request, result)
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt) or state.is_dir():
            _say_how_to_go_on(state, arguments)
        if isinstance(error, KeyboardInterrupt):
            return stopping.status()
        raise
    discard(state)
    return _report(request, result, clock.monotonic() - started)


def _say_how_to_go_on(state: Path, arguments: list[str]) -> None:
    if not state.is_dir():
        print("skyscatter: interrupted before anything was finished", file=sys.stderr)
        return
    common.say_how_to_go_on(state, arguments)


def _write(request: Request, result: Any) -> None:
    if request.output is not None:
        result.save(request.output)
    if request.corner is not None:
        result.corner(request.corner)
    if request.residual is not None:
        result.plot_residual(request.residual)
    if request.save_model is not None:
        result.model.save(request.save_model)


def _report(request: Request, result: Any, seconds: float) -> int:
    import skyscatter

    if request.json:
        content = result.to_json()
        dropped = ("coordinates", "model", "samples_z", "measured", "noise", "fitted", "model_error")
        summary = {
            "skyscatter": skyscatter.__version__,
            "model": result.model.name,
            **{name: value for name, value in content.items() if name not in dropped},
            "warnings": list(result.warnings),
            "seconds": round(seconds, 3),
            "outputs": [str(path) for path in request.files],
        }
        typer.echo(json.dumps(summary, allow_nan=False))
    if not request.quiet:
        typer.echo(str(result), err=True)
    elif not result.trusted:
        print(f"skyscatter: warning: {'; '.join(result.warnings)}", file=sys.stderr)
    return 0 if result.trusted else NOT_CONVERGED
