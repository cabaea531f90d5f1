"""Lamps of towns that an observer aloft sees themselves."""

from __future__ import annotations

import numpy as np

from skyscatter.columns import transmittance
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array
from skyscatter.solvers.townlamps import lamps_of

#: Lamps and observer are lifted by this share of the planet's radius, so that both are outside of it.
LIFT = 1e-9


def lamps_seen(scene: Scene, wavelengths: Array) -> tuple[Array, Array]:
    """Lamps above whose horizon the observer is.

    Parameters
    ----------
    scene : Scene
    wavelengths : ndarray, shape (wavelength,)
        [nm]

    Returns
    -------
    directions : ndarray, shape (lamp, 3)
        Unit vectors (east, north, up) from the observer.
    irradiance : ndarray, shape (lamp, wavelength)
        What arrives of each on a plane that faces it [W m-2 nm-1]: power times lobe times transmittance over the
        square of the distance.
    """
    radius, eye = scene.medium.radius * (1 + LIFT), scene.observer.position
    directions, irradiance = [np.zeros((0, 3))], [np.zeros((0, wavelengths.size))]
    in_sight = np.arccos(scene.medium.radius / (scene.medium.radius + scene.altitude)) * scene.medium.radius
    for lamps in lamps_of(scene, wavelengths):
        near = lamps.distance < in_sight
        angle, azimuth = lamps.distance[near] / scene.medium.radius, lamps.azimuth[near]
        up = np.stack([np.sin(angle) * np.sin(azimuth), np.sin(angle) * np.cos(azimuth), np.cos(angle)], axis=1)
        away = eye - radius * up
        far = np.linalg.norm(away, axis=1)
        cosine = np.sum(away * up, axis=1) / np.maximum(far, 1e-300)
        seen = np.flatnonzero((cosine > 0) & (far > 1.0))
        if not seen.size:
            continue
        intensity = np.interp(cosine[seen], lamps.lobe[0], lamps.lobe[1], left=0.0)
        share = intensity * lamps.weight[near][seen] / far[seen] ** 2
        through = transmittance(scene, radius * up[seen], eye, wavelengths)
        directions.append(-away[seen] / far[seen, None])
        irradiance.append(share[:, None] * lamps.spectrum * through)
    return np.concatenate(directions), np.concatenate(irradiance)
