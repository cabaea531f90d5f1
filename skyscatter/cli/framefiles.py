"""Files of sequences: numbered ones, each there whole or not at all, and films that are made of them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyscatter.cli.parse import FILMS
from skyscatter.errors import SkyscatterError
from skyscatter.tasks.task import key_of

if TYPE_CHECKING:
    from skyscatter.tasks.store import Store


def film_writer() -> Any:
    """What writes films.

    Raises
    ------
    SkyscatterError
        If it is not installed.
    """
    try:
        import imageio.v3 as writer
        import imageio_ffmpeg  # noqa: F401 - what it writes with
    except ImportError:
        raise SkyscatterError("output: films need imageio-ffmpeg: pip install imageio imageio-ffmpeg") from None
    return writer


def numbered(path: Path, count: int) -> tuple[Path, ...]:
    """So many files from the name of one.

    Examples
    --------
    >>> from pathlib import Path
    >>> from skyscatter.cli.framefiles import numbered
    >>> [path.name for path in numbered(Path("day.png"), 2)]
    ['day-0001.png', 'day-0002.png']
    """
    digits = max(len(str(count)), 4)
    return tuple(path.with_name(f"{path.stem}-{k + 1:0{digits}d}{path.suffix}") for k in range(count))


def write(path: Path, content: Mapping[str, bytes]) -> None:
    """Write the files of a frame, by their suffixes, each whole or not at all."""
    from skyscatter.atomic import atomic_path

    for suffix, file in content.items():
        with atomic_path(path.with_suffix(suffix)) as beside:
            beside.write_bytes(file)


@dataclass(frozen=True)
class FrameFolder:
    """Where the frames are: numbered files, each there whole or not at all, and a note of what they are frames of.

    Where a store keeps the frames the note is not needed: all files are written from there.

    Attributes
    ----------
    output : Path
        As it was asked for.
    suffix : str
        Of the frames.
    paths : tuple of Path
    note : Path
    recipe : dict
        Frames of another one are made anew.
    store : Path or None
    """

    output: Path
    suffix: str
    paths: tuple[Path, ...]
    note: Path
    recipe: dict[str, Any]
    store: Path | None

    @classmethod
    def of(cls, request: Any, step: float, frames: Any, look: dict[str, Any]) -> FrameFolder:
        """The folder for what a command asks; exposures change by at most a step [EV]."""
        import skyscatter

        output: Path = request.outputs[0]
        film = output.suffix.lower() in FILMS
        suffix = ".png" if film else output.suffix.lower()
        place, stem = (output.with_name(f"{output.name}.frames"), "frame") if film else (output.parent, output.stem)
        paths = numbered(place / f"{stem}{suffix}", len(frames.scenes))
        recipe = {
            "skyscatter": skyscatter.__version__,
            "scenes": [scene.model_dump(mode="json", exclude_none=True) for scene in frames.scenes],
            "camera": frames.camera.model_dump(mode="json"),
            "wavelengths_nm": frames.wavelengths.tolist(),
            "options": frames.recorded,
            "look": {**look, "step": step, "files": request.file_options.get(suffix, {})},
        }
        return cls(output, suffix, paths, place / f".{stem}.frames.json", recipe, request.store)

    @contextmanager
    def stored(self) -> Iterator[Store | None]:
        """The store that keeps the frames, where there is to be one."""
        if self.store is None:
            yield None
            return
        from skyscatter.tasks.store import Store

        about = {"sort": "frames", "suffix": self.suffix, "frames": len(self.paths)}
        store = Store(self.store, {**self.recipe, "suffix": self.suffix}, (), about)
        try:
            yield store
        finally:
            store.close()

    def missing(self) -> list[int]:
        """Numbers of the frames that are not there yet."""
        if self.store is not None:
            self.paths[0].parent.mkdir(exist_ok=True)
            return list(range(len(self.paths)))
        key = key_of(self.recipe)
        try:
            known = json.loads(self.note.read_text())["key"] == key
        except (OSError, ValueError, KeyError):
            known = False
        if not known:
            from skyscatter.atomic import atomic_path

            self.paths[0].parent.mkdir(exist_ok=True)
            for path in self.paths if self.output.suffix.lower() in FILMS else ():
                path.unlink(missing_ok=True)
            with atomic_path(self.note) as beside:
                beside.write_text(json.dumps({"key": key, "frames": len(self.paths), "made": []}))
        made = set(self._made())
        return [k for k, path in enumerate(self.paths) if k not in made or not path.is_file()]

    def _made(self) -> list[int]:
        return list(json.loads(self.note.read_text())["made"])

    def keep(self, number: int, content: Mapping[str, bytes]) -> None:
        """Write the files of a frame, by their suffixes, and note that they are of this sequence."""
        from skyscatter.atomic import atomic_path

        write(self.paths[number], content)
        if self.store is not None:
            return
        note = json.loads(self.note.read_text())
        note["made"] = [*note["made"], number]
        with atomic_path(self.note) as beside:
            beside.write_text(json.dumps(note))

    def finish(self, rate: float, progress: Any) -> list[Path]:
        """All frames are there: a film of so many a second is made of them; returns the files."""
        if self.output.suffix.lower() not in FILMS:
            self.note.unlink(missing_ok=True)
            return list(self.paths)
        from skyscatter.atomic import atomic_path
        from skyscatter.progress import say

        say("film")
        writer = film_writer()
        with atomic_path(self.output) as beside:
            with _film(beside, rate) as film:
                for k, path in enumerate(self.paths):
                    film.append_data(_even(writer.imread(path)))
                    progress.to((k + 1) / len(self.paths))
            if not beside.stat().st_size:
                raise SkyscatterError(f"{self.output}: the film could not be made; choose .mp4 or .gif")
        shutil.rmtree(self.paths[0].parent)
        return [self.output]


def _even(picture: Any) -> Any:
    """Most codecs want sizes that two divides."""
    high, wide = (side // 2 * 2 or side for side in picture.shape[:2])
    return picture[:high, :wide]


@contextmanager
def _film(path: Path, rate: float) -> Iterator[Any]:
    """A film to which pictures are added."""
    import imageio

    if path.suffix == ".gif":
        more: dict[str, Any] = {"duration": 1000 / rate, "loop": 0}
    else:
        codec = "libvpx-vp9" if path.suffix == ".webm" else "libx264"
        more = {"fps": rate, "macro_block_size": 1, "codec": codec, "ffmpeg_log_level": "error"}
    with imageio.get_writer(str(path), **more) as film:
        yield film
