"""Pictures of commands that memory does not hold: in parts, by way of a store, into files written strip by strip."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyscatter import memory
from skyscatter.cli import common, stopping
from skyscatter.errors import DomainError
from skyscatter.progress import remark, say

if TYPE_CHECKING:
    from skyscatter.image.skyframe import SkyFrame

#: Sums over walks that a store keeps for each number of a picture by them: sixteen batches.
BATCHES = 16
#: Fields of requests with which a picture cannot be made in parts, and the options that they come from.
OPTIONS = {
    "psf": "psf", "aperture_m": "aperture", "collecting_area_m2": "aperture", "unit": "unit", "filters": "filters",
    "resume": "resume", "every": "checkpoint", "subpixels": "subpixels", "denoise": "denoise", "smooth": "smooth",
    "preview": "preview",
}  # fmt: skip


@dataclass(frozen=True)
class Written:
    """A picture that is in its files, and never was in memory.

    Attributes
    ----------
    finished : float
    outputs : list of Path
    """

    outputs: list[Path]
    finished: float = 1.0


def fits(request: common.RunRequest, rays: int = 1, **given: Any) -> bool:
    """Whether memory holds a picture; where it does not, whether it can be made in parts is looked into at once.

    Raises
    ------
    DomainError
        Where it can be made in neither way, before any work.
    """
    width, height = request.size
    layers = (given.get("orders") or 0) + (2 if request.halved else 0) + (6 if given.get("stokes") else 0)
    try:
        memory.check_picture(width, height, request.wavelengths.size, layers, rays)
    except DomainError as error:
        _check_parts(request, error, given)
        return False
    return True


def _check_parts(request: common.RunRequest, error: DomainError, given: Mapping[str, Any]) -> None:
    """Refuse, with the words for what does not fit, what cannot be made in parts either."""
    from skyscatter.image import strips

    width, height = request.size

    def refuse(reason: str) -> DomainError:
        return DomainError("size", f"{width}x{height}", f"{error.allowed.partition('; ')[0]}; {reason}")

    for name in OPTIONS:
        if given.get(name) or getattr(request, name, None):
            words = f"--{OPTIONS[name]} needs the whole picture: leave it out"
            raise refuse(f"{words}, or make the picture smaller")
    if request.solver == "photons":
        raise refuse("the solver photons needs the whole picture: choose another, or make the picture smaller")
    needed = 0
    for path in request.outputs:
        try:
            strips.check_options(path, request.file_options.get(path.suffix.lower(), {}))
        except DomainError as refusal:
            raise refuse(f"{refusal.name} = {refusal.value}: {refusal.allowed}") from None
        needed += 8 * width * height * request.wavelengths.size
    needed += 8 * width * height * request.wavelengths.size * (BATCHES + 2 if request.solver == "path" else 1)
    free = shutil.disk_usage(request.outputs[0].parent if request.outputs else Path()).free
    if needed > free:
        disk = f"in parts some {memory.format_bytes(needed)} of disk, and {memory.format_bytes(free)} are free"
        raise refuse(f"{disk}; make it smaller, or with fewer wavelengths")


def run(
    request: common.RunRequest, scene: Any, camera: Any, label: str, arguments: list[str], sky: SkyFrame | None = None,
    **more: Any,
) -> Written:  # fmt: skip
    """Make a picture in parts and write its files; Ctrl-C keeps what is finished in the store.

    Raises
    ------
    KeyboardInterrupt
    DomainError
        For scenes and solvers that need the whole picture at once.
    """
    from skyscatter.progress import Progress
    from skyscatter.solvers.large import StoredPicture, render_stored
    from skyscatter.tasks.cluster import executor_of

    first = request.outputs[0] if request.outputs else Path("skyscatter")
    store = request.store or first.with_name(f"{first.name}.partial.zarr")
    try:
        with (
            stopping.keeping(lambda: common.keep(None, arguments, store)),
            Progress(1.0, label, request.progress) as progress,
            executor_of(request.workers, request.scheduler, request.worker_memory) as executor,
        ):
            if request.progress != "none":
                remark(f"larger than memory: made in parts, by way of {store}")
            render_stored(
                scene, camera, request.wavelengths, store, request.how,
                threads=request.threads, executor=executor, progress=progress.to, **more,
            )  # fmt: skip
            say("files")
            picture = StoredPicture(store, sky)
            for path in request.outputs:
                picture.save(path, **request.file_options.get(path.suffix.lower(), {}))
    except KeyboardInterrupt:
        common.keep(None, arguments, store)
        raise
    if request.store is None:
        shutil.rmtree(store, ignore_errors=True)
    return Written(request.outputs)
