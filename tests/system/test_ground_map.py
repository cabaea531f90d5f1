"""A ground whose albedo varies with place: against a plain ground, closed forms, and a quadrature of the adjacency."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from asking import asked
from bases import complaint
from significance import assert_agrees, over_seeds

import skyscatter
from skyscatter import Component, Ground, GroundMap, Medium, Scene, SpectralTable, Star, Sun
from skyscatter.media.fields import Exponential
from skyscatter.optics.rayleigh import RayleighPowerLaw

RADIUS, HEIGHT = 6371e3, 8e3
WAVELENGTHS = np.array([450.0, 650.0, 850.0])
RED_EDGE = SpectralTable(wavelengths=(450.0, 650.0, 850.0), values=(0.03, 0.05, 0.5))


def scene(depth: float, ground: Ground, elevation: float = 50.0, azimuth: float = 120.0) -> Scene:
    """Rayleigh air of an optical depth at 550 nm, a point Sun of irradiance 1, and an observer far above it."""
    optics = RayleighPowerLaw(coefficient=depth / HEIGHT, wavelength=550.0)
    air = Component(name="air", density=Exponential(scale_height=HEIGHT, top=80e3), optics=optics)
    return Scene(
        medium=Medium(planet_radius=RADIUS, components=(air,)),
        ground=ground,
        star=Star(spectrum=1.0, radius=0.0),
        sun=Sun(elevation_deg=elevation, azimuth_deg=azimuth),
        altitude=700e3,
    )


def look_at(where: Any, tilt: float = 0.0) -> tuple[Any, Any]:
    """Origins and directions of rays that meet the ground at x, y (..., 2) [m], leaning to the east by an angle."""
    where = np.asarray(where, float)
    x, y = where[..., 0], where[..., 1]
    ground = np.stack([x, y, np.sqrt(RADIUS**2 - x**2 - y**2)], axis=-1)
    up = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
    return ground + 500e3 * up, np.broadcast_to(-up, ground.shape)


def test_a_map_of_one_albedo_is_the_plain_ground() -> None:
    """To the last bit: the same machine code multiplies the same numbers in the same order.

    Many Suns, for a product that is rounded otherwise comes out the same by chance once in a few times.
    """
    plain = Ground(albedo=RED_EDGE)
    painted = Ground(albedo=RED_EDGE, map=GroundMap(classes=np.ones((3, 5)), albedos=(0.9, RED_EDGE), cell_size=2e3))
    rays = look_at([(0.0, 0.0), (2e3, -1e3), (3e4, 0.0)], 0.4)
    suns = np.linspace(20.0, 60.0, 9)
    for options, elevation in product(({"stokes": True}, {"sampling": "free-flight"}), suns):
        one, other = (
            skyscatter.radiance(
                scene(0.3, ground, elevation), *rays, WAVELENGTHS, parts=True, **asked("path", samples=64, **options)
            )
            for ground in (plain, painted)
        )
        np.testing.assert_array_equal(one.radiance, other.radiance)
        np.testing.assert_array_equal(one.standard_error, other.standard_error)
        for name in one.layers:
            np.testing.assert_array_equal(one.layers[name], other.layers[name], name)


@pytest.mark.parametrize("solver", ["single", "path"])
@pytest.mark.parametrize("tilt", [0.0, 0.9])
def test_without_air_every_cell_shows_its_own_albedo(solver: str, tilt: float) -> None:
    """Row 0 lies in the north, column 0 in the west; outside is the ground's own albedo, also on the far side."""
    classes = np.array([[0, 1, 2], [3, 4, 5]])
    albedos = (0.1, 0.2, 0.3, 0.4, 0.5, RED_EDGE)
    ground = Ground(albedo=0.05, map=GroundMap(classes=classes, albedos=albedos, cell_size="3 km"))
    x, y = np.meshgrid([-6e3, -4.4e3, -3e3, -1.6e3, 0.0, 1.4e3, 3e3, 4.4e3, 6e3], [4e3, 2.9e3, 0.1e3, -0.1e3, -2.9e3])
    column, row = np.floor(x / 3e3 + 1.5).astype(int), np.floor(1 - y / 3e3).astype(int)
    inside = (column >= 0) & (column < 3) & (row >= 0) & (row < 2)
    values = np.stack([a.values if isinstance(a, SpectralTable) else (a,) * 3 for a in albedos])
    picked = values[classes[np.clip(row, 0, 1), np.clip(column, 0, 2)]]
    expected = np.where(inside[..., None], picked, 0.05)
    there = scene(1e-9, ground)
    rays = look_at(np.stack([x, y], axis=-1), tilt)
    answer = skyscatter.radiance(there, *rays, WAVELENGTHS, solver)
    up = (rays[0] + rays[1] * 500e3) / RADIUS
    cosine = up @ there.sun.direction
    # Air of optical depth 1e-9 adds and takes no more than that.
    np.testing.assert_allclose(answer.radiance, expected * cosine[..., None] / np.pi, rtol=1e-7)
    # The antipode has the same x and y as the middle of the map.
    far = there.model_copy(update={"sun": Sun(elevation_deg=-60.0)})
    answer = skyscatter.radiance(far, [0.0, 0.0, -RADIUS - 7e5], [0.0, 0.0, 1.0], WAVELENGTHS, solver)
    np.testing.assert_allclose(answer.radiance, 0.05 * math.sin(math.radians(60)) / math.pi, rtol=1e-7)


