"""Where the program begins: signals are answered before anything else is loaded."""

from __future__ import annotations

import atexit
import ctypes
import gc
import os
import sys
from contextlib import suppress
from typing import NoReturn

from skyscatter.cli.stopping import answered, asked, deaf, end_now, status

#: New objects after which Python looks for circles among them: loading modules makes many, and next to no garbage.
GARBAGE = 100_000

#: glibc's numbers for how much free memory it keeps and from which size on it never does, and the largest such size.
TRIM, MAPPED, MOST = -1, -3, 32 << 20


def keep_memory() -> None:
    """Keep what arrays leave for the next ones: the system clears every page that it is given back, a second a GB."""
    with suppress(OSError, AttributeError):  # another system, or another C library
        settle = ctypes.CDLL(None).mallopt
        settle(MAPPED, MOST)
        settle(TRIM, 2**31 - 1)


def leave(result: int) -> NoReturn:
    """End now: taking the interpreter and the compiler apart would take half a second, and be of no use."""
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(result)


def program() -> NoReturn:
    """Run the program and end the process with its exit status."""
    with answered():
        gc.set_threshold(GARBAGE)
        keep_memory()
        try:
            from skyscatter.cli.main import main

            result = main()
            deaf()
        except KeyboardInterrupt:  # while modules were loaded
            print("skyscatter: interrupted", file=sys.stderr)
            result = status()
        if asked():
            # Not `sys.exit`, which waits for threads: some may be in compiled loops for long.
            end_now()
    leave(result)
