"""Constants of nature and of astronomy, in SI units."""

from __future__ import annotations

import math

PLANCK = 6.62607015e-34  #: [J s], exact (SI 2019)
LIGHT = 299792458.0  #: [m s-1], exact
BOLTZMANN = 1.380649e-23  #: [J K-1], exact
ELECTRON_VOLT = 1.602176634e-19  #: [J], exact
STEFAN_BOLTZMANN = 2 * math.pi**5 * BOLTZMANN**4 / (15 * PLANCK**3 * LIGHT**2)  #: [W m-2 K-4]
SOLAR_LUMINOSITY = 3.828e26  #: nominal luminosity of the Sun [W], IAU 2015 resolution B3
