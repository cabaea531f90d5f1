"""One band of a sensor: its response over wavelength, and averages over it that need few wavelengths.

A band sees the mean of the reflectance spectrum, weighted by its response times the Sun's spectrum,

    rho_band = int rho(lambda) R(lambda) E0(lambda) dlambda / int R(lambda) E0(lambda) dlambda,

with R a response per energy.  Path reflectance, transmittance and spherical albedo are smooth across a band, so that
the Gauss quadrature for the weight R E0 takes two or three wavelengths where a plain sum takes fifty; what gases absorb
is not smooth and is averaged over all samples (`Band.samples`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.record import Record
from skyscatter.spectra.solar import SOLAR_SPECTRA, solar_irradiance

Array = NDArray[np.float64]

Role = Literal[
    "coastal", "blue", "green", "red", "rededge", "nir", "nir-narrow", "water-vapour", "cirrus", "swir1", "swir2",
    "pan", "other",
]  # fmt: skip

#: Exponent of the shape that stands for a band of which only centre and width are known.  Against the response curves
#: of Sentinel-2A and 2B an exponent of 8 gives the effective wavelength within 0.1 nm, the standard deviation over
#: wavelength within 8 % and Rayleigh's optical depth within 0.1 % in all bands but B08, whose response falls towards
#: the infrared (0.3 nm, 7 %, 0.25 %).
SHAPE_EXPONENT = 8.0

#: Centres [nm] for which a role is presumed where none is given.
_ROLE_RANGES: tuple[tuple[float, float, Role], ...] = (
    (400, 452, "coastal"), (452, 515, "blue"), (515, 605, "green"), (605, 695, "red"), (695, 792, "rededge"),
    (792, 905, "nir"), (905, 980, "water-vapour"), (1350, 1400, "cirrus"), (1500, 1800, "swir1"), (2000, 2400, "swir2"),
)  # fmt: skip
_PAN_WIDTH = 130.0  # a visible band wider than this is panchromatic [nm]
_STEP = 0.5  # of the samples [nm]; lines of the Sun's table lie 0.5 to 5 nm apart


class Band(Record):
    """Response of one band: linear between its nodes, zero outside them.

    Parameters
    ----------
    name : str
    role : str
        What the band is good for: ``"blue"``, ``"nir"``, ``"cirrus"`` and so on; see `Role`.
    wavelengths : tuple of float
        Nodes [nm], ascending, inside the Sun's table (280 to 4000 nm).
    response : tuple of float
        Relative response per energy at the nodes, not negative.
    centre_nm, width_nm : float
        Centre, and full width at half of the highest response [nm]; as published where they are.
    approximate : bool
        Whether the response is a shape made from centre and width rather than a measured curve.
    note : str
        Where the numbers come from.

    Examples
    --------
    A red band of which centre and width are known; the Sun's spectrum falls across it.  Two wavelengths stand for all.

    >>> from skyscatter.dehaze import Band
    >>> red = Band.from_shape("red", 665, 30)
    >>> red.role, round(red.effective_wavelength, 1)  # nm
    ('red', 664.9)
    >>> red.nodes(2)[0].round()
    array([656., 674.])
    >>> round(red.solar_irradiance, 2)  # W m-2 nm-1, at 1 au
    1.53
    """

    name: str = Field(min_length=1)
    role: Role = "other"
    wavelengths: tuple[float, ...]
    response: tuple[float, ...]
    centre_nm: float = Field(gt=0.0)
    width_nm: float = Field(gt=0.0)
    approximate: bool = False
    note: str = ""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.wavelengths) != len(self.response) or len(self.wavelengths) < 2:
            raise ValueError(f"band {self.name}: wavelengths and response need the same length, at least 2")
        if np.any(np.diff(self.wavelengths) <= 0):
            raise ValueError(f"band {self.name}: wavelengths must increase")
        if min(self.response) < 0 or max(self.response) <= 0:
            raise ValueError(f"band {self.name}: the response must not be negative, nor zero everywhere")
        low, high = _sun_range()
        if self.wavelengths[0] < low or self.wavelengths[-1] > high:
            rule = f"band {self.name}: between {low:g} and {high:g} nm, where the Sun's spectrum is tabulated"
            raise DomainError("wavelength", (self.wavelengths[0], self.wavelengths[-1]), rule)
        return self

    @classmethod
    def from_table(
        cls, name: str, wavelengths_nm: Array, response: Array, role: Role | None = None, note: str = ""
    ) -> Self:
        """Band of a tabulated response; centre and width are measured on it, the role presumed from the centre."""
        wl, r = np.asarray(wavelengths_nm, dtype=float), np.asarray(response, dtype=float)
        if wl.shape != r.shape or wl.ndim != 1 or not r.size or not r.max() > 0:
            raise DomainError("response", name, "one value for each wavelength, not zero everywhere")
        if np.any(np.diff(wl) <= 0) or r.min() < 0:
            raise DomainError("response", name, "wavelengths must increase and responses must not be negative")
        inside = np.flatnonzero(r > 0)
        part = slice(max(inside[0] - 1, 0), inside[-1] + 2)
        wl, r = wl[part], r[part]
        centre = float(np.trapezoid(wl * r, wl) / np.trapezoid(r, wl))
        width = _width(wl, r)
        return cls(
            name=name,
            role=role or presumed_role(centre, width),
            wavelengths=tuple(wl.tolist()),
            response=tuple(r.tolist()),
            centre_nm=centre,
            width_nm=width,
            note=note,
        )

    @classmethod
    def from_shape(
        cls,
        name: str,
        centre_nm: float,
        width_nm: float,
        role: Role | None = None,
        exponent: float = SHAPE_EXPONENT,
        note: str = "",
    ) -> Self:
        """Band of which centre and full width at half maximum are known, flagged as approximate.

        ``R = exp(-ln 2 |2 (lambda - centre) / width|^exponent)``: 2 is a Gaussian, a large exponent a box.
        """
        if not 0 < width_nm < centre_nm or not exponent > 0:
            rule = "a width above 0 and below the centre, an exponent above 0"
            raise DomainError("width_nm", width_nm, rule)
        reach = 0.5 * width_nm * np.log2(1e4) ** (1.0 / exponent)  # to a response of 1e-4
        wl = np.linspace(centre_nm - reach, centre_nm + reach, 2 * max(int(np.ceil(reach / _STEP)), 40) + 1)
        response = np.exp2(-(np.abs(2.0 * (wl - centre_nm) / width_nm) ** exponent))
        return cls(
            name=name,
            role=role or presumed_role(centre_nm, width_nm),
            wavelengths=tuple(wl.tolist()),
            response=tuple(response.tolist()),
            centre_nm=centre_nm,
            width_nm=width_nm,
            approximate=True,
            note=note or "shape from centre and width",
        )

    def samples(self) -> tuple[Array, Array]:
        """Wavelengths [nm] at most 0.5 nm apart and their shares in the band's light, summing to 1; (sample,) each."""
        wl, weights, _ = _samples(self)
        return wl, weights

    def nodes(self, n: int = 2) -> tuple[Array, Array]:
        """Gauss quadrature for the weight response times solar irradiance.

        Exact for polynomials in wavelength of degree 2 n - 1 (against `samples`).  Three-term recurrence by the
        procedure of Stieltjes, nodes and weights from the Jacobi matrix (Golub & Welsch 1969, Mathematics of
        Computation 23, 221).

        Parameters
        ----------
        n : int
            Number of wavelengths, 1 to 20.

        Returns
        -------
        wavelengths, weights : ndarray, shape (n,) each
            [nm], ascending; weights are positive and sum to 1.
        """
        if not 1 <= n <= 20:
            raise DomainError("n", n, "1 to 20 wavelengths")
        wl, weights = _gauss(self, int(n))
        return wl.copy(), weights.copy()

    @property
    def effective_wavelength(self) -> float:
        """Mean wavelength of the light that the band sees outside the atmosphere [nm]: the node of order 1."""
        return float(self.nodes(1)[0][0])

    @property
    def solar_irradiance(self) -> float:
        """The Sun's spectral irradiance at 1 au averaged over the response [W m-2 nm-1].

        Turns radiance into reflectance, rho = pi L d^2 / (E0 cos(sun zenith)), with d the distance in au.
        """
        return _samples(self)[2]


