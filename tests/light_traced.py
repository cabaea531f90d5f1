"""Light traced from a star through voxels to a distant eye, in numpy.

Free flights, and at every scattering what goes on to the eye.  It shares nothing with the package but the density's
values.  Walks from the eye meet the star's 1 / r^2, and rare walks close to it bring a large part of the light; light
that goes to a distant eye has no such pole.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

Array = NDArray[np.float64]


class Lump(NamedTuple):
    """Dust on the cube from -1 to 1, zero beyond radius 1, and a star of power 1."""

    density: Array  #: (x, y, z), trilinear between the middles of cells
    extinction: float  #: where the density is 1
    albedo: float
    g: float  #: Henyey-Greenstein
    star: Array

    def extinction_at(self, places: Array) -> Array:
        cells = self.density.shape[0]
        return np.asarray(
            self.extinction * map_coordinates(self.density, 0.5 * (places.T + 1) * cells - 0.5, order=1, cval=0.0)
        )


def traced(lump: Lump, eye: Array, ring: tuple[float, float], photons: int, seed: int) -> Array:
    """Mean radiance in a ring around the star, between two angles [rad] seen from the eye.

    Of light scattered once, and of the rest.
    """
    random = np.random.default_rng(seed)
    middle = (lump.star - eye) / np.linalg.norm(lump.star - eye)
    place, way, weight = np.tile(lump.star, (photons, 1)), _anywhere(random, photons), np.ones(photons)
    seen = [0.0, 0.0]
    first = True
    while len(place):
        place, inside = _flown(lump, place, way, random)
        place, way, weight = place[inside], way[inside], weight[inside] * lump.albedo
        to_eye = eye - place
        distance = np.linalg.norm(to_eye, axis=1)
        to_eye /= distance[:, None]
        sine = np.linalg.norm(np.cross(to_eye, middle), axis=1)
        in_ring = (np.sin(ring[0]) < sine) & (sine < np.sin(ring[1]))
        given = weight * _chance(lump.g, np.einsum("pk,pk->p", way, to_eye)) / distance**2
        given = given[in_ring] * np.exp(-_depth(lump, place[in_ring], to_eye[in_ring], random))
        seen[0 if first else 1] += given.sum()
        first = False
        way = _turned(lump.g, way, random)
        kept = random.random(len(weight)) < np.minimum(weight / 0.1, 1.0)
        place, way, weight = place[kept], way[kept], np.maximum(weight[kept], 0.1)
    return np.array(seen) / photons / (2 * np.pi * (np.cos(ring[0]) - np.cos(ring[1])))


def _anywhere(random: np.random.Generator, number: int) -> Array:
    way = random.normal(size=(number, 3))
    return np.asarray(way / np.linalg.norm(way, axis=1)[:, None])


def _flown(lump: Lump, place: Array, way: Array, random: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """Where free flights end, by delta tracking, and whether that is inside of the sphere."""
    most = lump.extinction * lump.density.max()
    place, going = place.copy(), np.arange(len(place))
    while going.size:
        place[going] += (random.exponential(1 / most, going.size))[:, None] * way[going]
        out = np.einsum("pk,pk->p", place[going], place[going]) > 1
        ends = random.random(going.size) * most < lump.extinction_at(place[going])
        going = going[~(out | ends)]
    return place, np.einsum("pk,pk->p", place, place) <= 1


def _depth(lump: Lump, place: Array, way: Array, random: np.random.Generator) -> Array:
    """Optical depth from places in the sphere to its surface, by points one in each of equal steps of a third cell."""
    along = np.einsum("pk,pk->p", place, way)
    length = -along + np.sqrt(np.maximum(along**2 + 1 - np.einsum("pk,pk->p", place, place), 0.0))
    points = 3 * lump.density.shape[0]
    depth = np.zeros(len(place))
    for k in range(points):
        t = (k + random.random(len(place))) / points * length
        depth += lump.extinction_at(place + t[:, None] * way)
    return np.asarray(depth * length / points)


def _chance(g: float, cosine: Array) -> Array:
    return np.asarray((1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5))


def _turned(g: float, way: Array, random: np.random.Generator) -> Array:
    """Directions after a scattering."""
    square = ((1 - g * g) / (1 - g + 2 * g * random.random(len(way)))) ** 2
    cosine = (1 + g * g - square) / (2 * g)
    side = np.cross(way, _anywhere(random, len(way)))  # of any azimuth about the way
    side /= np.linalg.norm(side, axis=1)[:, None]
    return np.asarray(cosine[:, None] * way + np.sqrt(np.maximum(1 - cosine**2, 0.0))[:, None] * side)
