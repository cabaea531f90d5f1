"""What the rendering commands share: options, their checks, the run itself, and its report."""

from __future__ import annotations

import json
import logging
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from skyscatter.cli import parse, stopping
from skyscatter.cli.solver_options import LAYERS, refuse
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.models.kinds import SORTS
from skyscatter.progress import MODES
from skyscatter.solvers.options import RECORDS, Solver, record_of

if TYPE_CHECKING:
    from skyscatter.image.spectral import SpectralImage
    from skyscatter.solvers.state import Checkpoint

Wavelengths = Annotated[
    str,
    typer.Option(
        metavar="START:STOP:STEP",
        help="Vacuum wavelengths [nm], ends included, or a list: 450,550.  "
        "Sunlight is averaged half-way to neighbours.",
    ),
]
Place = Annotated[str | None, typer.Option(metavar="LAT,LON", help="Place on Earth [degree]; needs --time.")]
Moment = Annotated[
    str | None, typer.Option(metavar="ISO", help="Date and time, ISO 8601; no offset means UTC; needs --place.")
]
Denoise = Annotated[
    bool,
    typer.Option(
        "--denoise",
        help="Take noise off and estimate what is left (path, photons); files keep the raw picture, too. By Open Image "
        "Denoise where pyoidn is installed.",
    ),
]
Threads = Annotated[str | None, typer.Option(metavar="N", help="Threads; by default one per processor.")]
WorkerCount = Annotated[
    str | None,
    typer.Option("--workers", metavar="N", help="Processes of this machine that share the work, in place of threads."),
]
WorkerMemory = Annotated[
    str | None,
    typer.Option("--worker-memory", metavar="BYTES", help="That each of the --workers may take, such as 1GB (Linux)."),
]
Scheduler = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Have the workers of a dask scheduler do it: tcp://host:8786, or its file."),
]
StoreFolder = Annotated[
    Path | None,
    typer.Option(
        "--store",
        metavar="DIR",
        help="Folder (zarr) that keeps each finished part; repeat the command to go on, or with more --samples.",
    ),
]
Exposure = Annotated[
    str | None, typer.Option(metavar="EV", help="For PNG: auto (the default) or an exposure value (ISO 100).")
]
DEFAULT_TONE = "photograph"
#: Numbers of which a summary takes the median, at least.
JUDGED = 500_000
#: Share of the brightest pixel below which there is no light to tell the error of.
NO_LIGHT = 1e-9
TONES = (
    "photograph (the default: colours as strong as film has them), eye (they fade in dim light), filmic (as they are), "
    "asinh (the faint is lifted, the bright keeps its colour) or linear"
)
Tone = Annotated[str | None, typer.Option(metavar="NAME", help=f"For PNG: {TONES}.")]
SPACES = "srgb (the default), display-p3, rec2020 or any space of colour-science, such as adobe-rgb-1998"
Space = Annotated[str | None, typer.Option(metavar="NAME", help=f"For PNG: {SPACES}.")]
Bits = Annotated[str | None, typer.Option(metavar="N", help="For PNG: 8 (the default) or 16.")]
Output = Annotated[
    list[Path] | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help="File to write, by extension: .png, .exr, .hdr, .fits, .nc, .zarr; may be repeated; existing ones are "
        "replaced.",
    ),
]
Scale = Annotated[
    str | None,
    typer.Option(metavar="X", help="For the RGB of .exr and .hdr: value of a white of 1 cd m-2, else 1."),
]
Half = Annotated[bool, typer.Option("--half", help="For .exr: RGB as half floats.")]
NoSpectra = Annotated[bool, typer.Option("--no-spectra", help="For .exr: RGB alone.")]
Float32 = Annotated[
    bool, typer.Option("--float32", help="For .fits, .nc and .zarr: numbers of 7 digits, half the size.")
]
Filters = Annotated[
    str | None,
    typer.Option(
        metavar="LIST",
        help="For FITS: a plane per filter instead of the spectra; U, B, V, R, I, halpha, hbeta, oiii, nii, sii or "
        ".csv files, with commas between them.",
    ),
]
Unit = Annotated[
    str | None,
    typer.Option(
        metavar="UNIT",
        help="For .fits and .nc: brightness in Jy/sr, MJy/sr, ABmag/arcsec2, Vegamag/arcsec2 (of U, B, V, R, I); of "
        "whole pixels in Jy, ABmag, Vegamag, and of nebulae count where the telescope is given.",
    ),
]
Compress = Annotated[bool, typer.Option("--compress", help="For .fits: tiles compressed without loss.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print a summary as one JSON object on stdout.")]
Resume = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Go on from the .partial.zarr that an interrupted run left.")
]
Every = Annotated[
    str | None,
    typer.Option("--checkpoint", metavar="TIME", help="Keep what is finished this often: 30s, 10min; else 3min."),
]
NoClobber = Annotated[bool, typer.Option("--no-clobber", help="Refuse, before any work, to replace a file.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Nothing on stderr but errors.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Say on stderr what is done.")]
ProgressMode = Annotated[
    str,
    typer.Option("--progress", metavar="HOW", help="bar, log (lines on stderr), none or auto: a bar on a terminal."),
]


