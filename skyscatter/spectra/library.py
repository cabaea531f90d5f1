"""colour-science, loaded where it is needed: that takes a second."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np


def colour_science() -> Any:
    """The package ``colour``.

    It changes how numpy prints arrays, for the whole program, and remarks on what it would like to be installed; here
    it does neither.
    """
    with np.printoptions(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    return colour
