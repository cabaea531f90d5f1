"""Where the program begins: signals are answered before anything else is loaded."""

from __future__ import annotations

import atexit
import os
import sys
from contextlib import suppress
from typing import NoReturn

from skyscatter.cli.stopping import answered, asked, deaf, end_now, status


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
