"""``skyscatter render``: one scene of surfaces, from a model file to pictures and data files."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace
from typing import Annotated, Any

import typer

from skyscatter.cli import common, large, parse, pictures, polarised
from skyscatter.cli.solver_options import given, option, suited
from skyscatter.errors import DomainError, UnitsError
from skyscatter.units import metres

DEFAULT_WAVELENGTHS = "380:780:10"
SOLVERS = ("path", "photons", "auto")
#: Those that have options.
NAMED = SOLVERS[:2]


@dataclass(frozen=True)
class Request(common.RunRequest):
    """What the command line asks for, checked as far as that goes without a model."""

    seen: dict[str, tuple[float, float, float]]
    field_of_view: float | None
    orders: int | None
    stokes: bool
    subpixels: int | None
    png: dict[str, Any]

    @property
    def more(self) -> dict[str, Any]:
        """Arguments of `skyscatter.render` that only this command has, as far as they were given."""
        names = ("orders", "stokes", "subpixels")
        return {name: getattr(self, name) for name in names if getattr(self, name)}


def render(
    context: typer.Context,
    model: Annotated[str, typer.Argument(help="Name of a shipped model (see: skyscatter models) or a TOML file.")],
    size: Annotated[str | None, typer.Option(metavar="WxH", help="Picture size [pixel], else the model's.")] = None,
    position: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="The camera's place, 2m,0,30cm; else the model's."),
    ] = None,
    target: Annotated[str | None, typer.Option(metavar="X,Y,Z", help="The point in the middle of the picture.")] = None,
    up: Annotated[str | None, typer.Option(metavar="X,Y,Z", help="Direction that is upwards in the picture.")] = None,
    field_of_view: Annotated[
        str | None, typer.Option(metavar="ANGLE", help="Width of the picture, such as 50deg; else the model's.")
    ] = None,
    wavelengths: Annotated[
        str | None,
        typer.Option(
            metavar="START:STOP:STEP",
            help=f"Vacuum wavelengths [nm], ends included, or a list: 450,550; else {DEFAULT_WAVELENGTHS}, and "
            f"{pictures.ROOM_WAVELENGTHS} where nothing but .png files is made.  Light of lamps is averaged half-way "
            "to neighbours.",
        ),
    ] = None,
    solver: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="path (walks from the camera), photons (from the lamps, gathered), or auto, the better one.",
        ),
    ] = "auto",
    samples: Annotated[str | None, option("samples", NAMED)] = None,
    noise: Annotated[str | None, option("noise", NAMED)] = None,
    max_order: Annotated[str | None, option("max_order", NAMED)] = None,
    orders: Annotated[
        str | None, typer.Option(metavar="N", help="Layers with the light after 1, ..., N of them.")
    ] = None,
    subpixels: Annotated[
        str | None,
        typer.Option(metavar="N", help="N x N rays through each pixel, for smooth edges."),
    ] = None,
    stokes: polarised.Stokes = False,
    sampling: Annotated[str | None, option("sampling", NAMED)] = None,
    photons: Annotated[str | None, option("photons", NAMED)] = None,
    radius: Annotated[str | None, option("radius", NAMED)] = None,
    estimator: Annotated[str | None, option("estimator", NAMED)] = None,
    direct: Annotated[bool | None, option("direct", NAMED)] = None,
    seed: Annotated[str | None, option("seed", NAMED)] = None,
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
    scale: common.Scale = None,
    half: common.Half = False,
    no_spectra: common.NoSpectra = False,
    float32: common.Float32 = False,
    compress: common.Compress = False,
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
    """Render a scene of surfaces, media and lamps.

    Skies and nebulae are rendered, too, with the options of their own commands.

    Camera and viewpoint are the model's where nothing else is said.  Ctrl-C keeps what is finished, a picture as
    NAME.partial.EXT, and says how to go on.
    """
    outputs = parse.check_outputs(output or [], no_clobber)
    development = {"exposure": exposure, "tone": tone, "space": space, "glare": glare}
    common.check_png_options(outputs, {"look": look, **development, "bits": bits})
    whole = parse.parse_integer
    seen = {"position": position, "target": target, "up": up}
    request = Request(
        model=model,
        size=(0, 0) if size is None else parse.parse_size(size, "perspective"),
        seen={name: parse_triple(text, name, name != "up") for name, text in seen.items() if text is not None},
        field_of_view=None if field_of_view is None else parse.parse_angle(field_of_view, "field_of_view"),
        solver=solver,
        given=given(
            solver, SOLVERS, samples=samples, noise=noise, max_order=max_order, sampling=sampling, photons=photons,
            radius=radius, estimator=estimator, direct=direct, seed=seed,
        ),
        orders=whole(orders, "orders", 1, "give a number of layers, 1 or more"),
        stokes=stokes,
        subpixels=whole(subpixels, "subpixels", 1, "give a number of rays along each side of a pixel, 1 or more"),
        png=pictures.natural_options(look, development),
        outputs=outputs,
        file_options=common.file_options(
            outputs, scale=scale, half=half, no_spectra=no_spectra, float32=float32, compress=compress
        ),
        **common.run_options(
            wavelengths=pictures.wavelengths(wavelengths, outputs, pictures.ROOM_WAVELENGTHS, DEFAULT_WAVELENGTHS),
            denoise=denoise, threads=threads, workers=workers, worker_memory=worker_memory, scheduler=scheduler,
            store=store, bits=bits, as_json=as_json, quiet=quiet, verbose=verbose, progress=progress, every=every,
            resume=resume, preview=preview,
        ),
    )  # fmt: skip
    common.check_solver(request, SOLVERS)
    common.check_development(request.png["space"], request.png["tone"], request.bits)
    return common.stoppable(lambda: run(request, list(context.obj or [])))


def parse_triple(text: str, name: str, lengths: bool) -> tuple[float, float, float]:
    """``1m,0,30cm`` as three lengths [m], or three numbers."""
    words = text.split(",")
    try:
        values = [metres(word, name) if lengths else float(word) for word in words]
    except (UnitsError, ValueError):
        values = []
    if len(values) != 3:
        remedy = "three lengths with commas, such as 2m,0,30cm" if lengths else "three numbers with commas: 0,0,1"
        raise DomainError(name, text, f"give {remedy}")
    return values[0], values[1], values[2]


def build_camera(request: Request, model: Any) -> Any:
    """The model's camera, with the size and the field that were asked for."""
    camera = model.camera
    changes: dict[str, Any] = {}
    if request.size != (0, 0):
        changes = {"width": request.size[0], "height": request.size[1]}
    if request.field_of_view is not None:
        if camera.kind == "telescope":
            width = changes.get("width", camera.width)
            finer = type(camera).from_field_of_view(width, camera.height, request.field_of_view)
            changes["pixel_scale_deg"] = finer.pixel_scale_deg
        elif hasattr(camera, "fov_deg"):
            changes["fov_deg"] = request.field_of_view
        else:
            raise DomainError("field_of_view", request.field_of_view, f"a {camera.kind} has none; leave it out")
    return type(camera)(**{**camera.model_dump(), **changes})