def presumed_role(centre_nm: float, width_nm: float) -> Role:
    """Role of a band by its centre and width."""
    if width_nm > _PAN_WIDTH and centre_nm < 800:
        return "pan"
    return next((role for low, high, role in _ROLE_RANGES if low <= centre_nm < high), "other")


def _sun_range() -> tuple[float, float]:
    nodes = read_table(SOLAR_SPECTRA["astm-g173"])["wavelength_nm"]
    return float(nodes[0]), float(nodes[-1])


def _width(wl: Array, response: Array) -> float:
    """Distance of the outermost crossings of half the highest response."""
    half = 0.5 * float(response.max())
    above = np.flatnonzero(response >= half)
    first, last = int(above[0]), int(above[-1])
    low, high = wl[first], wl[last]
    if first > 0:
        low = np.interp(half, response[first - 1 : first + 1], wl[first - 1 : first + 1])
    if last < wl.size - 1:
        high = np.interp(-half, -response[last : last + 2], wl[last : last + 2])
    return float(high - low) if high > low else float(wl[-1] - wl[0]) / 2


@lru_cache(maxsize=256)
def _samples(band: Band) -> tuple[Array, Array, float]:
    """Wavelengths, weights that sum to 1, and the mean irradiance; a trapezoid over all kinks of both curves."""
    nodes = np.asarray(band.wavelengths)
    sun = read_table(SOLAR_SPECTRA["astm-g173"])["wavelength_nm"]
    count = int(np.ceil((nodes[-1] - nodes[0]) / _STEP)) + 1
    between = sun[(sun > nodes[0]) & (sun < nodes[-1])]
    wl = np.unique(np.concatenate([nodes, between, np.linspace(nodes[0], nodes[-1], max(count, 41))]))
    response = np.interp(wl, nodes, band.response)
    cell = np.zeros_like(wl)
    cell[:-1] += 0.5 * np.diff(wl)
    cell[1:] += 0.5 * np.diff(wl)
    light = cell * response * solar_irradiance(wl, band="point")
    keep = light > 0
    wl, weights = wl[keep], light[keep] / light.sum()
    wl.flags.writeable = weights.flags.writeable = False
    return wl, weights, float(light.sum() / (cell * response).sum())


@lru_cache(maxsize=1024)
def _gauss(band: Band, n: int) -> tuple[Array, Array]:
    wl, weights, _ = _samples(band)
    middle, scale = 0.5 * (wl[0] + wl[-1]), 0.5 * (wl[-1] - wl[0])
    x = (wl - middle) / scale  # on -1 to 1, where the recurrence is well conditioned
    diagonal, off = np.zeros(n), np.zeros(n)
    before, now, norm = np.zeros_like(x), np.ones_like(x), 1.0
    for k in range(n):  # Stieltjes: p_{k+1} = (x - a_k) p_k - b_k p_{k-1}
        diagonal[k] = weights @ (x * now * now) / norm
        before, now = now, (x - diagonal[k]) * now - (off[k - 1] ** 2 if k else 0.0) * before
        following = float(weights @ (now * now))
        off[k] = np.sqrt(following / norm)
        norm = following
    jacobi = np.diag(diagonal) + np.diag(off[:-1], 1) + np.diag(off[:-1], -1)
    values, vectors = np.linalg.eigh(jacobi)
    shares = vectors[0] ** 2
    return middle + scale * values, shares / shares.sum()
