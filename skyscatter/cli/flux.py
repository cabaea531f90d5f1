"""``skyscatter flux``: spectral fluxes of a model at altitudes and under Suns, as a table or labelled data."""

from __future__ import annotations

import json
import time as clock
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.cli import common, parse, stopping
from skyscatter.cli.solver_options import given, option
from skyscatter.errors import DomainError
from skyscatter.units import metres

if TYPE_CHECKING:
    from skyscatter.solvers.state import Checkpoint

SOLVERS = ("orders",)
SUFFIXES = (".nc", ".csv")
DEFAULT_SUN_ELEVATION = "30"


@dataclass(frozen=True)
class Request:
    """What the command line asks for, checked as far as that goes without a model."""

    model: str
    altitudes: NDArray[np.float64]
    elevations: NDArray[np.float64] | None  #: None where place and time say
    place: tuple[float, float] | None
    time: str | None
    wavelengths: NDArray[np.float64]
    given: dict[str, Any]  #: options of the solver
    threads: int | None
    outputs: list[Path]
    json: bool
    quiet: bool
    progress: str
    resume: Path | None
    every: float | None


def flux(
    context: typer.Context,
    model: Annotated[
        str, typer.Argument(help="Name of a shipped model (see: skyscatter models) or a TOML file.")
    ] = "earth",
    altitude: Annotated[
        str, typer.Option(metavar="LIST", help="Heights above the ground, START:STOP:STEP or a list: 0,1km,12km.")
    ] = "0",
    place: common.Place = None,
    time: common.Moment = None,
    sun_elevation: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Elevations of the Sun [degree], START:STOP:STEP or a list: 5,30,60; "
            f"{DEFAULT_SUN_ELEVATION} if nothing is said.",
        ),
    ] = None,
    wavelengths: common.Wavelengths = "300:1000:50",
    tolerance: Annotated[str | None, option("tolerance", SOLVERS)] = None,
    max_order: Annotated[str | None, option("max_order", SOLVERS)] = None,
    threads: common.Threads = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="File to write, .nc or .csv; else the table goes to stdout."
        ),
    ] = None,
    as_json: common.AsJson = False,
    resume: common.Resume = None,
    checkpoint: common.Every = None,
    no_clobber: common.NoClobber = False,
    quiet: common.Quiet = False,
    verbose: common.Verbose = False,
    progress: common.ProgressMode = "auto",
) -> int:
    """Compute fluxes of a planet's air: direct, diffuse, downward, upward, net and actinic, with estimated errors.

    The Sun stands where --place and --time put it, or at --sun-elevation.  One solution serves all altitudes and Suns.
    Units are W m-2 nm-1.
    """
    common.check_place(place, time, {"sun_elevation": sun_elevation})
    request = Request(
        model=model,
        altitudes=parse.parse_values(altitude, "altitude", lambda word: metres(word, "altitude"), "0,1km,12km"),
        elevations=_elevations(sun_elevation) if place is None else None,
        place=None if place is None else parse.parse_place(place),
        time=time,
        wavelengths=parse.parse_wavelengths(wavelengths),
        given=given("orders", SOLVERS, tolerance=tolerance, max_order=max_order),
        threads=parse.parse_integer(threads, "threads", 1, "give a number of threads, 1 or more"),
        outputs=[parse.check_output(path, SUFFIXES) for path in output or []],
        json=as_json,
        quiet=quiet,
        progress=common.talk(quiet, verbose, progress),
        resume=None if resume is None else parse.check_checkpoint(resume),
        every=None if checkpoint is None else parse.parse_time(checkpoint, "checkpoint"),
    )
    parse.check_new(request.outputs if no_clobber else ())
    return common.stoppable(lambda: run(request, list(context.obj or [])))


def _elevations(given: str | None) -> NDArray[np.float64]:
    text = DEFAULT_SUN_ELEVATION if given is None else given
    elevations = parse.parse_values(text, "sun_elevation", float, "10:90:10 or 5,30,60")
    if not np.abs(elevations).max() <= 90.0:
        raise DomainError("sun_elevation", text, "give elevations between -90 and 90 degrees")
    return elevations


