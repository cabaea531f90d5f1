"""``skyscatter nebula``: one nebula, from a model file to pictures and data files."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from skyscatter.cli import common, large, parse, pictures, polarised, sequence
from skyscatter.cli import nebula_options as options
from skyscatter.cli.nebula_options import Request
from skyscatter.cli.solver_options import given, option
from skyscatter.errors import DomainError
from skyscatter.units import PARSEC

DEFAULT_WAVELENGTHS = "380:780:10"


def nebula(
    context: typer.Context,
    model: Annotated[str, typer.Argument(help="Name of a shipped model (see: skyscatter models) or a TOML file.")],
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Picture size [pixel], else 512x512, by 4 walks a pixel.")
    ] = None,
    field_of_view: Annotated[
        str | None,
        typer.Option(
            metavar="WIDTH", help="Width of the picture, 10arcmin or 2pc; else the model's, or the whole nebula."
        ),
    ] = None,
    pixel_scale: Annotated[
        str | None, typer.Option(metavar="ANGLE", help="Angle of a pixel, such as 0.5arcsec, in place of a width.")
    ] = None,
    inclination: Annotated[
        str | None, typer.Option(metavar="DEG", help="Tilt of the model's axis from the line of sight, towards north.")
    ] = None,
    azimuth: Annotated[
        str | None, typer.Option(metavar="DEG", help="Turn of the model about its own axis [degree].")
    ] = None,
    azimuths: Annotated[
        str | None, typer.Option(metavar="START:END:STEP", help="A frame for each azimuth [degree], or a list of them.")
    ] = None,
    inclinations: Annotated[
        str | None,
        typer.Option(metavar="START:END:STEP", help="The same for the tilt; with --azimuths a path, frame by frame."),
    ] = None,
    exposure_step: Annotated[
        str | None, typer.Option(metavar="EV", help="Most that the exposure changes from frame to frame, else 0.1.")
    ] = None,
    frame_rate: Annotated[str | None, typer.Option(metavar="N", help="Frames a second of a film, else 24.")] = None,
    position_angle: Annotated[
        str | None, typer.Option(metavar="DEG", help="Turn in the sky, from north through east [degree].")
    ] = None,
    wavelengths: Annotated[
        str | None,
        typer.Option(
            metavar="START:STOP:STEP",
            help=f"Vacuum wavelengths [nm], ends included, or a list: 450,550; else {DEFAULT_WAVELENGTHS}, with a node "
            "in each narrow band that is asked for, and 14 that suit colours where nothing but natural colour is made.",
        ),
    ] = None,
    solver: Annotated[
        str, typer.Option(metavar="NAME", help="path (all orders of scattering), single (the first alone) or photons.")
    ] = "path",
    samples: Annotated[str | None, option("samples", options.SOLVERS)] = None,
    noise: Annotated[str | None, option("noise", options.SOLVERS)] = None,
    tolerance: Annotated[str | None, option("tolerance", options.SOLVERS)] = None,
    max_order: Annotated[str | None, option("max_order", options.SOLVERS)] = None,
    orders: Annotated[
        str | None, typer.Option(metavar="N", help="Layers with the light scattered once, ..., N times (path).")
    ] = None,
    stokes: polarised.Stokes = False,
    sampling: Annotated[str | None, option("sampling", options.SOLVERS)] = None,
    transmittance: Annotated[str | None, option("transmittance", options.SOLVERS)] = None,
    photons: Annotated[str | None, option("photons", options.SOLVERS)] = None,
    radius: Annotated[str | None, option("radius", options.SOLVERS)] = None,
    estimator: Annotated[str | None, option("estimator", options.SOLVERS)] = None,
    direct: Annotated[bool | None, option("direct", options.SOLVERS)] = None,
    seed: Annotated[str | None, option("seed", options.SOLVERS)] = None,
    denoise: common.Denoise = False,
    threads: common.Threads = None,
    workers: common.WorkerCount = None,
    worker_memory: common.WorkerMemory = None,
    scheduler: common.Scheduler = None,
    store: common.StoreFolder = None,
    filters: common.Filters = None,
    palette: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="For PNG: sho, hubble, hos, hoo, rvb, or three filters: sii,halpha,V."),
    ] = None,
    tone: Annotated[
        str | None,
        typer.Option(metavar="NAME", help=f"For PNG: {common.TONES}; of a palette lupton or linear."),
    ] = None,
    stretch: Annotated[
        str | None, typer.Option(metavar="X", help="For PNG with lupton: linear white as a share of the white level.")
    ] = None,
    softening: Annotated[
        str | None, typer.Option(metavar="Q", help="For PNG with lupton: 8 if nothing is said.")
    ] = None,
    continuum: Annotated[
        str | None,
        typer.Option(
            metavar="HOW",
            help="For PNG of a palette, the light between the lines: keep, subtract, or natural (in its own colours).",
        ),
    ] = None,
    look: pictures.Look = None,
    glare: pictures.Glare = None,
    exposure: common.Exposure = None,
    space: common.Space = None,
    bits: common.Bits = None,
    smooth: pictures.Smooth = None,
    psf: Annotated[
        str | None,
        typer.Option(
            metavar="PSF",
            help="Blur: gaussian:FWHM or moffat:FWHM:BETA, FWHM in arc seconds, airy:DIAMETER, hubble; else none, but "
            f"{options.SEEING:g} pixels in .png files that are smoothed or of no stated size.",
        ),
    ] = None,
    aperture: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="Diameter of the mirror, for photon noise: 2.4m.")
    ] = None,
    exposure_time: Annotated[
        str | None, typer.Option(metavar="TIME", help="Exposure, for photon noise: 600s, 20min, 2h.")
    ] = None,
    throughput: Annotated[
        str | None, typer.Option(metavar="SHARE", help="Share of the photons that are counted, else all: 30%.")
    ] = None,
    scale: common.Scale = None,
    half: common.Half = False,
    no_spectra: common.NoSpectra = False,
    float32: common.Float32 = False,
    compress: common.Compress = False,
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
    """Render a nebula as a telescope sees it: north up, east left.

    Position and distance are the model's.  Ctrl-C keeps what is finished, a picture as NAME.partial.EXT,
    and says how to go on.

    --azimuths and --inclinations go around it: a frame for each, to numbered files, or to a film where the output is
    .mp4, .webm or .gif.  Repeat the command to go on with one; --store shares the frames with other programs.
    """
    paths = {"azimuths": azimuths, "inclinations": inclinations}
    turn = sequence.turned(paths, exposure_step, frame_rate)
    outputs = parse.check_outputs(output or [], no_clobber, parse.FILMS if turn else ())
    if turn is not None:
        angles = {"azimuth": azimuth, "inclination": inclination}
        settled = {name: angle for name, angle in angles.items() if paths[f"{name}s"] is not None}
        taken = {"resume": resume, "psf": psf or aperture, "denoise": denoise or None, "smooth": smooth}
        taken |= {"preview": preview or None}
        _check_turn(outputs, {**settled, **taken})
    png = {"palette": palette, "tone": tone, "stretch": stretch, "softening": softening, "exposure": exposure}
    png |= {"continuum": continuum, "glare": glare}
    common.check_png_options(outputs, {"look": look, **png, "space": space, "bits": bits})
    developed = options.png_options(png, space, look)
    turned = {"inclination_deg": inclination, "azimuth_deg": azimuth, "position_angle_deg": position_angle}
    observation = options.observation(psf, aperture, exposure_time, throughput, seed)
    pictures.check_smooth(smooth, denoise, outputs, solver)
    first = size is None and solver == "path"
    few = pictures.NEBULA_WAVELENGTHS if filters is None and not options.of_planes(developed) else DEFAULT_WAVELENGTHS
    if first and noise is None and store is None:
        samples = samples or options.FIRST_SAMPLES
    request = Request(
        model=model,
        size=parse.parse_size(size, "telescope"),
        turned={name: parse.parse_degrees(text, name, 360.0, 0.0) for name, text in turned.items() if text is not None},
        field=None if field_of_view is None else parse.parse_field(field_of_view),
        pixel_scale_deg=None if pixel_scale is None else parse.parse_angle(pixel_scale, "pixel_scale"),
        solver=solver,
        given=given(
            solver,
            options.SOLVERS,
            samples=samples,
            noise=noise,
            tolerance=tolerance,
            max_order=max_order,
            sampling=sampling,
            transmittance=transmittance,
            photons=photons,
            radius=radius,
            estimator=estimator,
            direct=direct,
            seed=None if solver == "single" and aperture is not None else seed,
        ),
        orders=parse.parse_integer(orders, "orders", 1, "give a number of layers, 1 or more"),
        stokes=stokes,
        filters=filters,
        png=developed,
        observation=observation,
        seeing=options.SEEING if (first or smooth) and psf is None else 0.0,
        smooth=smooth,
        first=first,
        outputs=outputs,
        file_options=common.file_options(
            outputs,
            scale=scale,
            half=half,
            no_spectra=no_spectra,
            float32=float32,
            compress=compress,
            unit=options.brightness_unit(unit, observation),
        ),
        **common.run_options(
            wavelengths=pictures.wavelengths(wavelengths, outputs, few, DEFAULT_WAVELENGTHS),
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
    common.check_solver(request, options.SOLVERS)
    if wavelengths is None:
        request = options.with_bands(request)
    options.check(request)
    if turn is not None:
        asked = turn
        kept = "repeat the command to go on with the frames that are missing"
        return common.stoppable(lambda: run_turn(request, asked), kept)
    return common.stoppable(lambda: run(request, list(context.obj or [])))


def _check_turn(outputs: list[Path], meaningless: Mapping[str, Any]) -> None:
    """Refuse what a turn has no use for."""
    sequence.check_output(outputs)
    for name, value in meaningless.items():
        if value is not None:
            raise DomainError(name, str(value), "means nothing to frames from several sides; leave it out")


def run_turn(request: Request, turn: sequence.FrameList) -> int:
    """Frames from around a nebula; all have the width of the widest."""
    import skyscatter
    from skyscatter.solvers.sequence import Frames

    model: Any = skyscatter.load_model(request.model)
    common.check_command(model, request.model, "nebula")
    scenes = tuple(model.scene(**{**request.turned, **side}) for side in turn.sides)
    camera = max((build_camera(request, scene) for scene in scenes), key=lambda camera: camera.pixel_scale_deg)
    frames = Frames(scenes, camera, request.wavelengths, None, {"solver": request.how, **_layers(request)})
    look = {**request.png, "bits": request.bits}
    exposure = None if options.of_planes(look) else look.pop("exposure", "auto")
    return sequence.produce(request, turn, model.name, frames, look, exposure)


def _layers(request: Request) -> dict[str, Any]:
    """The layers that were asked for, as `skyscatter.render` takes them."""
    layers: dict[str, Any] = {} if request.orders is None else {"orders": request.orders}
    return layers | ({"stokes": True} if request.stokes else {})


def build_camera(request: Request, scene: Any, suited: float | None = None) -> Any:
    """Telescope of the request's width or pixel scale, else of the width that suits [m], else of all of it."""
    from skyscatter.geometry.telescope import Telescope
    from skyscatter.space import width_of_all

    width, height = request.size
    if request.pixel_scale_deg is not None:
        return Telescope(width=width, height=height, pixel_scale_deg=request.pixel_scale_deg)
    if request.field is not None and request.field[0] == "angle":
        return Telescope.from_field_of_view(width, height, request.field[1])
    if request.field is not None:
        across = request.field[1]
    else:
        across = width_of_all(scene, width / height) if suited is None else suited
    return Telescope.from_length(width, height, across, scene.view.distance)


