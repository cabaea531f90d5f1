"""Sequences: frames of skies from one solved field, and of turns around nebulae, to numbered files or to a film."""

from __future__ import annotations

import re
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from skyscatter.cli import common, parse
from skyscatter.cli.framefiles import FrameFolder, film_writer
from skyscatter.cli.parse import FILMS
from skyscatter.cli.towns import with_towns
from skyscatter.errors import DomainError

#: A date, and a time and an offset where they are given.
_ISO = r"\d{4}-\d\d-\d\d(?:[T ]\d\d(?::\d\d(?::\d\d(?:\.\d+)?)?)?)?(?:Z|[+-]\d\d:\d\d)?"
_TIMES = re.compile(rf"^({_ISO})[:/]({_ISO})[:/](\d.*)$")
#: Frames of a film in a second.
RATE = 24
MOST_FRAMES = 100_000


@dataclass(frozen=True)
class FrameList:
    """What a sequence is asked for beside a single picture; one of the lists has its frames."""

    times: tuple[str, ...] = ()
    elevations: tuple[float, ...] = ()
    models: tuple[str, ...] = ()
    sides: tuple[dict[str, float], ...] = ()  #: of a nebula: angles of its model by their names
    step: float = 0.1
    rate: float = RATE


def parse_times(text: str) -> tuple[str, ...]:
    """Moments of ``START:END:STEP``, ends included: dates and times by ISO 8601, and a step such as 15min.

    Examples
    --------
    >>> from skyscatter.cli.sequence import parse_times
    >>> parse_times("2026-06-21T04:00:2026-06-21T05:00:30min")
    ('2026-06-21T04:00:00', '2026-06-21T04:30:00', '2026-06-21T05:00:00')
    """
    found = _TIMES.match(text.strip())
    rule = "give START:END:STEP, such as 2026-06-21T04:00:2026-06-21T22:00:15min, with at most 100000 frames"
    if found is None:
        raise DomainError("times", text, rule)
    try:
        start, end = (datetime.fromisoformat(word) for word in found.groups()[:2])
        step = timedelta(seconds=parse.parse_time(found[3], "times"))
        count = int((end - start) / step * (1 + 1e-12)) + 1
    except (ValueError, TypeError, ZeroDivisionError) as error:
        raise DomainError("times", text, rule) from error
    if not 1 <= count <= MOST_FRAMES:
        raise DomainError("times", text, rule)
    return tuple((start + k * step).isoformat() for k in range(count))


def parse_angles(text: str, name: str, limit: float) -> tuple[float, ...]:
    """Angles [degree] in the order of the frames, none beyond the limit: 40:-10:-1, or a list.

    Examples
    --------
    >>> from skyscatter.cli.sequence import parse_angles
    >>> parse_angles("10:-5:-5", "sun_elevations", 90.0)
    (10.0, 5.0, 0.0, -5.0)
    """
    rule = "give START:END:STEP in degrees, such as 40:-10:-0.5, or a list: 10,5,0"
    try:
        if ":" in text:
            start, end, step = (float(word) for word in text.split(":"))
            if not (step != 0 and (end - start) / step >= 0 and (end - start) / step < MOST_FRAMES):
                raise ValueError
            values = [start + k * step for k in range(int((end - start) / step * (1 + 1e-12) + 1e-9) + 1)]
        else:
            values = [float(word) for word in text.split(",")]
    except ValueError as error:
        raise DomainError(name, text, rule) from error
    if not all(-limit <= value <= limit for value in values):
        raise DomainError(name, text, f"angles lie between {-limit:g} and {limit:g} degrees")
    return tuple(values)


def asked(
    model: str, times: str | None, elevations: str | None, step: str | None, rate: str | None
) -> FrameList | None:
    """The sequence that a command asks for; None for a single sky."""
    models = tuple(word.strip() for word in model.split(",")) if "," in model else ()
    given = {"times": times, "sun_elevations": elevations, "model": model if models else None}
    chosen = [name for name, value in given.items() if value is not None]
    if not chosen:
        for name, value in {"exposure_step": step, "frame_rate": rate}.items():
            if value is not None:
                raise DomainError(name, value, "is for --times, --sun-elevations and lists of models; leave it out")
        return None
    if len(chosen) > 1:
        raise DomainError(chosen[1], given[chosen[1]], f"give one list of frames: leave out {chosen[0]} or this")
    frames = FrameList(
        () if times is None else parse_times(times),
        () if elevations is None else parse_angles(elevations, "sun_elevations", 90.0),
        models,
    )
    return paced(frames, step, rate)