def test_marched_and_free_walks_agree_over_a_checkerboard() -> None:
    """The two ways to walk share neither the choice of the ground as the next vertex nor its guide."""
    board = np.indices((16, 16)).sum(axis=0) % 2
    ground = Ground(albedo=0.2, map=GroundMap(classes=board, albedos=(0.9, RED_EDGE), cell_size=1500.0))
    there = scene(0.4, ground)
    rays = look_at([(700.0, 700.0), (-700.0, 700.0), (1e5, 0.0)], 0.5)
    _, marched = over_seeds(
        lambda seed: skyscatter.radiance(
            there, *rays, WAVELENGTHS, solver=skyscatter.Path(samples=512, seed=seed), orders=3
        ),
        16,
    )
    _, free = over_seeds(
        lambda seed: skyscatter.radiance(
            there, *rays, WAVELENGTHS, solver=skyscatter.Path(samples=4000, sampling="free-flight", seed=seed), orders=3
        ),
        16,
    )
    for name in ("radiance", "order2", "order3"):
        error = np.hypot(marched[name][1], free[name][1])
        assert_agrees(marched[name][0], free[name][0], error, slack=2e-4)


def adjacency(depth: float, near: float, far: float) -> float:
    """Radiance at the nadir, Sun at the zenith, of light that a white square ring of the ground sent, scattered once.

    Gauss-Legendre over the height of the scattering and, by symmetry, an eighth of the ring: distances `near` to `far`
    along the axes [m], points (x, y) seen from above, on the sphere; air as flat layers, which at this depth is as
    good as exact.
    """
    nodes, weights = np.polynomial.legendre.leggauss(48)
    u, w = 0.5 * (nodes + 1), 0.5 * weights
    # Heights by z = e^s - 1 km: the light comes from low down where the ring is near.
    s = np.log(1 + 80.0) * u
    z, dz = 1e3 * (np.exp(s) - 1), 1e3 * np.exp(s) * np.log(1 + 80.0) * w
    ratio = np.log(far / near)
    r0, dr = near * np.exp(ratio * u), near * np.exp(ratio * u) * ratio * w
    phi, dphi = 0.25 * np.pi * u, 0.25 * np.pi * w
    z, r0, phi = z[:, None, None], r0[None, :, None], phi[None, None, :]
    r = r0 / np.cos(phi)
    area = 8 * r * (dr[None, :, None] / np.cos(phi)) * dphi[None, None, :]
    drop = RADIUS - np.sqrt(RADIUS**2 - r**2)
    upright = np.sqrt(1 - (r / RADIUS) ** 2)
    height, square = z + drop, r**2 + (z + drop) ** 2
    leaves = (height * upright - r * r / RADIUS) / np.sqrt(square)  # cosine of the zenith angle on the ground
    cosine = height / np.sqrt(square)
    below = depth * (1 - np.exp(-z / HEIGHT))
    phase = 3 / (16 * np.pi) * (1 + cosine**2)  # towards the zenith
    radiance = np.exp(-depth / upright) * upright / np.pi
    scattered = depth / HEIGHT * np.exp(-z / HEIGHT) * np.exp(-(depth - below)) * dz[:, None, None]
    light = radiance * leaves * np.exp(-below / cosine) / square * phase * (area / upright)
    return float(np.sum(scattered * light))


