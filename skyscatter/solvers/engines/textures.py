"""Textures of precomputed atmospheric scattering from a solved sky: red, green and blue of all its orders.

A shader makes radiance of two textures, each linear between its texels, times a phase function:

    L = A(r, mu, mu_s, nu) rayleigh(nu) + B(r, mu, mu_s, nu) cornette_shanks(g, nu).

Precomputed scattering has in A what is scattered once by air and everything scattered more often, in B what is
scattered once by aerosol, each at the texels themselves.  There are 8 texels over nu, the last two 44 degrees apart,
and aerosols do not follow Cornette & Shanks.  So A and B begin with that, and then both are changed by as little as
makes the sum right on rays between the texels too (`fitted`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.image.colour import colour_space, xyz_to_rgb_matrix, xyz_weights
from skyscatter.kernels.optics import SceneTable
from skyscatter.solvers.compile import phase_cosines
from skyscatter.solvers.direct import outward_profile, slant_columns
from skyscatter.solvers.engines.bruneton import (
    IRRADIANCE_SIZE,
    MU_S_SIZE,
    MU_SIZE,
    NU,
    NU_SIZE,
    R_SIZE,
    TRANSMITTANCE_SIZE,
    Layout,
    between_nodes,
    cornette_shanks,
    rayleigh,
)
from skyscatter.solvers.sweeps import FLOOR, view
from skyscatter.workers import Workers

if TYPE_CHECKING:
    from skyscatter.solvers.field import RadianceField

Array = NDArray[np.float64]

#: Azimuths from the Sun at which the sum is made right, besides the texels.
AZIMUTHS = 12
#: Suns for every column of them: what is linear between columns is made right at these.
SUNS_PER_CELL = 3
#: Rows over mu that are computed together.
BLOCK = 16
#: By how much a ray is kept off the horizon, which belongs to the ground and to the sky [cosine].
OFF_HORIZON = 1e-7
#: Cost of changing texels, and of changing neighbours differently, against relative errors of the radiance; by day, and
#: with the Sun below the horizon.  There light falls faster than what is linear between two Suns can follow, and
#: angles that no ray has in a row would be bent to make up for it.
STIFFNESS, ROUGHNESS = (0.01, 0.05), (0.05, 0.5)
#: Share of the brightest channel below which errors of the others count as if they had this much light.
DIMMEST = 0.05
#: Share of the optical depth from the ground that is too little to be seen.
SEEN = 2e-4
#: Angle from the Sun within which rays count less, as there is less of the sky [rad].
AUREOLE = np.radians(20.0)
#: Phase functions whose forward and backward values differ by no more than this are air's.
SYMMETRIC = 0.1
#: Asymmetries tried, and scattering angles at which laws are compared [degree]: fits mend what is wrong elsewhere.
ASYMMETRIES, COMPARED_DEG = np.arange(0.0, 0.96, 0.01), np.arange(1.0, 45.0, 1.0)


class Textures(NamedTuple):
    """Arrays of a planet's textures; luminances as linear sRGB [cd m-2], illuminances [lx]."""

    transmittance: Array  #: (r, mu, 3)
    scattering: Array  #: A (r, mu, mu_s, nu, 3)
    single_mie: Array  #: B
    higher_order: Array  #: the part of A that is scattered more than once
    irradiance: Array  #: (r, mu_s, 3)


@dataclass(frozen=True)
class Source:
    """A field with all that its textures need.

    Attributes
    ----------
    field : RadianceField
    table : SceneTable
        With the Sun in the z axis: what a ray sees depends on its four numbers alone, so one Sun serves all.
    layout : Layout
    rgb : ndarray, shape (wavelength, 3)
        Turns spectra into linear sRGB.
    asymmetry : float
        Of the shader's aerosol.
    """

    field: RadianceField
    table: SceneTable
    layout: Layout
    rgb: Array
    asymmetry: float

    @classmethod
    def of(cls, field: RadianceField, layout: Layout) -> Source:
        """For a layout."""
        table = field.at(field.sun(90.0, 0.0))
        rgb = xyz_weights(field.wavelengths) @ xyz_to_rgb_matrix(colour_space("srgb")).T
        return cls(field, table, layout, rgb, asymmetry_of(table, rgb))

    @property
    def sunlight(self) -> Array:
        """Spectral irradiance of the Sun above the air [W m-2 nm-1]."""
        return np.asarray(self.table.optics.sun_irradiance.sum(axis=0))


