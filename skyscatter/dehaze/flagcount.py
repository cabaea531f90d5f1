"""How much of an image has each flag, counted while its windows are worked through."""

from __future__ import annotations

from threading import Lock

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.flags import Flag


class FlagCount:
    """Counts pixels by flag; any thread may add windows, in any order, and the shares are the same."""

    def __init__(self) -> None:
        self._lock = Lock()
        # By whole bytes: whole numbers, whose sum has no order.
        self._bytes = np.zeros(256, np.int64)

    def add(self, mask: NDArray[np.uint8]) -> None:
        """Count the pixels of a window."""
        found = np.bincount(mask.ravel(), minlength=256)
        with self._lock:
            self._bytes += found

    def shares(self) -> dict[str, float]:
        """Share of all pixels, those without data among them, that have a flag; by the flag's name in lower case."""
        total = max(int(self._bytes.sum()), 1)
        values = np.arange(256)
        return {
            str(flag.name).lower(): round(int(self._bytes[(values & int(flag)) != 0].sum()) / total, 6) for flag in Flag
        }
