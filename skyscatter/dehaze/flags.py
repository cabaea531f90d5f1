"""What a pixel's flags say: bits of one byte, so that several can hold."""

from __future__ import annotations

from enum import IntFlag


class Flag(IntFlag):
    """Why a pixel is no plain measurement of clear ground."""

    NODATA = 1  #: nothing was measured
    SATURATED = 2  #: at the top of what the file or the sensor can hold
    CLOUD = 4  #: the surface is not seen
    CIRRUS = 8  #: thin high cloud in the band at 1.38 micrometres; taken off
    WATER = 16
    SHADOW = 32  #: much darker than the air allows for lit ground
    CLIPPED = 64  #: the estimate was negative and has been set to 0
    UNCERTAIN = 128  #: nothing dark nearby: the haze there is the prior's, or a neighbour's
