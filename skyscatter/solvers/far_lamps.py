"""Lamps that walks or photons meet too seldom: what is said before a run, for no error bar can tell it afterwards.

Light diffuses in a dense medium: of walks with the single-scattering albedo w and the mean cosine g the share
exp(-k t) / (1 + t (1 - g)),  k^2 = 3 (1 - w) (1 - w g),  comes some t free paths away (Ishimaru 1978, Wave propagation
and scattering in random media, section 9), to the order of magnitude.  Where hardly one of all is expected there,
the spread of those that came tells nothing of those that did not.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.kernels.codes.surfaces import BOX, CONDUCTOR, DIELECTRIC, MIRROR, POINT_LAMP, SPHERE, SURFACE_LAMP
from skyscatter.kernels.surfaces.tables import LampTable, MediaTable
from skyscatter.solvers.compile import phase_cosines

if TYPE_CHECKING:
    from skyscatter.kernels.surfaces.gathering import WalkTable

Array = NDArray[np.float64]
#: Expected number of walks along a ray (or of photons) that find a lamp, below which there is a warning.
FEW = 0.1
#: Share of the walks that aim at one cell of a picture all around from which on it is a spot.
SPOT = 0.02


def current_medium(media: MediaTable, stack: NDArray[np.int64]) -> int:
    """The medium of highest priority in a stack, of several the one entered last; 0 in an empty one."""
    entered = [int(m) for m in stack if m >= 0]
    return max(reversed(entered), key=lambda m: media.priority[m], default=0)


def share_through_fog(table: WalkTable, place: Array) -> float:
    """Share of the walks from a place that diffuse as far as the nearest lamp, at the best wavelength.

    Only the medium at the place counts, and only where it is the same everywhere: elsewhere 1.
    """
    from skyscatter.surfaces.packing import starting_stack

    media, guide = table.media, table.guide
    near = np.isin(table.lamps.kind, (POINT_LAMP, SURFACE_LAMP)) & (guide.power > 0)
    m = current_medium(media, starting_stack(table.shapes, place))
    if not (near.any() and media.constant[m] and guide.scatters[m]):
        return 1.0
    away = np.linalg.norm(guide.middle[near] - place, axis=1) - guide.size[near]
    inside = np.flatnonzero(table.shapes.inside == m)
    reach = max((_extent(table, int(body)) for body in inside), default=np.inf) if m > 0 else np.inf
    depth = min(max(float(away.min()), 0.0), reach) * media.extinction[m]
    g, k = diffusion(media, m)
    return float((np.exp(-k * depth) / (1 + depth * (1 - g))).max())


def diffusion(media: MediaTable, m: int) -> tuple[Array, Array]:
    """Mean cosine g of a medium that is the same everywhere, and its rate k over a free path, (wavelength,)."""
    albedo = np.where(media.extinction[m] > 0, media.scattering[m] / np.maximum(media.extinction[m], 1e-300), 0.0)
    g = _mean_cosine(media, m)
    return g, np.sqrt(3 * np.clip(1 - albedo, 0, 1) * np.clip(1 - albedo * g, 0, None))


def _mean_cosine(media: MediaTable, m: int) -> Array:
    mu = phase_cosines()
    own = slice(media.first[m], media.first[m + 1])
    weight = media.density[own, None] * media.sigma_s[own]
    phase = np.einsum("cw,caw->aw", weight / np.maximum(weight.sum(axis=0), 1e-300), media.phase[own]) * mu[:, None]
    return np.asarray(np.pi * ((phase[1:] + phase[:-1]) * (mu[:-1] - mu[1:])[:, None]).sum(axis=0))


def _extent(table: WalkTable, body: int) -> float:
    """Diagonal [m] of the box around a body with a volume, of a sphere its diameter."""
    shapes = table.shapes
    mesh = shapes.triangle[shapes.triangle_body == body][:, :9].reshape(-1, 3)
    sizes = [float(np.linalg.norm(np.ptp(mesh, axis=0)))] if len(mesh) else []
    for row in np.flatnonzero(shapes.shape_body == body):
        p, kind = shapes.parameters[row], shapes.kind[row]
        size = 2 * p[3] if kind == SPHERE else 2 * np.linalg.norm(p[3:6]) if kind == BOX else np.inf
        sizes.append(float(size))
    return max(sizes)


def share_by_glass(table: WalkTable) -> float:
    """Share of the walks from smooth glass or a mirror that meet the largest lamp with a surface; 1 without either.

    Where there is none of these, a bright spot of a picture all around counts.
    As if it were seen from the rim of the scene: by its size over that of the scene.
    """
    materials, lamps = table.materials, table.lamps
    smooth = np.isin(materials.kind, (MIRROR, DIELECTRIC, CONDUCTOR)) & (materials.roughness == 0)
    shining = (lamps.kind == SURFACE_LAMP) & (table.guide.power > 0)
    if not smooth.any():
        return 1.0
    if not shining.any():
        return share_by_spot(lamps)
    return float(min(table.guide.size[shining].max() / (2 * max(lamps.radius, 1e-300)), 1.0) ** 2)


def share_by_spot(lamps: LampTable) -> float:
    """Share of all directions in which the brightest cell of a picture lies; 1 where none holds much of its light."""
    chance = np.diff(lamps.around_cdf, prepend=0.0)
    if not chance.size or chance.max() < SPOT:
        return 1.0
    rows, columns = lamps.around.shape[:2]
    row = int(np.argmax(chance)) // columns
    return float(np.diff(np.sin(np.pi * (np.array([row, row + 1]) / (rows - 1) - 0.5)))[0] / 2 / columns)


def warn_of_far_lamps(table: WalkTable, origins: Array, tries: int, remedy: str) -> None:
    """Warn where fewer than `FEW` of so many walks (or photons) come from the camera's place to a lamp (or back)."""
    if len(origins) and share_through_fog(table, np.median(origins, axis=0)) * tries < FEW:
        warnings.warn(
            f"the medium at the viewpoint is so dense that next to none of {tries} walks come from there to a lamp: "
            f"the light and its stated error may both be far too small; {remedy}",
            stacklevel=3,
        )


def warn_of_small_lamps(table: WalkTable, tries: int) -> None:
    """Warn where fewer than `FEW` of so many walks from smooth glass or a mirror meet a lamp: none can be aimed."""
    if share_by_glass(table) * tries < FEW:
        warnings.warn(
            f"lamps are so small that next to none of {tries} walks meet one by way of smooth glass or a mirror: that "
            "light and its stated error may both be far too small; choose the solver photons, or give more samples",
            stacklevel=3,
        )
