"""Solver ``single``: sunlight scattered once, by deterministic quadrature.

Leaves out all light that is scattered or reflected more than once: a clear blue sky loses a third of its light to
that, a hazy or twilight sky most of it.  The emission of the medium and light from outside are included as far as they
come straight to the observer.
"""

from __future__ import annotations

import numpy as np

from skyscatter.solvers.base import Answer, Array, Options, Rays
from skyscatter.solvers.kernels.optics import SceneTable
from skyscatter.solvers.kernels.single import make_scratch, single_rays

#: Largest disagreement of the two quadrature rules on a piece of a ray.  The result is as a rule ten times better, and
#: within 1e-4 in the worst case of the tests, where several pieces err the same way.
DEFAULT_TOLERANCE = 5e-5


def check(options: Options) -> None:
    """Refuse what means nothing here."""
    options.refuse("single", "samples", "noise", "max_order", "sampling", "orders")


def single_parts(scene: SceneTable, rays: Rays, tolerance: float) -> tuple[Array, Array, Array]:
    """Radiance scattered once, reflected once by the ground, and direct; each (ray, wavelength)."""
    shape = (len(rays.origins), scene.optics.albedo.size)
    scattered, ground, direct = np.empty(shape), np.empty(shape), np.empty(shape)
    single_rays(scene, rays.origins, rays.directions, tolerance, make_scratch(scene), scattered, ground, direct)
    return scattered, ground, direct


def solve(scene: SceneTable, rays: Rays, options: Options) -> Answer:
    """Radiance of single scattering; see `skyscatter.radiance`."""
    scattered, ground, direct = single_parts(scene, rays, options.tolerance or DEFAULT_TOLERANCE)
    layers = {"direct": direct, "scattered": scattered, "ground": ground} if options.parts else {}
    radiance = scattered + ground + direct
    return Answer(radiance, np.zeros_like(radiance), layers, np.zeros(len(radiance), np.int64))
