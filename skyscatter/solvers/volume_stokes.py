"""Solver ``path`` for polarised light in media of three dimensions: walks as among surfaces, where there are none.

The walks of `skyscatter.solvers.volume_path` do not know of polarisation; these do, and take longer to the same error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyscatter.solvers import surface_path
from skyscatter.solvers.base import Array, Asked, Rays
from skyscatter.solvers.depths import warn_of_depths
from skyscatter.solvers.options import SPACE_TOLERANCE, Path
from skyscatter.solvers.surface_path import Context, no_walks, solve
from skyscatter.solvers.volume_single import prepare as prepare_single

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyscatter.space import SpaceScene

__all__ = ["DEFAULT_TOLERANCE", "check", "no_walks", "prepare", "solve"]

#: Tolerance of what pictures add beside the solver, as for `skyscatter.solvers.photons`.
DEFAULT_TOLERANCE = SPACE_TOLERANCE


def check(asked: Asked[Path]) -> None:
    """Refuse what means nothing here."""
    asked.refuse("path with polarised light in three dimensions", "sampling", "tolerance", "transmittance")


def prepare(
    scene: SpaceScene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Path],
    threads: int,
    progress: Callable[[float], None] | None,
) -> Context:
    """The tables of a scene, and a word where its dust is too deep for walks."""
    table = prepare_single(scene, rays, wavelengths, asked, threads, progress)
    warn_of_depths(table, rays, tuple(component.name for component in scene.medium.components), asked)
    return surface_path.prepare(scene, rays, wavelengths, asked, threads, progress)
