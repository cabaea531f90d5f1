"""Progress with the time left, on stderr."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any, Self, TextIO

#: Seconds between two lines where there is no terminal to redraw one on.
LINE_INTERVAL = 10.0


class Progress:
    """How much of a task is done and how long the rest will take.

    On a terminal it is a bar that redraws itself (rich, imported only then); elsewhere, when it is forced, a line at
    most every ten seconds.

    Parameters
    ----------
    total : float
        Amount of work, in any unit; positive.
    label : str
        What is being done.
    enabled : bool, optional
        Show it or not; by default only when the stream is a terminal.
    stream : text stream, optional
        Where to write; by default ``sys.stderr``.
    """

    def __init__(self, total: float, label: str, enabled: bool | None = None, stream: TextIO | None = None) -> None:
        if not total > 0:
            raise ValueError(f"total = {total!r}: the amount of work must be positive")
        self.total, self.label = float(total), label
        self.done = 0.0
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self.enabled = self._terminal if enabled is None else enabled
        self._bar: Any = None
        self._task: Any = None
        self._started = self._last_line = time.monotonic()

    def __enter__(self) -> Self:
        self._started = self._last_line = time.monotonic()
        if self.enabled and self._terminal:
            self._start_bar()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
        elif self.enabled and kind is None and self.done >= self.total:
            self._line(f"done in {format_seconds(time.monotonic() - self._started)}")

    def update(self, n: float = 1.0) -> None:
        """Another `n` of `total` is done."""
        self.to(self.done + n)

    def to(self, done: float) -> None:
        """`done` of `total` is done by now; it never goes back, nor past the total."""
        self.done = min(max(self.done, float(done)), self.total)
        if self._bar is not None:
            self._bar.update(self._task, completed=self.done)
        elif self.enabled and not self._terminal and time.monotonic() - self._last_line >= LINE_INTERVAL:
            self._last_line = time.monotonic()
            left = self.seconds_left()
            rest = "" if left is None else f", {format_seconds(left)} left"
            self._line(f"{100 * self.done / self.total:.0f} %{rest}")

    def seconds_left(self) -> float | None:
        """Time left [s] if the rest goes at the mean pace so far; None before any work is done."""
        if self.done <= 0:
            return None
        return (time.monotonic() - self._started) * (self.total - self.done) / self.done

    def _line(self, text: str) -> None:
        self._stream.write(f"{self.label}: {text}\n")
        self._stream.flush()

    def _start_bar(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeRemainingColumn(elapsed_when_finished=True),
            console=Console(file=self._stream),
        )
        self._task = self._bar.add_task(self.label, total=self.total)
        self._bar.start()


def format_seconds(seconds: float) -> str:
    """Seconds as words of a sensible size: ``8 s``, ``2 min 05 s``, ``1 h 07 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