Previewed = Annotated[
    bool, typer.Option("--preview", help="Show the picture growing in the terminal, in natural colours.")
]


@dataclass(frozen=True)
class RunRequest:
    """What every rendering command is asked, checked as far as that goes without a model."""

    model: str
    size: tuple[int, int]
    wavelengths: NDArray[np.float64]
    solver: str
    #: Options of the solver by their names, as far as they were typed.
    given: dict[str, Any]
    denoise: bool | None
    threads: int | None
    workers: int | None
    scheduler: str | None
    worker_memory: int | None
    store: Path | None
    bits: int
    outputs: list[Path]
    #: Options of the files by their extension, but for those of pictures.
    file_options: dict[str, dict[str, Any]]
    json: bool
    quiet: bool
    progress: str
    resume: Path | None
    every: float | None
    preview: bool | None

    @property
    def how(self) -> Solver:
        """The solver with its options."""
        return record_of(self.solver, **self.given)

    @property
    def halved(self) -> bool:
        """Whether two halves of the walks are told apart, by which noise is taken off."""
        return bool(self.denoise)


def run_options(**texts: Any) -> dict[str, Any]:
    """Values of the fields of `RunRequest` that every command parses alike, from what was typed."""
    integer = parse.parse_integer
    return {
        "wavelengths": parse.parse_wavelengths(texts["wavelengths"]),
        "threads": integer(texts["threads"], "threads", 1, "give a number of threads, 1 or more"),
        "denoise": texts["denoise"] or None,
        **worker_options(texts["workers"], texts["scheduler"], texts["worker_memory"]),
        "store": checked_store(texts["store"], texts["resume"], texts["every"]),
        "bits": integer(texts["bits"], "bits", 8, "choose 8 or 16") or 8,
        "json": texts["as_json"],
        "quiet": texts["quiet"],
        "progress": talk(texts["quiet"], texts["verbose"], texts["progress"]),
        "every": None if texts["every"] is None else parse.parse_time(texts["every"], "checkpoint"),
        "resume": None if texts["resume"] is None else parse.check_checkpoint(texts["resume"]),
        "preview": checked_preview(texts["preview"], texts["store"], texts["quiet"]),
    }


def checked_preview(preview: bool, store: Path | None, quiet: bool) -> bool | None:
    """Whether the picture is shown while it is made."""
    for name, value in {"store": store, "quiet": quiet or None}.items():
        if preview and value is not None:
            rule = "leaves nothing to look at for --preview; leave one of them out"
            raise DomainError(name, str(value), rule)
    return preview or None


def checked_store(store: Path | None, resume: Path | None, every: str | None) -> Path | None:
    """The folder of a run, which needs no checkpoints."""
    for name, value in {"resume": resume, "checkpoint": every}.items():
        if store is not None and value is not None:
            raise DomainError(name, str(value), "a --store keeps each part as it is finished; leave it out")
    return store