def run(request: Request, arguments: list[str]) -> int:
    """Solve, write, report; returns the exit status."""
    import skyscatter
    from skyscatter.solvers.fluxdata import to_csv

    started = clock.monotonic()
    model: Any = skyscatter.load_model(request.model)
    common.check_command(model, request.model, "sky")
    top = model.medium.top
    if not (request.altitudes.min() >= 0.0 and request.altitudes.max() <= top):
        beyond = float(request.altitudes[np.argmax(np.abs(request.altitudes - top / 2))])
        raise DomainError("altitude", beyond, f"lies between 0 and the top of the air, {top:g} m")
    scene, elevations = _scene(request, model)
    checkpoint = common.checkpoint_for(request.resume, request.outputs, request.every, "skyscatter-flux")
    try:
        with stopping.keeping(lambda: common.keep(checkpoint, arguments)):
            dataset = _solve(request, model.name, scene, elevations, checkpoint)
        for path in request.outputs:
            _write(dataset, path)
    except BaseException:
        common.keep(checkpoint, arguments)
        raise
    checkpoint.remove()
    if not request.outputs and not request.json:
        typer.echo(to_csv(dataset), nl=False)
    return _report(request, model, dataset, clock.monotonic() - started)


def _scene(request: Request, model: Any) -> tuple[Any, NDArray[np.float64]]:
    """Scene, and elevations of its Sun [degree]."""
    from skyscatter.solvers.eclipse import eclipse_of

    if request.place is not None and request.time is not None:
        # Of the lights of the night no field is solved: the Sun alone is meant, and said below.
        scene = model.scene_at(*request.place, request.time, lights=("sun",)).model_copy(update={"lights": None})
        if eclipse_of(scene) is not None:
            raise DomainError("time", request.time, "is in an eclipse of the Sun, whose light no field holds; see sky")
        _warn_of_night(request.time, scene.sun.elevation_deg)
        return scene, np.array([scene.sun.elevation_deg])
    assert request.elevations is not None
    return model.scene(), request.elevations


def _warn_of_night(time: str, elevation: float) -> None:
    """Say that the fluxes of a night are not those of its lights."""
    from skyscatter.models.sky import DARK

    if elevation < DARK:
        warnings.warn(
            f"time = {time} has the Sun at {elevation:.1f} degrees: these are fluxes of sunlight alone, without the "
            "other lights of the night; give another --time, or see the night by skyscatter sky",
            stacklevel=2,
        )


def _solve(request: Request, name: str, scene: Any, elevations: NDArray[np.float64], checkpoint: Checkpoint) -> Any:
    """The field and its fluxes, as labelled data."""
    import skyscatter
    from skyscatter.progress import Progress, say

    with Progress(1.0, f"{name} fluxes", request.progress) as progress:
        field = skyscatter.solve(
            scene,
            request.wavelengths,
            sun_elevations_deg=(float(elevations.min()), float(elevations.max())),
            threads=request.threads,
            progress=progress.to,
            resume=request.resume,
            checkpoint=checkpoint,
            **request.given,
        )
        say("integrals over directions")
        return field.flux_dataset(request.altitudes, elevations, progress=progress.to, checkpoint=checkpoint)


def _write(dataset: Any, path: Path) -> None:
    if path.suffix.lower() == ".nc":
        from skyscatter.netcdf import save_dataset

        save_dataset(dataset, path)
        return
    from skyscatter.solvers.fluxdata import to_csv

    with atomic_path(path) as temporary:
        temporary.write_text(to_csv(dataset), encoding="utf-8")


def _report(request: Request, model: Any, dataset: Any, seconds: float) -> int:
    import skyscatter
    from skyscatter.solvers.fluxdata import QUANTITIES
    from skyscatter.spectra.cells import cell_edges, wide_cells

    # Relative to what goes down at that place: net and upward fluxes may be near to nothing.
    share = (dataset["net_error"] / dataset["down"].where(dataset["down"] > 0)).values
    error = float(np.nanmedian(share)) if np.isfinite(share).any() else None
    summary = {
        "skyscatter": skyscatter.__version__,
        "model": model.name,
        "altitude_m": request.altitudes.tolist(),
        "sun_elevation_deg": dataset["sun_elevation"].values.tolist(),
        "wavelengths_nm": request.wavelengths.tolist(),
        "cells_nm": np.transpose(cell_edges(request.wavelengths)).tolist(),
        "estimated_error": error,
        **({} if request.outputs else {name: dataset[name].values.tolist() for name in QUANTITIES}),
        "seconds": round(seconds, 3),
        "outputs": [str(path) for path in request.outputs],
    }
    if request.json:
        typer.echo(json.dumps(summary, allow_nan=False))
    elif not request.quiet:
        from skyscatter.progress import format_seconds

        accuracy = "" if error is None else f", median estimated error of the net flux {common.percent(error)} of down"
        accuracy += common.missed(error, request.given.get("tolerance"))
        written = f"; wrote {', '.join(summary['outputs'])}" if request.outputs else ""
        done = f"{dataset['net'].size} places, Suns and wavelengths{accuracy}; {format_seconds(seconds)}{written}"
        typer.echo(f"{model.name}: {done}", err=True)
        if note := wide_cells(request.wavelengths):
            typer.echo(f"note: {note}", err=True)
    return 0