def run(request: Request, arguments: list[str]) -> int:
    """Render, observe, write, report; returns the exit status."""
    import skyscatter
    from skyscatter.image.skyframe import SkyFrame

    started = clock.monotonic()
    model: Any = skyscatter.load_model(request.model)
    common.check_command(model, request.model, "nebula")
    fits = large.fits(request, **_layers(request), **request.observation)
    scene: Any = model.scene(**request.turned)
    # What suits a nebula may cut off what sticks out when it is turned.
    camera = build_camera(request, scene, None if request.turned else model.picture_width)
    sky = SkyFrame.seen(scene.view, camera, model.name)
    if not fits:
        written = large.run(request, scene, camera, model.name, arguments, sky, **_layers(request))
        summary = summarise(request, model, scene, camera, None, None, clock.monotonic() - started, written)
        return common.report(request, summary, describe)
    rendered = common.render_request(request, scene, camera, model.name, arguments, **_layers(request))
    noise = common.median_error(rendered.raw) if request.solver != "single" else None
    with rendered.writing() as outputs:
        image = rendered.image.placed(sky)
        exposure, even = _write(request, image, outputs)
    summary = summarise(request, model, scene, camera, noise, exposure, clock.monotonic() - started, rendered)
    summary["smoothed"] = even
    return common.report(request, summary, describe)


