"""Polarised light scattered once over smooth floors and by the sea: electric fields as vectors in three dimensions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.media.everywhere import Everywhere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import Rayleigh
from skyscatter.surfaces.lamps import PointLamp
from skyscatter.surfaces.materials import Conductor, Dielectric, Interface, Mirror
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene, Viewpoint
from skyscatter.surfaces.shapes import Box, Plane

Array = NDArray[Any]
POWER, THIN = 2.0, 1e-5
LAMP = np.array([0.5, 1.0, 0.8])
EYE = np.array([-2.0, 0.3, 1.5])
#: Of integrals along a ray.
NODES = np.polynomial.legendre.leggauss(256)
#: Where the gas is.
ROOM = Box(position=(0, 0, 2), size=(6, 6, 3.9))
#: What lies below z = 0, with the indices above and below; complex ones of metal.
FLOORS: dict[str, tuple[Any, float, complex]] = {
    "metal": (Conductor(n=0.6, k=2.1), 1.0, 0.6 + 2.1j),
    "mirror": (Mirror(reflectance=0.8), 1.0, 0j),
    "glass": (Dielectric(), 1.0, 1.5 + 0j),
    "total": (Dielectric(), 1.5, 1.0 + 0j),
}


def gas(extinction: float, phase: Any = None) -> skyscatter.Component:
    optics = Particles(extinction=extinction, single_scattering_albedo=1.0, phase=phase or Rayleigh())
    return skyscatter.Component(name="gas", density=Everywhere(), optics=optics)


def over_floor(floor: str | None, extinction: float = THIN, phase: Any = None) -> SurfaceScene:
    """A lamp in thin gas, above a smooth plane or nothing at all."""
    # No endless line: of what lies far away too few photons are found for errors that are normal.
    bodies: tuple[Body, ...] = (Body(name="room", shape=ROOM, material=Interface(), inside="gas"),)
    above, below = 1.0, 1.0
    if floor is not None:
        material, above, index = FLOORS[floor]
        inside = {"inside": "below"} if floor in ("glass", "total") else {}
        below = index.real if inside else 1.0
        bodies += (Body(name="floor", shape=Plane(), material=material, **inside),)
    return SurfaceScene(
        media=(
            SurfaceMedium(name="around", index=above),
            SurfaceMedium(name="gas", components=(gas(extinction, phase),), index=above),
            SurfaceMedium(name="below", index=below),
        ),
        bodies=bodies,
        lamps=(PointLamp(name="lamp", position=tuple(LAMP), power=POWER),),
        viewpoint=Viewpoint(position=tuple(EYE), target=(0, 0, 0)),
    )


def sights(*pairs: tuple[float, float]) -> tuple[Array, Array]:
    """Origins and directions (ray, 3) from azimuths and elevations."""
    d = direction_from_azimuth_elevation(*np.array(pairs).T)
    return np.broadcast_to(EYE, d.shape), d


#: Angles of incidence of 60, 50 and 30 degrees, and one look up.
LOOKS = ((80.0, -30.0), (60.0, -40.0), (95.0, -60.0), (70.0, 20.0))


def amplitudes(above: float, index: complex, cosine: Array) -> tuple[Array, Array]:
    """Amplitude coefficients r_p, r_s of a boundary from above, fields exp(-i omega t)."""
    beyond = np.sqrt(1 - (above / index) ** 2 * (1 - cosine**2) + 0j)
    # The wave beyond fades away downwards.
    beyond = np.where((index * beyond).imag < 0, -beyond, beyond)
    along = (index * cosine - above * beyond) / (index * cosine + above * beyond)
    across = (above * cosine - index * beyond) / (above * cosine + index * beyond)
    return along, across


def turned_field(along: Array, across: Array, field: Array, k: Array, normal: Array) -> tuple[Array, Array]:
    """Fields (n, 3) of light along k (n, 3) that is reflected by facets of these normals, and its new direction."""
    after = k - 2 * np.sum(k * normal, axis=-1, keepdims=True) * normal
    s = np.cross(k, after)
    s /= np.linalg.norm(s, axis=-1, keepdims=True)
    p, p_after = np.cross(s, k), np.cross(s, after)
    dot = [np.sum(field * axis, axis=-1) for axis in (p, s)]
    return (along * dot[0])[:, None] * p_after + (across * dot[1])[:, None] * s, after


def reflected_field(floor: str, field: Array, k: Array) -> tuple[Array, Array]:
    """The same of the plane z = 0."""
    if floor == "mirror":
        along, across = np.full(len(k), 0.8**0.5 + 0j), np.full(len(k), -(0.8**0.5) + 0j)
    else:
        along, across = amplitudes(*FLOORS[floor][1:], -k[:, 2])
    return turned_field(along, across, field, k, np.array([0.0, 0.0, 1.0]))


def stokes_of(field: Array, d: Array) -> Array:
    """Stokes vectors (n, 4) of fields that travel along -d, (3,) or (n, 3), as in docs/conventions.md."""
    v = np.array([0.0, 0.0, 1.0]) - d[..., 2:] * d
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    a, b = np.sum(field * v, axis=-1), np.sum(field * np.cross(v, d), axis=-1)
    return np.stack([
        abs(a) ** 2 + abs(b) ** 2, abs(a) ** 2 - abs(b) ** 2, 2 * (a * b.conj()).real, 2 * (a.conj() * b).imag,
    ], axis=-1)  # fmt: skip


def leg(
    floor: str | None,
    origin: Array,
    d: Array,
    ends: tuple[float, float],
    seen_by: Array | None,
    images: tuple[bool, ...] = (False, True),
) -> Array:
    """Stokes vector of what a leg sends to the camera; `seen_by` is the camera's own direction before a mirror.

    Of `images` False is the lamp itself, True the one in the mirror.
    """
    x, w = NODES
    # Distances evenly by angle from the point nearest to the lamp.
    sides = (np.array(ROOM.position) + np.outer([-0.5, 0.5], ROOM.size) - origin) / d
    ends = max(ends[0], sides.min(axis=0).max()), min(ends[1], sides.max(axis=0).min())
    near = (LAMP - origin) @ d
    apart = np.linalg.norm(LAMP - origin - near * d)
    low, high = (np.arctan((t - near) / apart) for t in ends)
    angle = 0.5 * (high + low) + 0.5 * (high - low) * x
    weight = 0.5 * (high - low) * w * apart / np.cos(angle) ** 2
    y = origin + (near + apart * np.tan(angle))[:, None] * d
    total = np.zeros(4)
    for image in images if floor else (False,):
        lamp = LAMP * ([1, 1, -1] if image else [1, 1, 1])
        way = y - lamp
        r = np.linalg.norm(way, axis=-1, keepdims=True)
        k = way / r
        start = k * ([1, 1, -1] if image else [1, 1, 1])
        one = np.cross(start, [0.3, 0.5, 0.8])
        one /= np.linalg.norm(one, axis=-1, keepdims=True)
        for field in (one, np.cross(start, one)):  # two halves of unpolarised light
            amplitude, flies = field * np.sqrt(0.5), start
            if image and floor:
                amplitude, flies = reflected_field(floor, amplitude, start)
            # A dipole sends out what of its field lies across the line of sight; 3 / 8 pi of the power into it.
            light = np.sqrt(3 / (8 * np.pi)) * (amplitude - (amplitude @ d)[:, None] * d)
            if seen_by is not None and floor:
                light, _ = reflected_field(floor, light, np.broadcast_to(-d, light.shape))
            sent = stokes_of(light, d if seen_by is None else seen_by)
            total += np.sum((weight * THIN * POWER / (4 * np.pi * r[:, 0] ** 2))[:, None] * sent, axis=0)
            assert np.allclose(flies, k)
    return total


def truth(floor: str | None, o: Array, d: Array, images: tuple[bool, ...] = (False, True)) -> Array:
    """Stokes vectors (ray, 4) of light scattered once, before and after reflections."""
    out = []
    for origin, sight in zip(o, d, strict=True):
        down = -origin[2] / sight[2] if floor and sight[2] < 0 else np.inf
        vector = leg(floor, origin, sight, (0.0, down), None, images)
        if down < np.inf:
            vector = vector + leg(floor, origin + down * sight, sight * [1, 1, -1], (0.0, np.inf), sight, images)
        out.append(vector)
    return np.array(out)


# --- the sea ------------------------------------------------------------------------------------------------------


def facet_stokes(index: complex, light: Array, wi: Array, wo: Array) -> Array:
    """Stokes vectors (n, 4), seen along -wo, of light (n, 4), seen along wi, that facets reflect from wi to wo (n, 3).

    Linear light alone: a half of what is not polarised in each of two fields, and what is in one.
    """
    normal = wi + wo
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    coefficients = amplitudes(1.0, index, np.sum(normal * wi, axis=-1))
    v = np.array([0.0, 0.0, 1.0]) - wi[:, 2:] * wi
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    left = np.cross(v, wi)
    linear, chi = np.hypot(light[:, 1], light[:, 2]), 0.5 * np.arctan2(light[:, 2], light[:, 1])
    plain = 0.5 * (light[:, 0] - linear)
    fields = [(plain, v), (plain, left), (linear, np.cos(chi)[:, None] * v + np.sin(chi)[:, None] * left)]
    total = np.zeros_like(light)
    for power, field in fields:
        turned, _ = turned_field(*coefficients, field, -wi, normal)
        total += power[:, None] * stokes_of(turned, -wo)
    return total


def hidden(slope: float, cosine: Array) -> Array:
    """Lambda of normally distributed slopes."""
    a = cosine / (slope * np.sqrt(1 - cosine**2))
    return np.asarray(0.5 * (np.exp(-a * a) / (a * np.sqrt(np.pi)) - erfc(a)))


def off_the_sea(slope: float, index: complex, wo: Array, light: Any, nodes: int = 24) -> Array:
    """Stokes vector (4,), seen along -wo (3,), of light that waves reflect once; `light(wi)` tells it as seen along wi.

    By Gauss-Hermite nodes over both slopes: P(slopes) (m . wo) / (m_z wo_z) / (1 + Lambda + Lambda').
    """
    x, w = np.polynomial.hermite.hermgauss(nodes)
    sx, sy = (s.ravel() for s in np.meshgrid(slope * x, slope * x))
    weight = np.outer(w, w).ravel() / np.pi
    m = np.stack([-sx, -sy, np.ones_like(sx)], axis=-1)
    m /= np.linalg.norm(m, axis=-1, keepdims=True)
    facing = m @ wo
    wi = 2 * facing[:, None] * m - wo
    some = (facing > 0) & (wi[:, 2] > 0)
    m, facing, wi, weight = m[some], facing[some], wi[some], weight[some]
    weight *= facing / (m[:, 2] * wo[2]) / (1 + hidden(slope, wo[2]) + hidden(slope, wi[:, 2]))
    sent = facet_stokes(index, np.array([light(one) for one in wi]), wi, np.broadcast_to(wo, wi.shape))
    return np.asarray(weight @ sent)