def textured_top(table: SceneTable) -> float:
    """Altitude above which there is too little air to be seen [m]: of the textures, which are finer for a lower one.

    Rays go on beyond it.  Observers above it are taken down to it by the shader.
    """
    columns = table.columns
    altitude = np.linspace(0, columns.top, 400)
    depth = outward_profile(columns, altitude) @ table.optics.sigma_t
    matters = (depth > SEEN * depth[0]).any(axis=1)
    return float(altitude[min(int(matters.sum()), altitude.size - 1)])


def hazes(table: SceneTable) -> NDArray[np.bool_]:
    """Which components scatter otherwise than air does, (component,)."""
    phase = table.optics.phase
    return np.asarray((np.abs(phase[:, 0] - phase[:, -1]) > SYMMETRIC * phase[:, 0]).any(axis=1))


def asymmetry_of(table: SceneTable, rgb: Array) -> float:
    """Asymmetry with which Cornette & Shanks' law is nearest to the mean phase function of haze; 0.8 without any."""
    light = table.optics.sun_irradiance.sum(axis=0) * rgb[:, 1]
    columns = slant_columns(table.columns, 0.0, 1.0)
    assert columns is not None
    weight = np.where(hazes(table), columns, 0.0)[:, None] * table.optics.sigma_s * light
    if weight.sum() <= 0:
        return 0.8
    mean = np.einsum("caw,cw->a", table.optics.phase, weight) / weight.sum()
    nu = np.cos(np.radians(COMPARED_DEG))
    seen = np.log(np.interp(-nu, -phase_cosines(), mean))
    misses = [np.mean((np.log(cornette_shanks(g, nu)) - seen) ** 2) for g in ASYMMETRIES]
    return float(ASYMMETRIES[int(np.argmin(misses))])


def rays_of(r: Array, mu: Array, mu_s: Array, nu: Array) -> tuple[Array, Array]:
    """Origins [m] and directions with these four numbers, arrays (n,), under a Sun in the z axis; each (n, 3)."""
    sine, sun_sine = np.sqrt(np.maximum(1 - mu**2, 0)), np.sqrt(np.maximum(1 - mu_s**2, 0))
    zero = np.zeros_like(mu)
    up, sunward = np.stack([sun_sine, zero, mu_s], axis=-1), np.stack([-mu_s, zero, sun_sine], axis=-1)
    both = sine * sun_sine
    cosine = np.clip(np.where(both > 1e-12, (nu - mu * mu_s) / np.where(both > 1e-12, both, 1.0), 1.0), -1.0, 1.0)
    aside = np.sqrt(1 - cosine**2)
    side = np.stack([zero, np.ones_like(mu), zero], axis=-1)
    direction = mu[:, None] * up + sine[:, None] * (cosine[:, None] * sunward + aside[:, None] * side)
    return r[:, None] * up, direction


class Light(NamedTuple):
    """Luminance that rays gather in the air, in linear sRGB [cd m-2]; each (n, 3)."""

    air: Array  #: scattered once by air
    haze: Array  #: scattered once by everything else
    multiple: Array  #: scattered more often, or reflected before


