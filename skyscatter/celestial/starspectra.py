"""Spectra of stars by their colour: smooth, without lines, with the magnitudes in U, B, V and I that go with B - V."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial.frames import Array
from skyscatter.spectra.cells import cell_edges
from skyscatter.spectra.solar import blackbody_irradiance
from skyscatter.spectra.vega import BAND_NODES, magnitude

#: Colours between which spectra are mixed.
COLOURS = np.round(np.arange(-0.35, 2.505, 0.01), 2)
#: Nodes of the spectra [nm].
NODES = np.concatenate(
    [np.arange(280.0, 300.0), BAND_NODES, np.arange(925.0, 1100.0, 5.0), np.arange(1100.0, 4001.0, 25.0)]
)
#: B - V with V - I: medians of the Hipparcos stars to V = 7.
_V_I = (
    (-0.35, -0.36), (-0.20, -0.18), (-0.10, -0.07), (0.0, 0.02), (0.1, 0.11), (0.2, 0.21), (0.3, 0.35), (0.4, 0.47),
    (0.5, 0.57), (0.6, 0.66), (0.7, 0.74), (0.8, 0.84), (0.9, 0.91), (1.0, 0.98), (1.1, 1.06), (1.2, 1.15),
    (1.3, 1.26), (1.4, 1.38), (1.5, 1.54), (1.6, 1.81), (1.7, 1.99), (2.0, 2.30), (2.5, 2.80),
)  # fmt: skip
#: B - V with U - B: dwarfs to 0.7, giants from 0.9 (Johnson 1966, Ann. Rev. Astron. Astrophys. 4, 193), two
#: digits, recalled.
_U_B = (
    (-0.35, -1.22), (-0.30, -1.08), (-0.20, -0.71), (-0.10, -0.33), (0.0, 0.0), (0.1, 0.09), (0.2, 0.08), (0.3, 0.03),
    (0.4, 0.0), (0.5, 0.02), (0.6, 0.10), (0.7, 0.24), (0.8, 0.43), (0.9, 0.62), (1.0, 0.84), (1.1, 1.03), (1.2, 1.22),
    (1.3, 1.43), (1.4, 1.63), (1.5, 1.81), (1.6, 1.90), (2.5, 1.95),
)  # fmt: skip
#: Where the correction to a black body counts in full for each band [nm]: between U and B lies the Balmer jump.
_KNOTS = np.array([370.0, 400.0, 440.0, 545.0, 800.0])
_BANDS = ("U", "B", "V", "I")


def colour_temperature(b_v: ArrayLike) -> Array:
    """Temperature [K] of a star by its B - V (Ballesteros 2012, Europhys. Lett. 97, 34008)."""
    colour = 0.92 * np.asarray(b_v, dtype=float)
    return np.asarray(4600.0 * (1.0 / (colour + 1.7) + 1.0 / (colour + 0.62)))


def star_spectra(b_v: ArrayLike, wavelengths: ArrayLike) -> Array:
    """Irradiance of stars of V = 0.

    Parameters
    ----------
    b_v : array_like, shape (star,)
        Colours; those below -0.35 and above 2.5 count as these.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], 280 to 4000; the light is averaged over their cells.

    Returns
    -------
    ndarray, shape (star, wavelength)
        [W m-2 nm-1]

    Notes
    -----
    A black body of the temperature of Ballesteros 2012 times a function that is linear over wavelength between values
    for U, B, V and I and constant beyond; these values are such that the spectrum has V = 0 and, by Bessell's bands and
    zero points (`skyscatter.spectra.vega`), the star's own B - V and the mean V - I and U - B of stars of that colour.
    V - R comes out within 0.03 of that of standard stars.  Single stars differ from the mean: in V - I by 0.04, with
    B - V above 1.5, where molecules absorb, by 0.4; in U - B by 0.1 and more.

    Examples
    --------
    A blue, a white, and a red star; at 550 nm nearly the same.

    >>> from skyscatter.celestial.starspectra import star_spectra
    >>> (star_spectra([-0.2, 0.0, 1.5], [450.0, 550.0, 650.0]) * 1e11).round(1)
    array([[7.2, 3.6, 2. ],
           [6.3, 3.6, 2.2],
           [1.7, 3.6, 4.6]])
    """
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    rows = _means(wl)
    place = np.clip((np.asarray(b_v, dtype=float) - COLOURS[0]) / 0.01, 0.0, COLOURS.size - 1.0)
    low = np.minimum(place.astype(int), COLOURS.size - 2)
    share = (place - low)[:, None]
    # V is linear in the light, so that a mixture of spectra of V = 0 has V = 0.
    return np.asarray((1.0 - share) * rows[low] + share * rows[low + 1])


def _means(wl: Array) -> Array:
    """The table of spectra, averaged over the cells of wavelengths; shape (colour, wavelength)."""
    table = _table()
    if wl.size < 2:
        return np.stack([np.interp(wl, NODES, row) for row in table])
    total = np.concatenate(
        [np.zeros((len(table), 1)), np.cumsum(0.5 * (table[:, 1:] + table[:, :-1]) * np.diff(NODES), axis=1)], axis=1
    )
    low, high = cell_edges(wl)
    ends = []
    for x in (np.clip(low, NODES[0], NODES[-1]), np.clip(high, NODES[0], NODES[-1])):
        i = np.clip(np.searchsorted(NODES, x, side="right") - 1, 0, NODES.size - 2)
        part = x - NODES[i]
        slope = (table[:, i + 1] - table[:, i]) / (NODES[i + 1] - NODES[i])
        ends.append(total[:, i] + part * (table[:, i] + 0.5 * part * slope))
    return np.asarray((ends[1] - ends[0]) / (high - low))


@lru_cache(maxsize=1)
def _table() -> Array:
    """Spectra of V = 0 at `NODES` for each of `COLOURS`."""
    black = np.stack([blackbody_irradiance(NODES, t, 1.0, 1.0) for t in colour_temperature(COLOURS)])
    black /= black[:, [np.searchsorted(NODES, 550.0)]]
    v_i, u_b = (np.interp(COLOURS, pairs[:, 0], pairs[:, 1]) for pairs in (np.array(_V_I), np.array(_U_B)))
    wanted = np.stack([COLOURS + u_b, COLOURS, np.zeros(COLOURS.size), -v_i])
    inner = slice(*np.searchsorted(NODES, [BAND_NODES[0], BAND_NODES[-1] + 0.5]))
    logarithm = np.zeros((len(_BANDS), COLOURS.size))
    spectra = black
    # Each band answers to its own value above all, so that this closes in on the solution quickly.
    for _ in range(40):
        off = np.stack([magnitude(spectra[:, inner], band) for band in _BANDS]) - wanted
        logarithm += 0.4 * np.log(10.0) * off
        at_knots = logarithm[[0, 1, 1, 2, 3]]
        spectra = black * np.exp(np.stack([np.interp(NODES, _KNOTS, column) for column in at_knots.T]))
    spectra *= 10 ** (0.4 * magnitude(spectra[:, inner], "V"))[:, None]
    spectra.flags.writeable = False
    return spectra
