"""What a pixel's flags say: bits of one byte, so that several can hold."""

from __future__ import annotations

from enum import IntFlag

import numpy as np
from numpy.typing import NDArray


class Flag(IntFlag):
    """Why a pixel is no plain measurement of clear ground.

    Examples
    --------
    What the number 36 in a mask says, and how many pixels show a cloud:

    >>> import numpy as np
    >>> from skyscatter.dehaze import Flag
    >>> [flag.name for flag in Flag(36)]
    ['CLOUD', 'SHADOW']
    >>> mask = np.array([[0, 4], [36, 64]], dtype=np.uint8)
    >>> int(np.count_nonzero(mask & Flag.CLOUD))
    2
    """

    NODATA = 1  #: nothing was measured
    SATURATED = 2  #: at the top of what the file or the sensor can hold
    CLOUD = 4  #: the surface is not seen
    CIRRUS = 8  #: thin high cloud in the band at 1.38 micrometres; taken off
    WATER = 16
    SHADOW = 32  #: much darker than the air allows for lit ground
    CLIPPED = 64  #: the estimate was negative and has been set to 0
    UNCERTAIN = 128  #: nothing dark nearby: the haze there is the prior's, or a neighbour's


#: The flags in words, for those who read a mask elsewhere.
MEANINGS = {
    Flag.NODATA: "no data", Flag.SATURATED: "saturated", Flag.CLOUD: "cloud", Flag.CIRRUS: "cirrus, taken off",
    Flag.WATER: "water", Flag.SHADOW: "shadow", Flag.CLIPPED: "negative and set to 0", Flag.UNCERTAIN: "haze uncertain",
}  # fmt: skip


def mark(flags: NDArray[np.uint8], where: NDArray[np.bool_], flag: Flag) -> None:
    """Set a flag, in place, where a mask of the same shape holds."""
    flags |= where.astype(np.uint8) * np.uint8(flag)