def light_of(source: Source, origins: Array, directions: Array) -> Light:
    """Light that is scattered into rays, without that of the ground in which they may end."""
    problem, field = source.field.fine.problem, source.field.fine.loaded
    unseen = field._replace(ground=np.full_like(field.ground, FLOOR))
    components = source.table.optics.sigma_s.shape[0]
    lit = np.zeros((len(origins), components, source.field.wavelengths.size), np.float32)
    scattered, multiple, _, _ = view(problem, unseen, source.table, origins, directions, lit)
    # Tables are even in the sine of half the angle.
    half_sine = np.sqrt(np.clip(0.5 * (1 - directions[:, 2]), 0.0, 1.0))
    cell, part = between_nodes(half_sine, problem.whole.shape[2])
    air = np.zeros_like(scattered[:, 0])
    for c in np.flatnonzero(~hazes(source.table)):
        phase = problem.whole[0, c]
        air += lit[:, c] * ((1 - part)[:, None] * phase[cell] + part[:, None] * phase[cell + 1])
    rgb = source.rgb
    return Light(air @ rgb, (scattered[:, 0] - air) @ rgb, np.maximum(multiple[:, 0], 0.0) @ rgb)


def fitted(suns: Array, mu_s: Array, nu: Array, light: Array, start: Array, asymmetry: float) -> Array:
    """Texels of A and B, begun at given ones, with which their sum is right between them too.

    Least squares of relative errors over all rays of a row, with a cost of changing texels.  Only neighbouring columns
    meet in a ray, so the normal equations are tridiagonal in blocks.

    Parameters
    ----------
    suns, mu_s : (sun,)
        Shares of the columns, 0 to 1, at which rays were computed, and the Sun's zenith cosines there.
    nu : (mu, sun, ray)
    light : (mu, sun, ray, channel)
    start : (mu, column, texel, channel)
        Texels of A over nu, then those of B.
    asymmetry : float
    """
    basis = _basis(nu, asymmetry)
    size = np.abs(light)
    size = np.maximum(size, np.maximum(DIMMEST * size.max(axis=3, keepdims=True), FLOOR))
    weigh = np.sqrt(np.minimum(np.arccos(nu) / AUREOLE, 1.0))[..., None] / size
    column, part = between_nodes(suns, MU_S_SIZE)
    unit = _units(start, asymmetry)[..., 0]
    seen = (1 - part)[:, None, None] * start[:, column] + part[:, None, None] * start[:, column + 1]
    miss = (light - np.einsum("msrt,mstc->msrc", basis, seen, optimize=True)) * weigh
    # Of each Sun: by how much changes at the column before and at that behind change radiances.
    sides = [
        np.einsum("msrt,msrc,mst->mscrt", basis, share[:, None, None] * weigh, unit[:, column + k], optimize=True)
        for k, share in enumerate((1 - part, part))
    ]
    rays = nu.shape[2] * SUNS_PER_CELL
    texels = basis.shape[-1]
    whole = (nu.shape[0], MU_S_SIZE, light.shape[3], texels)
    right, diagonal = np.zeros(whole), np.zeros((*whole, texels)) + _cost(mu_s[::SUNS_PER_CELL])
    upper = np.zeros((*whole, texels))
    for k, side in enumerate(sides):
        turned = np.swapaxes(side, -1, -2)
        add = turned @ side / rays
        pull = np.einsum("mscrt,msrc->msct", side, miss, optimize=True) / rays
        for sun, place in enumerate(column + k):
            diagonal[:, place] += add[:, sun]
            right[:, place] += pull[:, sun]
    across = np.swapaxes(sides[0], -1, -2) @ sides[1] / rays
    for sun, place in enumerate(column):
        upper[:, place] += across[:, sun]
    return np.asarray(start + np.swapaxes(block_tridiagonal(diagonal, upper, right), -1, -2) * unit[..., None])


def _basis(nu: Array, asymmetry: float) -> Array:
    """What texels of A, then those of B, make of radiances at angles of any shape; (..., texel)."""
    cell, part = between_nodes((nu + 1) / 2, NU_SIZE)
    hat = np.zeros((*nu.shape, NU_SIZE))
    np.put_along_axis(hat, cell[..., None], (1 - part)[..., None], axis=-1)
    np.put_along_axis(hat, cell[..., None] + 1, part[..., None], axis=-1)
    return np.concatenate([hat * rayleigh(nu)[..., None], hat * cornette_shanks(asymmetry, nu)[..., None]], axis=-1)


