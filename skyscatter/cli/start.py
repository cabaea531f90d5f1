"""Where the program begins: signals are answered before anything else is loaded."""

from __future__ import annotations

import sys
from typing import NoReturn

from skyscatter.cli.stopping import answered, asked, deaf, end_now, status


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
    sys.exit(result)
