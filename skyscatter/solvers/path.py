"""Solver ``path``: all orders of scattering by backward Monte Carlo.

The first order of sunlight comes from ``single``, without noise; random walks add the rest.  With
``sampling="free-flight"`` everything, the first order too, comes from plain walks with free flights drawn by the
extinction of the hero wavelength: slow, independent, and there to test the rest.
"""

from __future__ import annotations

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.geometry.meridian import meridian_frame
from skyscatter.solvers.base import Answer, Options, Rays, Tables, prepare_tables
from skyscatter.solvers.kernels.flight import flight_rays, make_flight_scratch
from skyscatter.solvers.kernels.path import BATCHES, make_scratch, path_rays
from skyscatter.solvers.kernels.polar import make_polar
from skyscatter.solvers.single import single_parts, single_polarisation

DEFAULT_SAMPLES = 16
#: Tolerance of the first order: its error, a tenth of this or less, is far below any noise that is worth waiting for.
DEFAULT_TOLERANCE = 5e-4
#: Where ``noise`` decides, no ray gets more walks than this.
MOST_SAMPLES = 1 << 20
#: Orders of scattering that are followed when nothing else is said: roulette ends all walks long before.
MOST_ORDERS = 100_000
SAMPLINGS = ("march", "free-flight")

prepare = prepare_tables


def check(options: Options) -> None:
    """Refuse what contradicts itself."""
    options.refuse("path in shells", "transmittance")
    if options.samples is not None and options.noise is not None:
        raise DomainError("samples", options.samples, "give samples or noise, not both")
    if options.sampling is not None and options.sampling not in SAMPLINGS:
        raise DomainError("sampling", options.sampling, f"choose from {', '.join(SAMPLINGS)}")
    if options.sampling == "free-flight":
        options.refuse("path with free-flight sampling", "noise", "tolerance")


def walks_for(options: Options) -> int:
    """Walks per ray: what was asked for, rounded up to whole batches."""
    samples = DEFAULT_SAMPLES if options.samples is None else int(options.samples)
    if options.noise is not None:
        samples = MOST_SAMPLES
    return samples if samples < BATCHES else -(-samples // BATCHES) * BATCHES


def solve(tables: Tables, rays: Rays, options: Options) -> Answer:
    """Radiance of all orders, see `skyscatter.radiance`."""
    scene, land, matrix = tables
    n, (components, wavelengths) = len(rays.origins), scene.optics.sigma_s.shape
    mean, error = np.empty((n, wavelengths)), np.empty((n, wavelengths))
    by_order = np.empty((n, options.orders, wavelengths))
    used = np.empty(n, np.int64)
    max_order = MOST_ORDERS if options.max_order is None else int(options.max_order)
    seed, walks = np.int64(options.seed), walks_for(options)
    tolerance = options.tolerance or DEFAULT_TOLERANCE
    polar = None
    if matrix is not None:
        sums = 3 if options.sampling == "free-flight" else min(walks, BATCHES)
        polar = make_polar(matrix, meridian_frame(rays.origins, rays.directions)[0], sums)
    if options.sampling == "free-flight":
        flight_rays(
            scene, land, rays.origins, rays.directions, rays.numbers, seed, walks, max_order,
            make_flight_scratch(components, wavelengths), polar, mean, error, by_order, used,
        )  # fmt: skip
        scattered = ground = np.zeros_like(mean)
        direct = single_parts(scene, land, rays, DEFAULT_TOLERANCE)[2]
    else:
        scattered, ground, direct = single_parts(scene, land, rays, tolerance)
        path_rays(
            scene, land, rays.origins, rays.directions, rays.numbers, scattered + ground, seed, walks,
            options.noise or 0.0, max_order, make_scratch(components, wavelengths, walks), polar, mean, error, by_order,
            used,
        )  # fmt: skip
    layers = {}
    if matrix is not None and polar is not None:
        layers = {name: polar.mean[:, k] for k, name in enumerate("QUV")}
        if options.sampling != "free-flight":
            q, u = single_polarisation(scene, land, matrix, rays, tolerance)
            layers |= {"Q": layers["Q"] + q, "U": layers["U"] + u}
        layers |= {f"{name}_error": polar.error[:, k] for k, name in enumerate("QUV")}
    if options.parts:
        layers |= {"direct": direct, "scattered": scattered, "ground": ground, "multiple": mean}
    if options.orders:
        by_order[:, 0] += scattered + ground
        layers |= {f"order{k + 1}": by_order[:, k] for k in range(options.orders)}
    return Answer(scattered + ground + direct + mean, error, layers, used)