def choose(request: Request, scene: Any) -> str:
    """The solver: that which was asked for, the one that knows the options given, or the better one."""
    if request.solver != "auto":
        return request.solver
    able = suited(request.given, NAMED)
    if len(able) == 1:
        return able[0]
    from skyscatter.solvers.choice import preferred_solver

    return preferred_solver(scene, request.wavelengths, request.halved, request.stokes)


def run(request: Request, arguments: list[str]) -> int:
    """Render, write, report; returns the exit status."""
    import skyscatter

    started = clock.monotonic()
    model: Any = skyscatter.load_model(request.model)
    common.check_command(model, request.model, "render")
    camera = build_camera(request, model)
    rays = (request.subpixels or 1) ** 2
    request = replace(request, size=(camera.width, camera.height))
    fits = large.fits(request, rays, **request.more)
    scene = model.scene(**request.seen)
    request = replace(request, solver=choose(request, scene))
    if not fits:
        written = large.run(request, scene, camera, model.name, arguments, **request.more)
        summary = summarise(request, model, scene, written, None, None, clock.monotonic() - started)
        return common.report(request, summary, describe)
    rendered = common.render_request(request, scene, camera, model.name, arguments, **request.more)
    with rendered.writing() as outputs:
        image = rendered.image
        exposure = image.auto_exposure() if request.png["exposure"] == "auto" else float(request.png["exposure"])
        png = {**request.png, "exposure": exposure, "bits": request.bits}
        for path in outputs:
            suffix = path.suffix.lower()
            image.save(path, **(png if suffix == ".png" else request.file_options.get(suffix, {})))
    noise = common.median_error(rendered.raw)
    summary = summarise(request, model, scene, rendered, noise, exposure, clock.monotonic() - started)
    return common.report(request, summary, describe)


def summarise(
    request: Request,
    model: Any,
    scene: Any,
    rendered: common.Rendered | large.Written,
    noise: float | None,
    exposure: float | None,
    seconds: float,
) -> dict[str, Any]:
    """What ``--json`` prints."""
    viewpoint = scene.viewpoint
    return {
        **common.summary_of_run(request, model, seconds, rendered),
        "viewpoint": {"position_m": list(viewpoint.position), "target_m": list(viewpoint.target)},
        "subpixels": request.subpixels or 1,
        "noise": noise,
        "polarisation": polarised.summary(rendered.image) if isinstance(rendered, common.Rendered) else None,
        "exposure_ev": None if exposure is None else float(exposure),
    }


def describe(summary: dict[str, Any]) -> str:
    """The summary for people."""
    from skyscatter.progress import format_seconds

    noise = summary["noise"]
    accuracy = "" if noise is None else f", median noise {common.percent(noise)}"
    accuracy += common.describe_denoising(summary)
    accuracy += polarised.described(summary["polarisation"])
    exposure = "" if summary["exposure_ev"] is None else f"EV {summary['exposure_ev']:.1f}; "
    return (
        f"{common.describe_part(summary)}{summary['model']}: solver {summary['solver']}{accuracy}; "
        f"{exposure}{format_seconds(summary['seconds'])}; "
        f"wrote {', '.join(summary['outputs']) or 'nothing'}"
    )
