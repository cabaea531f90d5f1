"""From a scene and wavelengths to the tables that the kernels read."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.ground import Ground
from skyscatter.kernels.columns import FieldTable
from skyscatter.kernels.eclipse import NO_ECLIPSE
from skyscatter.kernels.lookup import ColumnTable, build_column_table
from skyscatter.kernels.optics import GroundTable, OpticsTable, SceneTable
from skyscatter.media.medium import Medium
from skyscatter.media.tables import pack_rows
from skyscatter.optics.phase import normalise
from skyscatter.scene import Scene
from skyscatter.spectra.table import evaluate
from skyscatter.workers import in_parts

Array = NDArray[np.float64]

#: Cells of the phase function tables; nodes at cos_theta = 1 - 2 (k / n)^2, 0.11 degrees apart at the Sun.
PHASE_CELLS = 1024
#: Rings on which the radiance of the solar disk is tabulated, over the squared fractional radius.
DISK_RINGS = 513


@lru_cache(maxsize=8)
def field_tables(medium: Medium) -> tuple[FieldTable, ColumnTable]:
    """Fields and columns of a medium; independent of wavelength and Sun, and so shared by all scenes of a medium."""
    fields = pack_rows([shell.row() for shell in medium.shells], medium.radius)
    return fields, build_column_table(fields, in_parts=in_parts)


def phase_cosines() -> Array:
    """Cosines of the scattering angles at which phase functions are tabulated, falling from 1 to -1."""
    return 1 - 2 * (np.arange(PHASE_CELLS + 1) / PHASE_CELLS) ** 2


@lru_cache(maxsize=8)
def medium_optics(medium: Medium, wavelengths: tuple[float, ...]) -> tuple[Array, Array, Array, Array, Array]:
    """Scattering, extinction and emission (component, wl), phase (component, angle, wl), its distribution function."""
    wl, mu = np.array(wavelengths), phase_cosines()
    count = len(medium.components)
    sigma_s, sigma_t, emission = (np.zeros((count, wl.size)) for _ in range(3))
    phase = np.empty((count, mu.size, wl.size))
    for c, component in enumerate(medium.components):
        coefficients = component.optics.coefficients(wl, component.density.reference_column())
        sigma_s[c] = component.weight * coefficients.scattering
        sigma_t[c] = component.weight * (coefficients.scattering + coefficients.absorption)
        emission[c] = component.weight * (coefficients.emission + evaluate(component.emission, wl))
        values = component.optics.phase_function(wl).value(mu[::-1], wl)
        phase[c] = normalise(mu[::-1], values)[::-1]
    cell = np.pi * (phase[:, 1:] + phase[:, :-1]) * (mu[:-1] - mu[1:])[None, :, None]
    cdf = np.concatenate([np.zeros((count, 1, wl.size)), np.cumsum(cell, axis=1)], axis=1)
    return sigma_s, sigma_t, emission, phase, np.ascontiguousarray(np.moveaxis(cdf / cdf[:, -1:], 1, 2))


@lru_cache(maxsize=8)
def matrix_tables(medium: Medium, wavelengths: tuple[float, ...]) -> Array:
    """Elements a1, a2, a3, a4, b1, b2 of the scattering matrix [sr-1], shape (component, 6, angle, wavelength).

    At the angles of the phase tables and on their scale: element 0 is the phase table.
    """
    wl, rising = np.array(wavelengths), phase_cosines()[::-1]
    tables = np.empty((len(medium.components), 6, rising.size, wl.size))
    for c, component in enumerate(medium.components):
        elements = component.optics.phase_function(wl).matrix(rising, wl)
        integral = 2 * np.pi * np.trapezoid(elements[0], rising, axis=0)
        tables[c] = (elements / integral)[:, ::-1]
    tables[:, 0] = medium_optics(medium, wavelengths)[3]  # not even rounding tells them apart
    return tables


def disk_points(axis: Array, radius: float) -> tuple[Array, Array, Array]:
    """Points on a disk that integrate polynomials of degree 5 over it: the middle and a hexagon.

    Stroud (1971), Approximate Calculation of Multiple Integrals, rule S2:5-1 (Radon's seven points): weights 1/4 and
    1/8, the hexagon at sqrt(2/3) of the radius.

    Returns
    -------
    directions : (7, 3), weights : (7,), squared fractional radius : (7,)
    """
    if radius <= 0:
        return axis[None, :], np.ones(1), np.zeros(1)
    helper = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    side = np.cross(axis, helper)
    side /= np.linalg.norm(side)
    up = np.cross(side, axis)
    angle = np.arange(6) * np.pi / 3
    offset = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up
    rho = np.sin(radius) * np.sqrt(2 / 3)
    ring = np.sqrt(1 - rho**2) * axis + rho * offset
    weights = np.array([1 / 4] + [1 / 8] * 6)
    return np.vstack([axis, ring]), weights, np.array([0.0] + [2 / 3] * 6)


def compile_scene(scene: Scene, wavelengths: Array) -> SceneTable:
    """Tables of a scene at wavelengths [nm], with all of its sunlight; the costly parts are kept between calls.

    Eclipses are for those solvers that can follow them: `skyscatter.solvers.eclipse.eclipse_table`.
    """
    if scene.world:
        material = scene.ground.material
        names = ", ".join(part.name for part in getattr(scene, scene.world, ())) or (material and material.kind)
        rule = "is more than shells of air over Lambertian ground, for the solver path alone; leave it out"
        raise DomainError(scene.world, names, rule)
    fields, columns = field_tables(scene.medium)
    sigma_s, sigma_t, emission, phase, cdf = medium_optics(scene.medium, tuple(float(w) for w in wavelengths))
    distance, star = scene.star_distance, scene.star
    irradiance = star.irradiance(wavelengths, distance)
    radius = float(np.arcsin(star.radius / distance))
    axis = scene.sun.direction
    directions, weights, square = disk_points(axis, radius)
    share: Array = weights[:, None] * star.limb(np.sqrt(1 - square), wavelengths)
    share = share / np.sum(share, axis=0)
    background = evaluate(scene.background, wavelengths)
    rings = np.linspace(0.0, 1.0, DISK_RINGS)
    solid_angle = np.pi * np.sin(radius) ** 2
    mean_radiance: Array = irradiance / solid_angle if radius > 0 else np.zeros(wavelengths.size)
    optics = OpticsTable(
        sigma_s=sigma_s,
        sigma_t=sigma_t,
        emission=emission,
        phase=phase,
        phase_cdf=cdf,
        mean_cosine=_mean_cosines(phase[:, :, wavelengths.size // 2]),
        sun_direction=np.ascontiguousarray(directions),
        sun_irradiance=share * irradiance,
        sun_chance=weights,
        disk_axis=axis,
        disk_radius=radius,
        disk_radiance=mean_radiance * star.limb(np.sqrt(1 - rings), wavelengths),
        albedo=mean_albedo(compile_ground(scene.ground, wavelengths)),
        emits=bool(np.any(emission)),
        glows=bool(np.any(emission) or np.any(background)),
        background=background,
    )
    return SceneTable(columns, optics, fields.breaks, NO_ECLIPSE)


def compile_ground(ground: Ground, wavelengths: Array) -> GroundTable:
    """The albedos of a ground at wavelengths [nm], and its map."""
    albedo = ground.reflectance(wavelengths)[None]
    if ground.map is None:
        return GroundTable(albedo, np.zeros((0, 0), np.uint8), 1.0)
    return GroundTable(
        np.concatenate([albedo, ground.map.reflectance(wavelengths)]), ground.map.rows, ground.map.cell_size
    )


def mean_albedo(ground: GroundTable) -> Array:
    """Albedo of the mean cell of the map, or of ground without a map, shape (wavelength,)."""
    if ground.cells.size == 0:
        return ground.albedo[0]
    share = np.bincount(ground.cells.ravel(), minlength=len(ground.albedo)) / ground.cells.size
    return np.asarray(share @ ground.albedo)


def _mean_cosines(phase: Array) -> Array:
    """Mean cosine of tabulated phase functions (component, angle)."""
    mu = phase_cosines()
    mean = np.asarray(-2 * np.pi * np.trapezoid(phase * mu, mu, axis=1))
    return mean
