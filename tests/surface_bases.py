"""The bases that every material and every shape inherits, and the registers that notice a missing one."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from skyscatter.kernels.codes.surfaces import ABSORBED, DELTA, REFLECTED, TRANSMITTED
from skyscatter.kernels.surfaces import bsdf, rays
from skyscatter.kernels.surfaces.tables import ShapeTable
from skyscatter.surfaces.materials import Interface, Lambert
from skyscatter.surfaces.packing import item_areas, pack_materials, pack_shapes

Array = NDArray[np.float64]
#: Class of the package -> class that tests it.
MATERIAL_TESTS: dict[type, type] = {}
WAVELENGTHS = np.array([450.0, 550.0, 650.0])
#: Chance that a right density fails a chi-square test.
FALSE_ALARM = 1e-4


def unit(*vector: float) -> Array:
    """A vector of length 1."""
    return np.array(vector, float) / np.linalg.norm(vector)


#: Normal of the surface: along no axis of the frame.
NORMAL = unit(0.3, -0.5, 0.7)


def direction(cosine: Any, azimuth: Any) -> Array:
    """Directions (..., 3) by the cosine from `NORMAL` and the azimuth around it."""
    a = np.cross(NORMAL, [1.0, 0.0, 0.0])
    a /= np.linalg.norm(a)
    b = np.cross(NORMAL, a)
    cosine, azimuth = np.broadcast_arrays(np.asarray(cosine, float), np.asarray(azimuth, float))
    sine = np.sqrt(1 - cosine**2)
    return (
        cosine[..., None] * NORMAL + (sine * np.cos(azimuth))[..., None] * a + (sine * np.sin(azimuth))[..., None] * b
    )


class Draws(NamedTuple):
    """Drawn directions (draw, 3), values and chances (draw, wavelength), events (draw,)."""

    wi: Array
    value: Array
    chance: Array
    event: NDArray[np.int64]


class Bsdf:
    """A material between two media of given indices, at all `WAVELENGTHS`."""

    def __init__(self, material: Any, here: float | Array = 1.0, there: float | Array = 1.0) -> None:
        self.table = pack_materials([material], WAVELENGTHS)
        self.here, self.there = (np.broadcast_to(x, 3).astype(float) for x in (here, there))
        ratio = self.here / self.there
        self.dispersive = bool(np.ptp(ratio) > 0)

    def turned(self) -> Bsdf:
        """The same from the other side."""
        other = object.__new__(Bsdf)
        other.table, other.here, other.there, other.dispersive = self.table, self.there, self.here, self.dispersive
        return other

    def draw(self, wo: Array, count: int, adjoint: bool = False, hero: int = 0, seed: int = 1) -> Draws:
        """Draw directions."""
        numbers = np.random.default_rng(seed).random((count, 5))
        result = Draws(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count, np.int64))
        bsdf.sample_bsdfs(
            self.table, 0, hero, NORMAL, wo, numbers, self.here, self.there, self.dispersive, adjoint, *result
        )
        return result

    def at(self, wo: Array, wi: Array, adjoint: bool = False) -> tuple[Array, Array]:
        """Values and densities (direction, wavelength), by the functions for one and for both, which must agree."""
        wi = np.ascontiguousarray(wi.reshape(-1, 3))
        value, chance, both = *np.zeros((2, len(wi), 3)), np.zeros((2, len(wi), 3))
        bsdf.bsdf_values(self.table, 0, NORMAL, wo, wi, self.here, self.there, adjoint, value, chance, both)
        np.testing.assert_allclose(both, [value, chance], rtol=1e-14)
        return value, chance


def cells(polar: int, around: int, fine: int) -> tuple[Array, Array]:
    """Middles of a fine grid of directions, (polar x fine, around x fine, 3), and the solid angle of each of them."""
    cosines = -1 + 2 * (np.arange(polar * fine) + 0.5) / (polar * fine)
    azimuths = 2 * np.pi * (np.arange(around * fine) + 0.5) / (around * fine)
    solid = np.array(4 * np.pi / (polar * around * fine**2))
    return direction(*np.meshgrid(cosines, azimuths, indexing="ij")), solid


class BsdfContract:
    """What every material has to keep, from both sides, head-on and at a slant."""

    material: ClassVar[Any]
    here: ClassVar[Any] = 1.0
    there: ClassVar[Any] = 1.0
    #: Whether all light goes on.
    lossless: ClassVar[bool] = False
    #: Bound of value over density.
    heaviest: ClassVar[float] = 1.0
    #: Whether what passes is refracted, so that its radiance changes by n^2.
    refracts: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        MATERIAL_TESTS[type(cls.material)] = cls

    @pytest.fixture(params=["outside", "inside"])
    def case(self, request: pytest.FixtureRequest) -> tuple[Bsdf, float]:
        """The material, and on which side of it the light travels."""
        sample = Bsdf(self.material, self.here, self.there)
        return (sample, 1.0) if request.param == "outside" else (sample.turned(), -1.0)

    @pytest.fixture(params=[0.95, 0.4], ids=["steep", "slanting"])
    def seen(self, request: pytest.FixtureRequest, case: tuple[Bsdf, float]) -> tuple[Bsdf, Array]:
        """The material and `wo`."""
        return case[0], direction(case[1] * request.param, 1.1)

    def test_a_draw_tells_its_own_value_and_density(self, seen: tuple[Bsdf, Array]) -> None:
        """And draws are unit vectors on the side that the event says."""
        sample, wo = seen
        for adjoint in (False, True):
            drawn = sample.draw(wo, 500, adjoint)
            kept = drawn.event != ABSORBED
            np.testing.assert_allclose(np.linalg.norm(drawn.wi[kept], axis=1), 1, rtol=1e-14)
            same_side = (drawn.wi @ NORMAL > 0) == (wo @ NORMAL > 0)
            np.testing.assert_array_equal(same_side[kept], (drawn.event[kept] & 3) == REFLECTED)
            assert (drawn.chance[kept, 0] > 0).all()
            assert not drawn.value[~kept].any()
            assert not drawn.chance[~kept].any()
            some = kept & (drawn.event < DELTA)
            value, chance = sample.at(wo, drawn.wi[some], adjoint)
            np.testing.assert_allclose(drawn.value[some], value, rtol=1e-12)
            np.testing.assert_allclose(drawn.chance[some], chance, rtol=1e-12)
            # A direction that is no matter of chance has no density.
            delta_value, _ = sample.at(wo, drawn.wi[drawn.event >= DELTA], adjoint)
            if (drawn.event >= DELTA).all():
                assert not delta_value.any()

    def test_draws_follow_the_density(self, seen: tuple[Bsdf, Array]) -> None:
        """Chi-square of counts in 16 x 16 cells against the integral of the density, for the first and last hero."""
        sample, wo = seen
        drawn = sample.draw(wo, 20_000)
        if (drawn.event >= DELTA).all():
            # No matter of chance is which of two directions it is: their shares against their probabilities.
            reflected = drawn.event == REFLECTED + DELTA
            share = drawn.chance[reflected, 0].max(initial=0.0)
            assert np.ptp(drawn.chance[reflected, 0]) == 0 if reflected.any() else True
            np.testing.assert_allclose(drawn.chance[~reflected, 0], 1 - share, rtol=1e-12)
            assert abs(reflected.mean() - share) <= 4 * np.sqrt(share * (1 - share) / 20_000)
            return
        fine = 32
        grid, solid = cells(16, 16, fine)
        _, chance = sample.at(wo, grid)
        expected = chance.reshape(16, fine, 16, fine, 3).sum(axis=(1, 3)) * solid
        for hero in (0, 2):
            count = 60_000
            drawn = sample.draw(wo, count, hero=hero, seed=5 + hero)
            kept = drawn.event != ABSORBED
            wi = drawn.wi[kept]
            a = direction(0.0, 0.0)
            row = np.minimum((8 * (1 + wi @ NORMAL)).astype(int), 15)
            azimuth = np.arctan2(wi @ np.cross(NORMAL, a), wi @ a) % (2 * np.pi)
            observed = np.bincount(row * 16 + np.minimum((azimuth * 8 / np.pi).astype(int), 15), minlength=256)
            share = expected[..., hero].ravel()
            # Its integral is the share of draws that go on: to 1.2e-3, the error of the table of what meets other
            # facets, and 5e-4, that of the quadrature of sharp lobes.
            spread = np.sqrt(max(share.sum() * (1 - share.sum()), 0.0) / count)
            assert abs(kept.mean() - share.sum()) < 4.5 * spread + 1.7e-3, (hero, kept.mean(), share.sum())
            full = share * count >= 8
            merged = np.append(observed[full], observed[~full].sum() + (~kept).sum())
            lost = max(1 - share.sum(), 0.0)  # the error of the table must not fall on this cell alone
            wanted = np.append(share[full] * count, (share[~full].sum() + lost) * count)
            use = wanted > 1e-6 * count
            statistic = ((merged[use] - wanted[use]) ** 2 / wanted[use]).sum()
            assert stats.chi2.sf(statistic, use.sum() - 1) > FALSE_ALARM, (hero, statistic, use.sum())

    def test_reciprocal(self, case: tuple[Bsdf, float]) -> None:
        """Both ways f / n^2 is the same number (Veach 1997, equation 5.14), to rounding; photons go the other way."""
        sample, side = case
        rng = np.random.default_rng(3)
        found = 0
        for _ in range(40):
            wo = direction(side * rng.uniform(0.05, 1), rng.uniform(0, 6.28))
            wi = direction(rng.uniform(-1, 1), rng.uniform(0, 6.28))
            crossed = (wi @ NORMAL > 0) != (side > 0)
            way_back = sample.turned() if crossed else sample
            there = sample.there if crossed else sample.here
            forth, _ = sample.at(wo, wi)
            back, _ = way_back.at(wi, wo)
            f, g = forth[0] / abs(wi @ NORMAL), back[0] / abs(wo @ NORMAL)
            np.testing.assert_allclose(f / sample.here**2, g / there**2, rtol=1e-10, atol=1e-300)
            photons, _ = sample.at(wo, wi, True)
            np.testing.assert_allclose(photons[0] / abs(wi @ NORMAL), g, rtol=1e-10, atol=1e-300)
            found += int(forth.any())
        drawn = sample.draw(direction(side * 0.5, 0.0), 10)
        assert found > 0 or (drawn.event >= DELTA).all()

    def test_energy(self, seen: tuple[Bsdf, Array]) -> None:
        """No more power leaves than came, whatever is drawn; all of it where nothing is kept."""
        sample, wo = seen
        drawn = sample.draw(wo, 20_000, adjoint=True)
        weight = np.divide(drawn.value, drawn.chance, out=np.zeros_like(drawn.value), where=drawn.chance > 0)
        hero = weight[:, 0]
        error = hero.std() / np.sqrt(len(hero))
        assert hero.mean() <= 1 + 4 * error + 1e-12
        if self.lossless:
            assert abs(hero.mean() - 1) <= 4 * error + 1e-12, hero.mean()
        assert weight.max() <= self.heaviest + 1e-9

    def test_white_furnace(self, seen: tuple[Bsdf, Array]) -> None:
        """In radiance n^2 on all sides a surface disappears, but for what it keeps: that is seen from both ends."""
        sample, wo = seen
        drawn = sample.draw(wo, 20_000)
        passed = (drawn.event & 3) == TRANSMITTED
        radiance = np.where(passed & self.refracts, (sample.there[0] / sample.here[0]) ** 2, 1.0)
        weight = np.divide(drawn.value[:, 0], drawn.chance[:, 0], out=np.zeros(20_000), where=drawn.chance[:, 0] > 0)
        power = sample.draw(wo, 20_000, adjoint=True, seed=2)
        other = np.divide(power.value[:, 0], power.chance[:, 0], out=np.zeros(20_000), where=power.chance[:, 0] > 0)
        error = np.hypot((weight * radiance).std(), other.std()) / np.sqrt(20_000)
        assert abs((weight * radiance).mean() - other.mean()) <= 4 * error + 1e-12
        if self.lossless:
            assert abs((weight * radiance).mean() - 1) <= 4 * error + 1e-12

    def test_spectral_weights_are_unbiased(self, seen: tuple[Bsdf, Array]) -> None:
        """By the balance heuristic over heroes every wavelength gets the power that it gets as the only hero."""
        sample, wo = seen
        estimates = []
        for hero in range(3):
            drawn = sample.draw(wo, 20_000, adjoint=True, hero=hero, seed=20 + hero)
            mean = drawn.chance.mean(axis=1, keepdims=True)
            estimates.append(np.divide(drawn.value, mean, out=np.zeros_like(drawn.value), where=mean > 0))
        together = np.concatenate(estimates)  # heroes in equal numbers
        for i in range(3):
            alone = sample.draw(wo, 60_000, adjoint=True, hero=i, seed=30 + i)
            weight = np.divide(
                alone.value[:, i], alone.chance[:, i], out=np.zeros(60_000), where=alone.chance[:, i] > 0
            )
            error = np.hypot(together[:, i].std(), weight.std()) / np.sqrt(60_000)
            assert abs(together[:, i].mean() - weight.mean()) <= 4.5 * error + 1e-12


#: Class of the package -> class that tests it.
SHAPE_TESTS: dict[type, type] = {}


def pack(*shapes: Any, inside: int = -1, material: Any = None) -> ShapeTable:
    """A table with one body for every shape."""
    return pack_shapes([(shape, 0, inside, -1) for shape in shapes], [material or Lambert()])


class Hits(NamedTuple):
    """Items (ray,), -1 without a hit; distances (ray,) and normals (ray, 3)."""

    item: NDArray[np.int64]
    distance: Array
    normal: Array


def shoot(table: ShapeTable, origins: Array, directions: Array, far: float = np.inf, skip: Any = -1) -> Hits:
    """`closest_hit` of many rays."""
    n = len(origins)
    items, hits = np.zeros(n, np.int64), np.full((n, 4), np.nan)
    skips = np.broadcast_to(skip, n).astype(np.int64)
    rays.closest_hits(table, origins, directions, np.full(n, far), skips, items, hits)
    return Hits(items, hits[:, 0], hits[:, 1:])


def blocked(table: ShapeTable, origins: Array, directions: Array, far: Any, skip: Any = -1, skip_far: Any = -1) -> Any:
    """`blocked` of many rays."""
    n, result = len(origins), np.zeros(len(origins), bool)
    wide = [np.broadcast_to(x, n).astype(t) for x, t in ((far, float), (skip, np.int64), (skip_far, np.int64))]
    rays.are_blocked(table, origins, directions, *wide, result)
    return result


def crossings(table: ShapeTable, origins: Array, directions: Array) -> NDArray[np.int64]:
    """How often each ray enters and leaves, (ray, 2)."""
    result = np.zeros((len(origins), 2), np.int64)
    rays.count_crossings(table, origins, directions, result, np.zeros(4))
    return result


def sphere_points(rng: np.random.Generator, count: int) -> Array:
    """Even directions (count, 3)."""
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def lines(rng: np.random.Generator, middle: Array, radius: float, count: int) -> tuple[Array, Array]:
    """Rays along even and isotropic lines through a ball: from its surface, by the cosine."""
    starts, turn = sphere_points(rng, count), sphere_points(rng, count)
    directions = turn - starts  # a unit vector plus an even one is distributed by the cosine
    return middle + radius * starts, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def sampled(table: ShapeTable, rng: np.random.Generator, count: int) -> tuple[NDArray[np.int64], Array, Array]:
    """Items, points and normals, even in area over all items."""
    areas = item_areas(table)
    items = rng.choice(areas.size, size=count, p=areas / areas.sum())
    points = np.zeros((count, 6))
    rays.sample_items(table, items, *rng.random((2, count)), points)
    return items, points[:, :3], points[:, 3:]


class ShapeContract:
    """What every shape has to keep, at its own size, at that of a droplet and at that of a planet."""

    #: Turned somehow, not around the origin, about 1 m in size.
    lengths: ClassVar[tuple[str, ...]]
    shape: ClassVar[Any]
    #: Its area [m2], in closed form.
    area: ClassVar[float]
    #: Whether no straight line enters it twice.
    convex: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        SHAPE_TESTS[type(cls.shape)] = cls

    def residual(self, points: Array) -> Array:
        """Distance [m] of points from the shape at its own size, negative inside, as far as it is small."""
        raise NotImplementedError

    @pytest.fixture(params=[1.0, 1e-5, 6.4e6], ids=["metre", "droplet", "planet"])
    def scale(self, request: pytest.FixtureRequest) -> float:
        """Factor for all lengths."""
        return float(request.param)

    def scaled(self, scale: float) -> Any:
        """The shape with all lengths multiplied."""
        grown = {}
        for name in self.lengths:
            value = getattr(self.shape, name)
            grown[name] = tuple(scale * x for x in value) if isinstance(value, tuple) else scale * value
        return type(self.shape)(**{**self.shape.model_dump(exclude_none=True), **grown})

    @pytest.fixture
    def table(self, scale: float) -> ShapeTable:
        """The shape alone."""
        return pack(self.scaled(scale))

    def ball(self) -> tuple[Array, float]:
        """A ball around it at its own size."""
        low, high = self.shape.bounds
        return 0.5 * (low + high), 0.6 * float(np.linalg.norm(high - low))

    def test_hits_lie_on_it(self, table: ShapeTable, scale: float) -> None:
        """To some rounding errors of the coordinates; normals are unit vectors and point out."""
        rng = np.random.default_rng(1)
        middle, radius = self.ball()
        origins, directions = lines(rng, middle, radius, 4000)
        hit = shoot(table, scale * origins, directions)
        met = hit.item >= 0
        assert met.sum() > 200
        points = origins[met] + (hit.distance[met] / scale)[:, None] * directions[met]
        # Distances lose digits where a ray grazes: an error of 1e-15 across becomes that over the cosine along.
        assert np.abs(self.residual(points)).max() < 2e-14 * (1 + np.abs(middle).max())
        np.testing.assert_allclose(np.linalg.norm(hit.normal[met], axis=1), 1, rtol=1e-14)
        assert (self.residual(points + 1e-6 * hit.normal[met]) > 0).mean() > 0.999
        if self.shape.holds_volume:
            assert ((hit.normal[met] * directions[met]).sum(axis=1) < 0).all()
            assert (self.residual(points - 1e-6 * hit.normal[met]) < 0).mean() > 0.999

    def test_area_by_lines(self, table: ShapeTable, scale: float) -> None:
        """Isotropic lines through a ball meet a surface 2 area / (4 pi radius^2) times (Santalo 1976, section 14.3)."""
        middle, radius = self.ball()
        origins, directions = lines(np.random.default_rng(2), middle, radius, 40_000)
        met = crossings(table, scale * origins, directions).sum(axis=1)
        expected = 2 * self.area / (4 * np.pi * radius**2)
        assert abs(met.mean() - expected) < 4 * met.std() / 200
        np.testing.assert_allclose(item_areas(table).sum(), self.area * scale**2, rtol=1e-12)

    def test_samples_are_even_in_area(self, table: ShapeTable, scale: float) -> None:
        """Like the places where isotropic lines cross it: chi-square of both counts in 5 x 5 x 5 cells."""
        middle, radius = self.ball()
        rng = np.random.default_rng(3)
        _, points, normals = sampled(table, rng, 30_000)
        few = slice(5000)
        assert np.abs(self.residual(points[few] / scale)).max() < 1e-14 * (1 + np.abs(middle).max())
        assert (self.residual(points[few] / scale + 1e-6 * normals[few]) > 0).mean() > 0.999
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=1e-14)
        origins, directions = lines(rng, middle, radius, 100_000)
        hit = shoot(table, scale * origins, directions)
        met = hit.item >= 0
        crossed = origins[met] + (hit.distance[met] / scale)[:, None] * directions[met]
        low, high = self.shape.bounds
        edges = [np.linspace(a - 1e-3, b + 1e-3, 6) for a, b in zip(low, high, strict=True)]
        one, _ = np.histogramdd(points / scale, edges)
        two, _ = np.histogramdd(crossed, edges)
        full = one + two > 20
        counts = np.array([one[full], two[full]])
        assert stats.chi2_contingency(counts)[1] > FALSE_ALARM

    def test_a_start_on_it_does_not_find_it_again(self, table: ShapeTable, scale: float) -> None:
        """Outward never (of one that is convex), inward at the far side only, and nothing at the distance 0."""
        rng = np.random.default_rng(4)
        items, points, normals = sampled(table, rng, 20_000)
        directions = sphere_points(rng, 20_000)
        outward = (directions * normals).sum(axis=1) > 0
        hit = shoot(table, points, directions, skip=items)
        if self.convex:
            assert (hit.item[outward] == -1).all()
        if self.shape.holds_volume:
            inward = ~outward
            assert (hit.item[inward] >= 0).mean() > 0.9999  # one in 1e5 starts within a rounding error of an edge
            assert (hit.distance[hit.item >= 0] > 0).all()
            there = points / scale + np.nan_to_num(hit.distance / scale)[:, None] * directions
            assert np.abs(self.residual(there[hit.item >= 0])).max() < 1e-13
        elif self.convex:
            assert (hit.item == -1).all()

    def test_crossings_balance(self, table: ShapeTable, scale: float) -> None:
        """Rays from outside leave as often as they enter, rays from inside once more."""
        if not self.shape.holds_volume:
            assert (crossings(table, *(scale * np.eye(3), np.eye(3))).sum(axis=1) <= 1).all()
            return
        rng = np.random.default_rng(5)
        low, high = self.shape.bounds
        origins = low + (high - low) * rng.random((20_000, 3))
        side = self.residual(origins)
        sure = np.abs(side) > 1e-9
        directions = sphere_points(rng, 20_000)
        found = crossings(table, scale * origins, directions)[sure]
        np.testing.assert_array_equal(found[:, 1] - found[:, 0], side[sure] < 0)
        assert 0.02 < (side < 0).mean() < 0.9

    def test_blocked_agrees_with_the_nearest_hit(self, table: ShapeTable, scale: float) -> None:
        """For segments of all lengths; what is left out at the far end blocks nothing, nor does an interface."""
        rng = np.random.default_rng(6)
        middle, radius = self.ball()
        origins, directions = lines(rng, middle, radius, 5000)
        far = scale * radius * rng.uniform(0, 2, 5000)
        hit = shoot(table, scale * origins, directions)
        expected = (hit.item >= 0) & (hit.distance < far)
        np.testing.assert_array_equal(blocked(table, scale * origins, directions, far), expected)
        assert 0.02 < expected.mean() < 0.98
        if len(table.triangle) == 0:
            assert not blocked(table, scale * origins, directions, np.inf, skip_far=0).any()
        thin = pack(self.scaled(scale), material=Interface())
        assert not blocked(thin, scale * origins, directions, np.inf).any()
