"""Scratch arrays of the kernels, made once per call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address


@by_address
class Work(NamedTuple):
    """What a kernel writes down between two steps."""

    density: np.ndarray  #: (component,) at the current point
    along: np.ndarray  #: (component,) columns from the start of a line [m]
    from_start: np.ndarray  #: (component,) columns outward from its start [m]
    across: np.ndarray  #: (component,) twice the columns outward from its lowest point [m]
    to_sun: np.ndarray  #: (component,) columns to the Sun [m]
    spare: np.ndarray  #: (component,)
    phase: np.ndarray  #: (component, wavelength) phase functions at an angle [sr-1]
    weighted: np.ndarray  #: (component, wavelength) the same times scattering per unit density [m-1 sr-1]
    through: np.ndarray  #: (wavelength,) transmittance along the line
    sun: np.ndarray  #: (wavelength,) transmittance to the Sun
    scattering: np.ndarray  #: (wavelength,) scattering coefficient at the point [m-1]
    towards: np.ndarray  #: (wavelength,) the same times the phase function [m-1 sr-1]
    emitted: np.ndarray  #: (wavelength,) emission at the point
    source: np.ndarray  #: (wavelength,)
    fine: np.ndarray  #: (wavelength,)
    coarse: np.ndarray  #: (wavelength,)


def make_work(components: int, wavelengths: int) -> Work:
    """Scratch arrays for a scene of that size."""
    return Work(
        np.zeros(components), np.zeros(components), np.zeros(components), np.zeros(components),
        np.zeros(components), np.zeros(components), np.zeros((components, wavelengths)),
        np.zeros((components, wavelengths)), np.zeros(wavelengths), np.zeros(wavelengths), np.zeros(wavelengths),
        np.zeros(wavelengths), np.zeros(wavelengths), np.zeros(wavelengths), np.zeros(wavelengths),
        np.zeros(wavelengths),
    )  # fmt: skip
