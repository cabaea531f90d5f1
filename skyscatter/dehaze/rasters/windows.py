"""Images worked through window by window with bounded memory; the windows have no influence on the result."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.rasters.base import RasterSource, Window
from skyscatter.dehaze.rasters.handles import environment
from skyscatter.dehaze.rasters.sinks import RasterSink
from skyscatter.errors import DomainError
from skyscatter.kernels.processors import processors
from skyscatter.tasks.door import opened
from skyscatter.tasks.task import Shared, Task

#: Values [byte] of one window, where no size is asked for.
_WINDOW_BYTES = 48 << 20
_SMALLEST, _LARGEST = 256, 2048
#: Times that the values of a window are in memory while they are worked on; measured with twelve bands.
COPIES = 8

Progress = Callable[[float], object]


def windows(height: int, width: int, size: int, multiple: int = 1) -> Iterator[Window]:
    """Windows that tile an image, row by row, with edges on multiples of the lattice cell counted from its corner.

    Parameters
    ----------
    height, width : int
        Of the image [pixel].
    size : int
        Wanted on a side; rounded up to a multiple of `multiple`.
    multiple : int
        Cell of the lattice [pixel].
    """
    for name, value in (("window", size), ("multiple", multiple)):
        if value < 1:
            raise DomainError(name, value, "give 1 pixel or more")
    step = -(-size // multiple) * multiple
    for row in range(0, height, step):
        for col in range(0, width, step):
            yield Window(row, min(row + step, height), col, min(col + step, width))


def default_size(bands: int) -> int:
    """Pixels on a side of windows of some 50 MB."""
    side = int((_WINDOW_BYTES / (4 * max(bands, 1))) ** 0.5)
    return min(max(side // _SMALLEST * _SMALLEST, _SMALLEST), _LARGEST)


def map_windows(
    source: RasterSource,
    function: Callable[..., Any],
    *,
    size: int | None = None,
    multiple: int = 1,
    overlap: int = 0,
    bands: Sequence[int | str] | None = None,
    flags: bool = False,
    threads: int | None = None,
    executor: Any = None,
    progress: Progress | None = None,
) -> Generator[tuple[Window, Any], None, None]:
    """Apply a function to all windows of an image; results come row by row, whatever works on them.

    No more windows are in memory at a time than wait for the workers, or are at work: two for each, and one.

    Parameters
    ----------
    source : RasterSource
    function : callable
        ``function(row0, col0, values)`` of a window that starts at row0, col0 (reaching `overlap` pixels over on
        each side, as far as the image goes), or ``function(row0, col0, values, flags)`` with `flags`.
    size, multiple : int, optional
        As in `windows`; of some 50 MB if not given.
    overlap : int
        Pixels around a window that the function needs to see.
    bands : sequence, optional
        As in `RasterSource.read`.
    flags : bool
        Whether the function is given the flags too.
    threads : int, optional
        One per processor if not given.
    executor : int, concurrent.futures.Executor or distributed.Client, optional
        What works on the windows, as for `skyscatter.render`; they are read here all the same, and the function must
        change nothing.
    progress : callable, optional
        Called with the finished share, 0 to 1, from the calling thread.

    Yields
    ------
    window : Window
        Without the overlap.
    result : object
        What the function returned; arrays still have the overlap (see `cropped`).
    """
    count = len(source.bands) if bands is None else len(bands)
    todo = list(windows(source.height, source.width, size or default_size(count), multiple))

    def read(window: Window) -> tuple[Any, ...]:
        outer = grown(window, overlap, source.height, source.width)
        values, seen = source.read_with_flags(*outer, bands=bands)
        return (outer.row0, outer.col0, values, *((seen,) if flags else ()))

    with environment(), opened(executor, threads or processors()) as engine:
        shared = None if engine.local else Shared(function)

        def task(window: Window) -> Task:
            if engine.local:  # read in the threads, too
                return Task(lambda: function(*read(window)))
            seen = read(window)
            return Task(_apply, seen, shared, memory=COPIES * seen[2].nbytes)

        waiting: deque[tuple[Window, Future[Any]]] = deque()
        most = engine.workers if engine.local else 2 * engine.workers
        try:
            for number, window in enumerate(todo):
                # The next window goes to the workers before the finished one is handed out, so that they have work.
                ready = _first(waiting) if len(waiting) >= most else None
                waiting.append((window, engine.submit(task(window))))
                if ready is not None:
                    yield ready
                    _say(progress, (number + 1 - len(waiting)) / len(todo))
            while waiting:
                yield _first(waiting)
                _say(progress, 1.0 - len(waiting) / len(todo))
        finally:
            for _, future in waiting:
                future.cancel()


def _apply(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


def _say(progress: Progress | None, share: float) -> None:
    if progress is not None:
        progress(share)


def _first(waiting: deque[tuple[Window, Future[Any]]]) -> tuple[Window, Any]:
    window, future = waiting.popleft()
    return window, future.result()


def for_each_window(
    source: RasterSource,
    sinks: RasterSink | Mapping[str, RasterSink],
    function: Callable[..., Any],
    each: Callable[[Any], object] | None = None,
    **options: Any,
) -> None:
    """Apply a function to all windows of an image and write what it returns.

    Parameters
    ----------
    source : RasterSource
    sinks : RasterSink or mapping of str to RasterSink
        One, for a function that returns an array; or one for each array of the mapping that it returns.
    function : callable
        As in `map_windows`; returns arrays (band, y, x) as large as what it was given.
    each : callable, optional
        Called with every result, in the calling thread.
    options
        Of `map_windows`.
    """
    overlap = options.get("overlap", 0)
    named = sinks if isinstance(sinks, Mapping) else {"result": sinks}
    # Where a sink fails, no more windows are read: the image may be closed at once.
    with closing(map_windows(source, function, **options)) as found:
        for window, result in found:
            if each is not None:
                each(result)
            outer = grown(window, overlap, source.height, source.width)
            arrays = result if isinstance(result, Mapping) else {"result": result}
            for name, sink in named.items():
                sink.write(window.row0, window.col0, cropped(arrays[name], outer, window))


def grown(window: Window, overlap: int, height: int, width: int) -> Window:
    """A window with `overlap` more pixels on each side, as far as the image goes."""
    return Window(
        max(window.row0 - overlap, 0),
        min(window.row1 + overlap, height),
        max(window.col0 - overlap, 0),
        min(window.col1 + overlap, width),
    )


def cropped(values: NDArray[Any], outer: Window, inner: Window) -> NDArray[Any]:
    """The part of an array over the window `outer` that lies in the window `inner`."""
    if np.shape(values)[-2:] != outer.shape:
        raise DomainError("values", f"shape {np.shape(values)}", f"must be as large as the window, {outer.shape}")
    rows = slice(inner.row0 - outer.row0, inner.row1 - outer.row0)
    cols = slice(inner.col0 - outer.col0, inner.col1 - outer.col0)
    return values[..., rows, cols]
