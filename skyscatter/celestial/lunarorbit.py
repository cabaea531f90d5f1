"""The Moon's motion about the Earth: ERFA's series, and terms that it leaves out, fitted to JPL's ephemeris."""

from __future__ import annotations

import math

import numpy as np

from skyscatter.celestial.frames import AU, J2000, Array
from skyscatter.datafiles import read_table

_ARCSEC = math.pi / 648000.0  # [rad]


def moon_place(day: float, fraction: float) -> Array:
    """Vector from the Earth's centre to the Moon's.

    Parameters
    ----------
    day, fraction : float
        Julian date (TDB; TT does as well) in two parts.

    Returns
    -------
    ndarray, shape (3,)
        [m] in the axes of ICRS.

    Notes
    -----
    ERFA's ``moon98`` (Meeus; 3 arcsec and 3 km in the mean, up to 18 arcsec) with the terms of ``data/moon_terms.csv``.
    Against DE421 from 1900 to 2050: longitude 0.11 arcsec in the mean and at most 0.8, latitude 0.08 and 0.45, distance
    120 and 720 m.  From then to 2100 the terms go on; fitted to shorter spans they were 0.6 arcsec and 1 km off
    40 years later.

    Examples
    --------
    >>> import numpy as np
    >>> from skyscatter.celestial.lunarorbit import moon_place
    >>> round(float(np.linalg.norm(moon_place(2461265.0, 0.24))) / 1e3)  # km, 12 August 2026
    366971
    """
    import erfa

    to_ecliptic = np.asarray(erfa.ecm06(J2000, 0.0))
    x, y, z = (float(v) for v in to_ecliptic @ np.asarray(erfa.moon98(day, fraction)["p"]) * AU)
    more = _corrections(day, fraction)
    longitude = math.atan2(y, x) + more[0] * _ARCSEC
    latitude = math.atan2(z, math.hypot(x, y)) + more[1] * _ARCSEC
    distance = math.sqrt(x * x + y * y + z * z) + more[2] * 1e3
    level = math.cos(latitude)
    unit = np.array([level * math.cos(longitude), level * math.sin(longitude), math.sin(latitude)])
    return np.asarray(distance * unit @ to_ecliptic)


def _corrections(day: float, fraction: float) -> Array:
    """What to add to longitude and latitude [arcsec] and to the distance [km]; shape (3,)."""
    import erfa

    t = read_table("moon_terms.csv")
    days = (day - J2000) + fraction
    centuries = days / 36525.0
    phase = t["rate"] * days + t["d"] * erfa.fad03(centuries) + t["sun"] * erfa.falp03(centuries)
    phase += t["moon"] * erfa.fal03(centuries) + t["node"] * erfa.faf03(centuries)
    # Rows without arguments are a constant and its change: their phase is 0, and the sine's place holds the change.
    constant = (t["rate"] == 0.0) & (t["d"] == 0.0) & (t["sun"] == 0.0) & (t["moon"] == 0.0) & (t["node"] == 0.0)
    values = t["sine"] * np.where(constant, centuries, np.sin(phase)) + t["cosine"] * np.cos(phase)
    return np.asarray(np.bincount(t["coordinate"].astype(int), weights=values, minlength=3), dtype=float)
