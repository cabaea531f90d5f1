"""Lines of the constellations in an observer's sky."""

from __future__ import annotations

import numpy as np

from skyscatter.celestial.frames import Array, SkyFrame
from skyscatter.celestial.stars import stars_at
from skyscatter.datafiles import read_table


def constellation_lines(sight: SkyFrame) -> Array:
    """Ends of the lines of all constellations, for a place and a moment.

    Parameters
    ----------
    sight : SkyFrame

    Returns
    -------
    ndarray, shape (line, 2, 3)
        Unit vectors (east, north, up) to the two stars of each line, also below the horizon.  The lines are those of
        d3-celestial; others draw some constellations in other ways.

    Examples
    --------
    Lines that are above the horizon of Paris on a winter evening.

    >>> from skyscatter.celestial.constellations import constellation_lines
    >>> from skyscatter.celestial.frames import Sight
    >>> ends = constellation_lines(Sight(48.86, 2.35, "2026-01-12T22:00Z"))
    >>> ends.shape, int((ends[..., 2] > 0).all(axis=1).sum())
    ((742, 2, 3), 333)
    """
    stars, table = stars_at(sight), read_table("constellation_lines.csv")
    order = np.argsort(stars.numbers)
    place = [order[np.searchsorted(stars.numbers[order], table[end])] for end in ("from_hip", "to_hip")]
    return np.asarray(stars.directions[np.stack(place, axis=1)])
