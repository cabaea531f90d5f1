"""Ctrl-C and SIGTERM: answered within seconds whatever is running, with what is finished kept.

The first of them raises `KeyboardInterrupt` in the main thread; later ones change nothing, so that they cannot cut off
what is being kept.  Where the main thread is in compiled code, or something has swallowed the exception, a second
thread keeps the finished part after `PATIENCE` seconds and ends the process.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

#: Seconds that the main thread has to come to an end by itself.
PATIENCE = 3.5
#: Seconds that what is finished may take to be kept where the main thread hangs.
LONGEST = 60.0
#: Seconds after which it is told again what a callback of a library has swallowed.
AGAIN = 0.05
#: What is asked to end, and the usual exit status of a program that a signal has ended.
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143}


class _Stop:
    """What a signal has asked of the command that runs."""

    def __init__(self) -> None:
        self.status: int | None = None
        self.raised = False
        #: The signal that was raised as an exception.
        self.number = signal.SIGINT
        #: What signals did before.
        self.before: dict[Any, Any] = {}
        self.keep: Callable[[], None] | None = None
        #: Held while something is kept or written.
        self.lock = threading.RLock()
        self.ended = threading.Event()


_now = _Stop()


def status() -> int:
    """The exit status of an interrupted command."""
    return _now.status or SIGNALS[signal.SIGINT]


def asked() -> bool:
    """Whether a signal has asked the command to end."""
    return _now.status is not None


def deaf() -> None:
    """All is done: signals change nothing any more, while the interpreter ends."""
    for number in _now.before:
        signal.signal(number, signal.SIG_IGN)
    _now.before.clear()


@contextmanager
def keeping(keep: Callable[[], None]) -> Iterator[None]:
    """`keep` is called if the process has to end while the body hangs."""
    before, _now.keep = _now.keep, keep
    try:
        yield
    finally:
        _now.keep = before


@contextmanager
def undisturbed() -> Iterator[None]:
    """The body is not given up for hanging: it keeps something."""
    with _now.lock:
        yield


@contextmanager
def answered() -> Iterator[None]:
    """Answer signals while the body runs; what they did before comes back after it."""
    global _now
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _now = stop = _Stop()
    heard, told = socket.socketpair()
    told.setblocking(False)
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            stop.before[number] = signal.signal(number, lambda got, frame: _raise(stop, got, frame))
    unraisable = sys.unraisablehook
    sys.unraisablehook = lambda what: _swallowed(stop, what, unraisable)
    woken = signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(stop, heard), name="stopping", daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(woken)
        sys.unraisablehook = unraisable
        stop.ended.set()
        for number, handler in stop.before.items():
            signal.signal(number, handler)
        told.close()


def _raise(stop: _Stop, number: int, frame: FrameType | None) -> None:
    if not stop.raised:
        stop.raised, stop.number = True, signal.Signals(number)
        stop.status = stop.status or SIGNALS[signal.Signals(number)]
        raise KeyboardInterrupt


def _swallowed(stop: _Stop, what: Any, otherwise: Callable[[Any], object]) -> None:
    """Raise it again, outside of the callback that has not let it through; say nothing of that."""
    if not (issubclass(what.exc_type, KeyboardInterrupt) and stop.raised):
        otherwise(what)
        return
    stop.raised = False
    main = threading.main_thread().ident or 0
    tell = (lambda: signal.pthread_kill(main, stop.number)) if hasattr(signal, "pthread_kill") else interrupt_main
    again = threading.Timer(AGAIN, tell)
    again.daemon = True
    again.start()


def _watch(stop: _Stop, heard: socket.socket) -> None:
    """Wait for a signal, and for the end that should follow it; bring it about where it does not."""
    # Open to the end: later signals are told, too.
    with heard:
        while (said := heard.recv(1)) and said[0] not in SIGNALS:
            pass
        if not said:
            return
        # The handler runs in the main thread only, which may be in compiled code; of several signals that have come by
        # then Python answers the one with the least number first.
        stop.status = SIGNALS[signal.Signals(said[0])]
        while not stop.ended.wait(PATIENCE):
            if stop.lock.acquire(blocking=False):  # it is not keeping anything
                end_now(stop.keep)


def end_now(keep: Callable[[], None] | None = None) -> None:
    """End the process without waiting for any thread; what is half written goes."""
    from skyscatter.atomic import discard_unfinished

    if keep is not None:
        # Elsewhere: what hangs may hold what this waits for.
        keeper = threading.Thread(target=_quietly, args=(keep,), daemon=True)
        keeper.start()
        keeper.join(LONGEST)
    discard_unfinished()
    if sys.stderr.isatty():
        sys.stderr.write("\x1b[?25h")  # the cursor, which a bar hides
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):
            stream.flush()
    os._exit(status())


def _quietly(keep: Callable[[], None]) -> None:
    with suppress(Exception):
        keep()
