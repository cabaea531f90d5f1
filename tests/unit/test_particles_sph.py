"""Particle sets: densities against the sum over all particles, columns against quadrature, mass, convergence, files."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from field_bounds import assert_bounds_hold
from pydantic import ValidationError
from scipy.integrate import quad
from scipy.spatial import cKDTree

from skyscatter.errors import DomainError, MissingDataError
from skyscatter.kernels.particles import chord_integral
from skyscatter.kernels.space import fill_columns, fill_densities, make_space_work
from skyscatter.media.particles import ParticleSet
from skyscatter.media.shapes import GaussianSphere
from skyscatter.media.spacetables import field_table, pack_space
from skyscatter.media.voxels import VoxelGrid

RNG = np.random.default_rng(21)
NUMBER = 700
#: Smoothing lengths over a factor of 100, some particles within others.
PLACES = RNG.normal(size=(NUMBER, 3)) * [1, 2, 0.5]
MASSES = RNG.uniform(0.1, 1, NUMBER)
LENGTHS = 10 ** RNG.uniform(-1.7, 0.3, NUMBER)


def kernel(q):
    """Cubic spline of Monaghan & Lattanzio (1985) with h = 1, as they write it."""
    return np.where(q < 1, 1 - 1.5 * q**2 + 0.75 * q**3, np.where(q < 2, 0.25 * (2 - q) ** 3, 0.0)) / np.pi


def direct(points, lengths=LENGTHS):
    distance = np.linalg.norm(points[:, None] - PLACES, axis=2)
    return (MASSES * kernel(distance / lengths) / lengths**3).sum(axis=1)


def particles(**options):
    given = {"positions": PLACES, "masses": MASSES, "smoothing_lengths": LENGTHS, "resolution": 0}
    return ParticleSet(**given | options)


def plummer(number, rng):
    """Places in a Plummer sphere of radius 1 (Aarseth, Henon & Wielen 1974, A&A 37, 183, eq. A2)."""
    radius = (rng.random(number) ** (-2 / 3) - 1) ** -0.5
    direction = rng.normal(size=(number, 3))
    return radius[:, None] * direction / np.linalg.norm(direction, axis=1)[:, None]


@pytest.mark.parametrize(("lengths", "tolerance"), [(LENGTHS, 2e-5), (np.full(NUMBER, 0.3), 3e-6)])
def test_densities_are_the_sum_over_all_particles(lengths, tolerance):
    """In single precision: places are known to 6e-8 of half a leaf, up to 2 units: 1e-5 of h = 0.02, 4e-7 of 0.3."""
    many, far = RNG.normal(size=(1000, 3)) * [1, 2, 0.5], RNG.uniform(-9, 9, (300, 3))
    points = np.concatenate([many, PLACES[:200] + 1e-3, far])
    expected = direct(points, lengths)
    density = particles(smoothing_lengths=lengths).density(points)
    np.testing.assert_allclose(density, expected, rtol=tolerance, atol=1e-6 * np.median(expected))


def test_columns_are_the_integral_of_the_density():
    field = particles()
    for _ in range(5):
        start, end = RNG.normal(size=(2, 3)) * [2, 3, 1]
        length = np.linalg.norm(end - start)
        # The density has kinks in its second derivative at q = 0, 1 and 2 of every particle that is near.
        nearest = np.dot(PLACES - start, end - start) / length
        off = np.linalg.norm(PLACES - start - nearest[:, None] * (end - start) / length, axis=1)
        cuts = [nearest]
        for edge in (1.0, 2.0):
            half = np.sqrt(np.maximum((edge * LENGTHS) ** 2 - off**2, 0.0))
            cuts += [nearest - half, nearest + half]
        cuts = np.unique(np.concatenate([[0.0, length], *(np.asarray(c)[off < 2 * LENGTHS] for c in cuts)]))
        cuts = cuts[(cuts >= 0) & (cuts <= length)]
        node, weight = np.polynomial.legendre.leggauss(8)
        t = 0.5 * (cuts[1:] + cuts[:-1])[:, None] + 0.5 * np.diff(cuts)[:, None] * node
        density = direct(start + t.reshape(-1, 1) * (end - start) / length).reshape(t.shape)
        expected = np.sum(0.5 * np.diff(cuts) * (density @ weight))
        assert field.column(start, end) == pytest.approx(expected, rel=3e-6)


def test_one_particle_in_closed_form():
    h = 0.5
    one = ParticleSet(positions=[[1.0, 2.0, 3.0]], masses=[4.0], smoothing_lengths=[h], resolution=0)
    assert one.density([1, 2, 3]) == pytest.approx(4 / (math.pi * h**3), rel=1e-6)
    # Through the middle: 2 * (1 - 1/2 + 3/16 + 1/16) h / (pi h^3).
    assert one.column([1, 2, -9], [1, 2, 9]) == pytest.approx(4 * 1.5 / (math.pi * h**2), rel=1e-6)
    assert one.column([1, 2, 3], [1, 2, 9]) == pytest.approx(2 * 1.5 / (math.pi * h**2), rel=1e-6)
    assert one.column([2.0001, 2, -9], [2.0001, 2, 9]) == 0.0
    assert one.reference_column() == pytest.approx(4 * 1.5 / (math.pi * h**2), rel=1e-6)
    # Along the edge of the sphere, and of its box.
    assert one.column([2.0, 2, -9], [2.0, 2, 9]) == pytest.approx(0.0, abs=1e-12)
    assert one.column([2.0, 3, -9], [2.0, 3, 9]) == 0.0


def test_the_tabulated_chord_is_the_integral():
    for b in (0.0, 0.01, 0.07, 0.3, 0.9, 1.0, 1.4, 1.99):
        half = math.sqrt(4 - b * b)
        points = [math.sqrt(1 - b * b)] if b < 1 else None
        along = quad(lambda s, b=b: float(kernel(math.hypot(b, s))), 0, half, points=points, epsabs=1e-12)[0]
        exact = 2 * np.pi * along
        assert _chord_integral(b * b) == pytest.approx(exact, abs=4e-7)


def _chord_integral(b2):
    from numba import njit

    return njit(lambda x: chord_integral(x))(b2)


def test_parts_of_a_column_add_up():
    field = particles()
    a, b = RNG.normal(size=(2, 300, 3)) * 2
    middle = a + RNG.uniform(0, 1, (300, 1)) * (b - a)
    # The table of whole chords is good to 1e-7 of a particle's largest column.
    np.testing.assert_allclose(field.column(a, middle) + field.column(middle, b), field.column(a, b), rtol=1e-6)
    np.testing.assert_allclose(field.column(b, a), field.column(a, b), rtol=1e-9)


def test_mass_is_the_integral_of_the_columns():
    """Gauss-Legendre over the cross-section of two particles that overlap."""
    field = ParticleSet(
        positions=[[0, 0, 0], [0.3, 0.2, 0.5]], masses=[1.0, 2.0], smoothing_lengths=[0.5, 0.6], resolution=0,
        factor=7.0,
    )  # fmt: skip
    node, weight = np.polynomial.legendre.leggauss(120)
    x, y = np.meshgrid(1.6 * node, 1.6 * node)
    start = np.stack([x, y, np.full_like(x, -5.0)], axis=-1)
    total = 1.6**2 * np.einsum("ij,i,j", field.column(start, start + np.array([0, 0, 10])), weight, weight)
    assert field.mass == 21.0
    assert total == pytest.approx(21.0, rel=1e-5)


def test_two_halves_make_the_whole():
    whole, first = particles(), RNG.random(NUMBER) < 0.4
    halves = [particles(positions=PLACES[k], masses=MASSES[k], smoothing_lengths=LENGTHS[k]) for k in (first, ~first)]
    points = RNG.normal(size=(500, 3))
    parts = sum(half.density(points) for half in halves)
    # Other leaves, so other roundings of places to 1e-5 of the smallest h, as above.
    np.testing.assert_allclose(parts, whole.density(points), rtol=2e-5, atol=1e-7)
    a, b = RNG.normal(size=(2, 200, 3)) * 3
    np.testing.assert_allclose(sum(h.column(a, b) for h in halves), whole.column(a, b), rtol=2e-5)


def test_voxels_with_a_particle_edge_add_linearly():
    """One medium of a core on voxels and an edge of particles: each component as if alone, weights linear."""
    core = VoxelGrid.from_field(GaussianSphere(width=0.5), 20)
    fields = [core, particles(), particles(factor=2.5)]
    table, work = pack_space(fields), make_space_work()
    points, ends = RNG.normal(size=(2, 300, 3))
    density, column = np.zeros((300, 3)), np.zeros((300, 3))
    fill_densities(table, points, work, density)
    fill_columns(table, points, ends, work, column)
    for k, field in enumerate(fields):
        np.testing.assert_allclose(density[:, k], field.density(points), rtol=1e-12)
        np.testing.assert_allclose(column[:, k], field.column(points, ends), rtol=1e-12)
    np.testing.assert_allclose(column[:, 2], 2.5 * column[:, 1], rtol=1e-12)


def test_a_sampled_plummer_sphere_converges():
    """With one smoothing length h for all, the error at a point has two parts that are known beforehand.

    Noise: the variance of a Poisson sum, density * m * integral of W^2.  Bias: h^2 / 2 times the second moment of W
    along an axis times the Laplacian of the density (and terms of h^4).  With h falling as N^(-1/7) both fall
    together, as N^(-2/7).
    """
    q, w = np.polynomial.legendre.leggauss(200)
    q, w = q + 1, w * 4 * np.pi * (q + 1) ** 2
    square, moment = np.sum(w * kernel(q) ** 2), np.sum(w * kernel(q) * q**2) / 3
    assert np.sum(w * kernel(q)) == pytest.approx(1.0, rel=1e-6)
    rng = np.random.default_rng(31)
    points = rng.uniform(-1, 1, (600, 3))
    s = 1 + (points**2).sum(axis=1)
    density = 0.75 / np.pi * s**-2.5
    laplacian = 0.75 / np.pi * (-15 * s**-3.5 + 35 * (s - 1) * s**-4.5)
    errors = []
    for number in (2000, 32_000):
        h = 0.25 * (number / 2000) ** (-1 / 7)
        squares = []
        for _ in range(12):
            field = ParticleSet(
                positions=plummer(number, rng), masses=np.full(number, 1 / number),
                smoothing_lengths=np.full(number, h), resolution=0,
            )  # fmt: skip
            squares.append(np.mean((field.density(points) - density) ** 2))
        errors.append(np.sqrt(np.mean(squares)))
        variance = density * square / (number * h**3)
        expected = np.sqrt(np.mean(variance + (0.5 * moment * h**2 * laplacian) ** 2))
        # Three standard deviations of 12 sets of some 20 independent places each.
        assert errors[-1] == pytest.approx(expected, rel=0.15)
    assert np.log(errors[0] / errors[1]) / np.log(16) == pytest.approx(2 / 7, abs=0.06)


def test_smoothing_lengths_are_half_the_distance_to_a_neighbour():
    field = ParticleSet(positions=PLACES, neighbours=20, resolution=0)
    expected = 0.5 * cKDTree(PLACES).query(PLACES, k=21)[0][:, -1]
    np.testing.assert_allclose(field.particles.lengths, expected, rtol=1e-12)
    assert field.mass == NUMBER
    with pytest.raises(DomainError, match="no neighbours"):
        _ = ParticleSet(positions=[[0, 0, 0]]).particles
    with pytest.raises(DomainError, match="in one place"):
        _ = ParticleSet(positions=np.zeros((50, 3))).particles


def test_extremes_contain_all_values():
    field = particles()
    low = RNG.uniform(-3, 3, (200, 3))
    high = low + RNG.uniform(0, 0.6, (200, 3))
    lowest, highest = field.extremes(low, high)
    density = field.density(low + RNG.uniform(0, 1, (300, 200, 3)) * (high - low))
    assert np.all(density >= lowest)
    assert np.all(density <= highest)
    table = field_table((field,))
    assert np.all(table.upper >= table.lower)


# Where only the rim of particles reaches a box, their bounds cost a tenth of a second.
@pytest.mark.parametrize(("resolution", "boxes"), [(0, 2000), (20, 4000)])
def test_bounds_hold_on_the_edges_of_particles(resolution, boxes):
    field = particles(resolution=resolution)
    places, _, lengths = field.particles
    special = np.concatenate([places + reach * lengths[:, None] for reach in (-2, -1, 0, 1, 2)]).T
    assert_bounds_hold(field, special, boxes)


def test_needles_and_sheets_are_bounded_in_little_memory():
    """Boxes of 1e-9 by 30 are cut across their long sides alone: cut into eight they took 20 GB, and were not done."""
    field = particles()
    low = RNG.normal(size=(300, 3))
    size = RNG.permuted(np.repeat([[1e-9, 1e-9, 30.0], [1e-9, 30.0, 30.0]], 150, axis=0), axis=1)
    tracemalloc.start()
    lowest, highest = field.extremes(low - 0.5 * size, low + 0.5 * size)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    density = field.density(low)
    assert np.all((lowest <= density * (1 + 1e-6)) & (density * (1 - 1e-6) <= highest))
    # 300 boxes, some thousand parts of each at once, 100 bytes a part.
    assert peak < 1e8


def test_upper_bounds_are_close_where_particles_are_many():
    places = np.random.default_rng(5).random((20_000, 3))
    field = ParticleSet(positions=places, resolution=0)
    low = RNG.uniform(0.2, 0.7, (50, 3))
    high = low + 0.1
    _, highest = field.extremes(low, high)
    density = field.density(low + RNG.uniform(0, 1, (2000, 50, 3)) * (high - low)).max(axis=0)
    assert np.all(highest >= density)
    # Twice a density in the box, which 2000 places find to some 10 %.
    assert np.max(highest / density) < 2.2


def test_a_grid_of_particles_has_their_mass_and_nearly_their_columns():
    rng = np.random.default_rng(17)
    exact = ParticleSet(positions=rng.random((8000, 3)), resolution=0)
    size = (exact.bounds[1] - exact.bounds[0]).max() / np.median(exact.particles.lengths)
    points, directions = rng.uniform(0.3, 0.7, (2000, 3)), rng.normal(size=(2000, 3))
    value, column = exact.density(points), exact.column(points - 9 * directions, points + 9 * directions)
    errors = []
    for fineness in (2, 4):
        voxels = exact.resampled(math.ceil(fineness * size))
        mass = voxels.cube.sum(dtype=float) * voxels.cell.prod() * voxels.factor
        assert mass == pytest.approx(exact.mass, rel=1e-12)
        values, columns = voxels.density(points), voxels.column(points - 9 * directions, points + 9 * directions)
        errors.append([np.sqrt(np.mean((values / value - 1) ** 2)), np.sqrt(np.mean((columns / column - 1) ** 2))])
    # What the documentation promises; columns here are shorter, through 20 particles instead of 31: sqrt(31 / 20).
    assert errors[0][0] < 0.05
    assert errors[0][1] < 0.008 * 1.25
    np.testing.assert_allclose(np.log2(np.array(errors[0]) / errors[1]), 2.0, atol=0.25)
    # Particles smaller than a cell lose nothing either, nor do those at the edge.
    coarse = particles().resampled(9)
    assert coarse.cube.sum(dtype=float) * coarse.cell.prod() * coarse.factor == pytest.approx(MASSES.sum(), rel=1e-12)


def test_resolution_auto_takes_a_grid_where_one_does():
    even = ParticleSet(positions=np.random.default_rng(5).random((3000, 3)))
    low, high = ParticleSet(positions=even.positions, resolution=0).bounds
    assert even.cells == math.ceil(2 * (high - low).max() / np.median(even.particles.lengths)) <= 256
    assert even.terms()[0].program[0].data is even.grid.terms()[0].program[0].data
    clustered = ParticleSet(positions=plummer(20_000, np.random.default_rng(6)))
    assert clustered.cells == 0
    assert ParticleSet(positions=PLACES, resolution=33).cells == 33


def test_files_and_units(tmp_path):
    from astropy.table import Table

    np.savez(tmp_path / "a.npz", positions=PLACES, masses=MASSES, smoothing_lengths=LENGTHS)
    columns = {"X": PLACES[:, 0], "Y": PLACES[:, 1], "Z": PLACES[:, 2]}
    Table(columns | {"masses": MASSES, "smoothing_lengths": LENGTHS}).write(tmp_path / "a.fits")
    points = RNG.normal(size=(100, 3))
    for name in ("a.npz", "a.fits"):
        field = ParticleSet(file=str(tmp_path / name), length_unit="1 km", resolution=0)
        np.testing.assert_allclose(field.density(1e3 * points), 1e-9 * particles().density(points), rtol=1e-6)
        assert ParticleSet.model_validate_json(field.model_dump_json()) == field
    np.savez(tmp_path / "b.npz", masses=MASSES)
    with pytest.raises(MissingDataError, match="holds no positions"):
        _ = ParticleSet(file=str(tmp_path / "b.npz")).particles
    assert particles() == particles()
    assert hash(particles()) == hash(particles())
    assert particles() != particles(masses=2 * MASSES)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({}, "give positions"),
        ({"positions": PLACES, "file": "a.npz"}, "give positions"),
        ({"positions": PLACES[:, :2]}, "needs the shape"),
        ({"positions": PLACES, "masses": MASSES[:5]}, "one number for each of the 700"),
        ({"positions": PLACES, "masses": -MASSES}, "never negative"),
        ({"positions": PLACES, "smoothing_lengths": 0 * LENGTHS}, "positive lengths"),
        ({"positions": PLACES * np.nan}, "finite"),
        ({"positions": PLACES, "resolution": -1}, "0 for exact"),
        ({"positions": PLACES, "length_unit": 0.0}, "positive length"),
    ],
)
def test_bad_input_is_told_in_one_line(options, text):
    with pytest.raises(ValidationError, match=text):
        ParticleSet(**options)
