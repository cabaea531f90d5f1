"""Make data/lamps.csv: spectra of street lamps and room lamps.  Needs: colour-science.

Illuminants of CIE 15:2018 as published with colour-science (BSD-3-Clause): HP1 (high-pressure sodium), HP5 (metal
halide), FL2 and FL11 (fluorescent), LED-B1 and LED-B3 (phosphor-converted LEDs).  The two others are computed: an
incandescent lamp by Planck's law at 2856 K (CIE standard illuminant A), and low-pressure sodium as its D doublet.
"""

from __future__ import annotations

import numpy as np
from _table import write_table

WAVELENGTHS = np.arange(380, 781)
#: Column -> name of the illuminant.
ILLUMINANTS = {
    "high-pressure-sodium": "HP1",
    "metal-halide": "HP5",
    "fluorescent": "FL2",
    "triphosphor": "FL11",
    "led-2700k": "LED-B1",
    "led-4000k": "LED-B3",
}
#: The D lines in vacuum [nm] (Kramida et al., NIST Atomic Spectra Database), taken as equally strong.
SODIUM = (589.1583, 589.7558)
SECOND_RADIATION = 1.4388e-2  #: c2 of the CIE's definition of illuminant A [m K]
TEMPERATURE = 2856.0


def planck() -> np.ndarray:
    """Shape of the spectrum of a black body."""
    metre = WAVELENGTHS * 1e-9
    return metre**-5 / np.expm1(SECOND_RADIATION / (metre * TEMPERATURE))


def sodium() -> np.ndarray:
    """The doublet on the grid: linear between its nodes with the power and the mean wavelength of the lines."""
    values = np.zeros(WAVELENGTHS.size)
    for line in SODIUM:
        k = int(np.floor(line - WAVELENGTHS[0]))
        share = line - WAVELENGTHS[k]
        values[k] += 1 - share
        values[k + 1] += share
    return values


def main() -> None:
    """Write every spectrum with an integral of 1 over 380 to 780 nm."""
    import colour

    columns = {}
    for name, illuminant in ILLUMINANTS.items():
        spectrum = colour.SDS_ILLUMINANTS[illuminant]
        columns[name] = np.interp(WAVELENGTHS, spectrum.wavelengths, spectrum.values)
    columns |= {"incandescent": planck(), "low-pressure-sodium": sodium()}
    shapes = [values / np.trapezoid(values, WAVELENGTHS) for values in columns.values()]
    write_table(
        "lamps.csv",
        [
            "Spectra of lamps, each with an integral of 1 from 380 to 780 nm. Units: nm, nm-1 (power per wavelength).",
            "CIE 15:2018 illuminants " + ", ".join(f"{new} = {old}" for new, old in ILLUMINANTS.items()) + ",",
            "as shipped by colour-science (BSD-3-Clause), linear between their nodes 5 nm apart;",
            "incandescent = Planck's law at 2856 K; low-pressure-sodium = the D doublet alone, within 2 nm.",
            "Script: tools/make_lamps.py",
        ],
        ["wavelength_nm", *columns],
        [(str(wl), *(f"{shape[k]:.4g}" for shape in shapes)) for k, wl in enumerate(WAVELENGTHS)],
    )


if __name__ == "__main__":
    main()
