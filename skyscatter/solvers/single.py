"""Solver ``single``: sunlight scattered once, by deterministic quadrature.

Leaves out all light that is scattered or reflected more than once: a clear blue sky loses a third of its light to
that, a hazy or twilight sky most of it.  The emission of the medium and light from outside are included as far as they
come straight to the observer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skyscatter.geometry.meridian import meridian_turns
from skyscatter.kernels.optics import GroundTable, SceneTable, ground_rows
from skyscatter.kernels.polar import B1
from skyscatter.kernels.single import make_scratch, single_rays
from skyscatter.solvers.base import Answer, Array, Asked, Rays, Tables, prepare_tables
from skyscatter.solvers.eclipse import light_axis
from skyscatter.solvers.options import SINGLE_TOLERANCE, Single

#: Largest disagreement of the two quadrature rules on a piece of a ray.  The result is as a rule ten times better, and
#: within 1e-4 in the worst case of the tests, where several pieces err the same way.
DEFAULT_TOLERANCE = SINGLE_TOLERANCE

prepare = prepare_tables


def check(asked: Asked[Single]) -> None:
    """Refuse what means nothing here."""
    asked.refuse("single", "orders")


def single_parts(scene: SceneTable, land: GroundTable, rays: Rays, tolerance: float) -> tuple[Array, Array, Array]:
    """Radiance scattered once, reflected once by the ground, and direct; each (ray, wavelength)."""
    scattered, white, direct = white_parts(scene, rays, tolerance)
    # Plain or mapped, the albedo is the last factor: the order of a product decides its last bit.
    return scattered, white * met_albedo(scene, land, rays), direct


def white_parts(scene: SceneTable, rays: Rays, tolerance: float) -> tuple[Array, Array, Array]:
    """The same over white ground."""
    shape = (len(rays.origins), scene.optics.albedo.size)
    scattered, white, direct = np.empty(shape), np.empty(shape), np.empty(shape)
    single_rays(scene, rays.origins, rays.directions, tolerance, make_scratch(scene), scattered, white, direct)
    return scattered, white, direct


def met_albedo(scene: SceneTable, land: GroundTable, rays: Rays) -> Array:
    """Albedo of the ground where rays meet it, shape (ray or 1, wavelength); any number where they do not."""
    if land.cells.size == 0:
        return land.albedo[:1]
    rows = np.zeros(len(rays.origins), np.int64)
    ground_rows(land, ground_points(scene.columns.radius, rays)[0], rows)
    return land.albedo[rows]


def ground_points(radius: float, rays: Rays) -> tuple[Array, NDArray[np.bool_]]:
    """Where rays meet the ground (ray, 3), or are nearest to it, and which do; one that starts there meets it there."""
    along = np.sum(rays.origins * rays.directions, axis=1)
    nearest = rays.origins - along[:, None] * rays.directions
    square = radius**2 - np.sum(nearest**2, axis=1)
    half = np.sqrt(np.maximum(square, 0.0))
    return rays.origins + np.maximum(-along - half, 0.0)[:, None] * rays.directions, (square > 0.0) & (along < 0.0)


def single_polarisation(
    scene: SceneTable, land: GroundTable, matrix: Array, rays: Rays, tolerance: float
) -> tuple[Array, Array]:
    """Q and U of light scattered once, each (ray, wavelength).

    Along a straight line both the plane of scattering and the meridian plane stay the same.  Referred to the former, Q
    is the radiance with b1 in place of the phase function; one rotation refers it to the latter.
    """
    optics = scene.optics._replace(phase=matrix[:, B1].copy(), emits=False)
    q = single_parts(scene._replace(optics=optics), land, rays, tolerance)[0]
    turned = meridian_turns(rays.origins, rays.directions, light_axis(scene.optics))
    return q * turned[:, :1], q * turned[:, 1:]


def solve(tables: Tables, rays: Rays, asked: Asked[Single]) -> Answer:
    """Radiance of single scattering, see `skyscatter.radiance`."""
    return answer(tables, rays, asked, met_albedo(tables.scene, tables.ground, rays))


def answer(tables: Tables, rays: Rays, asked: Asked[Single], factors: Array) -> Answer:
    """The same over ground of some reflectance factors, (ray or 1, wavelength)."""
    scene, land, matrix = tables
    tolerance = asked.how.tolerance or DEFAULT_TOLERANCE
    scattered, white, direct = white_parts(scene, rays, tolerance)
    ground = white * factors
    layers = {"direct": direct, "scattered": scattered, "ground": ground} if asked.parts else {}
    radiance = scattered + ground + direct
    zero = np.zeros_like(radiance)
    if matrix is not None:
        q, u = single_polarisation(scene, land, matrix, rays, tolerance)
        layers |= {"Q": q, "U": u, "V": zero} | {f"{name}_error": zero for name in "QUV"}
    return Answer(radiance, zero, layers, np.zeros(len(radiance), np.int64))
