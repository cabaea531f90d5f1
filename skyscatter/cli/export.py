"""``skyscatter export``: a model's sky in the form in which a real-time engine loads it."""

from __future__ import annotations

import json
import os
import time as clock
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from skyscatter.cli import common, parse
from skyscatter.cli.solver_options import given, option
from skyscatter.errors import DomainError

#: What textures can hold is coarser than this.
DEFAULT_TOLERANCE = 0.01
ENGINES = ("three",)
SOLVERS = ("orders",)


@dataclass(frozen=True)
class Request:
    """What the command line asks for, checked as far as that goes without a model."""

    model: str
    engine: str
    folder: Path
    wavelengths: NDArray[np.float64]
    tolerance: float
    threads: int | None
    json: bool
    quiet: bool
    progress: str


def export(
    model: Annotated[
        str, typer.Argument(help="Name of a shipped model (see: skyscatter models) or a TOML file.")
    ] = "earth",
    to: Annotated[
        str, typer.Option(metavar="ENGINE", help="three: @takram/three-atmosphere, an npm package for three.js.")
    ] = "three",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FOLDER", help="Folder to write; MODEL-ENGINE if none.")
    ] = None,
    wavelengths: common.Wavelengths = "400:700:25",
    tolerance: Annotated[str | None, option("tolerance", SOLVERS, str(DEFAULT_TOLERANCE))] = None,
    threads: common.Threads = None,
    as_json: common.AsJson = False,
    quiet: common.Quiet = False,
    verbose: common.Verbose = False,
    progress: common.ProgressMode = "auto",
) -> int:
    """Write the sky of a planet for a real-time engine: from every altitude in the air, under every Sun.

    Five textures and atmosphere.json, which also says how far skies in them are from those that were computed.
    """
    if to not in ENGINES:
        raise DomainError("to", to, f"choose one of {', '.join(ENGINES)}")
    request = Request(
        model=model,
        engine=to,
        folder=output or Path(f"{Path(model).stem}-{to}"),
        wavelengths=parse.parse_wavelengths(wavelengths),
        tolerance=given("orders", SOLVERS, tolerance=tolerance).get("tolerance", DEFAULT_TOLERANCE),
        threads=parse.parse_integer(threads, "threads", 1, "give a number of threads, 1 or more"),
        json=as_json,
        quiet=quiet,
        progress=common.talk(quiet, verbose, progress),
    )
    above = next(place for place in (request.folder, *request.folder.absolute().parents) if place.exists())
    if not above.is_dir():
        raise DomainError("output", str(request.folder), f"{above} is a file: give the name of a folder")
    if not os.access(above, os.W_OK):
        raise DomainError("output", str(request.folder), f"{above} may not be written to: give another folder")
    return common.stoppable(lambda: run(request))


def run(request: Request) -> int:
    """Solve, write, report; returns the exit status."""
    import skyscatter
    from skyscatter.progress import Progress, format_seconds, say
    from skyscatter.solvers.engines.three import check_colours, needed_suns

    started = clock.monotonic()
    model: Any = skyscatter.load_model(request.model)
    common.check_command(model, request.model, "sky")
    check_colours(request.wavelengths)
    scene = model.scene()
    with Progress(1.0, f"{model.name} for {request.engine}", request.progress) as progress:
        field = skyscatter.solve(
            scene, request.wavelengths, sun_elevations_deg=needed_suns(scene.medium), tolerance=request.tolerance,
            threads=request.threads, progress=progress.to,
        )  # fmt: skip
        say("textures")
        made = field.export(request.engine, request.folder, threads=request.threads, progress=progress.to)
    seconds = clock.monotonic() - started
    if request.json:
        summary = {"skyscatter": skyscatter.__version__, "model": model.name, "folder": str(request.folder),
                   "deviations": made["deviations"], "seconds": round(seconds, 3)}  # fmt: skip
        typer.echo(json.dumps(summary, allow_nan=False))
    elif not request.quiet:
        median = max(row["median"] for row in made["deviations"] if row["sun_elevations_deg"][0] >= 0)
        words = f"by day half of all directions are within {common.percent(median)} of what was computed"
        typer.echo(f"{model.name}: wrote {request.folder}; {words}; {format_seconds(seconds)}", err=True)
    return 0