def paced(frames: FrameList, step: str | None, rate: str | None) -> FrameList:
    """The same, told how fast exposures may change and frames follow each other."""
    most, often = parse.parse_positive(step, "exposure_step"), parse.parse_positive(rate, "frame_rate")
    return replace(frames, step=most or frames.step, rate=often or frames.rate)


def turned(paths: Mapping[str, str | None], step: str | None, rate: str | None) -> FrameList | None:
    """The path around a nebula that a command asks for; None for a single picture.

    Parameters
    ----------
    paths : mapping
        Name of an angle, such as ``azimuths``, -> what was typed for all frames; two of them go frame by frame.
    step, rate : str or None
        As they were typed.
    """
    angles = {name: parse_angles(text, name, 360.0) for name, text in paths.items() if text is not None}
    if not angles:
        for name, value in {"exposure_step": step, "frame_rate": rate}.items():
            if value is not None:
                raise DomainError(name, value, f"is for {' and '.join(map(option, paths))}; leave it out")
        return None
    first, *others = angles
    for name in others:
        if len(angles[name]) != len(angles[first]):
            rule = f"has {len(angles[name])} frames and {option(first)} {len(angles[first])}; give as many"
            raise DomainError(name, paths[name], rule)
    names = [f"{name[:-1]}_deg" for name in angles]
    sides = tuple(dict(zip(names, values, strict=True)) for values in zip(*angles.values(), strict=True))
    return paced(FrameList(sides=sides), step, rate)


def option(name: str) -> str:
    """A name as it is typed."""
    return f"--{name.replace('_', '-')}"


def check_output(outputs: Sequence[Path]) -> None:
    """Refuse, before any time is spent, what a sequence cannot be written to."""
    if len(outputs) != 1:
        rule = "a sequence has one output: frame.png for numbered files, or a film such as day.mp4"
        raise DomainError("output", ", ".join(map(str, outputs)), rule)
    if outputs[0].suffix.lower() in FILMS:
        film_writer()


def scenes_of(request: Any, sequence: FrameList) -> tuple[str, tuple[Any, ...]]:
    """A name for all of it, and the scene of each frame."""
    import skyscatter

    if sequence.models:
        loaded: list[Any] = [skyscatter.load_model(name) for name in sequence.models]
        for name, model in zip(sequence.models, loaded, strict=True):
            common.check_command(model, name, "sky")
        scenes = [_scene(request, with_towns(model, request.towns, request.lights.lights)) for model in loaded]
        return f"{len(scenes)} models", tuple(scenes)
    air: Any = skyscatter.load_model(request.model)
    common.check_command(air, request.model, "sky")
    air = with_towns(air, request.towns, request.lights.lights)
    if sequence.times:
        where = (request.altitude, request.lights)
        return air.name, tuple(air.scene_at(*request.place, t, *where) for t in sequence.times)
    return air.name, tuple(
        air.scene(sun_elevation_deg=e, sun_azimuth_deg=request.sun_azimuth, altitude=request.altitude)
        for e in sequence.elevations
    )


def _scene(request: Any, model: Any) -> Any:
    if request.place is not None and request.time is not None:
        return model.scene_at(*request.place, request.time, request.altitude, request.lights)
    return model.scene(
        sun_elevation_deg=request.sun_elevation, sun_azimuth_deg=request.sun_azimuth, altitude=request.altitude
    )


def run(request: Any, sequence: FrameList, look: dict[str, Any], exposure: float | str | None) -> int:
    """Frames of skies: solve, render, write; returns the exit status.  Arguments are those of `produce`."""
    from skyscatter.cli.composed import composed
    from skyscatter.solvers.sequence import Frames, check_seed

    name, scenes = scenes_of(request, sequence)
    highest = max(scenes, key=lambda scene: scene.sun.elevation_deg)
    # A picture is centred on the highest Sun, and stays there.
    request, camera = composed(request, highest.observer, highest.sun.azimuth_deg, bool(sequence.times))
    camera.through(0, 0, scenes[0].observer)
    frames = Frames(scenes, camera, request.wavelengths, None, _options(request))
    one_air = not sequence.models and request.solver == "orders" and "max_order" not in request.given
    if one_air:
        check_seed(request.given.get("seed", 0), scenes)
    return produce(request, sequence, name, frames, look, exposure, one_air)


