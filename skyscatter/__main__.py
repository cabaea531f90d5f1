"""``python -m skyscatter``: the program, where its script is not on the path."""

import sys

from skyscatter.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