def _write(request: Request, image: Any, outputs: list[Path]) -> tuple[float | None, bool]:
    """Write the files; returns the exposure value of a picture in natural colour, and whether it was smoothed."""
    from skyscatter.progress import say

    png, exposure, even = dict(request.png), None, None
    if request.evened:
        say("smoothing")
        even = pictures.evened(image)
        image = pictures.unhalved(image)
    data = options.observed(image, request.observation)
    shown = data
    if common.has_suffix(outputs, ".png"):
        shown = options.as_seen(data if even is None else options.observed(even, request.observation), request.seeing)
    if not options.of_planes(png):
        stated = png.get("exposure", "auto")
        exposure = png["exposure"] = shown.auto_exposure() if stated == "auto" else float(stated)
    for path in outputs:
        suffix = path.suffix.lower()
        taken = {**png, "bits": request.bits} if suffix == ".png" else dict(request.file_options.get(suffix, {}))
        if suffix == ".fits" and request.filters is not None:
            taken["filters"] = request.filters
        (shown if suffix == ".png" else data).save(path, **taken)
    return exposure, even is not None


def summarise(
    request: Request,
    model: Any,
    scene: Any,
    camera: Any,
    noise: float | None,
    exposure: float | None,
    seconds: float,
    rendered: common.Rendered | large.Written,
) -> dict[str, Any]:
    """What ``--json`` prints."""
    view = scene.view
    angles = ("ra_deg", "dec_deg", "inclination_deg", "azimuth_deg", "position_angle_deg")
    observed = {
        name: value.model_dump(exclude_none=True) if name == "psf" else value
        for name, value in request.observation.items()
    }
    return {
        **common.summary_of_run(request, model, seconds, rendered),
        "view": {"distance_pc": float(view.distance) / PARSEC, **{name: float(getattr(view, name)) for name in angles}},
        "pixel_scale_arcsec": 3600.0 * camera.pixel_scale_deg,
        "noise": noise,
        "filters": request.filters,
        "observation": observed or None,
        "polarisation": polarised.summary(rendered.image) if isinstance(rendered, common.Rendered) else None,
        "exposure_ev": None if exposure is None else float(exposure),
    }


def describe(summary: dict[str, Any]) -> str:
    """The summary for people."""
    from skyscatter.progress import format_seconds

    noise, exposure = summary["noise"], summary["exposure_ev"]
    accuracy = "" if noise is None else f", median noise {common.percent(noise)}"
    accuracy += common.describe_denoising(summary)
    accuracy += ", smoothed in the picture" if summary.get("smoothed") else ""
    accuracy += polarised.described(summary["polarisation"])
    accuracy += "" if exposure is None else f"; EV {exposure:.1f}"
    width = summary["size"][0] * summary["pixel_scale_arcsec"]
    return (
        f"{common.describe_part(summary)}{summary['model']}: at {summary['view']['distance_pc']:.4g} pc, "
        f'{width:.4g}" wide; solver {summary["solver"]}{accuracy}; {format_seconds(summary["seconds"])}; '
        f"wrote {', '.join(summary['outputs']) or 'nothing'}"
    )
