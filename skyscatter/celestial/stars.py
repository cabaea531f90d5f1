"""Stars as an observer sees them: the bright ones of Hipparcos, and fainter ones of a user's own file."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial.frames import J2000, Array, SkyFrame
from skyscatter.celestial.starnames import NAMES
from skyscatter.celestial.starspectra import star_spectra
from skyscatter.datafiles import data_path
from skyscatter.errors import DomainError, TableFileError
from skyscatter.tablefile import Wanted, column_names, read_columns
from skyscatter.units import ANGLE, Measure

#: V to which the shipped catalogue goes.
SHIPPED_LIMIT = 7.0
#: Epoch [year] of its places; it counts from J2000 where a user's file says nothing.
EPOCH = 1991.25

_MAGNITUDE = Measure("magnitude", "", {"mag": 1.0}, "7.4", low=-30.0, high=40.0)
_MOTION = Measure(
    "proper motion", "mas/yr",
    {"mas/yr": 1.0, "mas yr-1": 1.0, "mas.yr-1": 1.0, "mas.yr**-1": 1.0, "arcsec/yr": 1e3, "arcsec yr-1": 1e3},
    "12 mas/yr",
)  # fmt: skip
_YEAR = Measure("year", "", {"yr": 1.0, "year": 1.0}, "2016.0", low=1800.0, high=2200.0)
_NEEDED = {
    "ra": Wanted(("RA", "RAJ2000", "ra_icrs", "RA_ICRS"), ANGLE.within(-360.0, 360.0)),
    "dec": Wanted(("DEC", "Dec", "DEJ2000", "de_icrs", "DE_ICRS"), ANGLE.within(-90.0, 90.0)),
    "V": Wanted(("Vmag", "mag", "magnitude"), _MAGNITUDE),
    "B_V": Wanted(("B-V", "bv", "colour", "color"), _MAGNITUDE),
}
_OPTIONAL = {
    "pm_ra": Wanted(("pmRA", "pmra"), _MOTION),
    "pm_dec": Wanted(("pmDE", "pmDEC", "pmdec"), _MOTION),
    "epoch": Wanted(("Epoch",), _YEAR),
}


@dataclass(frozen=True)
class Stars:
    """Stars above and below the horizon, brightest first; `stars_at` makes them.

    Examples
    --------
    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.stars import stars_at
    >>> stars = stars_at(Sight(48.86, 2.35, "2026-01-12T22:00Z"), limit=1.5)
    >>> [name for name, up in zip(stars.names, stars.directions[:, 2] > 0.5) if up]  # above 30 degrees
    ['Capella', 'Rigel', 'Procyon', 'Betelgeuse', 'Aldebaran', 'Pollux']
    >>> stars.irradiance([450.0, 550.0, 650.0]).shape
    (23, 3)
    """

    directions: Array  #: apparent, unrefracted (east, north, up), shape (star, 3)
    magnitudes: Array  #: in V, outside the air, shape (star,)
    colours: Array  #: B - V, shape (star,)
    names: tuple[str, ...]  #: proper names, empty for most
    numbers: Array = field(repr=False)  #: in Hipparcos, 0 for stars of a user's file; shape (star,)

    def __len__(self) -> int:
        return len(self.magnitudes)

    def irradiance(self, wavelengths: ArrayLike) -> Array:
        """Light of each star on a surface that faces it, outside the atmosphere.

        Parameters
        ----------
        wavelengths : array_like, shape (wavelength,)
            Vacuum wavelengths [nm], 280 to 4000; averaged over their cells.

        Returns
        -------
        ndarray, shape (star, wavelength)
            [W m-2 nm-1]; magnitude 0 in V is 3.631e-11 averaged over the band.  `star_spectra` says how the spectra
            are made.
        """
        return 10 ** (-0.4 * self.magnitudes)[:, None] * star_spectra(self.colours, wavelengths)


def stars_at(sight: SkyFrame, limit: float = SHIPPED_LIMIT, catalogue: str | os.PathLike[str] | None = None) -> Stars:
    """Stars for a place and a moment.

    Parameters
    ----------
    sight : SkyFrame
        A `skyscatter.celestial.frames.Sight`, or one from Mars.
    limit : float
        Stars of lower V than this.
    catalogue : path, optional
        CSV or FITS file with fainter stars; those of V below 7 in it are left out, for they are shipped.  Columns are
        ``ra`` and ``dec`` with the unit ``[deg]`` (ICRS), ``V`` and ``B_V`` [mag], and if wanted ``pm_ra`` (with the
        cosine of the declination in it) and ``pm_dec`` ``[mas/yr]`` and ``epoch`` [year] of the place, 2000 unless
        given.  ``RAJ2000``, ``DEJ2000``, ``Vmag``, ``B-V``, ``pmRA`` and ``pmDE`` are understood as well.

    Returns
    -------
    Stars

    Raises
    ------
    DomainError
        For a limit beyond 7 without a file, or one that is not a number.
    TableFileError
        For a file that cannot be read, or lacks a column or a unit.

    Notes
    -----
    Proper motion to the date, no parallax (0.75 arcsec for the nearest star, 0.1 for most bright ones) and no radial
    velocity.  Magnitudes of variable stars are those of the years 1990 to 1993.

    Examples
    --------
    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.stars import stars_at
    >>> stars = stars_at(Sight(-24.6, -70.4, "2026-04-12T03:00Z"), limit=6.0)
    >>> len(stars), stars.names[:3], stars.magnitudes[:3].round(2).tolist()
    (5037, ('Sirius', 'Canopus', 'Arcturus'), [-1.46, -0.61, -0.05])
    """
    if not np.isfinite(limit):
        raise DomainError("limit", limit, "a magnitude")
    if limit > SHIPPED_LIMIT and catalogue is None:
        raise DomainError(
            "limit", limit, f"the shipped stars end at {SHIPPED_LIMIT:g}; give a catalogue of fainter ones"
        )
    parts = [_shipped()]
    if catalogue is not None:
        parts.append(_users(os.fspath(catalogue)))
    ra, dec, pm_ra, pm_dec, epoch, v, b_v, number = np.concatenate(parts, axis=1)
    kept = np.flatnonzero(v < limit)
    kept = kept[np.argsort(v[kept], kind="stable")]
    years = 2000.0 + ((sight.state.tt[0] - J2000) + sight.state.tt[1]) / 365.25 - epoch[kept]
    towards = _moved(ra[kept], dec[kept], years[:, None] * np.stack([pm_ra[kept], pm_dec[kept]], axis=1))
    names = tuple(NAMES.get(int(hip), "") for hip in number[kept])
    return Stars(sight.horizontal(towards), v[kept], b_v[kept], names, number[kept])


def _moved(ra: Array, dec: Array, motion: Array) -> Array:
    """Unit vectors in ICRS of places [degree] after motions [mas] to the east and north."""
    a, d = np.radians(ra), np.radians(dec)
    east = np.stack([-np.sin(a), np.cos(a), np.zeros_like(a)], axis=1)
    north = np.stack([-np.sin(d) * np.cos(a), -np.sin(d) * np.sin(a), np.cos(d)], axis=1)
    place = np.stack([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)], axis=1)
    angle = motion * (np.pi / 648_000_000.0)
    place += angle[:, :1] * east + angle[:, 1:] * north
    return np.asarray(place / np.linalg.norm(place, axis=1, keepdims=True))


@lru_cache(maxsize=1)
def _shipped() -> Array:
    """Rows ra, dec [degree], proper motions [mas per year], epoch, V, B - V and number; shape (8, star)."""
    with np.load(data_path("stars.npz"), allow_pickle=False) as t:
        rows = [1e-7 * t["ra"], 1e-7 * t["dec"], t["pm_ra"], t["pm_dec"], np.full(t["ra"].size, EPOCH)]
        return np.stack([*rows, 1e-3 * t["v"], 1e-3 * t["b_v"], t["hip"]]).astype(float)


def _users(path: str) -> Array:
    """As `_shipped`, from a user's file: its stars that are not shipped."""
    names = column_names(path)
    chosen = {field: _column(names, field, want) for field, want in (_NEEDED | _OPTIONAL).items()}
    for name, want in _NEEDED.items():
        if not chosen[name]:
            words = " or ".join(dict.fromkeys((name, *want.names)))
            raise TableFileError(path, f"has no column {words}; there are {', '.join(names)}")
    wanted = {name: want for name, want in (_NEEDED | _OPTIONAL).items() if chosen[name]}
    columns = read_columns(path, wanted, {name: chosen[name] for name in wanted})
    read = {name: np.array(values) for name, values in columns.items()}
    rest = np.zeros(read["V"].size)
    rows = [
        read["ra"],
        read["dec"],
        read.get("pm_ra", rest),
        read.get("pm_dec", rest),
        read.get("epoch", rest + 2000.0),
    ]
    table = np.stack([*rows, read["V"], read["B_V"], rest])
    return table[:, read["V"] >= SHIPPED_LIMIT]


def _column(names: tuple[str, ...], field: str, want: Wanted) -> str:
    """Which of a file's columns has what a field wants; empty if none has."""
    lowered = {name.lower(): name for name in names}
    return next((lowered[name.lower()] for name in (field, *want.names) if name.lower() in lowered), "")
