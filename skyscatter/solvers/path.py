"""Solver ``path``: all orders of scattering by backward Monte Carlo.

The first order of sunlight comes from ``single``, without noise; random walks add the rest.  With
``sampling="free-flight"`` everything, the first order too, comes from plain walks with free flights drawn by the
extinction of the hero wavelength: slow, independent, and there to test the rest.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.geometry.meridian import meridian_frame
from skyscatter.kernels.flight import flight_rays, make_flight_scratch
from skyscatter.kernels.path import BATCHES, make_scratch, path_rays
from skyscatter.kernels.polar import make_polar
from skyscatter.solvers.base import Answer, Array, Asked, Rays, Tables, Walks, prepare_tables
from skyscatter.solvers.direct import outward_profile, slant_columns
from skyscatter.solvers.options import AIR_TOLERANCE, USUAL_WALKS, Path
from skyscatter.solvers.single import single_parts, single_polarisation

if TYPE_CHECKING:
    from skyscatter.scene import Scene

DEFAULT_SAMPLES = USUAL_WALKS
#: Tolerance of the first order: its error, a tenth of this or less, is far below any noise that is worth waiting for.
DEFAULT_TOLERANCE = AIR_TOLERANCE
#: Where ``noise`` decides, no ray gets more walks than this.
MOST_SAMPLES = 1 << 20
#: Orders of scattering that are followed when nothing else is said: roulette ends all walks long before.
MOST_ORDERS = 100_000
SAMPLINGS = ("march", "free-flight")

#: Transport free paths of a vertical way through the air from which on few walks state too small an error, and how many
#: are few: in fog of 4.5 of them (g = 0.85, depth 30) 88 % of runs of 256 walks lie within two standard errors.
MOST_DEPTH, FEW_WALKS = 4.0, 1000
#: Mean cosine of the air, and transmittance from the ground to the Sun, beyond which plain walks miss the bright sky
#: around a low Sun: on Mars with the Sun at 3 degrees 72 % of runs of 1024 walks lie within two standard errors.
FORWARD, DIM_SUN = 0.5, 0.05
#: Mean cosine from which on that holds for marched walks in twilight, and elevation of the Sun [degree] from which on:
#: on Mars with the Sun at -3 degrees 83 % of runs of 1024 walks lie within two standard errors, at +1 degree 91.6 %.
TWILIGHT, LOW_SUN = 0.7, 1.5
#: Optical depth of scattering from which on a layer thinner than so many metres is rarely met by marched walks, whose
#: points lie in a few strata of each leg: in 10 m of fog of depth 1 runs of 4096 walks were up to 2.7 of their standard
#: errors dark.
SHEET_DEPTH, SHEET = 0.1, 500.0
#: Share of a layer's greatest density that it has at the ground if it is not aloft.  In the planet's shadow light comes
#: by way of what shines above, and few legs end there: under a tent from 11 to 18 km of depth 0.7, the Sun at -3
#: degrees, runs of other seeds differ by half and more.
ALOFT = 0.01
#: Heights at which a layer's column is looked up to find its thickness.
LOOKS = 501


def prepare(
    scene: Scene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Path],
    threads: int,
    progress: Callable[[float], None] | None,
) -> Tables:
    """The tables of a scene, and a word where walks that matter are too rare for their error bars."""
    tables = prepare_tables(scene, rays, wavelengths, asked, threads, progress)
    warn_of_rare_walks(scene, tables, asked)
    return tables


def warn_of_rare_walks(scene: Scene, tables: Tables, asked: Asked[Path]) -> None:
    """Warn of scenes in which a sample cannot know its own error, from the scene alone."""
    if asked.how.sampling == "free-flight":
        if hidden_sun(scene, tables):
            warnings.warn(
                f"sampling = 'free-flight' with sun_elevation_deg = {scene.sun.elevation_deg:g}: plain walks from dark "
                "ground hardly ever find the light of so low a Sun, and the standard error of those that have not is "
                "too small; leave sampling out",
                stacklevel=2,
            )
        return
    column = outward_profile(tables.scene.columns)[0]
    scattered = column @ tables.scene.optics.sigma_s
    forward = (column * tables.scene.optics.mean_cosine) @ tables.scene.optics.sigma_s
    if scene.sun.elevation_deg < LOW_SUN and np.any(forward > TWILIGHT * scattered):
        warnings.warn(
            f"sun_elevation_deg = {scene.sun.elevation_deg:g}: by so low a Sun through air that scatters forward the "
            "standard error of walks is too small; take the solver orders",
            stacklevel=2,
        )
    for name, thickness in thin_layers(scene, tables):
        warnings.warn(
            f"the layer {name!r} is at most {thickness:.3g} m thick: marched walks rarely meet it, and their standard "
            "error is too small; take the solver orders, or sampling='free-flight'",
            stacklevel=2,
        )
    for name in layers_aloft(scene, tables) if scene.sun.elevation_deg < 0 else ():
        warnings.warn(
            f"sun_elevation_deg = {scene.sun.elevation_deg:g}: in twilight marched walks rarely find the light of "
            f"a layer aloft, {name!r}, and their standard error is too small; take the solver orders",
            stacklevel=2,
        )
    depth, name = transport_depth(scene, tables)
    walks = FEW_WALKS if asked.how.noise is not None else walks_for(asked)
    if depth > MOST_DEPTH and walks < FEW_WALKS:
        warnings.warn(
            f"samples = {walks}: light comes through {depth:.3g} transport free paths of {name!r}, and the standard "
            f"error of fewer than {FEW_WALKS} walks is too small there; raise samples, or take the solver orders",
            stacklevel=2,
        )


def hidden_sun(scene: Scene, tables: Tables) -> bool:
    """Whether the ground lies in the planet's shadow, or sees little of the Sun through air that scatters forward."""
    table = tables.scene
    column = slant_columns(table.columns, 0.0, float(np.sin(np.radians(scene.sun.elevation_deg))))
    if scene.sun.elevation_deg < 0 or column is None:
        return True
    scattered = column @ table.optics.sigma_s
    forward = (column * table.optics.mean_cosine) @ table.optics.sigma_s > FORWARD * scattered
    return bool(np.any(forward & (np.exp(-column @ table.optics.sigma_t) < DIM_SUN)))


