"""Tables that cost nothing, and images made with them: for tests of what is done with a table, not of its physics."""

from __future__ import annotations

import numpy as np

from skyscatter.dehaze.bands import load_sensor
from skyscatter.dehaze.forward import STANDARD_PRESSURE, Atmosphere, reflectance_above
from skyscatter.dehaze.sensing import gases, with_water
from skyscatter.dehaze.table import BENDS_AT, GREATEST_AOD, TermsTable, lobatto

#: Exponent of the optical depth over wavelength and single-scattering albedo, near those of the models.
KINDS = {"continental": (1.2, 0.90), "maritime": (0.3, 0.98), "urban": (1.3, 0.65), "none": (1.0, 1.0)}


def made_up_table(atmosphere, bands, angles, *, aod=None, progress=None, **_):
    """In place of `build_table`: closed forms with the shape of single scattering; smooth, of the right size and signs.

    Terms are exponentials of the depths over the cosines.  Haze sends back three times what its phase function
    does in the first order, which is what many orders come to.
    """
    if atmosphere.aerosol == "none" or aod == 0:
        depths = np.zeros(1)
    elif aod is None:
        depths = BENDS_AT * np.expm1(lobatto(0.0, float(np.log1p(GREATEST_AOD / BENDS_AT)), 8))
    else:
        depths = aod * np.array([0.8, 1.0, 1.2])
    ranges = (angles.sun_zenith, angles.view_zenith, angles.relative_azimuth)
    nodes = [lobatto(low, high, 3 if high > low else 1) for low, high in ranges]
    exponent, albedo = KINDS[atmosphere.aerosol]
    wl = np.array([band.effective_wavelength for band in bands])
    depth, sun, view, turn, wl = np.meshgrid(depths, *nodes, wl, indexing="ij")
    air = 0.0088 * (wl / 1e3) ** -4.05 * atmosphere.pressure_hpa / STANDARD_PRESSURE
    haze = depth * (wl / 550.0) ** -exponent
    mu_s, mu_v = np.cos(np.radians(sun)), np.cos(np.radians(view))
    scattering = -mu_s * mu_v + np.sqrt((1 - mu_s**2) * (1 - mu_v**2)) * -np.cos(np.radians(turn))
    slant = 1 / mu_s + 1 / mu_v
    strength = 0.75 * (1 + scattering**2) * air + albedo * haze
    path = 0.25 * strength / (air + haze) / (mu_s + mu_v) * -np.expm1(-(air + haze) * slant)
    kept = np.exp(-(0.5 * air + (1 - 0.85 * albedo) * haze) / mu_s)
    direct = np.exp(-(air + haze) / mu_v)
    through = np.exp(-(0.5 * air + (1 - 0.85 * albedo) * haze) / mu_v)
    back = 0.9 * -np.expm1(-air) + 0.15 * -np.expm1(-haze)
    values = np.stack([path, kept * direct, kept * (through - direct), back], axis=-1)
    if progress is not None:
        progress(1.0)
    return TermsTable(tuple(bands), atmosphere, depths, *nodes, values, 1e-4)


def bands_of(*names, sensor="sentinel-2a"):
    return tuple(load_sensor(sensor).band(name) for name in names)


def air_of(table, sun, view=0.0, turn=0.0, **columns):
    """Terms with water in them and the gases above, at one geometry or (place,) of them."""
    sun, view, turn = (np.atleast_1d(np.asarray(a, float)) for a in (sun, view, turn))
    gas = gases(table.bands, sun, view, table.atmosphere.pressure_hpa, **columns)
    return gas, lambda aod: with_water(table.at(aod, sun, view, turn)[:1], gas)[0]


def seen_from_above(table, surface, aod, sun, environment=None, **columns):
    """Reflectance above the atmosphere of ground (band, y, x) under a depth (y, x) or one, seen straight down."""
    shape = surface.shape[1:]
    depth = np.broadcast_to(np.asarray(aod, float), shape).ravel()
    gas, terms_at = air_of(table, np.full(depth.size, sun), np.zeros(depth.size), np.zeros(depth.size), **columns)
    flat = surface.reshape(len(surface), -1).T
    around = None if environment is None else environment.reshape(len(surface), -1).T
    toa = gas.above * reflectance_above(terms_at(depth), flat, around)
    return toa.T.reshape(surface.shape)


def ground(bands, height, width, seed=0):
    """Fields, woods and lakes with texture, by the covers' own spectra: (band, y, x)."""
    from skyscatter.dehaze.dark import cover_spectra

    rng = np.random.default_rng(seed)
    kinds = rng.choice([0, 1, 3, 4, 5], p=[0.3, 0.15, 0.2, 0.15, 0.2], size=(-(-height // 7), -(-width // 7)))
    kinds = kinds.repeat(7, 0).repeat(7, 1)[:height, :width]
    mean = cover_spectra(bands).mean
    bright = 1 + 0.1 * rng.standard_normal((height, width))
    return np.clip(mean[kinds].transpose(2, 0, 1) * bright, 0.001, 0.9)


__all__ = ["Atmosphere", "air_of", "bands_of", "ground", "made_up_table", "seen_from_above"]
