"""The bases that every material and every shape inherits, and the registers that notice a missing one."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from skyscatter.solvers.kernels.surfaces import bsdf
from skyscatter.solvers.kernels.surfaces.tables import ABSORBED, DELTA, REFLECTED, TRANSMITTED
from skyscatter.surfaces.packing import pack_materials

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
        numbers = np.random.default_rng(seed).random((count, 3))
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
        fine = 24
        grid, solid = cells(16, 16, fine)
        _, chance = sample.at(wo, grid)
        expected = chance.reshape(16, fine, 16, fine, 3).sum(axis=(1, 3)) * solid
        for hero in (0, 2):
            count = 100_000
            drawn = sample.draw(wo, count, hero=hero, seed=5 + hero)
            kept = drawn.event != ABSORBED
            wi = drawn.wi[kept]
            a = direction(0.0, 0.0)
            row = np.minimum((8 * (1 + wi @ NORMAL)).astype(int), 15)
            azimuth = np.arctan2(wi @ np.cross(NORMAL, a), wi @ a) % (2 * np.pi)
            observed = np.bincount(row * 16 + np.minimum((azimuth * 8 / np.pi).astype(int), 15), minlength=256)
            share = expected[..., hero].ravel()
            # Its integral is the share of draws that go on.
            z = (kept.sum() - count * share.sum()) / np.sqrt(count * max(share.sum() * (1 - share.sum()), 1e-3))
            assert abs(z) < 4.5 + 1e-3 * np.sqrt(count), (hero, z, share.sum())  # 1e-3: the quadrature of sharp lobes
            full = share * count >= 8
            merged = np.append(observed[full], observed[~full].sum() + (~kept).sum())
            wanted = np.append(share[full] * count, count - share[full].sum() * count)
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
        assert weight.max() <= 1 + 1e-9

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