def thin_layers(scene: Scene, tables: Tables) -> list[tuple[str, float]]:
    """Components that scatter much within little height, and their columns over their largest densities [m]."""
    density = densities(tables)
    thickness = density.sum(axis=0) / np.maximum(density.max(axis=0), 1e-300) * tables.scene.columns.top / len(density)
    thin = (thickness < SHEET) & scatters_much(tables)
    return [(scene.medium.components[k].name, float(thickness[k])) for k in np.flatnonzero(thin)]


def layers_aloft(scene: Scene, tables: Tables) -> list[str]:
    """Components that scatter much, and nothing near the ground."""
    density = densities(tables)
    aloft = (density[0] < ALOFT * density.max(axis=0)) & scatters_much(tables)
    return [scene.medium.components[k].name for k in np.flatnonzero(aloft)]


def densities(tables: Tables) -> Array:
    """Mean densities between even heights, from the ground up; (height, component)."""
    columns = tables.scene.columns
    height = np.linspace(0.0, columns.top, LOOKS)
    return np.asarray(-np.diff(outward_profile(columns, height), axis=0) / height[1])


def scatters_much(tables: Tables) -> NDArray[np.bool_]:
    """Whether a component's vertical depth of scattering counts; (component,)."""
    column = outward_profile(tables.scene.columns)[0]
    return np.asarray(np.any(column[:, None] * tables.scene.optics.sigma_s > SHEET_DEPTH, axis=1))


def transport_depth(scene: Scene, tables: Tables) -> tuple[float, str]:
    """Scatterings of a vertical way through the air, forward ones counted as none, and the component with most."""
    table = tables.scene
    depths = (outward_profile(table.columns)[0] * (1 - table.optics.mean_cosine))[:, None] * table.optics.sigma_s
    worst = int(np.argmax(depths.sum(axis=0)))
    return float(depths[:, worst].sum()), scene.medium.components[int(np.argmax(depths[:, worst]))].name