def worker_options(workers: str | None, scheduler: str | None, memory: str | None) -> dict[str, Any]:
    """What runs the work, from what was typed."""
    if memory is not None and workers is None:
        rule = "caps the --workers of this machine; those of dask have limits of their own, threads have none"
        raise DomainError("worker_memory", memory, rule)
    if workers is not None and scheduler is not None:
        raise DomainError("workers", workers, "give --workers or --scheduler, not both")
    return {
        "workers": parse.parse_integer(workers, "workers", 1, "give a number of processes, 1 or more"),
        "scheduler": scheduler,
        "worker_memory": None if memory is None else _cap(memory),
    }


def _cap(memory: str) -> int:
    """Bytes of a worker, refused at once where they cannot be had."""
    from skyscatter.tasks.processes import check_cap

    found = parse.parse_bytes(memory, "worker_memory")
    check_cap(found)
    return found


def talk(quiet: bool, verbose: bool, progress: str) -> str:
    """How progress is shown, after the log has been told how much to say."""
    if progress not in MODES:
        raise DomainError("progress", progress, f"choose one of {', '.join(MODES)}")
    if quiet and (verbose or progress != "auto"):
        name = "verbose" if verbose else "progress"
        raise DomainError(name, True if verbose else progress, "contradicts --quiet; leave one of them out")
    level = logging.ERROR if quiet else logging.INFO if verbose else logging.WARNING
    logging.getLogger("skyscatter").setLevel(level)
    return "none" if quiet else progress


def check_solver(request: RunRequest, solvers: Sequence[str]) -> None:
    """Refuse layers that the chosen solver of a command cannot give, and runs of which nothing would be kept."""
    for name, able in LAYERS.items():
        value = getattr(request, name, None)
        if value is not None and request.solver in RECORDS and request.solver not in able:
            refuse(name, value, request.solver, [one for one in solvers if one in able])
    if not request.outputs and not request.json:
        raise DomainError("output", "", "nothing would be kept; name a file with -o, or ask for --json")


def check_command(model: Any, name: str, command: str) -> None:
    """Refuse a model that another command renders."""
    if model.command != command:
        raise DomainError("model", name, f"is {SORTS[model.command]}; use skyscatter {model.command}")


def check_place(place: str | None, time: str | None, sun: Mapping[str, str | None]) -> None:
    """Refuse a place without a time, and options that say where the Sun is beside both."""
    if (place is None) != (time is None):
        given, missing = ("place", "time") if time is None else ("time", "place")
        raise DomainError(given, place or time, f"needs --{missing} as well")
    if place is not None and any(value is not None for value in sun.values()):
        options = " and ".join(f"--{name.replace('_', '-')}" for name in sun)
        raise DomainError("place", place, f"settles where the Sun is; leave out {options}")


def has_suffix(outputs: list[Path], *suffixes: str) -> bool:
    """Whether one of the files is of one of these kinds."""
    return any(path.suffix.lower() in suffixes for path in outputs)


def check_png_options(outputs: list[Path], options: dict[str, Any]) -> None:
    """Options that only a picture for a display has would otherwise be ignored in silence."""
    if has_suffix(outputs, ".png", *parse.FILMS):
        return
    for name, value in options.items():
        if value is not None:
            raise DomainError(name, value, "is for PNG files; name one with -o, or leave this out")


