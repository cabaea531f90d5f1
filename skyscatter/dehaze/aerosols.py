"""Aerosols by name: mixtures of a few sorts of spheres whose optical depth at 550 nm is given.

`continental`, `maritime` and `urban` are the mixtures of the World Meteorological Organization (WCP-112, 1986): four
basic components by volume, which is how the 6S code has them (Vermote et al. 1997, IEEE Trans. Geosci. Remote Sensing
35, 675).  Sizes and refractive indices of the components are those of d'Almeida, Koepke & Shettle 1991, as in 6SV 1.1:
with them Mie theory reproduces that code's cross sections to 0.2 %.  `desert`, `biomass-burning` and ten more
places are two modes each after the climatology of Dubovik et al. 2002 (J. Atmos. Sci. 59, 590, table 1), recalled; that
the albedos which follow agree with those of the table within 0.04 is a test.

All are spheres, which is untrue of desert dust: its backscatter is overestimated by Mie theory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import erf, exp, log, sqrt
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.datafiles import read_table
from skyscatter.dehaze.ownaerosol import SUFFIXES, is_file, read_aerosol
from skyscatter.errors import DomainError
from skyscatter.media.fields import Exponential
from skyscatter.media.medium import Component
from skyscatter.optics.mie import LogNormalMode, MieAerosol
from skyscatter.optics.particles import Particles
from skyscatter.record import nearest
from skyscatter.spectra.table import SpectralTable

Array = NDArray[np.float64]
AerosolName = Literal["continental", "maritime", "urban", "desert", "biomass-burning"]

SCALE_HEIGHT = 2000.0  #: of every aerosol [m], the default of 6S
REFERENCE_NM = 550.0

#: Median radius by number [m] and geometric standard deviation of the basic components (d'Almeida et al. 1991).
_SIZES = {
    "dust-like": (0.471e-6, 2.512),
    "water-soluble": (0.0285e-6, 2.239),
    "oceanic": (0.30e-6, 2.51),
    "soot": (0.0118e-6, 2.00),
}
#: Particles outside do not count [m]: the limits of d'Almeida et al. 1991 and OPAC above, those of 6S below.
_SMALLEST, _LARGEST = 1e-9, 20e-6
#: Share of the components in the volume (WCP-112).
_VOLUMES: dict[str, dict[str, float]] = {
    "continental": {"dust-like": 0.70, "water-soluble": 0.29, "soot": 0.01},
    "maritime": {"water-soluble": 0.05, "oceanic": 0.95},
    "urban": {"dust-like": 0.17, "water-soluble": 0.61, "soot": 0.22},
}


class _Column(NamedTuple):
    """Size distribution over a site: volumes per area [um], median radii by volume [um], widths (standard deviations of
    the logarithm), n, and k at 440, 670, 870, 1020 nm.
    """

    volumes: tuple[float, float]
    radii: tuple[float, float]
    widths: tuple[float, float]
    n: float
    k: tuple[float, float, float, float]


def _grey(value: float) -> tuple[float, float, float, float]:
    return (value,) * 4


#: By name: `desert` is Solar Village (Saudi Arabia), `biomass-burning` the Amazonian forest.  Radii and volumes are
#: those at an optical depth of 0.5 at 440 nm, of dust and sea salt at 0.3 at 1020 nm.
_SITES = {
    "desert": _Column((0.026, 0.274), (0.12, 2.32), (0.40, 0.60), 1.56, (0.0029, 0.0013, 0.0010, 0.0010)),
    "biomass-burning": _Column((0.060, 0.025), (0.1465, 3.56), (0.40, 0.79), 1.47, _grey(0.0093)),
    "washington": _Column((0.075, 0.030), (0.175, 3.28), (0.38, 0.75), 1.40, _grey(0.003)),
    "paris": _Column((0.070, 0.035), (0.175, 3.00), (0.43, 0.79), 1.40, _grey(0.009)),
    "mexico-city": _Column((0.060, 0.055), (0.14, 3.02), (0.43, 0.63), 1.47, _grey(0.014)),
    "maldives": _Column((0.060, 0.075), (0.18, 2.93), (0.46, 0.76), 1.44, _grey(0.011)),
    "cerrado": _Column((0.050, 0.055), (0.145, 3.53), (0.47, 0.79), 1.52, _grey(0.015)),
    "zambia": _Column((0.060, 0.045), (0.1325, 3.58), (0.40, 0.73), 1.51, _grey(0.021)),
    "boreal-forest": _Column((0.060, 0.025), (0.1575, 3.31), (0.43, 0.81), 1.50, _grey(0.0094)),
    "bahrain": _Column((0.050, 0.256), (0.15, 2.54), (0.42, 0.61), 1.55, (0.0025, 0.0014, 0.0010, 0.0010)),
    "cape-verde": _Column((0.026, 0.270), (0.12, 1.90), (0.52, 0.60), 1.48, (0.0025, 0.0007, 0.0006, 0.0006)),
    "hawaii": _Column((0.12, 0.24), (0.16, 2.70), (0.48, 0.68), 1.36, _grey(0.0015)),
}
#: How the air of one place varies, as two that have its mean and its deviation: in the radius of the fine mode [um],
#: for which the table says 0.01 to 0.05, and in the volume of the coarse one, in proportion.
_SIDES = {"smaller": (-0.03, -0.5), "larger": (0.03, 0.5)}
#: Those that are offered by name; the others stand for what haze may be besides (`unsolved`).
_OFFERED = ("desert", "biomass-burning")
_SITE_WAVELENGTHS = (440.0, 670.0, 870.0, 1020.0)
_SITE_LARGEST = 15e-6  # the end of the size range that the inversion of sky radiances covers


class _Part(NamedTuple):
    """One sort of sphere: optics with the optical depth 1 at 550 nm, and its share in that of the mixture."""

    name: str
    optics: MieAerosol | Particles
    share: float


def aerosol_names() -> tuple[str, ...]:
    """Names that `aerosol_components` knows.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> from skyscatter.dehaze import aerosol_names
    >>> aerosol_names()
    ('continental', 'maritime', 'urban', 'desert', 'biomass-burning')
    """
    return (*_VOLUMES, *_OFFERED)


def site_names() -> tuple[str, ...]:
    """The aerosols of twelve places, each as its air varies to either side: they span what haze may be."""
    return tuple(f"{site} {side}" for site in _SITES for side in _SIDES)


def check_aerosol(aerosol: str, known: Sequence[str]) -> None:
    """Refuse what is neither one of the known names nor the file of an aerosol.

    Raises
    ------
    MissingDataError, DomainError
    """
    if is_file(str(aerosol)):
        read_aerosol(aerosol)
    elif aerosol not in known:
        rule = f"{nearest(str(aerosol), known)}; or a file of your own, {' or '.join(SUFFIXES)}"
        raise DomainError("aerosol", aerosol, rule)


def aerosol_components(
    aerosol: str | Mapping[str, float],
    optical_depth: float,
    scale_height: float = SCALE_HEIGHT,
    top: float | None = None,
) -> tuple[Component, ...]:
    """Components of a medium for a named aerosol or for several at once.

    Parameters
    ----------
    aerosol : str or mapping of str to float
        A name, or the file of an aerosol of one's own (see `ownaerosol.read_aerosol`);
        or names and their shares in the optical depth at 550 nm (not negative, summing to 1).
    optical_depth : float
        Vertical extinction optical depth at 550 nm of all components together, at least 0.
    scale_height : float
        Of the exponential profile above altitude 0 [m].
    top : float, optional
        Where the profile ends [m]; 16 scale heights when not given.

    Returns
    -------
    tuple of Component

    Raises
    ------
    DomainError
        For an unknown name, shares that do not sum to 1, or a value out of range.
    """
    if not (np.isfinite(optical_depth) and optical_depth >= 0):
        raise DomainError("optical_depth", optical_depth, "a finite number, at least 0")
    density = Exponential(scale_height=scale_height, top=top)
    return tuple(_component(part, density, float(optical_depth * part.share)) for part in _parts(aerosol))


def _component(part: _Part, density: Exponential, depth: float) -> Component:
    """A sort of particles with that optical depth at 550 nm; that of a table is a spectrum, which weighs."""
    if isinstance(part.optics, MieAerosol):
        optics = part.optics.model_copy(update={"optical_depth": depth})
        return Component(name=part.name, density=density, optics=optics)
    return Component(name=part.name, density=density, optics=part.optics, weight=depth)


def aerosol_spectrum(aerosol: str | Mapping[str, float], wavelengths_nm: ArrayLike) -> tuple[Array, Array, Array]:
    """Optical depth relative to 550 nm, single-scattering albedo and asymmetry parameter; shape (wavelength,) each."""
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    depth, scattered, forward = np.zeros((3, wl.size))
    for part in _parts(aerosol):
        extinction, albedo, asymmetry = _properties(part.optics, wl)
        own = part.share * extinction / _properties(part.optics, np.array([REFERENCE_NM]))[0][0]
        depth += own
        scattered += own * albedo
        forward += own * albedo * asymmetry
    return depth, scattered / depth, forward / scattered


def aerosol_optics(aerosol: str, wavelengths_nm: Array, cos_theta: Array) -> tuple[Array, Array, Array]:
    """Optical depth relative to 550 nm and albedo, (wavelength,), and phase function [sr-1], (wavelength, angle).

    Of a name, of one of `site_names` too, or of a file.
    """
    parts = _parts(aerosol) if is_file(aerosol) else _mixture(aerosol)
    depth, scattered, phase = np.zeros(len(wavelengths_nm)), np.zeros(len(wavelengths_nm)), np.float64(0.0)
    for part in parts:
        extinction, albedo, _ = _properties(part.optics, wavelengths_nm)
        own = part.share * extinction / _properties(part.optics, np.array([REFERENCE_NM]))[0][0]
        function = part.optics.phase_function(wavelengths_nm).value(cos_theta, wavelengths_nm)
        depth += own
        scattered += own * albedo
        phase = phase + (own * albedo)[:, None] * function.T
    return depth, scattered / depth, np.asarray(phase / scattered[:, None])


def _properties(optics: MieAerosol | Particles, wl: Array) -> tuple[Array, Array, Array]:
    """Extinction of some unit, single-scattering albedo and asymmetry, each (wavelength,)."""
    if isinstance(optics, MieAerosol):
        extinction, albedo, asymmetry = optics.optical_properties(wl)
        return extinction, albedo, asymmetry
    scattering, absorption, _ = optics.coefficients(wl, 1.0)
    total = scattering + absorption
    return total, scattering / total, optics.phase.mean_cosine(wl)


def _parts(aerosol: str | Mapping[str, float]) -> tuple[_Part, ...]:
    """All sorts of spheres; a sort that two mixtures share is one part."""
    shares = {aerosol: 1.0} if isinstance(aerosol, str) else dict(aerosol)
    for name, share in shares.items():
        check_aerosol(name, aerosol_names())
        if not share >= 0:
            raise DomainError(f"share of {name}", share, "not negative")
    if abs(sum(shares.values()) - 1.0) > 1e-6:
        raise DomainError("aerosol", shares, "shares that sum to 1")
    merged: dict[str, _Part] = {}
    for name, share in shares.items():
        # A file may change while the program runs; what is made of names may be kept.
        parts = (_Part("own", read_aerosol(name), 1.0),) if is_file(name) else _mixture(name)
        for part in parts if share > 0 else ():
            before = merged[part.name].share if part.name in merged else 0.0
            merged[part.name] = part._replace(share=before + share * part.share)
    return tuple(merged.values())


@lru_cache(maxsize=16)
def _mixture(name: str) -> tuple[_Part, ...]:
    site, _, side = name.partition(" ")
    if site in _SITES:
        return (_Part(name, _site_optics(_varied(_SITES[site], side) if side else _SITES[site]), 1.0),)
    optics = {component: _basic_optics(component) for component in _VOLUMES[name]}
    extinction = {
        component: volume / _mean_volume(*_SIZES[component]) * _cross_section(optics[component])
        for component, volume in _VOLUMES[name].items()
    }
    total = sum(extinction.values())
    return tuple(_Part(component, optics[component], extinction[component] / total) for component in optics)


def _basic_optics(component: str) -> MieAerosol:
    radius, spread = _SIZES[component]
    mode = LogNormalMode(
        median_radius=radius, geometric_standard_deviation=spread, min_radius=_SMALLEST, max_radius=_LARGEST
    )
    table, column = read_table("aerosol_refractive_index.csv"), component.replace("-", "_")
    wl = tuple(table["wavelength_nm"].tolist())
    return MieAerosol(
        modes=(mode,),
        refractive_index_real=SpectralTable(wavelengths=wl, values=tuple(table[f"{column}_n"].tolist())),
        refractive_index_imag=SpectralTable(wavelengths=wl, values=tuple(table[f"{column}_k"].tolist())),
        optical_depth=1.0,
        wavelength=REFERENCE_NM,
    )


def _varied(site: _Column, side: str) -> _Column:
    """A place on a day to one side of its mean."""
    radius, coarse = _SIDES[side]
    return site._replace(
        radii=(site.radii[0] + radius, site.radii[1]), volumes=(site.volumes[0], (1 + coarse) * site.volumes[1])
    )


def _site_optics(site: _Column) -> MieAerosol:
    """Two modes given by volume: the median by number is exp(-3 s^2) below that by volume, and the number follows from
    the mean volume.
    """
    modes = []
    for volume, radius, width in zip(site.volumes, site.radii, site.widths, strict=True):
        median, spread = radius * 1e-6 * exp(-3.0 * width**2), exp(width)
        number = volume * 1e-18 / _mean_volume(median, spread, np.inf)
        modes.append(
            LogNormalMode(
                median_radius=median, geometric_standard_deviation=spread, fraction=number, max_radius=_SITE_LARGEST
            )
        )
    return MieAerosol(
        modes=tuple(modes),
        refractive_index_real=site.n,
        refractive_index_imag=SpectralTable(wavelengths=_SITE_WAVELENGTHS, values=site.k),
        optical_depth=1.0,
        wavelength=REFERENCE_NM,
    )


def _mean_volume(median: float, spread: float, largest: float = _LARGEST) -> float:
    """Volume of the particles below `largest` [m3] per particle of the uncut log-normal: its third moment."""
    s = log(spread)
    below = 0.5 * (1.0 + erf((log(largest / median) - 3.0 * s * s) / (s * sqrt(2.0)))) if np.isfinite(largest) else 1.0
    return 4.0 / 3.0 * np.pi * median**3 * exp(4.5 * s * s) * below


def _cross_section(optics: MieAerosol) -> float:
    """Extinction at 550 nm per particle of the uncut distribution [m2]."""
    return float(optics.optical_properties([REFERENCE_NM])[0][0])
