"""Make data/ussa1976.csv: the U.S. Standard Atmosphere 1976 from the ground to 120 km.  Needs: numpy, scipy.

Source: NOAA-S/T 76-1562, U.S. Standard Atmosphere, 1976 (U.S. Government, public domain).  To 86 km the standard's
own hydrostatic layers (Table 4, equations 18, 33a, 33b); above, its temperature law (equations 25, 27, 29) and the
pressures of its Table I at the altitudes typed below, joined by a monotone cubic in the logarithm.
"""

from __future__ import annotations

import numpy as np
from _table import write_table
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]
EARTH_RADIUS = 6356766.0  # m, equation 18
GRAVITY, GAS_CONSTANT, MOLAR_MASS, BOLTZMANN = 9.80665, 8.31432, 0.0289644, 1.380622e-23  # the standard's own values
BASES = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3, 84852.0])  # geopotential metres, Table 4
LAPSES = np.array([-6.5e-3, 0.0, 1.0e-3, 2.8e-3, 0.0, -2.8e-3, -2.0e-3])  # K per geopotential metre
HIGH_ALTITUDE = np.array([86e3, 90e3, 95e3, 100e3, 105e3, 110e3, 115e3, 120e3])
HIGH_PRESSURE = np.array([0.37338, 0.18359, 7.5966e-2, 3.2011e-2, 1.4477e-2, 7.1042e-3, 4.0096e-3, 2.5382e-3])


def low(altitude: Array) -> tuple[Array, Array]:
    """Kinetic temperature [K] and pressure [Pa] to 86 km."""
    h = EARTH_RADIUS * altitude / (EARTH_RADIUS + altitude)
    temperatures, pressures = [288.15], [101325.0]
    for base, top, lapse in zip(BASES[:-1], BASES[1:], LAPSES, strict=True):
        t, p = _layer(top - base, temperatures[-1], pressures[-1], lapse)
        temperatures.append(float(t))
        pressures.append(float(p))
    index = np.clip(np.searchsorted(BASES, h, side="right") - 1, 0, len(LAPSES) - 1)
    both = [_layer(x - BASES[i], temperatures[i], pressures[i], LAPSES[i]) for x, i in zip(h, index, strict=True)]
    molecular, pressure = np.array(both).T
    # Molar mass falls from 80 to 86 km (Table 8, ratio 0.999579 at 86 km); a parabola is within 1e-4 of the table.
    ratio = 1.0 - 4.21e-4 * np.clip((altitude - 80e3) / 6e3, 0.0, 1.0) ** 2
    return molecular * ratio, pressure


def _layer(rise: float, temperature: float, pressure: float, lapse: float) -> tuple[float, float]:
    exponent = GRAVITY * MOLAR_MASS / GAS_CONSTANT
    if lapse == 0.0:
        return temperature, pressure * float(np.exp(-exponent * rise / temperature))
    top = temperature + lapse * rise
    return top, pressure * float((temperature / top) ** (exponent / lapse))


def high(altitude: Array) -> tuple[Array, Array]:
    """Kinetic temperature [K] and pressure [Pa] from 86 to 120 km."""
    ellipse = 263.1905 - 76.3232 * np.sqrt(np.clip(1.0 - ((altitude - 91e3) / 19942.9) ** 2, 0.0, None))
    upper = np.where(altitude < 110e3, ellipse, 240.0 + (altitude - 110e3) * 12e-3)
    temperature = np.where(altitude < 91e3, 186.8673, upper)
    nodes = np.concatenate([[80e3, 83e3], HIGH_ALTITUDE])
    pressures = np.concatenate([low(nodes[:2])[1], HIGH_PRESSURE])
    return temperature, np.exp(PchipInterpolator(nodes, np.log(pressures))(altitude))


def main() -> None:
    """Rows every 500 m, and at the kinks between the layers so that interpolation does not cut them."""
    kinks = EARTH_RADIUS * BASES[1:-1] / (EARTH_RADIUS - BASES[1:-1])
    altitude = np.unique(np.concatenate([np.arange(0.0, 120001.0, 500.0), kinks, [91e3, 110e3]]))
    split = np.searchsorted(altitude, 86e3)
    parts = [low(altitude[:split]), high(altitude[split:])]
    temperature, pressure = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    number = pressure / (BOLTZMANN * temperature)
    write_table(
        "ussa1976.csv",
        [
            "U.S. Standard Atmosphere 1976 (NOAA-S/T 76-1562, public domain), geometric altitude; to 86 km computed",
            "from its layer formulas, above from its temperature law and typed pressures (Table I, every 4-5 km).",
            "Units: m, K, Pa, m-3. Interpolate temperature linearly, pressure and number density in the logarithm",
            "(within 1e-3 of the layer formulas). Script: tools/make_ussa1976.py",
        ],
        ["altitude", "temperature", "pressure", "number_density"],
        [
            (f"{z:.10g}", f"{t:.3f}", f"{p:.6g}", f"{n:.6g}")
            for z, t, p, n in zip(altitude, temperature, pressure, number, strict=True)
        ],
    )


if __name__ == "__main__":
    main()