def _units(start: Array, asymmetry: float) -> Array:
    """Changes of texels that double the radiance there, (mu, column, texel, 1)."""
    phases = np.concatenate([rayleigh(NU), cornette_shanks(asymmetry, NU)])[:, None]
    light = np.abs(start * phases)
    total = (light[:, :, :NU_SIZE] + light[:, :, NU_SIZE:]).max(axis=3, keepdims=True)
    return np.asarray(np.maximum(np.concatenate([total, total], axis=2), FLOOR) / phases)


def _cost(mu_s: Array) -> Array:
    """Quadratic form of what changes of the texels of A and B cost, for every column; (column, 1, texel, texel)."""
    steps = np.diff(np.eye(NU_SIZE), axis=0)
    stiff, rough = (np.where(mu_s > 0, *both)[:, None, None] ** 2 for both in (STIFFNESS, ROUGHNESS))
    return np.asarray(np.kron(np.eye(2), stiff * np.eye(NU_SIZE) + rough * (steps.T @ steps))[:, None], float)


def block_tridiagonal(diagonal: Array, upper: Array, right: Array) -> Array:
    """Solve symmetric systems whose blocks meet their neighbours only, by elimination from the first to the last.

    Parameters
    ----------
    diagonal, upper : (case, block, channel, n, n)
        Blocks on the diagonal and those right of it; the last of the latter is not used.
    right : (case, block, channel, n)

    Returns
    -------
    ndarray, shape of `right`
    """
    d, y = diagonal.copy(), right.copy()
    for k in range(1, d.shape[1]):
        before = np.concatenate([upper[:, k - 1], y[:, k - 1, ..., None]], axis=-1)
        done = np.linalg.solve(d[:, k - 1], before)
        turned = np.swapaxes(upper[:, k - 1], -1, -2)
        d[:, k] -= turned @ done[..., :-1]
        y[:, k] -= (turned @ done[..., -1:])[..., 0]
    out = np.zeros_like(right)
    for k in range(d.shape[1] - 1, -1, -1):
        rest = y[:, k] - ((upper[:, k] @ out[:, k + 1, ..., None])[..., 0] if k + 1 < d.shape[1] else 0.0)
        out[:, k] = np.linalg.solve(d[:, k], rest[..., None])[..., 0]
    return out


def _seen(source: Source, r: float, mu: Array, mu_s: Array, nu: Array) -> Light:
    """Light of rays whose mu is one of a row, mu_s one of a column, and nu (mu, sun, ray); each (..., 3)."""
    m, s = (np.broadcast_to(x, nu.shape).ravel() for x in (mu[:, None, None], mu_s[:, None]))
    found = light_of(source, *rays_of(np.full(m.size, r), m, s, nu.ravel()))
    return Light(*(x.reshape(*nu.shape, 3) for x in found))


def scattering_block(source: Source, r: float, mu: Array) -> tuple[Array, Array, Array]:
    """A, B and the higher orders in A for some rows at one radius; each (mu, mu_s, nu, channel)."""
    every = SUNS_PER_CELL * (MU_S_SIZE - 1) + 1
    suns = np.linspace(0, 1, every)
    mu_s = source.layout.sun_cosines(suns)
    columns = mu_s[::SUNS_PER_CELL]
    reach = np.sqrt(np.maximum((1 - mu[:, None] ** 2) * (1 - mu_s**2), 0.0))[..., None]
    middle = (mu[:, None] * mu_s)[..., None]
    texels = np.clip(NU, (middle - reach)[:, ::SUNS_PER_CELL], (middle + reach)[:, ::SUNS_PER_CELL])
    between = np.clip(middle + reach * np.cos(np.linspace(0, np.pi, AZIMUTHS)), -1.0, 1.0)
    at_texels = _seen(source, r, mu, columns, texels)
    of_air, of_haze = rayleigh(texels)[..., None], cornette_shanks(source.asymmetry, texels)[..., None]
    single = at_texels.air / of_air
    start = np.concatenate([single + at_texels.multiple / of_air, at_texels.haze / of_haze], axis=2)
    light = np.add.reduce(_seen(source, r, mu, mu_s, between))
    found = fitted(suns, mu_s, between, light, start, source.asymmetry)
    a, b = found[:, :, :NU_SIZE], found[:, :, NU_SIZE:]
    return a, b, a - single