@pytest.mark.parametrize(("near", "far"), [(250.0, 10e3), (5e3, 25e3)])
def test_light_of_the_surroundings_that_is_scattered_once(near: float, far: float) -> None:
    """A black pixel in a bright square: the second order over that over black ground is the ring's light alone."""
    depth, cells = 0.02, round(2 * far / (2 * near)) // 2 * 2 + 1
    side = 2 * near
    classes = np.ones((cells, cells))
    classes[cells // 2, cells // 2] = 0
    ring = GroundMap(classes=classes, albedos=(0.0, 1.0), cell_size=side)
    rays = look_at([0.0, 0.0])

    def second(ground: Ground, seed: int) -> Any:
        there = scene(depth, ground, elevation=90.0)
        return skyscatter.radiance(
            there, *rays, [550.0], solver=skyscatter.Path(samples=2048, max_order=2, seed=seed), orders=2
        )

    _, painted = over_seeds(lambda seed: second(Ground(map=ring), seed), 16)
    _, black = over_seeds(lambda seed: second(Ground(), seed), 16)
    excess = painted["order2"][0] - black["order2"][0]
    error = np.hypot(painted["order2"][1], black["order2"][1])
    expected = np.array([adjacency(depth, near, side * cells / 2)])
    assert error[0] < 0.03 * expected[0]
    assert_agrees(excess, expected, error, slack=1e-3)


def test_refuses() -> None:
    cells = np.zeros((2, 2))
    for arguments, words in (
        ({"classes": np.zeros(3), "albedos": (0.1,), "cell_size": 1}, ["classes", "(y, x)"]),
        ({"classes": cells + 1, "albedos": (0.1,), "cell_size": 1}, ["classes = 1.0", "from 0 to 0"]),
        ({"classes": cells + 0.5, "albedos": (0.1, 0.2), "cell_size": 1}, ["classes = 0.5", "whole numbers"]),
        ({"classes": cells - np.inf, "albedos": (0.1, 0.2), "cell_size": 1}, ["classes = -inf"]),
        ({"classes": cells, "albedos": (), "cell_size": 1}, ["albedos = 0", "1 to 255"]),
        ({"classes": cells, "albedos": (0.1, 1.5), "cell_size": 1}, ["albedos.1 = 1.5", "between 0 and 1"]),
        ({"classes": cells, "albedos": ("cheese",), "cell_size": 1}, ["cheese"]),
        ({"classes": cells, "albedos": (0.1,), "cell_size": 0}, ["cell_size = 0", "positive"]),
    ):
        message = complaint(lambda arguments=arguments: GroundMap(**arguments))
        assert all(word in message for word in words), message
    painted = scene(0.1, Ground(map=GroundMap(classes=cells, albedos=(0.1,), cell_size=1.0)))
    message = complaint(lambda: skyscatter.radiance(painted, *look_at([0.0, 0.0]), [550.0]))
    assert all(word in message for word in ("ground.map", "orders", "path"))


def test_a_map_is_written_and_read_back() -> None:
    """As part of a model file or a recipe."""
    ground = Ground(albedo=0.1, map=GroundMap(classes=[[0, 1]], albedos=("snow", 0.4), cell_size="2 km"))
    assert Ground.model_validate(ground.model_dump(mode="json")) == ground