def produce(
    request: Any,
    sequence: FrameList,
    name: str,
    frames: Any,
    look: dict[str, Any],
    exposure: float | str | None,
    one_air: bool = False,
) -> int:
    """Make the frames that are not there, and what is made of them; returns the exit status.

    Parameters
    ----------
    request : RunRequest
    sequence : FrameList
    name : str
        In the summary.
    frames : skyscatter.solvers.sequence.Frames
    look : dict
        Options of the pictures.
    exposure : float, "auto" or None
        Of the pictures [EV]; None where they have none.
    one_air : bool
        One field is solved for all frames.
    """
    from skyscatter.progress import Progress
    from skyscatter.solvers.sequence import part_of
    from skyscatter.tasks.cluster import executor_of
    from skyscatter.tasks.door import opened

    started = clock.monotonic()
    with (
        Progress(1.0, f"{name} sequence", request.progress) as progress,
        executor_of(request.workers, request.scheduler, request.worker_memory) as given,
        opened(given, request.threads) as executor,  # exposures and frames by the same workers
    ):
        folder = FrameFolder.of(request, sequence.step, frames, {**look, "exposure": exposure})
        with folder.stored() as store:
            missing = folder.missing()
            unmade = missing if store is None else [k for k in missing if not store.kept(part_of(k))]
            exposures = None
            if unmade:
                frames = _solved(request, frames, progress, store) if one_air else frames
                if folder.suffix == ".png" and exposure is not None:
                    exposures = _exposures(request, sequence, frames, exposure, executor)
            save = look if folder.suffix == ".png" else request.file_options.get(folder.suffix, {})
            _write(request, frames, missing, folder, save, exposures, executor, progress, store)
        outputs = folder.finish(sequence.rate, progress)
    summary = {
        "model": name,
        "frames": len(frames.scenes),
        "made": len(unmade),
        "size": list(request.size),
        "solver": request.solver,
        "seconds": round(clock.monotonic() - started, 3),
        "complete": True,
        "outputs": [str(path) for path in outputs],
    }
    return common.report(request, summary, describe)


def _options(request: Any) -> dict[str, Any]:
    chosen: dict[str, Any] = {"stokes": True} if request.stokes else {}
    return {"solver": request.how, **chosen} | ({} if request.sun_disk else {"sun_disk": False})


def _solved(request: Any, frames: Any, progress: Any, store: Any) -> Any:
    """The frames with the field that serves them all; with a store one program solves it, for all."""
    from skyscatter.progress import say
    from skyscatter.solvers.sequence import field_for
    from skyscatter.solvers.stored import stored_context

    say("one field for all frames")
    solve = partial(
        field_for, frames.scenes, frames.camera, frames.wavelengths, tolerance=request.given.get("tolerance"),
        stokes=request.stokes, threads=request.threads, progress=progress.to,
    )  # fmt: skip
    return replace(frames, solved=solve() if store is None else stored_context(store, solve, True, progress.to))


def _exposures(request: Any, sequence: FrameList, frames: Any, exposure: float | str, executor: Any) -> Any:
    """Exposure of each frame [EV]."""
    from skyscatter.progress import say
    from skyscatter.solvers.sequence import adapted, own_exposures

    if exposure != "auto":
        return np.full(len(frames.scenes), float(exposure))
    say("exposures")
    return adapted(own_exposures(frames, executor, request.threads), sequence.step)


def _write(
    request: Any,
    frames: Any,
    missing: list[int],
    folder: FrameFolder,
    save: dict[str, Any],
    exposures: Any,
    executor: Any,
    progress: Any,
    store: Any,
) -> None:
    from skyscatter.progress import say
    from skyscatter.solvers.sequence import files

    say("frames")

    def options(number: int) -> dict[str, Any]:
        return dict(save) if exposures is None else {**save, "exposure": float(exposures[number])}

    made = files(frames, missing, folder.suffix, options, executor, request.threads, store)
    for done, (number, content) in enumerate(made, start=1):
        folder.keep(number, content)
        progress.to(done / len(missing))


def describe(summary: dict[str, Any]) -> str:
    """The summary for people."""
    from skyscatter.progress import format_seconds

    outputs = summary["outputs"]
    files = outputs[0] if len(outputs) == 1 else f"{outputs[0]} to {outputs[-1]}"
    was = summary["frames"] - summary["made"]
    before = f", {was} of them were there" if was else ""
    return (
        f"{summary['model']}: {summary['frames']} frames{before}; {format_seconds(summary['seconds'])}; wrote {files}"
    )
