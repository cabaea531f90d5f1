"""Density fields of three dimensions: each against its definition and against quadrature (see `space_bases`)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from bases import members
from scipy.integrate import solve_ivp
from scipy.interpolate import RegularGridInterpolator
from scipy.special import erfc
from space_bases import SPACE_TESTS, Array, SpatialFieldBase, own_frame, reference_columns

from skyscatter.media.filaments import Filament
from skyscatter.media.fronts import Front
from skyscatter.media.operations import (
    AnySpatialField,
    Carved,
    Moved,
    Power,
    Product,
    Rotated,
    Scaled,
    Sum,
    Warped,
    warp_modes,
)
from skyscatter.media.particles import ParticleSet
from skyscatter.media.planets import AroundPlanet
from skyscatter.media.shapes import (
    BonnorEbert,
    GaussianShell,
    GaussianSphere,
    King,
    Plummer,
    PowerLaw,
    Shell,
    Sphere,
)
from skyscatter.media.structures import BipolarLobes, Box, Cone, FlaredDisk, Slab
from skyscatter.media.turbulence import Turbulence, turbulent_modes
from skyscatter.media.voxels import VoxelGrid

PLACED: dict[str, Any] = {
    "position": (1.0, -2.0, 0.5),
    "axis": (1.0, 2.0, 3.0),
    "turn_deg": 25.0,
    "axes": (1, 0.6, 1.7),
}
BAD_PLACES = (({"axis": (0, 0, 0)}, "axis = "), ({"axes": (1, 0, 1)}, "axes = "))


def distance(field: Any, points: Array) -> Array:
    return np.linalg.norm(own_frame(field, points), axis=-1)


class TestSphere(SpatialFieldBase):
    field_class = Sphere
    examples = (Sphere(radius=2.0), Sphere(radius="1 pc"), Sphere(radius=3.0, **PLACED))
    refused = (
        ({"radius": 0.0}, "radius = 0.0: must be a positive length"),
        ({"radius": "1 s"}, "radius"),
        ({}, "radius is missing"),
        *(({"radius": 1.0, **bad}, message) for bad, message in BAD_PLACES),
    )

    def expected(self, field: Any, points: Array) -> Array:
        return 1.0 * (distance(field, points) <= field.radius)


class TestGaussianSphere(SpatialFieldBase):
    field_class = GaussianSphere
    examples = (GaussianSphere(width=1.5), GaussianSphere(width=0.5, **PLACED))
    refused = (({"width": -1.0}, "width = -1.0"),)

    def expected(self, field: Any, points: Array) -> Array:
        x = distance(field, points) / field.width
        return np.where(x <= 6.07, np.exp(-0.5 * x**2), 0)


class TestPlummer(SpatialFieldBase):
    field_class = Plummer
    examples = (Plummer(radius=1.0), Plummer(radius=1.0, cut=3.0), Plummer(radius=0.7, cut=20.0, **PLACED))
    refused = (({"radius": 0.0}, "radius = 0.0"), ({"radius": 1.0, "cut": -1.0}, "cut = -1.0"))

    def expected(self, field: Any, points: Array) -> Array:
        r, a = distance(field, points), field.radius
        return np.where(r <= (field.cut or 40 * a), (1 + (r / a) ** 2) ** -2.5, 0)


class TestKing(SpatialFieldBase):
    field_class = King
    examples = (King(core=1.0, cut=30.0), King(core=0.5, cut=4.0, **PLACED))
    refused = (({"core": 0.0, "cut": 1.0}, "core = 0.0"), ({"core": 1.0, "cut": 0.0}, "cut = 0.0"))

    def expected(self, field: Any, points: Array) -> Array:
        r = distance(field, points)
        return np.where(r <= field.cut, (1 + (r / field.core) ** 2) ** -1.5, 0)


class TestPowerLaw(SpatialFieldBase):
    field_class = PowerLaw
    examples = tuple(
        PowerLaw(core=1.0, exponent=exponent, cut=cut, **place)
        for exponent, cut, place in (
            (2.0, 50.0, {}),
            (1.0, 5.0, PLACED),
            (2.37, 1e3, {}),
            (7.0, 9.0, {}),
            (31.3, 2.0, {}),
        )
    )
    refused = (
        ({"core": 0.0, "cut": 1.0, "exponent": 2.0}, "core = 0.0"),
        ({"core": 1.0, "cut": 1.0, "exponent": 0.0}, "exponent = 0.0"),
        ({"core": 1.0, "cut": 1.0, "exponent": 41.0}, "exponent = 41.0: must be at most 40"),
    )

    def expected(self, field: Any, points: Array) -> Array:
        r = distance(field, points)
        return np.where(r <= field.cut, (1 + (r / field.core) ** 2) ** (-0.5 * field.exponent), 0)


class TestBonnorEbert(SpatialFieldBase):
    field_class = BonnorEbert
    tolerance = 1e-6
    examples = (
        BonnorEbert(radius=1.0),
        BonnorEbert(radius=2.0, dimensionless_radius=200.0),
        BonnorEbert(radius=1.0, pressure_contrast=5.0, **PLACED),
    )
    refused = (
        ({"radius": 0.0}, "radius = 0.0"),
        ({"radius": 1.0, "dimensionless_radius": 2e3}, "dimensionless_radius = 2000.0"),
        ({"radius": 1.0, "pressure_contrast": 1.0}, "pressure_contrast = 1.0"),
        ({"radius": 1.0, "pressure_contrast": 5.0, "dimensionless_radius": 3.0}, "pressure_contrast = 5.0: follows"),
    )

    def expected(self, field: Any, points: Array) -> Array:
        xi = distance(field, points) / field.radius * field.xi_max
        # Another form of the equation: ln density over ln xi, for the mass m = xi^2 psi'.
        start = math.log(1e-3)
        solution = solve_ivp(
            lambda x, y: [-y[1] * math.exp(-x), math.exp(3 * x + y[0])],
            (start, math.log(field.xi_max) + 1e-9), [-1e-6 / 6, 1e-9 / 3], rtol=1e-11, atol=1e-14, dense_output=True,
        )  # fmt: skip
        inside = xi <= field.xi_max
        density = np.exp(solution.sol(np.clip(np.log(xi), start, math.log(field.xi_max)))[0])
        return np.where(inside, density, 0.0)

    def test_critical_sphere_has_the_published_contrast(self) -> None:
        # Bonnor (1956): the critical sphere has a centre 14.04 times as dense as its edge.
        field = BonnorEbert(radius=1.0)
        assert 1 / field.density([1 - 1e-12, 0, 0]) == pytest.approx(14.04, abs=0.02)

    def test_pressure_contrast_is_that_of_the_densities(self) -> None:
        field = BonnorEbert(radius=1.0, pressure_contrast=30.0)
        assert field.density([0, 0, 1 - 1e-13]) == pytest.approx(1 / 30, rel=1e-8)


class TestShell(SpatialFieldBase):
    field_class = Shell
    examples = (Shell(inner=1.0, outer=2.0), Shell(inner=0.95, outer=1.0, **PLACED), Shell(inner=0.0, outer=1.0))
    refused = (({"inner": 2.0, "outer": 1.0}, "inner = 2.0"), ({"inner": 0.0, "outer": 0.0}, "outer = 0.0"))

    def expected(self, field: Any, points: Array) -> Array:
        r = distance(field, points)
        return 1.0 * ((r >= field.inner) & (r <= field.outer))


class TestGaussianShell(SpatialFieldBase):
    field_class = GaussianShell
    tolerance = 1e-6
    bound_slack = 2e3  # the thinnest changes by its all over 1/100 of its size
    examples = (
        GaussianShell(radius=1.0, width=0.1),
        GaussianShell(radius=1.0, width=0.01),
        GaussianShell(radius=1.0, width=0.5, **PLACED),
    )
    refused = (({"radius": 1.0, "width": 0.0}, "width = 0.0"),)

    def expected(self, field: Any, points: Array) -> Array:
        x = (distance(field, points) - field.radius) / field.width
        return np.where(abs(x) <= 6.07, np.exp(-0.5 * x**2), 0)


class TestFlaredDisk(SpatialFieldBase):
    field_class = FlaredDisk
    tolerance = 1e-6
    bound_slack = 1e5  # density 178 at the inner rim, within a height of 1/200 of the disk's
    examples = (
        FlaredDisk(radius=1.0, height=0.1, inner=0.1, outer=3.0),
        FlaredDisk(radius=1.0, height=0.03, inner=0.5, outer=2.0, exponent=1.0, flaring=1.0, **PLACED),
        FlaredDisk(radius=1.0, height=0.3, inner=0.2, outer=2.0, exponent=0.0, flaring=0.0),
    )
    refused = (
        ({"radius": 1.0, "height": 0.1, "inner": 2.0, "outer": 1.0}, "inner = 2.0"),
        ({"radius": 1.0, "height": 0.0, "inner": 0.1, "outer": 1.0}, "height = 0.0"),
    )

    def sample(self, field: Any, count: int, reach: float = 0.6, seed: int = 1) -> Array:
        points = super().sample(field, count, reach, seed)
        points[::2] = field.centre + 0.1 * (points[::2] - field.centre)
        return points

    def expected(self, field: Any, points: Array) -> Array:
        x, y, z = own_frame(field, points).T
        big = np.hypot(x, y)
        with np.errstate(divide="ignore"):
            s = z / (field.height * (big / field.radius) ** field.flaring)
            value = (big / field.radius) ** -field.exponent * np.exp(-0.5 * s**2)
        return np.where((big >= field.inner) & (big <= field.outer) & (abs(s) <= 6.07), value, 0)


class TestCone(SpatialFieldBase):
    field_class = Cone
    tolerance = 1e-6  # closed forms where uniform; see below
    examples = (
        Cone(half_angle_deg=30.0, length=1.0),
        Cone(half_angle_deg=50.0, length=1.0, inner=0.3, both_sides=True, **PLACED),
        Cone(half_angle_deg=40.0, length=1.0, inner=0.1, exponent=2.0),
        Cone(half_angle_deg=28.0, length=1.0, both_sides=True),
    )
    refused = (
        ({"half_angle_deg": 90.0, "length": 1.0}, "half_angle_deg = 90.0"),
        ({"half_angle_deg": 9.0, "length": 1.0, "inner": 1.0}, "inner = 1.0"),
        ({"half_angle_deg": 9.0, "length": 1.0, "exponent": 2.0}, "inner = 0.0: must be above 0"),
    )

    def expected(self, field: Any, points: Array) -> Array:
        p = own_frame(field, points)
        r = np.linalg.norm(p, axis=1)
        angle = np.degrees(np.arccos(p[:, 2] / r))
        within = (angle <= field.half_angle_deg) | (field.both_sides & (180 - angle <= field.half_angle_deg))
        value = 1.0 if field.exponent == 0 else (r / field.inner) ** -field.exponent
        return np.where(within & (r >= field.inner) & (r <= field.length), value, 0)

    def test_uniform_cone_is_exact(self) -> None:
        field = Cone(half_angle_deg=45.0, length=2.0, both_sides=True)
        # At the height 0.5 over the tip the cone is 1 wide; across the tip's plane x = 0.3 it lacks 0.6 of the chord.
        assert field.column([-9, 0, 0.5], [9, 0, 0.5]) == pytest.approx(1.0, rel=1e-14)
        chord = 2 * math.sqrt(4 - 0.09)
        assert field.column([0.3, 0, -9], [0.3, 0, 9]) == pytest.approx(chord - 0.6, rel=1e-14)


class TestBipolarLobes(SpatialFieldBase):
    field_class = BipolarLobes
    examples = (
        BipolarLobes(length=2.0, width=0.8),
        BipolarLobes(length=2.0, width=1.0, hollow=0.9, **PLACED),
    )
    refused = (
        ({"length": 1.0, "width": 0.0}, "width = 0.0"),
        ({"length": 1.0, "width": 1.0, "hollow": 1.0}, "hollow = 1.0"),
    )

    def expected(self, field: Any, points: Array) -> Array:
        x, y, z = own_frame(field, points).T
        half = 0.5 * field.length
        m = (x**2 + y**2) / (0.5 * field.width) ** 2 + ((abs(z) - half) / half) ** 2
        return 1.0 * ((m <= 1) & (m >= field.hollow**2))


class TestSlab(SpatialFieldBase):
    field_class = Slab
    examples = (Slab(half_thickness=1.0, half_width=3.0), Slab(half_thickness=0.1, half_width=1.0, **PLACED))
    refused = (({"half_thickness": 0.0}, "half_thickness = 0.0"), ({"half_thickness": 1, "half_width": -1}, "= -1"))

    def expected(self, field: Any, points: Array) -> Array:
        x, y, z = abs(own_frame(field, points)).T
        return 1.0 * ((z <= field.half_thickness) & (x <= field.half_width) & (y <= field.half_width))

    def test_endless_slab_has_its_secant(self) -> None:
        field = Slab(half_thickness=1.0)
        assert field.column([-10, 0, -5], [10, 0, 5]) == pytest.approx(2 * math.sqrt(5), rel=1e-14)
        assert field.density([[9999, 9999, 1], [0, 0, 1.001]]).tolist() == [1, 0]


class TestBox(SpatialFieldBase):
    field_class = Box
    examples = (
        Box(half_sizes=(1.0, 2.0, 0.5)),
        Box(half_sizes=(1.0, 1.0, 1.0), **PLACED),
        Box(half_sizes=(1.0, 1.0, 1.0), position=(0.0, 0.0, 1e5), axis=(0.0, 1.0, 1.0)),
    )
    refused = (({"half_sizes": (1.0, 0.0, 1.0)}, "half_sizes"),)

    def expected(self, field: Any, points: Array) -> Array:
        return 1.0 * (abs(own_frame(field, points)) <= np.array(field.half_sizes)).all(axis=1)


class TestFilament(SpatialFieldBase):
    field_class = Filament
    tolerance = 1e-6
    bound_slack = 2e3
    points = ((-2, 0, 0), (-1, 1, 0.5), (0.5, 0.5, 0), (1, -1, 1), (2, 0, 2))
    examples = (
        Filament(points=((0, 0, -1), (0, 0, 1)), width=0.2),
        Filament(points=points, width=0.1),
        Filament(points=points, width=0.05, profile="plummer", smooth=False),
        Filament(points=points, width=0.1, profile="plummer", exponent=4.0, cut=0.5, **PLACED),
    )
    refused = (
        ({"points": ((0, 0, 0),), "width": 1.0}, "points = 1"),
        ({"points": ((0, 0, 0), (0, 0, 0)), "width": 1.0}, "leave out the second"),
        ({"points": ((0, 0, 0), (0, 0, 1)), "width": 0.0}, "width = 0.0"),
    )

    def sample(self, field: Any, count: int, reach: float = 0.6, seed: int = 1) -> Array:
        points = super().sample(field, count, reach, seed)
        on = np.resize(np.array(field.position) + (field.curve() * field.axes) @ field.rotation.T, (count, 3))
        points[::2] = (on + 0.05 * (points - points.mean(axis=0)))[::2]
        return points

    def expected(self, field: Any, points: Array) -> Array:
        p, curve = own_frame(field, points), field.curve()
        near = np.full(len(p), np.inf)
        for a, b in pairwise(curve):
            s = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            near = np.minimum(near, np.linalg.norm(p - a - s[:, None] * (b - a), axis=1))
        x = near / field.width
        if field.profile == "gaussian":
            return np.where(x <= 6.07, np.exp(-0.5 * x**2), 0)
        cut = 10 if field.cut is None else field.cut / field.width
        return np.where(x <= cut, (1 + x**2) ** (-0.5 * field.exponent), 0)

    def test_spline_goes_through_its_points(self) -> None:
        field = Filament(points=self.points, width=0.1)
        np.testing.assert_allclose(field.curve()[::8], self.points, atol=1e-14)
        np.testing.assert_allclose(field.density(self.points), 1.0, rtol=1e-12)


class TestTurbulence(SpatialFieldBase):
    field_class = Turbulence
    tolerance = 1e-6
    bound_slack = 1e4
    examples = (
        Turbulence(outer_scale=1.0, inner_scale=0.1, half_sizes=(1.0, 0.8, 0.6)),
        Turbulence(outer_scale=2.0, inner_scale=0.5, deviation=2.0, modes=61, half_sizes=(1, 1, 1), **PLACED),
    )
    refused = (
        ({"outer_scale": 1.0, "inner_scale": 1.0}, "inner_scale = 1.0"),
        ({"outer_scale": 1.0, "inner_scale": 0.1, "modes": 7}, "modes = 7"),
        ({"outer_scale": 1.0, "inner_scale": 0.1, "deviation": 0.0}, "deviation = 0.0"),
        ({"outer_scale": 1.0, "inner_scale": 0.1, "seed": -1}, "seed = -1"),
        ({"outer_scale": 1.0, "inner_scale": 0.1, "half_sizes": (0, 1, 1)}, "half_sizes"),
    )

    def expected(self, field: Any, points: Array) -> Array:
        p = own_frame(field, points)
        kx, ky, kz, phase, amplitude = turbulent_modes(field).astype(float)
        turns = p / field.outer_scale @ np.array([kx, ky, kz]) + phase
        logarithm = np.cos(2 * np.pi * turns) @ amplitude - np.log(np.i0(amplitude)).sum()
        return np.where((abs(p) <= field.half_sizes).all(axis=1), np.exp(logarithm), 0)

    def test_mean_and_deviation_over_much_space(self) -> None:
        random = np.random.default_rng(7)
        for deviation in (0.5, 1.2):
            field = Turbulence(outer_scale=1.0, inner_scale=0.05, deviation=deviation, seed=3)
            n = field.density(random.uniform(-900, 900, (200_000, 3)))
            # Independent points: standard errors follow from the samples.
            assert abs(n.mean() - 1) < 4 * n.std() / math.sqrt(n.size)
            assert np.log(n).std() == pytest.approx(deviation, rel=4 / math.sqrt(2 * n.size))
            # Many waves are nearly Gaussian together, and then the mean of ln n is minus half the variance.
            assert np.log(n).mean() == pytest.approx(-0.5 * deviation**2, rel=0.03)

    def test_spectrum_falls_as_asked(self) -> None:
        # The structure of ln n between shells of the transform of a cube of two outer scales, its box tapered.
        cells, size = 64, 2.0
        x = (np.arange(cells) + 0.5) / cells * size
        grid = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1)
        taper = np.hanning(cells)
        window = taper[:, None, None] * taper[:, None] * taper
        wave = np.fft.fftfreq(cells, 1 / cells)
        shell = np.rint(np.sqrt(sum(np.meshgrid(wave**2, wave**2, wave**2, indexing="ij")))).astype(int)
        for slope in (5 / 3, 3.0):
            power = np.zeros(24)
            for seed in range(4):
                field = Turbulence(outer_scale=1.0, inner_scale=0.0625, slope=slope, seed=seed, modes=400)
                transform = np.fft.fftn(window * np.log(field.density(grid)))
                power += (np.bincount(shell.ravel(), abs(transform.ravel()) ** 2) / np.bincount(shell.ravel()))[8:32]
            fitted = np.polyfit(np.log(np.arange(8, 32)), np.log(power), 1)[0]
            # Four fields of some 240 waves over two octaves fix a slope to about 0.15.
            assert fitted == pytest.approx(-slope - 2, abs=0.3)

    def test_knows_no_resolution(self) -> None:
        field = Turbulence(outer_scale=1.0, inner_scale=0.05)
        coarse, fine = (np.stack(np.meshgrid(*[np.arange(0, 1, h)] * 3), axis=-1) for h in (0.25, 0.125))
        np.testing.assert_array_equal(field.density(coarse), field.density(fine)[::2, ::2, ::2])

    def test_seeds_differ(self) -> None:
        a, b = (Turbulence(outer_scale=1.0, inner_scale=0.1, seed=seed).density([0.1, 0, 0]) for seed in (0, 1))
        assert a != b


def bumpy(rows: int, columns: int) -> tuple[tuple[float, ...], ...]:
    theta, phi = np.pi * np.arange(rows) / (rows - 1), 2 * np.pi * np.arange(columns) / columns
    table = 1 + 0.3 * np.sin(theta[:, None]) * np.cos(2 * phi) + 0.2 * np.cos(theta[:, None])
    return tuple(tuple(float(x) for x in row) for row in table)


class TestFront(SpatialFieldBase):
    field_class = Front
    tolerance = 1e-6
    bound_slack = 2e3
    examples = (
        Front(radii=((1.0,), (1.0,))),
        Front(radii=bumpy(9, 16), width=0.05),
        Front(radii=bumpy(17, 12), width=0.0, **PLACED),
    )
    refused = (
        ({"radii": ((1.0,),)}, "radii = '1 rows'"),
        ({"radii": ((1.0, 1.0), (1.0,))}, "all of one length"),
        ({"radii": ((1.0, 2.0), (1.0, 1.0))}, "are poles"),
        ({"radii": ((1.0,), (0.0,), (1.0,))}, "radii = 0.0"),
        ({"radii": ((1.0,), (1.0,)), "width": -1.0}, "width = -1.0"),
    )

    def expected(self, field: Any, points: Array) -> Array:
        p = own_frame(field, points)
        r, table = np.linalg.norm(p, axis=1), np.array(field.radii)
        theta, phi = np.arccos(p[:, 2] / r), np.arctan2(p[:, 1], p[:, 0]) % (2 * np.pi)
        nodes = np.linspace(0, np.pi, table.shape[0]), np.linspace(0, 2 * np.pi, table.shape[1] + 1)
        surface = RegularGridInterpolator(nodes, np.hstack([table, table[:, :1]]))(np.column_stack([theta, phi]))
        if field.width == 0:
            return 1.0 * (r <= surface)
        x = (r - surface) / field.width
        return np.where(x > 6.07, 0, np.where(x < -6.07, 1, 0.5 * erfc(x / math.sqrt(2))))


BALL, BLOB = Sphere(radius=1.0, position=(0.5, 0, 0)), GaussianSphere(width=0.4, axes=(1, 2, 0.5))
NOISE = Turbulence(outer_scale=1.0, inner_scale=0.2, modes=64)


class TestMoved(SpatialFieldBase):
    field_class = Moved
    examples = (BLOB.moved((1, 2, -3)), BALL.moved(("1 km", 0, 0)))
    refused = (({"field": BALL, "by": (1, 2)}, "by"),)

    def expected(self, field: Any, points: Array) -> Array:
        return field.field.density(points - np.array(field.by))


class TestRotated(SpatialFieldBase):
    field_class = Rotated
    examples = (
        BLOB.rotated(axis=(1, 1, 1), turn_deg=40.0, about=(1, 0, 0)),
        Box(half_sizes=(1, 2, 3)).rotated(axis=(0, 0, -1), turn_deg=30.0),
        (BLOB + BALL).rotated(axis=(0, 1, 0)),
    )
    refused = (({"field": BALL, "axis": (0, 0, 0)}, "axis = (0.0, 0.0, 0.0)"),)

    def expected(self, field: Any, points: Array) -> Array:
        placed = Sphere(radius=1.0, position=field.about, axis=field.axis, turn_deg=field.turn_deg)
        return field.field.density(own_frame(placed, points) + np.array(field.about))

    def test_turns_the_way_the_hand_does(self) -> None:
        pole = Sphere(radius=0.1, position=(1, 0, 0)).rotated(turn_deg=90.0)
        assert pole.density([0, 1, 0]) == 1.0
        tilted = Sphere(radius=0.1, position=(0, 0, 1)).rotated(axis=(0, 1, 0))
        assert tilted.density([0, 1, 0]) == 1.0


class TestScaled(SpatialFieldBase):
    field_class = Scaled
    examples = (BLOB.scaled(2.0, about=(1, 0, 0)), (BALL + BLOB).scaled((1.0, 3.0, 0.5)))
    refused = (({"field": BALL, "factors": (1, 0, 1)}, "factors = (1.0, 0.0, 1.0)"),)

    def expected(self, field: Any, points: Array) -> Array:
        about = np.array(field.about)
        return field.field.density(about + (points - about) / np.array(field.factors))


class TestProduct(SpatialFieldBase):
    field_class = Product
    tolerance = 1e-6
    bound_slack = 1e4
    examples = (
        BALL * BLOB,
        BALL * NOISE,
        (BALL + 2 * BLOB) * (BLOB + Box(half_sizes=(0.3, 1, 1))),
        BALL * Shell(inner=0.5, outer=1.0),
    )
    refused = (
        ({"fields": ()}, "fields = 0"),
        ({"fields": (BALL, BALL.moved((9, 0, 0)))}, "do not overlap"),
    )

    def expected(self, field: Any, points: Array) -> Array:
        return np.prod([part.density(points) for part in field.fields], axis=0)

    def test_shapes_of_one_density_are_exact(self) -> None:
        lens = BALL * Sphere(radius=1.0)
        assert lens.column([-5, 0.1, 0], [5, 0.1, 0]) == pytest.approx(2 * math.sqrt(0.99) - 0.5, rel=1e-14)


class TestSum(SpatialFieldBase):
    field_class = Sum
    bound_slack = 1e3
    examples = (BALL + BLOB, 2 * BALL + BLOB * 0.25, BALL.moved((5, 0, 0)) + 0.5 * (BLOB + BALL))
    refused = (
        ({"fields": ()}, "fields = 0"),
        ({"fields": (BALL,), "factors": (1.0, 2.0)}, "factors = 2: give one for each of the 1"),
        ({"fields": (BALL,), "factors": (-1.0,)}, "factors = -1.0"),
    )

    def expected(self, field: Any, points: Array) -> Array:
        factors = field.factors or (1.0,) * len(field.fields)
        return sum(f * part.density(points) for f, part in zip(factors, field.fields, strict=True))

    def test_columns_are_linear(self) -> None:
        start, end = self.lines(BALL + BLOB)
        expected = 2 * BALL.column(start, end) + 0.25 * BLOB.column(start, end)
        np.testing.assert_allclose((2 * BALL + 0.25 * BLOB).column(start, end), expected, rtol=1e-15)


class TestCarved(SpatialFieldBase):
    field_class = Carved
    tolerance = 1e-6
    bound_slack = 1e3
    examples = (
        BALL.carved_by(BLOB),
        BLOB.carved_by(BALL),
        BALL.carved_by(2 * BLOB + BALL.moved((0.5, 0.5, 0)), level=0.5),
        BALL.carved_by(Sphere(radius=0.5), level=0.5),
        PowerLaw(core=0.2, exponent=2.0, cut=1.0).carved_by(
            Cone(half_angle_deg=28.0, length=1.2, both_sides=True, axis=(1.0, 0.0, 0.0))
        ),
    )
    refused = (({"field": BALL, "by": BLOB, "level": 0.0}, "level = 0.0"),)

    def expected(self, field: Any, points: Array) -> Array:
        a, b = field.field.density(points), field.by.density(points)
        return a * np.maximum(1 - b, 0) if field.level is None else np.where(b < field.level, a, 0)


class TestPower(SpatialFieldBase):
    field_class = Power
    tolerance = 1e-6
    bound_slack = 1e3
    examples = ((BALL + BLOB) ** 2, (BALL * BLOB) ** 0.5, FlaredDisk(radius=1, height=0.3, inner=0.5, outer=2) ** 2)
    refused = (({"field": BALL, "exponent": 0.0}, "exponent = 0.0"),)

    def expected(self, field: Any, points: Array) -> Array:
        return field.field.density(points) ** field.exponent

    @pytest.mark.parametrize("field", [2 * BLOB, Plummer(radius=1.0), BALL], ids=["gaussian", "plummer", "sphere"])
    def test_squares_in_closed_form(self, field: Any) -> None:
        square, (start, end) = field**2, self.lines(field)
        assert [term.method for term in square.terms()] == [0]
        expected = reference_columns(square, start, end)
        np.testing.assert_allclose(square.column(start, end), expected, rtol=1e-9, atol=1e-11 * expected.max())
        points = self.sample(field, 100)
        np.testing.assert_allclose(square.density(points), field.density(points) ** 2, rtol=1e-12)


class TestWarped(SpatialFieldBase):
    field_class = Warped
    tolerance = 1e-6
    bound_slack = 1e4
    examples = (
        BALL.warped(0.1, 1.0),
        BLOB.warped(0.1, 0.5, seed=4).rotated((1, 0, 0), about=(1, 2, 3)).rotated((1, 0, 0)).field.field,
        Shell(inner=0.8, outer=1.0).warped(0.05, 1.0, seed=2).warped(0.05, 0.7),
    )
    refused = (
        ({"field": BALL, "amplitude": 0.0, "scale": 1.0}, "amplitude = 0.0"),
        ({"field": BALL, "amplitude": 1.0, "scale": 1.0, "seed": -1}, "seed = -1"),
    )

    def displacement(self, field: Any, points: Array) -> Array:
        modes = warp_modes(field.seed)
        turns = np.einsum("nd,imd->nim", points / field.scale, modes[:, :, :3]) + modes[:, :, 3]
        return 0.5 * field.amplitude * np.cos(2 * np.pi * turns).sum(axis=2)

    def expected(self, field: Any, points: Array) -> Array:
        return field.field.density(points + self.displacement(field, points))

    def test_displacement_is_as_large_as_asked(self) -> None:
        field = BALL.warped(0.1, 1.0)
        v = self.displacement(field, np.random.default_rng(1).uniform(-50, 50, (100_000, 3)))
        np.testing.assert_allclose(v.std(axis=0), 0.1, rtol=0.02)
        assert abs(v).max() <= 0.4

    def test_warps_move_with_their_fields(self) -> None:
        field = BALL.warped(0.1, 1.0)
        points = self.sample(field, 200)
        moved = field.rotated((0, 1, 0), turn_deg=30.0).moved((3, 0, 0))
        placed = Sphere(radius=1.0, position=(3, 0, 0), axis=(0, 1, 0), turn_deg=30.0)
        there = points - points.mean(axis=0) + [3, 0, 0]
        np.testing.assert_allclose(moved.density(there), field.density(own_frame(placed, there)), atol=1e-9)


def test_every_field_has_its_tests() -> None:
    # Grids and particles are tested in files of their own: what they hold is data, not a formula;
    # so is a planet's air.
    assert members(AnySpatialField) == {*SPACE_TESTS, VoxelGrid, ParticleSet, AroundPlanet}


def test_fields_from_a_file() -> None:
    import tomllib

    from pydantic import TypeAdapter

    text = """
    kind = "carve"
    by = { kind = "front", radii = [["1 pc", "1 pc"], ["1 pc", "2 pc"], ["1 pc", "1 pc"]], width = "0.1 pc" }
    [field]
    kind = "product"
    [[field.fields]]
    kind = "sphere"
    radius = "3 pc"
    [[field.fields]]
    kind = "turbulence"
    outer_scale = "1 pc"
    inner_scale = "0.1 pc"
    """
    adapter: TypeAdapter[Any] = TypeAdapter(AnySpatialField)
    field = adapter.validate_python(tomllib.loads(text))
    parsec = 3.0856775814913673e16
    turbulence = Turbulence(outer_scale=parsec, inner_scale=0.1 * parsec)
    point = np.array([0, 0, 2.5]) * parsec
    assert field.density(point) == pytest.approx(turbulence.density(point), rel=1e-12)
    assert field.density([0, 0, 0]) == 0


def test_programs_too_deep_are_refused() -> None:
    from bases import complaint

    def deep() -> Any:
        field: Any = BALL
        for seed in range(10):
            field = field.warped(0.01, 1.0, seed)
        return field

    assert "too deep" in complaint(deep)


def test_columns_of_segments_broadcast_and_vanish() -> None:
    field = BALL * BLOB
    assert field.column([0, 0, -1], [[0, 0, 1], [0, 0, 2]]).shape == (2,)
    assert field.column([0, 0, 0], [0, 0, 0]) == 0
    assert field.column([9, 9, 9], [9, 9, 10]) == 0
