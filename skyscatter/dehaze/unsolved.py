"""Aerosols that are not solved for: what they would do, from a solved model and the difference in a flat atmosphere.

Three models are solved for.  What haze may be besides is told by the aerosols of twelve places all over the world
(`aerosols.site_names`); what they change in the result and in the haze that is found is in the standard deviations.
The terms of each are those of the most alike solved model, and

    rho_path + d rho_path,    T r_T,    t_dir exp(-d tau / mu),    S + d S,

differences d and ratios r after `skyscatter.dehaze.flat`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.datafiles import read_table
from skyscatter.dehaze.aerosols import aerosol_optics, aerosol_spectrum, site_names
from skyscatter.dehaze.flat import DEGREE, FlatTerms, Haze, solve_flat
from skyscatter.dehaze.forward import BACK, DIFFUSE, DIRECT, PATH, STANDARD_PRESSURE
from skyscatter.dehaze.table import TermsTable, lobatto, polynomial_weights
from skyscatter.optics.phase import draine_value
from skyscatter.optics.rayleigh import cross_section_bodhaine1999

Array = NDArray[np.float64]

#: Aerosols whose optics are shipped, in the order of ``data/aerosol_sites.csv``.
TOLD = ("continental", "maritime", "urban", "desert", "biomass-burning", *site_names())
#: Scattering angles of the phase functions there [degree]: a satellite sees none much closer to the Sun.
ANGLES = np.arange(40.0, 180.5, 2.5)
#: Nodes over each range of angles (Sun, view, azimuth), at most: differences of aerosols are smoother than their light.
NODES = (3, 3, 5)
#: Molecules over a square metre at the standard pressure.
AIR_COLUMN = 2.1526e29


class Optics(NamedTuple):
    """Of one aerosol, at the bands.

    Attributes
    ----------
    extinction : (band,)
        Optical depth relative to that at 550 nm.
    albedo : (band,)
    moments : (band, DEGREE + 1)
    phase : (band, angle)
        At `ANGLES`; 1 on the average over the sphere.
    """

    extinction: Array
    albedo: Array
    moments: Array
    phase: Array


def optics_of(aerosol: str, wavelengths: Array) -> Optics:
    """Optics of one of `TOLD` at wavelengths [nm], from the shipped table; beyond its ends those of the ends."""
    table = read_table("aerosol_sites.csv")
    own = table["aerosol"] == TOLD.index(aerosol)
    x, at = np.log(table["wavelength_nm"][own]), np.log(wavelengths)

    def column(name: str) -> Array:
        return np.asarray(np.interp(at, x, table[name][own]))

    moments = np.stack([np.ones_like(at), *(column(f"m{n}") for n in range(1, DEGREE + 1))], axis=-1)
    phase = np.stack([column(f"p{angle:g}") for angle in ANGLES], axis=-1)
    extinction = np.exp(np.interp(at, x, np.log(table["extinction"][own])))
    return Optics(extinction, column("albedo"), moments, phase)


def imitations(tables: Sequence[TermsTable]) -> list[TermsTable]:
    """Tables of the aerosols of all places, each from the most alike of the solved ones; none without haze."""
    solved = [t for t in tables if t.atmosphere.aerosol in TOLD and t.aod[-1] > 0]
    if not solved:
        return []
    wavelengths = np.array([band.effective_wavelength for band in solved[0].bands])
    known = [optics_of(t.atmosphere.aerosol, wavelengths) for t in solved]
    wanted = {name: optics_of(name, wavelengths) for name in site_names()}
    nearest = {name: int(np.argmin([unlikeness(optics, k) for k in known])) for name, optics in wanted.items()}
    made: dict[str, TermsTable] = {}
    for number, (table, own) in enumerate(zip(solved, known, strict=True)):
        here = {name: wanted[name] for name, which in nearest.items() if which == number}
        if here:
            made |= imitated(table, own, here)
    return [made[name] for name in wanted]


def shaped(table: TermsTable) -> list[TermsTable]:
    """Tables of a user's aerosol of which only the asymmetry is known, with the phase functions that it may have.

    It is solved for with that of Henyey & Greenstein.  Aerosols of the same asymmetry send back more or less: each of
    those of all places lends the ratio of its own phase function to Henyey & Greenstein's of its own asymmetry.
    """
    wavelengths = np.array([band.effective_wavelength for band in table.bands])
    aerosol, cosines = table.atmosphere.aerosol, np.cos(np.radians(ANGLES))
    extinction, albedo, phase = aerosol_optics(aerosol, wavelengths, cosines)
    asymmetry = aerosol_spectrum(aerosol, wavelengths)[2]
    own = Optics(extinction, albedo, asymmetry[:, None] ** np.arange(DEGREE + 1), 4 * np.pi * phase)
    wanted = {}
    for name in site_names():
        lends = optics_of(name, wavelengths)
        usual = 4 * np.pi * draine_value(cosines, lends.moments[:, 1, None], 0.0)
        wanted[name] = own._replace(phase=own.phase * lends.phase / usual)
    return list(imitated(table, own, wanted).values())


def unlikeness(one: Optics, other: Optics) -> float:
    """Difference of what is scattered aside and of what is absorbed, over all bands."""

    def laws(o: Optics) -> Array:
        return o.extinction * np.stack([o.albedo * (1 - o.moments[:, 1]), 1 - o.albedo])

    return float(((laws(one) - laws(other)) ** 2).sum())


def imitated(table: TermsTable, own: Optics, wanted: dict[str, Optics]) -> dict[str, TermsTable]:
    """Tables of aerosols by name, from that of an aerosol whose optics are `own`."""
    angles = (table.sun_zenith, table.view_zenith, table.relative_azimuth)
    few = [lobatto(float(a[0]), float(a[-1]), min(a.size, n)) for a, n in zip(angles, NODES, strict=True)]
    flat = _flat(table, [own, *wanted.values()], few)
    sun, view, azimuth = (polynomial_weights(nodes, a) for nodes, a in zip(few, angles, strict=True))
    n_sun, n_view, n_azimuth = (nodes.size for nodes in few)
    # (aerosol, aod, band, ...) from here on.
    path = flat.path.reshape(*flat.path.shape[:3], n_sun, n_view, n_azimuth)
    more = np.einsum("mnbsva,is,jv,ka->mnijkb", path[1:] - path[:1], sun, view, azimuth, optimize=True)
    down = np.einsum("mnbs,is->mnib", (flat.through[1:] / flat.through[:1])[..., :n_sun], sun)[:, :, :, None, None]
    up = np.einsum("mnbv,jv->mnjb", (flat.through[1:] / flat.through[:1])[..., n_sun:], view)[:, :, None, :, None]
    back = (flat.back[1:] - flat.back[:1])[:, :, None, None, None]
    slant = 1 / np.cos(np.radians(table.view_zenith))[None, :, None, None]
    out = {}
    for m, (name, optics) in enumerate(wanted.items()):
        denser = table.aod[:, None] * (optics.extinction - own.extinction)
        values = np.empty_like(table.values)
        whole = (table.values[..., DIRECT] + table.values[..., DIFFUSE]) * down[m] * up[m]
        values[..., PATH] = np.maximum(table.values[..., PATH] + more[m], 0.0)
        straight = table.values[..., DIRECT] * down[m] * np.exp(-denser[:, None, None, None] * slant)
        values[..., DIRECT] = np.minimum(straight, whole)
        values[..., DIFFUSE] = whole - values[..., DIRECT]
        values[..., BACK] = np.clip(table.values[..., BACK] + back[m], 0.0, 1.0)
        atmosphere = table.atmosphere.model_copy(update={"aerosol": name})
        out[name] = replace(table, atmosphere=atmosphere, values=values)
    return out


def _flat(table: TermsTable, aerosols: Sequence[Optics], few: Sequence[Array]) -> FlatTerms:
    """Flat terms (aerosol, aod, band, ...) for all of `few` angles of Sun, view and azimuth."""
    wavelengths = np.array([band.effective_wavelength for band in table.bands])
    air = AIR_COLUMN * table.atmosphere.pressure_hpa / STANDARD_PRESSURE * cross_section_bodhaine1999(wavelengths)
    sun, view, azimuth = (g.ravel() for g in np.meshgrid(*(np.arange(a.size) for a in few), indexing="ij"))
    mu_s, mu_v, turn = np.cos(np.radians(few[0])), np.cos(np.radians(few[1])), np.cos(np.radians(few[2]))
    across = np.sqrt((1 - mu_s[sun] ** 2) * (1 - mu_v[view] ** 2)) * turn[azimuth]
    scattering = -mu_s[sun] * mu_v[view] - across  # backscatter where the azimuth is 0
    theta = np.degrees(np.arccos(np.clip(scattering, -1, 1)))
    shape = (len(aerosols), table.aod.size, len(table.bands))

    def each(values: Sequence[Array]) -> Array:
        stacked = np.stack(list(values))[:, None]
        return np.broadcast_to(stacked, (*shape, *stacked.shape[3:]))

    phase = [np.stack([np.interp(theta, ANGLES, p) for p in o.phase]) for o in aerosols]
    extinction = table.aod[:, None] * np.stack([o.extinction for o in aerosols])[:, None]
    haze = Haze(extinction, each([o.albedo for o in aerosols]), each([o.moments for o in aerosols]), each(phase))
    return solve_flat(
        np.broadcast_to(air, shape), haze, np.concatenate([mu_s, mu_v]), sun, view + few[0].size, scattering
    )  # fmt: skip
