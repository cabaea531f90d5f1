"""From spectra without gas bands to what a broadband instrument reads.

The model's spectrum holds air, aerosol and ozone.  Water vapour and the mixed gases (O2, CO2, CH4, ...) are put on
top, as factors: for each interval of the band model of `optics.gasbands` (data/gas_bands.csv) the transmittance along
the Sun's beam.  Diffuse light, which has gone another way through the vapour, gets the same factor; under a clear
sky that is a tenth of the light, mostly at wavelengths without strong bands.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.inversion.distributions import Distribution, LogNormal
from skyscatter.optics.gasbands import LARGEST_ZENITH, STANDARD_PRESSURE, gas_bands, mixed_air_mass, water_air_mass
from skyscatter.scene import Star

Array = NDArray[np.float64]

#: Vertical column of water vapour [g cm-2]: over land between 0.3 and 5.
PRECIPITABLE_WATER: dict[str, tuple[float, Distribution]] = {"precipitable_water": (1.5, LogNormal(1.5, 0.6))}
#: Nodes [nm] between which the ratio of flux to sunlight is smooth once lines are left out; dense where air and ozone
#: change it.
NODES = (
    290.0, 297.0, 303.0, 309.0, 315.0, 325.0, 340.0, 360.0, 385.0, 420.0, 460.0, 505.0, 550.0, 600.0, 660.0, 740.0,
    860.0, 1050.0, 1350.0, 1700.0, 2490.0,
)  # fmt: skip


@dataclass(frozen=True)
class Broadband:
    """A sum over the solar spectrum.

    Attributes
    ----------
    low, high : float
        The instrument's band [nm].  Beyond 2490 nm, where the table of gases ends, there is 0.8 % of what reaches
        the ground of the standard spectrum ASTM G173.
    pressure_hpa : float
        At the ground; scales the mixed gases.
    nodes : tuple of float
        Wavelengths [nm] at which the model is computed; in between the ratio of flux to sunlight is linear.

    Examples
    --------
    Sunlight from the zenith through water vapour (0.5 and 4 g cm-2) and mixed gases alone [W m-2]: a wet sky takes away
    infrared light, next to nothing of the visible.

    >>> import numpy as np
    >>> import skyscatter
    >>> from skyscatter.inversion import Broadband
    >>> star = skyscatter.load_model("earth").star
    >>> for band in (Broadband(), Broadband(400, 700)):
    ...     ratio = np.ones((1, band.wavelengths.size))
    ...     print([round(float(band.total(ratio, np.array([90.0]), water, star)[0]), -1) for water in (0.5, 4.0)])
    [1220.0, 1140.0]
    [530.0, 530.0]
    """

    low: float = 290.0
    high: float = 2490.0
    pressure_hpa: float = 1013.25
    nodes: tuple[float, ...] = NODES

    def __post_init__(self) -> None:
        if not (NODES[0] <= self.low < self.high <= NODES[-1]):
            rule = f"a band between {NODES[0]:g} and {NODES[-1]:g} nm, where the gases are tabulated"
            raise DomainError("broadband", f"{self.low:g} to {self.high:g} nm", rule)

    @property
    def wavelengths(self) -> Array:
        """Nodes that the band needs [nm]."""
        nodes = np.array(self.nodes)
        first = max(int(np.searchsorted(nodes, self.low, side="right")) - 1, 0)
        last = min(int(np.searchsorted(nodes, self.high, side="left")), nodes.size - 1)
        return np.asarray(nodes[first : last + 1], float)

    @cached_property
    def _fine(self) -> tuple[Array, Array, Array]:
        """Wavelengths of the intervals of the band model [nm], their widths [nm], and the share of each node."""
        row = np.sort(read_table("gas_bands.csv")["wavelength_nm"])
        wl = np.concatenate([np.arange(self.low, row[0], 1.0), row])  # without bands below the table's first interval
        wl = wl[(wl >= self.low) & (wl <= self.high)]
        edges = np.concatenate([[self.low], 0.5 * (wl[1:] + wl[:-1]), [self.high]])
        shares = np.stack([np.interp(wl, self.wavelengths, unit) for unit in np.eye(self.wavelengths.size)], axis=1)
        return wl, np.diff(edges), shares

    def total(self, ratio: Array, elevation_deg: Array, water: float, star: Star) -> Array:
        """Broadband flux (datum,) [W m-2].

        Parameters
        ----------
        ratio : ndarray, shape (datum, node)
            Flux at `wavelengths` over the star's irradiance at its own distance.
        elevation_deg : ndarray, shape (datum,)
            Of the Sun.
        water : float
            Vertical column of water vapour [g cm-2].
        star : Star
        """
        zenith = np.minimum(90.0 - elevation_deg, LARGEST_ZENITH)
        wl, widths, shares = self._fine
        gas = gas_bands(
            wl, mixed_air_mass(zenith) * self.pressure_hpa / STANDARD_PRESSURE, water * water_air_mass(zenith)
        )
        energy = star.irradiance(wl, star.distance) * widths
        return np.asarray(np.einsum("dn,wn,w,dw->d", ratio, shares, energy, gas, optimize=True))