def file_options(
    outputs: list[Path],
    *,
    scale: str | None,
    half: bool,
    no_spectra: bool,
    float32: bool,
    compress: bool,
    unit: Any = None,
    filters: str | None = None,
) -> dict[str, dict[str, Any]]:
    """Options of files by their extension, from what was typed; those that no file has a use for are refused."""
    factor = parse.parse_positive(scale, "scale")
    given = (
        ("scale", "scale", factor, (".exr", ".hdr")),
        ("half", "half", half or None, (".exr",)),
        ("no_spectra", "spectral", False if no_spectra else None, (".exr",)),
        ("float32", "dtype", "float32" if float32 else None, (".fits", ".nc", ".zarr")),
        ("compress", "compress", compress or None, (".fits",)),
        ("unit", "unit", unit, (".fits", ".nc")),
        ("filters", "filters", filters, (".fits",)),
    )
    found: dict[str, dict[str, Any]] = {}
    for option, name, value, suffixes in given:
        if value is None:
            continue
        if not has_suffix(outputs, *suffixes):
            kinds = " and ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
            remedy = f"is for {kinds} files; name one with -o, or leave this out"
            raise DomainError(option, True if value is False else value, remedy)
        for suffix in {path.suffix.lower() for path in outputs} & set(suffixes):
            found.setdefault(suffix, {})[name] = value
    return found


def check_brightness(options: Mapping[str, Mapping[str, Any]], wavelengths: NDArray[np.float64]) -> None:
    """Refuse, before any time is spent, filters without light and units that the files could not have."""
    asked = [taken for taken in options.values() if {"filters", "unit"} & set(taken)]
    if not asked:
        return
    from skyscatter.image import SkyFrame, SpectralImage
    from skyscatter.image.photometry import conversion

    sky = SkyFrame(ra_deg=0.0, dec_deg=0.0, pixel_scale_deg=1.0)
    for taken in asked:
        dark: Any = SpectralImage(np.zeros((1, 1, wavelengths.size)), wavelengths, sky=sky)
        if "filters" in taken:
            dark = dark.through(taken["filters"])
        if "unit" in taken:
            conversion(dark, taken["unit"])


def check_development(space: str, tone: str, bits: int) -> None:
    """Refuse colour spaces, tone curves and depths that there are not."""
    from skyscatter.image.colour import display_space
    from skyscatter.image.tone import TONES

    display_space(space)
    if tone not in TONES:
        raise DomainError("tone", tone, f"choose one of {', '.join(TONES)}")
    if bits not in (8, 16):
        raise DomainError("bits", bits, "choose 8 or 16")


def stoppable(run: Callable[[], int], kept: str = "") -> int:
    """Exit status of a run; that of an interrupted one where nothing was finished but what is said to be kept."""
    try:
        return run()
    except KeyboardInterrupt:
        print(f"skyscatter: interrupted{kept and '; '}{kept}", file=sys.stderr)
        return stopping.status()


def partial_path(path: Path) -> Path:
    """Where an unfinished picture goes: ``sky.partial.png`` beside ``sky.png``."""
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def checkpoint_path(outputs: list[Path], otherwise: str = "skyscatter") -> Path:
    """Where a run is kept: ``sky.png.partial.zarr`` beside its first output."""
    first = outputs[0] if outputs else Path(otherwise)
    return first.with_name(f"{first.name}.partial.zarr")


def checkpoint_for(
    resume: Path | None, outputs: list[Path], every: float | None, otherwise: str = "skyscatter"
) -> Checkpoint:
    """Where a run is kept: one that is resumed in the same folder from then on."""
    from skyscatter.solvers.state import EVERY, Checkpoint

    checkpoint = Checkpoint(resume or checkpoint_path(outputs, otherwise), every or EVERY)
    if resume is None and checkpoint.path.is_dir():
        logging.getLogger("skyscatter").warning(
            "%s of an interrupted run will be replaced; --resume it to go on with that run", checkpoint.path
        )
    return checkpoint


