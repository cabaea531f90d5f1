"""A room in fog, for several renderers: its measures, the scene as skyscatter takes it and as Mitsuba 3 does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import skyscatter
from skyscatter.media.everywhere import Everywhere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.spectra.table import SpectralTable
from skyscatter.surfaces.lamps import AreaLamp
from skyscatter.surfaces.materials import Lambert
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene, Viewpoint
from skyscatter.surfaces.shapes import Rectangle

AT_ONCE = {"mono": 1, "rgb": 3, "spectral": 4}  #: wavelengths that a path of Mitsuba's carries, by variant

ROULETTE = 5  #: bounces after which Mitsuba's paths may end by chance: its default


@dataclass(frozen=True)
class FogRoom:
    """A closed room with diffuse walls, an area lamp in the middle of the ceiling, and fog throughout.

    The left wall (x = 0) is reddish, the right one bluish; everything else is grey.  `extinction` [m-1] is that at
    550 nm and goes as a power of the wavelength.
    """

    size: tuple[float, float, float] = (4.0, 5.0, 2.6)
    lamp: tuple[float, float, float, float] = (1.7, 2.7, 2.3, 3.3)  #: x0, y0, x1, y1 on the ceiling
    power: float = 1.0  #: of the lamp at every wavelength [W nm-1]
    grey: float = 0.7
    extinction: float = 0.5
    angstrom: float = 0.5
    albedo: float = 0.999
    g: float = 0.85
    eye: tuple[float, float, float] = (2.0, 0.15, 1.5)
    target: tuple[float, float, float] = (2.0, 5.0, 1.25)

    def sigma_t(self, wavelengths: Any) -> Any:
        """Extinction [m-1], (wavelength,)."""
        return self.extinction * (np.asarray(wavelengths) / 550.0) ** -self.angstrom

    def reflectance(self, wall: str, wavelengths: Any) -> Any:
        """Albedo of a wall, (wavelength,)."""
        rise = 0.15 + 0.6 / (1.0 + np.exp(-(np.asarray(wavelengths) - 580.0) / 25.0))
        if wall == "x-":
            return rise
        return 0.9 - rise if wall == "x+" else np.full(np.shape(wavelengths), self.grey)

    @property
    def radiance(self) -> float:
        """Of the lamp [W m-2 sr-1 nm-1]."""
        x0, y0, x1, y1 = self.lamp
        return self.power / (np.pi * (x1 - x0) * (y1 - y0))

    def rectangles(self) -> list[tuple[str, Any, Any, Any]]:
        """Wall, middle and two half edges (3,) of all rectangles; half edge 1 x half edge 2 points into the room.

        The ceiling has a hole where the lamp is, and the lamp is one of them.
        """
        x, y, z = self.size
        x0, y0, x1, y1 = self.lamp
        flat = [(0.0, 0.0, x, y0), (0.0, y1, x, y), (0.0, y0, x0, y1), (x1, y0, x, y1)]
        made: list[tuple[str, Any, Any, Any]] = []

        def add(name: str, *vectors: tuple[float, float, float]) -> None:
            middle, u, v = (np.array(vector) for vector in vectors)
            made.append((name, middle, u, v))

        for name, (a, b, c, d) in [*(("z+", part) for part in flat), ("lamp", self.lamp)]:
            add(name, ((a + c) / 2, (b + d) / 2, z), (0, (d - b) / 2, 0), ((c - a) / 2, 0, 0))
        add("z-", (x / 2, y / 2, 0), (x / 2, 0, 0), (0, y / 2, 0))
        add("x-", (0, y / 2, z / 2), (0, y / 2, 0), (0, 0, z / 2))
        add("x+", (x, y / 2, z / 2), (0, 0, z / 2), (0, y / 2, 0))
        add("y-", (x / 2, 0, z / 2), (0, 0, z / 2), (x / 2, 0, 0))
        add("y+", (x / 2, y, z / 2), (x / 2, 0, 0), (0, 0, z / 2))
        return made


def surface_room(room: FogRoom, wavelengths: Any) -> SurfaceScene:
    """The room as skyscatter takes it."""
    bodies = []
    for number, (wall, middle, u, v) in enumerate(room.rectangles()):
        shape = Rectangle(corner=tuple(middle - u - v), first_edge=tuple(2 * u), second_edge=tuple(2 * v))
        if wall == "lamp":
            body = Body(name="lamp", shape=shape, material=Lambert(albedo=0.0), lamp=AreaLamp(power=room.power))
        else:
            values = tuple(float(a) for a in room.reflectance(wall, wavelengths))
            table = SpectralTable(wavelengths=tuple(float(w) for w in wavelengths), values=values)
            body = Body(name=f"wall {number}", shape=shape, material=Lambert(albedo=table))
        bodies.append(body)
    fog = Particles(
        extinction=room.extinction, wavelength=550.0, angstrom_exponent=room.angstrom,
        single_scattering_albedo=room.albedo, phase=HenyeyGreenstein(g=room.g),
    )  # fmt: skip
    media = SurfaceMedium(name="fog", components=(skyscatter.Component(name="fog", density=Everywhere(), optics=fog),))
    viewpoint = Viewpoint(position=room.eye, target=room.target)
    return SurfaceScene(media=(media,), bodies=tuple(bodies), viewpoint=viewpoint)


def mitsuba_room(mi: Any, room: FogRoom, wavelengths: Any, integrator: str, more: dict[str, Any] | None = None) -> Any:
    """Scene and fog at one wavelength, at three in an rgb variant, at all in a spectral one.

    Nothing bounds the fog: rays are in it where they start, and walls do not change it.
    """
    spectral, rgb = mi.is_spectral, mi.is_rgb

    def spectrum(values: Any) -> Any:
        values = [float(v) for v in np.broadcast_to(values, np.shape(wavelengths))]
        if spectral and min(values) == max(values):  # a table of zeros is refused
            return {"type": "uniform", "value": values[0]}
        if spectral:
            return {
                "type": "irregular", "wavelengths": ", ".join(repr(float(w)) for w in wavelengths),
                "values": ", ".join(map(repr, values)),
            }  # fmt: skip
        return {"type": "rgb", "value": values} if rgb else values[0]

    def volume(values: Any) -> Any:
        return {"type": "constvolume", "value": spectrum(values)}

    fog = mi.load_dict({
        "type": "homogeneous", "sigma_t": volume(room.sigma_t(wavelengths)), "albedo": volume(room.albedo),
        "phase": {"type": "hg", "g": room.g},
    })  # fmt: skip
    kind = {"type": integrator, "max_depth": -1, "rr_depth": ROULETTE}
    scene: dict[str, Any] = {"type": "scene", "integrator": kind}
    for number, (wall, middle, u, v) in enumerate(room.rectangles()):
        normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        matrix = np.eye(4)
        matrix[:3] = np.stack([u, v, normal, middle], axis=1)
        shape: dict[str, Any] = {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix.tolist())}
        black = {"type": "diffuse", "reflectance": spectrum(0.0)}
        if wall == "lamp":
            shape |= {"emitter": {"type": "area", "radiance": spectrum(room.radiance)}, "bsdf": black}
        else:
            shape["bsdf"] = {"type": "diffuse", "reflectance": spectrum(room.reflectance(wall, wavelengths))}
        scene[f"wall{number}"] = shape
    return mi.load_dict(scene | (more or {})), fog


def trace(mi: Any, dr: Any, scene: Any, medium: Any, rays_at: Any, wavelengths: Any, samples: int, seed: int) -> Any:
    """Mean radiance (ray, wavelength) of `samples` of Mitsuba's paths along each ray that starts in the medium.

    A path in the spectral variant carries 4 of the wavelengths, evenly spaced, each of which leads equally often; in
    the others it carries all that the scene has (1 or 3).
    """
    origins, directions = rays_at
    rays, lanes, count = len(origins), len(origins) * samples, len(wavelengths)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, lanes)
    lane = dr.arange(mi.UInt32, lanes)
    ray = lane // samples

    def point(values: Any) -> list[Any]:
        return [dr.gather(mi.Float, mi.Float(values[:, k].astype(np.float32)), ray) for k in range(3)]

    index, more = [mi.UInt32(k) for k in range(count)], {}
    if mi.is_spectral:
        index = [(lane + count // AT_ONCE["spectral"] * j) % count for j in range(AT_ONCE["spectral"])]
        grid = mi.Float(np.asarray(wavelengths, np.float32))
        more = {"wavelengths": mi.Spectrum(*(dr.gather(mi.Float, grid, i) for i in index))}
    where = mi.RayDifferential3f(o=mi.Point3f(*point(origins)), d=mi.Vector3f(*point(directions)), time=0.0, **more)
    light = scene.integrator().sample(scene, sampler, where, medium, True)[0]
    total = dr.zeros(mi.Float, rays * count)
    for j, i in enumerate(index):
        dr.scatter_reduce(dr.ReduceOp.Add, total, light[j], ray * count + i)
    return np.array(total, float).reshape(rays, count) / (samples * len(index) / count)


def camera_rays(room: FogRoom, pixels: int, fov_deg: float = 75.0) -> tuple[Any, Any]:
    """Origins and unit directions (pixel, 3) through the middles of a square picture, rows from the top."""
    forward = np.subtract(room.target, room.eye)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    half = np.tan(np.radians(fov_deg) / 2)
    across = (2 * (np.arange(pixels) + 0.5) / pixels - 1) * half
    directions = forward + across[None, :, None] * right - across[:, None, None] * up
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    directions = directions.reshape(-1, 3)
    return np.broadcast_to(np.asarray(room.eye), directions.shape).copy(), directions
