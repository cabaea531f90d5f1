"""``skyscatter models``: lists, shows, draws, checks and starts model files, and says what may stand in them."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from skyscatter.atomic import atomic_path
from skyscatter.cli import common, parse
from skyscatter.cli.examples import epilog
from skyscatter.cli.wavelengths import CHECKED_WAVELENGTHS, SHOWN_WAVELENGTHS
from skyscatter.errors import DomainError, ModelFileError, SkyscatterError
from skyscatter.plotting import plot_model, vertical_optical_depth

app = typer.Typer(
    help="List, show, draw, check and start model files; what may stand in them.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

PLOT_HELP = "Draw profiles, optical depths, phase functions; of a nebula maps of its columns: .png .svg .pdf"
SOURCE_WIDTH = 100


@app.callback(invoke_without_command=True)
def _list(context: typer.Context) -> None:
    """List the shipped models, skies, nebulae and scenes of surfaces; sub-commands show, draw and check one."""
    if context.invoked_subcommand is not None:
        return
    import skyscatter

    models = {name: skyscatter.load_model(name) for name in skyscatter.model_names()}
    width = max(len(name) for name in models)
    for title, command in (("skies", "sky"), ("nebulae", "nebula"), ("scenes of surfaces", "render")):
        chosen = {name: model for name, model in models.items() if model.command == command}
        if chosen:
            typer.echo(f"{title} (skyscatter {command}):")
        for name, model in chosen.items():
            typer.echo(f"  {name:<{width}}  {model.description.strip()}")


@app.command("show", epilog=epilog("models show"))
def show(
    name: Annotated[str, typer.Argument(help="Name of a shipped model or a TOML file.")],
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help=PLOT_HELP)] = None,
    no_clobber: common.NoClobber = False,
) -> None:
    """Print what a model consists of and where its numbers come from."""
    import skyscatter

    _check_plot(plot, no_clobber)
    model = skyscatter.load_model(name)
    typer.echo(describe_model(model))
    if plot is not None:
        plot_model(model, plot)


@app.command("check", epilog=epilog("models check"))
def check(
    file: Annotated[str, typer.Argument(help="A TOML file, or the name of a shipped model.")],
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help=PLOT_HELP)] = None,
    no_clobber: common.NoClobber = False,
) -> None:
    """Read a model file and evaluate each component once; an error names the field, the value and the remedy."""
    import skyscatter
    from skyscatter.progress import Progress

    _check_plot(plot, no_clobber)
    with Progress(1.0, f"checking {file}") as progress:
        model: Any = skyscatter.load_model(file)
        typer.echo(_checked(file, model, progress.to))
    if plot is not None:
        plot_model(model, plot)


def _checked(file: str, model: Any, tell: Callable[[float], None]) -> str:
    """Evaluate a model; returns what to say about a good one."""
    if hasattr(model, "planet"):
        from skyscatter.models.sky import warn_of_size

        for number, component in enumerate(model.components):
            _check_component(file, component)
            tell((number + 1) / len(model.components))
        if getattr(model, "world", ""):
            from skyscatter.cli.surface_models import check_held

            check_held(file, model)
        warn_of_size(model)
        return f"{file}: good ({len(model.components)} components, {len(model.sources)} sources)"
    if model.command == "render":
        from skyscatter.cli.surface_models import check_surfaces

        return check_surfaces(file, model)
    from skyscatter.cli.nebula_models import check_nebula

    return check_nebula(file, model, tell)


@app.command("new", epilog=epilog("models new"))
def new(
    name: Annotated[str, typer.Argument(help="Name of a shipped model to start from; skyscatter models lists them.")],
    file: Annotated[Path, typer.Argument(help="The TOML file to write.")],
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
) -> None:
    """Write a shipped model as a file to edit, with comments on its tables and kinds and on what it leaves out."""
    from skyscatter.models.start import model_to_edit

    text = model_to_edit(name)
    parse.check_output(file, (".toml",))
    if file.exists() and not force:
        raise DomainError("file", str(file), "exists; choose another name, or add --force to replace it")
    _write(text, file)
    typer.echo(f"{file}: edit it, then skyscatter models check {file}", err=True)


@app.command("schema", epilog=epilog("models schema"))
def schema(
    sort: Annotated[str | None, typer.Argument(help="Only of sky, nebula or render; of all when left out.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Else on stdout.")] = None,
) -> None:
    """Print the JSON schema of model files, with which an editor completes and checks them."""
    import json

    from skyscatter.models.schema import model_schema

    _write(json.dumps(model_schema(sort), indent=1) + "\n", output)


@app.command("reference", epilog=epilog("models reference"))
def reference(
    name: Annotated[str | None, typer.Argument(help="Only of this kind or table, such as tabulated.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Else on stdout.")] = None,
) -> None:
    """Print what a model file may say: every table, kind and field, with units, defaults, ranges and examples."""
    from skyscatter.models.reference import reference

    _write(reference(name), output)


def _write(text: str, file: Path | None) -> None:
    """The text into a file, or on stdout."""
    if file is None:
        typer.echo(text, nl=False)
        return
    parse.check_output(file, (file.suffix.lower(),))
    with atomic_path(file) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _check_plot(plot: Path | None, no_clobber: bool) -> None:
    if plot is not None:
        parse.check_output(plot, parse.PLOT_SUFFIXES)
        parse.check_new([plot] if no_clobber else ())


def _check_component(file: str, component: Any) -> None:
    column = float(component.density.vertical_column(0.0))
    if not (np.isfinite(column) and column > 0):
        raise ModelFileError(file, f"component {component.name}: vertical column {column:g} m; it must be positive")
    for field, values in zip(
        ("scattering", "absorption", "emission"),
        component.optics.coefficients(CHECKED_WAVELENGTHS, column),
        strict=True,
    ):
        if not (np.all(np.isfinite(values)) and np.all(np.asarray(values) >= 0)):
            raise ModelFileError(file, f"component {component.name}: {field} is negative or not finite")


def describe_model(model: Any) -> str:
    """The model as text: planet, components with vertical optical depths, sources; or a nebula's, or a scene's."""
    if model.command == "render":
        from skyscatter.cli.surface_models import describe_surfaces

        return describe_surfaces(model, SOURCE_WIDTH)
    if not hasattr(model, "planet"):
        from skyscatter.cli.nebula_models import describe_nebula

        return describe_nebula(model, SOURCE_WIDTH)
    heads = "".join(f"{wavelength:8.0f} nm" for wavelength in SHOWN_WAVELENGTHS)
    lines = [
        f"{model.name}: {model.description.strip()}",
        f"planet {model.planet.name}, radius {model.planet.radius / 1e3:g} km, atmosphere up to {model.top / 1e3:g} km",
        "",
        f"{'vertical optical depth':<44}{heads}",
    ]
    total = np.zeros(SHOWN_WAVELENGTHS.size)
    for component in model.components:
        try:
            depth = vertical_optical_depth(component, SHOWN_WAVELENGTHS)
        except SkyscatterError as error:
            raise ModelFileError(model.name, f"component {component.name}: {error}") from error
        total += depth
        kinds = f"{component.name} ({type(component.density).__name__}, {type(component.optics).__name__})"
        lines.append(f"  {kinds:<42}" + "".join(f"{value:11.4g}" for value in depth))
    lines.append(f"  {'all':<42}" + "".join(f"{value:11.4g}" for value in total))
    if getattr(model, "world", ""):
        from skyscatter.cli.surface_models import held_lines

        lines += held_lines(model)
    lines += ["", "sources"]
    for source in model.sources:
        lines += textwrap.wrap(source, SOURCE_WIDTH, initial_indent="  - ", subsequent_indent="    ")
    return "\n".join(lines)
