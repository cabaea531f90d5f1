"""Signals that come while LLVM is at work wait until it is done."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

#: Those that users and their systems send to end a program.
ASKING = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def postponed() -> Iterator[None]:
    """What a signal does happens after the body.

    LLVM hands over what it made through callbacks, and Python answers a signal at the first of its own instructions:
    that is in the callback, which lets no exception through.  The interruption would be lost, and the machine code
    with it: a function that is called then lies at address 0.
    """
    if threading.current_thread() is not threading.main_thread():  # where no signal is answered
        yield
        return
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in ASKING if callable(signal.getsignal(number))}
    for number in before:
        signal.signal(number, lambda got, frame: came.append(got))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])
