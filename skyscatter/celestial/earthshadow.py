"""Sunlight in the Earth's shadow: bent by the air into it, reddened and spread on its way.

Seen from the Moon in the shadow, the Sun's image is a ring of air around the Earth.  A ray whose straight line passes
the Earth's centre at a distance b is bent towards it by

    alpha(b) = -2 b ∫ (d ln n / dy) dw / y,   y = n r,  y^2 = b^2 + w^2                               (1)

and dimmed by exp(-tau), tau = 2 ∫ k dr / dy dw, along the bent path.  An image at b shows the Sun at the angle
b / D - alpha from the Earth's centre, on the other side where that is negative; radiance is kept along a ray but for
exp(-tau), so that the solid angle of the image, squeezed by the bending, holds all that refraction does to the light.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial.coverage import uncovered_light
from skyscatter.celestial.frames import Array
from skyscatter.media.fields import Gaussian, UsStandard1976
from skyscatter.optics.absorption import GasAbsorption
from skyscatter.optics.rayleigh import RayleighAir, refractive_index_bodhaine1999
from skyscatter.spectra.solar import disk_mean, limb_coefficients

EARTH_RADIUS = 6.371e6  #: [m]
CO2_PPM = 420.0  #: as the model ``earth`` has it
#: Top of the air that bends and dims [m]; rays above it pass.
TOP = 90e3
#: The air of the shipped model ``earth``: ozone [DU], middle and width of its layer [m]; aerosol at 550 nm, scale
#: height [m] and Angstrom's exponent.
OZONE_DU, OZONE_PEAK, OZONE_WIDTH = 300.0, 22e3, 5e3
AEROSOL_DEPTH, AEROSOL_SCALE, ANGSTROM = 0.05, 2e3, 1.23
#: Aerosol of the stratosphere in quiet years: optical depth at 550 nm (Kremser et al. 2016, Rev. Geophys. 54, 278: some
#: 0.005), middle and width of its layer [m], Angstrom's exponent of such small drops.
HIGH_DEPTH, HIGH_PEAK, HIGH_WIDTH, HIGH_ANGSTROM = 0.005, 18e3, 4e3, 1.5
#: Rays that pass lower than `CLOUDS` [m] are stopped by clouds, all but this share.  No measurement says how many there
#: are along the Earth's edge; with these two eclipses whose light was measured lie to either side (Hernitschek et al.
#: 2008, Appl. Opt. 47, H62: -3.32 mag on 9 February 1990, -1.7 mag on 3 March 2007).
CLOUDS, CLEAR = 8e3, 0.35
#: Heights of rays, steps along them, azimuths in the Sun's image, and angles from the shadow's axis.
HEIGHTS, STEPS, TURNS, ANGLES = 180, 400, 16, 241


class Grazing(NamedTuple):
    """Rays that pass through the air, by how high they would pass without it."""

    impact: Array  #: (ray,) distance of the straight line from the Earth's centre [m]
    bending: Array  #: (ray,) at 550 nm [rad]
    through: Array  #: (ray, wavelength) transmittance


def refraction(height: ArrayLike) -> Array:
    """Bending of a ray of 550 nm through the whole of the air.

    Parameters
    ----------
    height : array_like, shape (ray,)
        Lowest height of the ray [m], 0 to 90 km.

    Returns
    -------
    ndarray, shape (ray,)
        [rad]

    Examples
    --------
    Twice the refraction at the horizon, in arcminutes, and what is left of it 20 km up.

    >>> import numpy as np
    >>> from skyscatter.celestial.earthshadow import refraction
    >>> (np.degrees(refraction([0.0, 20e3])) * 60).round(1)
    array([66.1,  5.6])
    """
    return _bent(np.atleast_1d(np.asarray(height, dtype=float)))[1]


def _index(height: Array) -> Array:
    """Refractivity n - 1 at 550 nm."""
    ground = float(refractive_index_bodhaine1999(0.55, CO2_PPM)) - 1.0
    return np.asarray(ground * _air(height))


@lru_cache(maxsize=1)
def _air_table() -> tuple[Array, Array]:
    h = np.linspace(0.0, TOP, 901)
    return h, np.log(UsStandard1976().density(h))


def _air(height: Array) -> Array:
    """Density of air over that at the ground; cubic in the logarithm, for refraction asks for the slope."""
    from scipy.interpolate import CubicSpline

    return np.asarray(np.where(height < TOP, np.exp(CubicSpline(*_air_table())(np.minimum(height, TOP))), 0.0))


def _bent(lowest: Array) -> tuple[Array, Array, Array, Array]:
    """Impact parameters (ray,) [m], bendings (ray,) [rad], heights (ray, step) [m] and steps of the path there [m]."""
    h = np.linspace(0.0, TOP, 3601)
    r, n = EARTH_RADIUS + h, 1.0 + _index(h)
    y = n * r
    slope = np.gradient(np.log(n), r)
    by_y, stretch = slope / (slope * y + n), 1.0 / (slope * r * n + n)  # d ln n / dy and dr / dy
    impact = np.interp(lowest, h, y)
    # w from the lowest point to the top; steps grow outwards.
    x, weight = np.polynomial.legendre.leggauss(STEPS)
    end = np.sqrt(np.maximum(y[-1] ** 2 - impact**2, 0.0))
    w, dw = end[:, None] * 0.5 * (x + 1.0), end[:, None] * 0.5 * weight
    at = np.sqrt(impact[:, None] ** 2 + w**2)
    bending = -2.0 * impact * (np.interp(at, y, by_y) / at * dw).sum(axis=1)
    return impact, bending, np.interp(at, y, h), 2.0 * np.interp(at, y, stretch) * dw


def grazing(wavelengths: ArrayLike) -> Grazing:
    """Bending and transmittance of the rays that pass the Earth.

    Parameters
    ----------
    wavelengths : array_like, shape (wavelength,)
        [nm]

    Returns
    -------
    Grazing
        From the ground up to 90 km.

    Examples
    --------
    Red light comes through 10 km above the ground, and little blue light.

    >>> import numpy as np
    >>> from skyscatter.celestial.earthshadow import EARTH_RADIUS, grazing
    >>> rays = grazing([450.0, 650.0])
    >>> low = int(np.argmin(abs(rays.impact - EARTH_RADIUS - 11.7e3)))
    >>> rays.through[low].round(2)
    array([0.01, 0.15])
    """
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    lowest = TOP * np.linspace(0.0, 1.0, HEIGHTS) ** 1.5
    impact, bending, height, path = _bent(lowest)
    ozone = Gaussian(peak=OZONE_PEAK, width=OZONE_WIDTH, top=60e3)
    layers = (
        (_air, RayleighAir(co2_ppm=CO2_PPM).coefficients(wl, 1.0)),
        (
            _tabulated(ozone),
            GasAbsorption(species="o3", column_du=OZONE_DU).coefficients(wl, ozone.reference_column()),
        ),
    )
    depth = np.zeros((lowest.size, wl.size))
    for density, optics in layers:
        depth += (density(height) * path).sum(axis=1)[:, None] * (optics.scattering + optics.absorption)
    high = Gaussian(peak=HIGH_PEAK, width=HIGH_WIDTH, top=60e3)
    for share, whole, column, exponent in (
        (np.exp(-height / AEROSOL_SCALE), AEROSOL_DEPTH, AEROSOL_SCALE, ANGSTROM),
        (_tabulated(high)(height), HIGH_DEPTH, high.reference_column(), HIGH_ANGSTROM),
    ):
        depth += (share * path).sum(axis=1)[:, None] * whole / column * (wl / 550.0) ** -exponent
    clear = np.where(lowest < CLOUDS, CLEAR, 1.0)
    return Grazing(impact, bending, clear[:, None] * np.exp(-depth))


def _tabulated(field: Gaussian) -> Callable[[Array], Array]:
    """A density as a function of heights [m], by a table: each value of it by itself is slow."""
    h = np.linspace(0.0, TOP, 901)
    values = field.density(h)
    return lambda height: np.asarray(np.interp(height, h, values))


def shadow_share(
    angles: ArrayLike, sun_radius: float, distance: float, wavelengths: ArrayLike, sun_distance: float = math.inf
) -> Array:
    """Share of sunlight in the Earth's shadow and around it.

    Parameters
    ----------
    angles : array_like, shape (point,)
        Between the middles of Earth and Sun, as seen from the points [rad]; 0 on the shadow's axis.
    sun_radius : float
        Angular radius of the Sun there [rad].
    distance, sun_distance : float
        Of the points from the Earth's centre, and of the Earth from the Sun [m].
    wavelengths : array_like, shape (wavelength,)
        [nm]

    Returns
    -------
    ndarray, shape (point, wavelength)
        Above 1 nowhere.

    Examples
    --------
    In the middle of the shadow at the Moon's distance, 30' from it, and at 60', in the penumbra; blue and red.

    >>> import numpy as np
    >>> from skyscatter.celestial.earthshadow import shadow_share
    >>> share = shadow_share(np.radians([0.0, 0.5, 1.0]), 0.00465, 3.84e8, [450.0, 650.0])
    >>> [f"{value:.0e}" for value in share.ravel()]
    ['2e-08', '5e-05', '6e-05', '6e-04', '6e-01', '6e-01']
    """
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    theta = np.atleast_1d(np.asarray(angles, dtype=float))
    rays = grazing(wl)
    index = refractive_index_bodhaine1999(wl * 1e-3, CO2_PPM) - 1.0
    index = index / (refractive_index_bodhaine1999(0.55, CO2_PPM) - 1.0)
    # Bent at the Earth, light from a Sun that is not infinitely far seems to be bent a little less.
    lens = 1.0 / (1.0 + distance / sun_distance)
    edge = math.asin(rays.impact[-1] / distance)  # beyond it nothing is in the way
    shape = (theta.size, wl.size)
    share = uncovered_light(theta / sun_radius, np.full(theta.size, edge / sun_radius), wl).reshape(shape)
    weight = _weights(rays.impact) * rays.impact / distance**2
    nodes, over = np.polynomial.legendre.leggauss(TURNS)
    limb = limb_coefficients(wl) / disk_mean(wl) / (math.pi * sun_radius**2)
    for i in range(wl.size):
        beta = rays.impact / distance - lens * index[i] * rays.bending
        for k in range(theta.size):
            met = np.abs(np.abs(beta) - theta[k]) < sun_radius
            if met.any():
                arcs = _arcs(beta[met], float(theta[k]), sun_radius, limb[:, i], nodes, over)
                share[k, i] += (weight * rays.through[:, i])[met] @ arcs
    return share


def _weights(x: Array) -> Array:
    """Of the rule of trapezia over nodes."""
    step = np.diff(x)
    return np.asarray(0.5 * (np.append(step, 0.0) + np.insert(step, 0, 0.0)))


def _arcs(beta: Array, theta: float, radius: float, limb: Array, nodes: Array, over: Array) -> Array:
    """Radiance of the Sun integrated around circles about the Earth's middle, (ray,) [rad times radiance]."""
    size = np.abs(beta)
    across = np.maximum(2.0 * size * theta, 1e-300)
    cosine = np.clip((size**2 + theta**2 - radius**2) / across, -1.0, 1.0)
    # Half the arc of a circle of that size that lies within the Sun; opposite images have the same arc.
    half = np.arccos(cosine)
    turn = half[:, None] * 0.5 * (nodes + 1.0)
    square = size[:, None] ** 2 + theta**2 - 2.0 * size[:, None] * theta * np.cos(turn)
    mu = np.sqrt(np.clip(1.0 - square / radius**2, 0.0, 1.0))
    inside = square <= radius**2 * (1.0 + 1e-9)
    light = np.zeros_like(mu)
    for c in limb[::-1]:
        light = light * mu + c
    return np.asarray(half * (light * inside * over).sum(axis=1))