@dataclass(frozen=True)
class Rendered:
    """A picture, or as much of it as was finished.

    Attributes
    ----------
    image : SpectralImage
    finished : float
        Share of the work; 1 unless interrupted.
    outputs : list of Path
        Files to write: those that were asked for, or those of an unfinished picture.
    """

    image: SpectralImage
    finished: float
    outputs: list[Path]
    request: RunRequest
    arguments: list[str]
    checkpoint: Checkpoint | None

    @property
    def raw(self) -> SpectralImage:
        """The picture as it was computed."""
        return self.image.undenoised if self.denoising else self.image

    @property
    def denoising(self) -> dict[str, Any] | None:
        """How it was denoised, and the errors; None where it was not."""
        return self.image.recipe.get("denoising") if self.request.denoise else None

    @contextmanager
    def writing(self) -> Iterator[list[Path]]:
        """Write the files in the body; the checkpoint goes when they are there, and stays if they are not."""
        try:
            if self.finished < 1.0:
                with stopping.undisturbed():
                    yield self.outputs
                return
            yield self.outputs
        except BaseException as error:
            if self.finished < 1.0 and isinstance(error, SkyscatterError):
                print(f"skyscatter: the unfinished picture is not kept: {error}", file=sys.stderr)
                return
            keep(self.checkpoint, self.arguments, self.request.store)
            raise
        if self.checkpoint is not None:
            self.checkpoint.remove()
        if self.request.resume is not None:
            for path in self.outputs:
                remove_output(partial_path(path))


def remove_output(path: Path) -> None:
    """Take a file away that may be there, or a folder of ours."""
    from skyscatter.image.arraystrips import is_picture

    if is_picture(path):
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(FileNotFoundError):
        path.unlink()


def render_request(
    request: RunRequest, scene: Any, camera: Any, label: str, arguments: list[str], **more: Any
) -> Rendered:
    """Render with progress; what is finished is kept on the way, and when a signal ends it.

    Raises
    ------
    KeyboardInterrupt
        If it is interrupted before anything is finished.
    """
    import skyscatter
    from skyscatter.progress import Progress, say
    from skyscatter.solvers.run import Interrupted
    from skyscatter.tasks.cluster import executor_of

    store = request.store
    checkpoint = None if store else checkpoint_for(request.resume, request.outputs, request.every)
    halves: dict[str, Any] = {"halves": True} if request.halved else {}
    try:
        with (
            stopping.keeping(lambda: keep(checkpoint, arguments, store)),
            Progress(1.0, label, request.progress, above=_preview(request, checkpoint, scene, camera)) as progress,
            executor_of(request.workers, request.scheduler, request.worker_memory) as executor,
        ):
            image = skyscatter.render(
                scene,
                camera,
                request.wavelengths,
                solver=request.how,
                threads=request.threads,
                executor=executor,
                progress=progress.to,
                resume=request.resume,
                checkpoint=checkpoint,
                store=store,
                **halves,
                **more,
            )
            if request.denoise:
                say("denoising")
                image = image.denoised()
    except Interrupted as stop:
        with stopping.undisturbed():
            keep(checkpoint, arguments, store)
        if stop.state.share <= 0.0:
            raise KeyboardInterrupt from None
        # never 1: what `report` says of an interrupted run
        finished = min(stop.state.share, np.nextafter(1.0, 0.0))
        outputs = [partial_path(path) for path in request.outputs]
        return Rendered(stop.partial, finished, outputs, request, arguments, checkpoint)
    except KeyboardInterrupt:
        keep(checkpoint, arguments, store)
        raise
    return Rendered(image, 1.0, request.outputs, request, arguments, checkpoint)


def _preview(request: RunRequest, checkpoint: Checkpoint | None, scene: Any, camera: Any) -> Any:
    """What shows the picture above the bar; None where it was not asked for, or there is no terminal to show it."""
    if not request.preview or checkpoint is None:
        return None
    if not (sys.stderr.isatty() and request.progress in ("auto", "bar")):
        print("skyscatter: --preview needs a terminal and the bar; the run goes on without it", file=sys.stderr)
        return None
    from skyscatter.cli.preview import Preview

    return Preview(lambda: checkpoint.state, scene, camera, request.wavelengths, DEFAULT_TONE).text


