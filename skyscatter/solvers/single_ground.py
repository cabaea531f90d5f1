"""Solver ``single`` over a ground of any opaque material that is rough: land by its formulas, the sea, a mosaic.

What a white Lambertian ground reflects of the Sun is multiplied by the material's reflectance factor between the Sun,
averaged over what is up of its disk, and the observer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.ground import Ground
from skyscatter.solvers import single
from skyscatter.solvers.base import Answer, Array, Asked, Rays, Tables, prepare_tables
from skyscatter.surfaces.materials import Conductor, Mirror, Mosaic, Sea
from skyscatter.surfaces.packing import pack_materials, unfolded

if TYPE_CHECKING:
    from skyscatter.kernels.surfaces.tables import MaterialTable
    from skyscatter.scene import Scene
    from skyscatter.solvers.options import Single

check = single.check


class Context(NamedTuple):
    """The tables of the air, and what the ground does to light."""

    tables: Tables
    materials: MaterialTable


def prepare(
    scene: Scene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Single],
    threads: int,
    progress: Callable[[float], None] | None,
) -> Context:
    """The tables of a scene; refused where its ground is smooth, or polarises the light that is asked for."""
    material: Any = scene.ground.material
    for part in [material.rest, *material.materials] if isinstance(material, Mosaic) else [material]:
        if isinstance(part, Mirror) or (isinstance(part, Conductor) and part.roughness == 0):
            rule = "is smooth: single does not see what it mirrors; take path"
            raise DomainError("ground.material", part.kind, rule)
        if asked.stokes and isinstance(part, (Conductor, Sea)):
            rule = "polarises what it reflects, and single takes the ground's light for unpolarised; take path"
            raise DomainError("ground.material", part.kind, rule)
    bare = scene.model_copy(update={"ground": Ground(albedo=1.0)})
    tables = prepare_tables(bare, rays, wavelengths, asked, threads, progress)
    return Context(tables, pack_materials(unfolded([material])[0], wavelengths))


def solve(context: Context, rays: Rays, asked: Asked[Single]) -> Answer:
    """Radiance of single scattering, see `skyscatter.radiance`."""
    return single.answer(context.tables, rays, asked, _factors(context, rays))


def _factors(context: Context, rays: Rays) -> Array:
    """Reflectance factors of the ground where rays meet it (ray, wavelength); 0 where they do not."""
    from skyscatter.kernels.surfaces.reflectance import reflectance_factors

    scene = context.tables.scene
    factors = np.zeros((len(rays.origins), scene.optics.albedo.size))
    points, met = single.ground_points(scene.columns.radius, rays)
    points = points[met]
    normals = points / np.linalg.norm(points, axis=1)[:, None]
    out = np.zeros((len(points), factors.shape[1]))
    # Maps lie in the frame of the ground below the observer.
    mapped, views = points - [0.0, 0.0, scene.columns.radius], np.ascontiguousarray(-rays.directions[met])
    vacuum, spare = np.ones(factors.shape[1]), np.zeros((2, factors.shape[1]))
    sun = scene.optics.sun_direction, scene.optics.sun_irradiance
    reflectance_factors(context.materials, mapped, normals, views, *sun, vacuum, spare, out)
    factors[met] = out
    return factors