def scattering(
    source: Source, threads: int, progress: Callable[[float], None] | None = None
) -> tuple[Array, Array, Array]:
    """A, B and the higher orders in A, each (r, mu, mu_s, nu, channel) [cd m-2]."""
    layout = source.layout
    out = np.zeros((3, R_SIZE, MU_SIZE, MU_S_SIZE, NU_SIZE, 3))
    jobs = [(k, j) for k in range(R_SIZE) for j in range(0, MU_SIZE, BLOCK)]
    radii = layout.radii()
    half = MU_SIZE // 2

    def block(job: tuple[int, int]) -> None:
        k, j = job
        r = float(radii[k])
        edge = -float(layout.horizon(r)) / r
        mu = layout.scattering_mu(r)
        mu[:half], mu[half:] = np.minimum(mu[:half], edge - OFF_HORIZON), np.maximum(mu[half:], edge + OFF_HORIZON)
        out[:, k, j : j + BLOCK] = scattering_block(source, r, np.clip(mu[j : j + BLOCK], -1.0, 1.0))

    with Workers(threads) as pool:
        for done, _ in enumerate(pool.map(block, jobs), start=1):
            if progress is not None:
                progress(done / len(jobs))
    return out[0], out[1], out[2]


def transmittance(source: Source) -> Array:
    """Share of sunlight that comes through from the top, as red, green and blue of what is left of it; (r, mu, 3)."""
    layout, table = source.layout, source.table
    whole = source.sunlight @ source.rgb
    out = np.zeros((*TRANSMITTANCE_SIZE, 3))
    for k, r in enumerate(layout.radii(TRANSMITTANCE_SIZE[0])):
        edge = -float(layout.horizon(r)) / float(r)
        for j, mu in enumerate(np.maximum(layout.transmittance_mu(float(r)), edge + OFF_HORIZON)):
            columns = slant_columns(table.columns, float(r) - layout.bottom, float(mu))
            if columns is not None:
                out[k, j] = (source.sunlight * np.exp(-columns @ table.optics.sigma_t)) @ source.rgb / whole
    return out


def irradiance(source: Source) -> Array:
    """Illuminance of horizontal planes by the sky [lx], (r, mu_s, 3); 0 under Suns below the lowest."""
    layout = source.layout
    radii = np.linspace(layout.bottom, layout.top, IRRADIANCE_SIZE[0])
    mu_s = np.linspace(-1, 1, IRRADIANCE_SIZE[1])
    lit = mu_s >= layout.mu_s_min
    altitude = np.minimum(radii - layout.bottom, source.field.scene.medium.top)
    elevation = np.degrees(np.arcsin(np.clip(mu_s[lit], -1, 1)))
    found = source.field.fluxes(altitude[:, None], sun_elevation_deg=elevation)
    out = np.zeros((*IRRADIANCE_SIZE, 3))
    out[:, lit] = found.diffuse_down @ source.rgb
    return out


def make_textures(source: Source, threads: int, progress: Callable[[float], None] | None = None) -> Textures:
    """All of them."""
    share = 0.9  # of the time, roughly, for the largest three

    def part(done: float) -> None:
        if progress is not None:
            progress(share * done)

    a, b, higher = scattering(source, threads, part)
    made = Textures(transmittance(source), a, b, higher, irradiance(source))
    if progress is not None:
        progress(1.0)
    return made