def check(asked: Asked[Path]) -> None:
    """Refuse what contradicts itself."""
    asked.refuse("path in shells", "transmittance")
    if asked.how.sampling is not None and asked.how.sampling not in SAMPLINGS:
        raise DomainError("sampling", asked.how.sampling, f"choose from {', '.join(SAMPLINGS)}")
    if asked.how.sampling == "free-flight":
        asked.refuse("path with free-flight sampling", "noise", "tolerance")


def walks_for(asked: Asked[Path]) -> int:
    """Walks per ray: what was asked for, rounded up to whole batches."""
    samples = DEFAULT_SAMPLES if asked.how.samples is None else int(asked.how.samples)
    return whole_batches(MOST_SAMPLES if asked.how.noise is not None else samples)


def whole_batches(samples: int) -> int:
    """So many walks, rounded up to whole batches where there are several of them."""
    return samples if samples < BATCHES else -(-samples // BATCHES) * BATCHES


def no_walks(tables: Tables, rays: int, asked: Asked[Path]) -> Walks:
    """The sums with which walks begin."""
    layers = 1 if tables.matrix is None else 4
    wavelengths = tables.scene.optics.sigma_s.shape[1]
    return Walks.none(rays, layers, min(walks_for(asked), BATCHES), asked.orders, wavelengths)


def solve(tables: Tables, rays: Rays, asked: Asked[Path], walks: Walks | None = None) -> Answer:
    """Radiance of all orders, see `skyscatter.radiance`; `walks` that were made before are gone on with."""
    scene, land, matrix = tables
    n, (components, wavelengths) = len(rays.origins), scene.optics.sigma_s.shape
    mean, error = np.empty((n, wavelengths)), np.empty((n, wavelengths))
    by_order = np.empty((n, asked.orders, wavelengths))
    used = np.empty(n, np.int64)
    max_order = MOST_ORDERS if asked.how.max_order is None else int(asked.how.max_order)
    seed, count = np.int64(asked.how.seed), walks_for(asked)
    tolerance = asked.how.tolerance or DEFAULT_TOLERANCE
    polar = None
    if matrix is not None:
        sums = 3 if asked.how.sampling == "free-flight" else min(count, BATCHES)
        polar = make_polar(matrix, meridian_frame(rays.origins, rays.directions)[0], sums)
    if asked.how.sampling == "free-flight":
        flight_rays(
            scene, land, rays.origins, rays.directions, rays.numbers, seed, count, max_order,
            make_flight_scratch(components, wavelengths), polar, mean, error, by_order, used,
        )  # fmt: skip
        scattered = ground = np.zeros_like(mean)
        direct = single_parts(scene, land, rays, DEFAULT_TOLERANCE)[2]
    else:
        scattered, ground, direct = single_parts(scene, land, rays, tolerance)
        walks = walks or no_walks(tables, n, asked)
        path_rays(
            scene, land, rays.origins, rays.directions, rays.numbers, scattered + ground, seed, count, walks.done,
            walks.sums, asked.how.noise or 0.0, max_order, make_scratch(components, wavelengths, count), polar, mean,
            error, walks.marked, used,
        )  # fmt: skip
        walks.done, by_order = count // walks.sums.shape[2], walks.mean(slice(None), used)
    layers = {}
    if matrix is not None and polar is not None:
        layers = {name: polar.mean[:, k] for k, name in enumerate("QUV")}
        if asked.how.sampling != "free-flight":
            q, u = single_polarisation(scene, land, matrix, rays, tolerance)
            layers |= {"Q": layers["Q"] + q, "U": layers["U"] + u}
        layers |= {f"{name}_error": polar.error[:, k] for k, name in enumerate("QUV")}
    if asked.parts:
        layers |= {"direct": direct, "scattered": scattered, "ground": ground, "multiple": mean}
    if asked.orders:
        by_order[:, 0] += scattered + ground
        layers |= {f"order{k + 1}": by_order[:, k] for k in range(asked.orders)}
    return Answer(scattered + ground + direct + mean, error, layers, used)
