"""Progress with the time left, on stderr, and words for what is being done."""

from __future__ import annotations

import logging
import math
import sys
import threading
import time
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Any, Literal, Self, TextIO, get_args

from skyscatter.errors import DomainError

Mode = Literal["auto", "bar", "log", "none"]
MODES: tuple[str, ...] = get_args(Mode)

#: Seconds before the first line, and between the others: so many per cent of the time that has gone, within limits.
LINE_INTERVAL, LINE_SHARE, LONGEST_INTERVAL = 10.0, 0.1, 60.0
#: Seconds of work after which its pace is trusted, and work that is worth a word at once [s].
TRIAL, WORTH_A_WORD = 2.0, 60.0
#: Seconds between two looks at whether a line is due, and between two of what is above a bar.
TICK, ABOVE_INTERVAL = 0.2, 0.5
#: What is done so soon after the beginning was kept from an earlier run [s].
AT_ONCE = 1.0
#: Compiling that takes longer is foretold [s].
WORTH_TELLING = 5.0
#: What is said while functions are compiled.
COMPILING = "compiling, once where it can be kept"

_log = logging.getLogger("skyscatter")
#: What is shown at this moment.
_shown: list[Progress] = []


def say(words: str, anew: bool = True) -> None:
    """Tell what is done from now on: the log, and the progress that is shown.

    Parameters
    ----------
    words : str
    anew : bool
        Its share and its time count from zero.
    """
    _log.info(words)
    for progress in tuple(_shown):
        progress.phase(words, anew)


def remark(words: str) -> None:
    """Something to be said beside the time, if that is long."""
    _log.info(words)
    for progress in tuple(_shown):
        progress.remark = words