def keep(checkpoint: Checkpoint | None, arguments: list[str], store: Path | None = None) -> None:
    """Save what is needed to go on, and say how."""
    if store is not None and store.is_dir():
        command = shlex.join(["skyscatter", *arguments])
        print(f"skyscatter: stopped; what is finished is in {store}; go on with:\n  {command}", file=sys.stderr)
    if checkpoint is not None and checkpoint.save():
        say_how_to_go_on(checkpoint.path, arguments)


def say_how_to_go_on(state: Path, arguments: list[str]) -> None:
    """Where the finished part is, and the command that goes on with it."""
    command = shlex.join(["skyscatter", *without_resume(arguments), "--resume", str(state)])
    print(f"skyscatter: stopped; the finished part is in {state}; go on with:\n  {command}", file=sys.stderr)


def without_resume(arguments: list[str]) -> list[str]:
    """The arguments without an earlier ``--resume DIR``."""
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


def report(request: RunRequest, summary: dict[str, Any], describe: Callable[[dict[str, Any]], str]) -> int:
    """Print the summary for programs or for people; returns the exit status."""
    if request.json:
        typer.echo(json.dumps(summary, allow_nan=False))
    elif not request.quiet:
        typer.echo(describe(summary), err=True)
    return 0 if summary["complete"] else stopping.status()


def summary_of_run(request: RunRequest, model: Any, seconds: float, rendered: Any) -> dict[str, Any]:
    """The part of a summary that all rendering commands have; of what was made by the names of `Rendered`."""
    import skyscatter

    return {
        "skyscatter": skyscatter.__version__,
        "model": model.name,
        "size": list(request.size),
        "wavelengths_nm": request.wavelengths.tolist(),
        "solver": request.solver,
        "seed": request.how.recorded["seed"] if request.solver in ("path", "photons") else None,
        "tolerance": request.given.get("tolerance"),
        "seconds": round(seconds, 3),
        "complete": rendered.finished >= 1.0,
        "finished": rendered.finished,
        "colour": rendered.image.mean_colour() if hasattr(rendered, "image") else None,
        "denoising": getattr(rendered, "denoising", None),
        "outputs": [str(path) for path in rendered.outputs],
    }


def describe_denoising(summary: dict[str, Any]) -> str:
    """What was done against the noise, for people."""
    done = summary["denoising"]
    if done is None:
        return ""
    errors = [done["error"], done["raw_error"]]
    words = ["" if error is None else percent(error) for error in errors]
    return f"; denoised by {done['method']}" + (f", error {words[0]} in place of {words[1]}" if all(words) else "")


def median_error(image: Any) -> float | None:
    """Median over pixels and wavelengths of the relative stated error, where there is light; None in the dark.

    Light is what has a share of `NO_LIGHT` of the brightest at least: a night side tells nothing of the day beside it.
    Of more than `JUDGED` numbers every second, third and so on pixel counts: two digits are said.
    """
    if image.standard_error is None:
        return None
    radiance, error = (np.reshape(part, (-1, np.shape(part)[-1])) for part in (image.radiance, image.standard_error))
    step = 1 + radiance.size // JUDGED
    radiance, error = radiance[::step], error[::step]
    lit = np.isfinite(radiance) & np.isfinite(error) & (radiance > 0)
    lit &= radiance >= NO_LIGHT * np.max(radiance, initial=0.0, where=lit)
    return float(np.median(error[lit] / radiance[lit])) if lit.any() else None


def percent(share: float) -> str:
    """Two digits in per cent, never with an exponent: ``0.034`` is ``3.4 %``, ``1`` is ``100 %``."""
    return f"{np.format_float_positional(float(f'{100 * share:.2g}'), trim='-')} %"


def missed(error: float | None, tolerance: float | None) -> str:
    """What a summary adds where an error is above the tolerance that was asked for."""
    if error is None or tolerance is None or error <= tolerance:
        return ""
    return f", more than the {percent(tolerance)} asked for"


def describe_part(summary: dict[str, Any]) -> str:
    """How much is finished, for people; nothing where all is."""
    if summary["complete"]:
        return ""
    return f"interrupted with {100 * summary['finished']:.1f} % of the pixels finished; "
