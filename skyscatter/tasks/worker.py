"""What runs in a worker process: it keeps what tasks share, and asks for it where it has not got it."""

from __future__ import annotations

import os
import pickle
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from skyscatter.workers import steady_algebra

#: Shared values that a worker keeps: that of the job at work, and of one beside it.
MOST_KEPT = 2

_kept: OrderedDict[str, Any] = OrderedDict()
_lock = threading.Lock()


class Missing(NamedTuple):
    """The answer of a worker that has not got what a task shares with others."""

    process: int


class InFile(NamedTuple):
    """A shared value in a file that workers of this machine can read."""

    path: str


#: How a shared value comes: in a file, packed, or not at all because the worker should have it.
Gift = InFile | bytes | None


class Failed(NamedTuple):
    """What a task of a group has ended with, in place of its result."""

    error: BaseException


def settle(memory: int | None = None) -> None:
    """In a new process: Ctrl-C is the business of the one that began it, and there is so much memory [byte]."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if memory is not None:
        import resource

        # What a process writes to, mapped files that it only reads left out: machine code and libraries.
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))


def run_group(
    tasks: list[tuple[Callable[..., Any], tuple[Any, ...]]], key: str | None = None, gift: Gift = None
) -> tuple[float, list[Any]]:
    """Run tasks that share the same, one after the other; seconds of a task, and results or `Failed`."""
    began = time.perf_counter()
    found: list[Any] = []
    for call, arguments in tasks:
        try:
            found.append(run(call, arguments, key, gift))
        except Exception as error:
            found.append(Failed(_portable(error)))
    return (time.perf_counter() - began) / len(tasks), found


def _portable(error: Exception) -> BaseException:
    """An error that comes through to other processes."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever its own pickling raises: the error itself goes on, by its words
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def run(call: Callable[..., Any], arguments: tuple[Any, ...], key: str | None = None, gift: Gift = None) -> Any:
    """Run a task; `Missing` where what it shares is neither kept nor given."""
    if key is None:
        with steady_algebra():
            return call(*arguments)
    with _lock:
        if key not in _kept:
            if gift is None:
                return Missing(os.getpid())
            _kept[key] = _unpacked(gift)
        _kept.move_to_end(key)
        value = _kept[key]
        while len(_kept) > MOST_KEPT:
            _kept.popitem(last=False)
    with steady_algebra():
        return call(value, *arguments)


def _unpacked(gift: InFile | bytes) -> Any:
    if isinstance(gift, InFile):
        with Path(gift.path).open("rb") as file:
            return pickle.load(file)
    return pickle.loads(gift)