class Progress:
    """How much of a task is done and how long the rest will take.

    A bar that redraws itself (rich, imported only then), or lines: at first every ten seconds, later every minute, and
    at once where more than a minute of work is ahead.

    Parameters
    ----------
    total : float
        Amount of work, in any unit; positive.
    label : str
        What is being done.
    mode : {"auto", "bar", "log", "none"}, optional
        How to show it; auto is a bar on a terminal, and lines elsewhere.
    stream : text stream, optional
        Where to write; by default ``sys.stderr``.
    above : callable, optional
        What a bar has above it: of the terminal's columns and lines it makes something that rich can print.
    """

    def __init__(
        self,
        total: float,
        label: str,
        mode: str = "auto",
        stream: TextIO | None = None,
        above: Callable[[int, int], Any] | None = None,
    ) -> None:
        if not total > 0:
            raise ValueError(f"total = {total!r}: the amount of work must be positive")
        if mode not in MODES:
            raise DomainError("progress", mode, f"choose one of {', '.join(MODES)}")
        self.total, self.label = float(total), label
        self.done = self._kept = 0.0
        self.words = self.remark = ""
        self._stream = sys.stderr if stream is None else stream
        self.mode = mode if mode != "auto" else "bar" if self._stream.isatty() else "log"
        self._above = above
        self._made: Any = None
        self._made_at = -math.inf
        self._bar: Any = None
        self._task: Any = None
        self._compiling = _Compiling()
        self._said = self._foretold = False
        self._lock, self._end = threading.RLock(), threading.Event()
        self._began = self._started = self._last_line = time.monotonic()

    def __enter__(self) -> Self:
        self._began = self._started = self._last_line = time.monotonic()
        if self.mode == "none":
            return self
        if self.mode == "bar":
            self._start_bar()
        _shown.append(self)
        threading.Thread(target=self._watch, name="progress", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
        if self in _shown:
            _shown.remove(self)
        self._compiling.leave()
        with self._lock:
            if self._bar is not None:
                self._made_at = -math.inf  # the last look shows what has come since
                self._bar.stop()
                self._bar = None
            elif self.mode == "log" and kind is None and self._last_line > self._began:
                self._line(f"done in {format_seconds(time.monotonic() - self._began)}")

    def update(self, n: float = 1.0) -> None:
        """Another `n` of `total` is done."""
        self.to(self.done + n)

    def to(self, done: float) -> None:
        """`done` of `total` is done by now; it never goes back, nor past the total."""
        before, self.done = self.done, min(max(self.done, float(done)), self.total)
        if before == 0 < self.done and time.monotonic() - self._started < AT_ONCE:
            self._kept, self._started = self.done, time.monotonic()

    def phase(self, words: str, anew: bool = True) -> None:
        """Something else is done from now on; its share and time count from zero, or go on."""
        self.words = words
        if anew:
            self.done, self._kept, self._started, self._said = 0.0, 0.0, time.monotonic(), False

    def seconds_left(self) -> float | None:
        """Time left [s] if the rest goes at the mean pace so far; None before any work is done.

        What is there at once was done before: it says nothing of the pace.
        """
        if self.done <= self._kept:
            return None
        return (time.monotonic() - self._started) * (self.total - self.done) / (self.done - self._kept)

    def look(self) -> None:
        """Redraw the bar, or write a line if one is due."""
        if self.mode == "none":
            return
        with self._lock:
            left, now = self.seconds_left(), time.monotonic()
            long = left is not None and left > WORTH_A_WORD and now - self._started >= TRIAL and not self._said
            interval = min(max(LINE_INTERVAL, LINE_SHARE * (now - self._began)), LONGEST_INTERVAL)
            if long or (self.mode == "log" and now - self._last_line >= interval):
                self._said, self._last_line = self._said or long, now
                rest = "" if left is None else f", {format_seconds(left)} left"
                rest += f"; {self.remark}" if long and self.remark else ""
                self._line(f"{self._doing()}{self._share()}{rest}")
            if self._bar is not None:
                self._bar.update(self._task, completed=self.done, description=self._title())

    def _watch(self) -> None:
        while not self._end.wait(TICK):
            self._compiling.listen()
            if self._compiling.depth > 0:
                self._started += TICK  # the pace is that of the work
                self._foretell()
            self.look()

    def _foretell(self) -> None:
        """Say how long compiling will take, once and if it is worth it."""
        left = self._compiling.seconds_left()
        if not self._foretold and left > WORTH_TELLING:
            self._foretold = True
            with self._lock:
                self._line(f"{COMPILING}: about {format_seconds(left)}")

    def _share(self) -> str:
        """How much is done; while functions are compiled, how long that will go on."""
        compiling = self._compiling.seconds_left() if self._compiling.depth > 0 else 0.0
        return f"about {format_seconds(compiling)} left" if compiling > 1 else f"{100 * self.done / self.total:.0f} %"

    def _doing(self) -> str:
        words = COMPILING if self._compiling.depth > 0 else self.words
        return f"{words}: " if words else ""

    def _title(self) -> str:
        return f"{self.label}: {self._doing()}".rstrip(": ")

    def _line(self, text: str) -> None:
        if self._bar is not None:
            self._bar.console.print(f"{self.label}: {text}", highlight=False, markup=False)
            return
        self._stream.write(f"{self.label}: {text}\n")
        self._stream.flush()

    def _what_is_above(self, columns: int, lines: int) -> Iterable[Any]:
        """What is above the bar, if anything; made anew now and then, for a bar is redrawn more often."""
        if self._above is None:
            return
        if time.monotonic() - self._made_at >= ABOVE_INTERVAL:
            self._made_at = time.monotonic()
            self._made = self._above(columns, lines)
        yield self._made

    def _start_bar(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Plain

        console, above = Console(file=self._stream, force_terminal=True), self._what_is_above

        class Bar(Plain):
            """The bar, below what is above it."""

            def get_renderables(self) -> Iterable[Any]:
                yield from above(console.width, console.height)
                yield from super().get_renderables()

        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeRemainingColumn(elapsed_when_finished=True),
            console=console,
        )
        self._task = self._bar.add_task(self.label, total=self.total)
        self._bar.start()


class _Compiling:
    """Whether functions are being compiled at this moment, as numba tells; it is not loaded for it."""

    def __init__(self) -> None:
        self.depth = 0
        self._events: Any = None

    def listen(self) -> None:
        """Listen from when numba has been loaded."""
        events: Any = sys.modules.get("numba.core.event")
        if self._events is None and hasattr(events, "Listener"):
            self._events = events
            events.Listener.register(_Compiling)
            events.register("numba:compile", self)

    @staticmethod
    def seconds_left() -> float:
        """How long it will be until everything is compiled, as far as that is known [s]."""
        crew: Any = sys.modules.get("skyscatter.kernels.crew")
        return crew.seconds_left() if hasattr(crew, "seconds_left") else 0.0

    def leave(self) -> None:
        """Listen no more."""
        if self._events is not None:
            self._events.unregister("numba:compile", self)
            self._events = None

    def notify(self, event: Any) -> None:
        """A function begins or ends to be compiled; they are nested."""
        self.depth = max(self.depth + (1 if event.is_start else -1), 0)


def format_seconds(seconds: float) -> str:
    """Seconds as words of a sensible size: ``8 s``, ``2 min 05 s``, ``1 h 07 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
