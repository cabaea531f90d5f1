"""Visibility points: where the light of the photons is gathered."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.surfaces import STACK

#: What may have happened to a photon before it is gathered, one bit each: nothing at all since it left a lamp that rays
#: to lamps find too; only reflections and refractions without any spread; more; none of that to light from all around.
DIRECT, FOCUSED, SCATTERED, AMBIENT = 1, 2, 4, 8


@by_address
class Points(NamedTuple):
    """The visibility points of a pass, those in media or those on surfaces."""

    place: np.ndarray  #: (point, 3) [m]
    centre: np.ndarray  #: (point, 3) of the sphere or disk in which light is gathered [m]: beside the point near walls
    direction: np.ndarray  #: (point, 3) of the camera's walk, away from the camera
    normal: np.ndarray  #: (point, 3) outward normal of the surface
    density: np.ndarray  #: (point, component) in the medium
    weight: np.ndarray  #: (point, wavelength) by which scattered light counts for the ray: [m] in media, 1 on surfaces
    ray: np.ndarray  #: (point,) int64
    medium: np.ndarray  #: (point,) int64: the point's, or that on the walk's side of the surface
    beyond: np.ndarray  #: (point,) int64, medium on the other side
    body: np.ndarray  #: (point,) int64, whose surface it is
    item: np.ndarray  #: (point,) int64, and which item of it
    order: np.ndarray  #: (point,) int64, what happened between camera and point
    accepts: np.ndarray  #: (point,) int64, kinds of photons that count
    reach: np.ndarray  #: (point,) radius [m] of the sphere or disk in which light is gathered
    area: np.ndarray  #: (point,) share of the disk that lies on the surface and in sight
    crowded: np.ndarray  #: (point,) bool, whether something stands on the disk
    stack: np.ndarray  #: (point, STACK) int64, media that the point is inside of, on the walk's side of a surface
    count: np.ndarray  # type: ignore[assignment]  #: (1,) int64, points in use


def make_points(capacity: int, components: int, wavelengths: int) -> Points:
    """Room for so many points: 8 (29 + components + wavelengths) bytes each."""
    return Points._make([
        *(np.zeros((capacity, 3)) for _ in range(4)), np.zeros((capacity, components)),
        np.zeros((capacity, wavelengths)), *(np.zeros(capacity, np.int64) for _ in range(7)),
        np.zeros(capacity), np.ones(capacity), np.zeros(capacity, np.bool_),
        np.full((capacity, STACK), -1), np.zeros(1, np.int64),
    ])  # fmt: skip
