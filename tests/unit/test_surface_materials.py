"""Materials of surfaces: what every one has to keep, Fresnel's equations, indices of metals and glasses."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest
from facet_walks import glass_walks
from surface_bases import MATERIAL_TESTS, WAVELENGTHS, Bsdf, BsdfContract, direction

from skyscatter.errors import DomainError
from skyscatter.kernels.codes.surfaces import TRANSMITTED
from skyscatter.surfaces.facets import ANGLES, RATIOS, lost_table, single_share
from skyscatter.surfaces.grounds import RossLi, Rpv, Sea
from skyscatter.surfaces.indices import METALS, metal_index, refractive_index
from skyscatter.surfaces.materials import Conductor, Dielectric, Interface, Lambert, Material, Mirror, Mosaic

BK7, WATER = refractive_index("bk7", WAVELENGTHS), refractive_index("water", WAVELENGTHS)


class TestInterface(BsdfContract):
    """A boundary of a medium only."""

    material = Interface()
    here, there = 1.0, 1.5
    lossless = True
    refracts = False


class TestLambert(BsdfContract):
    """A diffuse reflector with a colour."""

    material = Lambert(albedo="vegetation")


class TestWhiteLambert(BsdfContract):
    """One that keeps nothing."""

    material = Lambert(albedo=1.0)
    lossless = True


class TestMosaic(BsdfContract):
    """What lies around the picture; its cells are in `tests/system/test_mosaics.py`."""

    material = Mosaic(classes=[[0]], materials=(Lambert(albedo=0.1),), rest=Lambert(albedo="vegetation"), cell_size=1.0)


class TestMirror(BsdfContract):
    """A mirror."""

    material = Mirror(reflectance=1.0)
    lossless = True


class TestSmoothGlass(BsdfContract):
    """A smooth surface between air and glass."""

    material = Dielectric()
    here, there = 1.0, 1.5
    lossless = True


class TestSmoothDispersive(BsdfContract):
    """Between water and glass as they are."""

    material = Dielectric()
    here, there = WATER, BK7
    lossless = True


class TestRoughGlass(BsdfContract):
    """A ground surface."""

    material = Dielectric(roughness=0.3)
    here, there = 1.0, 1.5
    lossless = True


class TestRoughestGlass(BsdfContract):
    """The same at the end of the scale, where from inside most of the light meets two facets."""

    material = Dielectric(roughness=1.0)
    here, there = 1.0, 1.5
    lossless = True


class TestRoughDispersive(BsdfContract):
    """A ground surface in water: each wavelength has its own density of one direction."""

    material = Dielectric(roughness=0.5)
    here, there = WATER, 1.15 * BK7
    lossless = True
    heaviest = 8.0  # XX


class TestSmoothMetal(BsdfContract):
    """A smooth metal."""

    material = Conductor(metal="gold")


class TestRoughMetal(BsdfContract):
    """A rough metal."""

    material = Conductor(metal="copper", roughness=0.4)
    here = 1.33


class TestRoughMirror(BsdfContract):
    """A metal that keeps nothing: what a facet throws on another is made up for."""

    material = Conductor(n=1e-15, k=1.0, roughness=0.5)
    lossless = True


class TestRoughestMirror(BsdfContract):
    """The same at the end of the scale, where most of the light meets two facets."""

    material = Conductor(n=1e-15, k=1.0, roughness=1.0)
    lossless = True


class TestLand(BsdfContract):
    """A bowl with a hot spot."""

    material = Rpv(amplitude=0.2, exponent=0.7, asymmetry=-0.2)
    heaviest = 8.0  # the hot spot and the bowl, of which draws by the cosine know nothing


class TestLeavesAndCrowns(BsdfContract):
    """A bowl, a hot spot and shadows."""

    material = RossLi(isotropic=0.3, volumetric=0.2, geometric=0.05)
    heaviest = 8.0  # as above


class TestSea(BsdfContract):
    """Waves in a stiff breeze, with foam."""

    material = Sea(wind_speed=12, upwelling=0.03)


class TestGlassySea(BsdfContract):
    """The smoothest sea, and nothing below: all draws look for the waves."""

    material = Sea(wind_speed=0)


def test_land_as_satellites_report_it() -> None:
    """Under an even sky the kernels give what the users' guide of the albedo product of MODIS (MCD43) lists.

    0.189184 and -1.377622, of an integration of its own: ours differ by 1e-5 and 4e-5.  And where the light comes from
    the zenith and goes to it, leaves give 0 and crowns 0.
    """
    even = RossLi(isotropic=0.5).albedo([550.0])
    leaves = (RossLi(isotropic=0.5, volumetric=1e-3).albedo([550.0]) - even) / 1e-3
    crowns = (RossLi(isotropic=0.5, geometric=1e-4).albedo([550.0]) - even) / 1e-4
    np.testing.assert_allclose([*leaves, *crowns], [0.189184, -1.377622], rtol=2e-4)
    up = RossLi(isotropic=0.1, volumetric=0.3, geometric=0.05).factor([0, 0, 1], [0, 0, 1], [550.0])
    np.testing.assert_allclose(up, 0.1, rtol=1e-12)


def test_every_material_is_tested() -> None:
    """A new kind without a test is noticed."""
    assert set(get_args(Material)) <= set(MATERIAL_TESTS)


def reflected_share(sample: Bsdf, cosine: float) -> np.ndarray:
    """Reflected share per wavelength as the kernels have it."""
    drawn = sample.draw(direction(cosine, 0.3), 400, adjoint=True)
    return drawn.value[np.flatnonzero((drawn.event & 3) == 1)[0]]


def amplitudes(cosine: float, here: Any, there: Any) -> tuple[np.ndarray, np.ndarray]:
    """Fresnel's amplitudes (perpendicular, parallel) with complex indices (Born & Wolf 1999, equation 1.5.21)."""
    m = np.asarray(there, complex) / here
    beyond = np.sqrt(1 - (1 - cosine**2) / m**2)
    return (cosine - m * beyond) / (cosine + m * beyond), (m * cosine - beyond) / (m * cosine + beyond)


def test_fresnel_in_closed_form() -> None:
    """Normal incidence, Brewster's angle, total reflection, and all angles with complex arithmetic."""
    glass = Bsdf(Dielectric(), 1.0, 1.5)
    np.testing.assert_allclose(reflected_share(glass, 1.0), 0.04, rtol=1e-12)
    # At Brewster's angle, tan = n, only the perpendicular part is reflected: ((n^2 - 1) / (n^2 + 1))^2 / 2.
    brewster = 1 / np.hypot(1, 1.5)
    np.testing.assert_allclose(reflected_share(glass, brewster), 0.5 * (1.25 / 3.25) ** 2, rtol=1e-12)
    # Total reflection from inside, beyond sin = 1 / n: nothing passes, and just before it something does.
    inside, critical = glass.turned(), np.sqrt(1 - 1 / 1.5**2)
    assert (inside.draw(direction(critical - 1e-9, 0.0), 500).event == 5).all()
    assert (inside.draw(direction(critical + 1e-3, 0.0), 500).event == 6).any()
    for cosine in np.linspace(0.02, 1.0, 20):
        share = sum(abs(r) ** 2 for r in amplitudes(cosine, 1.0, 1.5)) / 2
        np.testing.assert_allclose(reflected_share(glass, cosine), share, rtol=1e-11)
        for metal in METALS:
            n, k = metal_index(metal, WAVELENGTHS)
            expected = sum(abs(r) ** 2 for r in amplitudes(cosine, 1.33, n + 1j * k)) / 2
            found = reflected_share(Bsdf(Conductor(metal=metal), 1.33), cosine)
            np.testing.assert_allclose(found, expected, rtol=1e-11)


def test_a_metal_without_absorption_is_a_dielectric() -> None:
    """k = 0: also within total reflection."""
    for cosine in (0.1, 0.5, 0.9):
        metal = reflected_share(Bsdf(Conductor(n=1.2, k=0.0), 1.8), cosine)
        np.testing.assert_allclose(metal, reflected_share(Bsdf(Dielectric(), 1.8, 1.2), cosine), rtol=1e-12)


def test_smooth_refraction_by_snell() -> None:
    """The sine goes with the inverse of the index, in the plane of incidence; each hero of a dispersive one alone."""
    for hero in range(3):
        sample = Bsdf(Dielectric(), WATER, BK7)
        wo = direction(0.5, 0.7)
        drawn = sample.draw(wo, 50, hero=hero)
        passed = (drawn.event & 3) == 2
        cosine = -(drawn.wi[passed] @ direction(1.0, 0.0))
        expected = np.sqrt(1 - 0.75 * (WATER[hero] / BK7[hero]) ** 2)
        np.testing.assert_allclose(cosine, expected, rtol=1e-12)
        np.testing.assert_allclose(np.cross(wo, direction(1.0, 0.0)) @ drawn.wi[passed].T, 0, atol=1e-15)
        others = np.arange(3) != hero
        assert not drawn.chance[passed][:, others].any()
        assert (drawn.chance[~passed] > 0).all()


def test_indices_that_match_leave_nothing_to_see() -> None:
    """Glass in oil of the same index: light goes straight on, smooth or rough."""
    for roughness in (0.0, 0.3):
        drawn = Bsdf(Dielectric(roughness=roughness), 1.5, 1.5).draw(direction(0.2, 0.0), 100)
        np.testing.assert_array_equal(drawn.wi, np.broadcast_to(-direction(0.2, 0.0), (100, 3)))
        assert (drawn.value == 1).all()
        assert (drawn.event == 6).all()


@pytest.mark.parametrize("material", [Conductor(n=0.2, k=3.0), Dielectric()], ids=["metal", "glass"])
def test_rough_becomes_smooth(material: Any) -> None:
    """As the roughness goes to zero the lobe closes around the mirror direction and carries the smooth share."""
    rough = material.model_copy(update={"roughness": 0.001})
    wo = direction(0.6, 0.0)
    drawn = Bsdf(rough, 1.0, 1.5).draw(wo, 20_000, adjoint=True)
    reflected = drawn.event == 1
    mirror = 2 * (wo @ direction(1.0, 0.0)) * direction(1.0, 0.0) - wo
    # Half of the slopes are below alpha; a slope turns the reflected ray by twice its angle.
    turned = np.arccos(np.clip(drawn.wi[reflected] @ mirror, -1, 1))
    assert np.median(turned) < 0.003
    weight = drawn.value[:, 0] / np.maximum(drawn.chance.mean(axis=1), 1e-300)
    share = weight[reflected].sum() / 20_000
    smooth = reflected_share(Bsdf(material, 1.0, 1.5), 0.6)[0]
    assert abs(share - smooth) < 4 * np.sqrt(smooth / 20_000) + 1e-3


def lost_at(roughness: float, ratio: float, cosine: Any) -> Any:
    """Share that meets another facet, by the table as the kernels read it; a metal has the ratio infinity."""
    table, _ = lost_table(roughness)
    place = (ratio - 1) / (ratio + 1) if np.isfinite(ratio) else 1.0
    row = 0.5 * (RATIOS - 1) * (1 + np.sign(place) * np.sqrt(abs(place)))
    j = min(int(row), RATIOS - 2)
    rows = table[j] + (row - j) * (table[j + 1] - table[j])
    return np.interp(np.sqrt(cosine), np.linspace(0, 1, ANGLES), rows)


def test_single_reflections_of_facets() -> None:
    """At alpha = 1 a lossless mirror reflects 1 - c ln(1 + 1 / c) of the light once.

    There D = 1 / pi, Lambda = (1 / c - 1) / 2, and the integral of the lobe over all directions is elementary.
    """
    cosines = np.array([0.1, 0.3, 0.7, 1.0])
    expected = 1 - cosines * np.log1p(1 / cosines)
    # The quadrature's error, here with more points than the table has.
    found = [single_share(1.0, c, np.array([1e9]), 1 << 16)[0] for c in cosines]
    np.testing.assert_allclose(found, expected, atol=2e-4)
    np.testing.assert_allclose(1 - lost_at(1.0, np.inf, cosines), expected, atol=1e-3)
    fine = (np.arange(200_000) + 0.5) / 200_000
    mean = lost_table(1.0)[1][-1]
    assert abs(1 - mean - (2 * fine * (1 - fine * np.log1p(1 / fine))).mean()) < 5e-4
    assert [lost_table(a)[1].max() for a in (0.0, 0.001)] == [0.0, 0.0]


@pytest.mark.parametrize("roughness", [0.05, 0.1, 0.3, 0.6, 1.0])
def test_the_table_of_light_that_meets_other_facets(roughness: float) -> None:
    """At angles and indices between its own: to 1.2e-3, 7e-4 its quadrature and 5e-4 its lines."""
    rng = np.random.default_rng(round(100 * roughness))
    ratios = np.append(np.exp(rng.uniform(-1.0, 1.0, 12)), [1e9])
    for cosine in (0.03, *rng.uniform(0.03, 1.0, 5), 1.0):
        exact = 1 - single_share(roughness, cosine, ratios, 1 << 14)
        found = [lost_at(roughness, r if r < 1e9 else np.inf, cosine) for r in ratios]
        np.testing.assert_allclose(found, exact, rtol=0, atol=1.2e-3)


def test_a_rough_metal_absorbs_more_than_a_smooth_one() -> None:
    """Light that meets several facets is absorbed several times: more saturated colours, but not without end."""
    smooth = reflected_share(Bsdf(Conductor(metal="gold")), 1.0)
    drawn = Bsdf(Conductor(metal="gold", roughness=0.7)).draw(direction(1.0, 0.0), 40_000)
    rough = (drawn.value / np.maximum(drawn.chance, 1e-300)).mean(axis=0)
    assert (rough < smooth).all()
    assert rough[0] / rough[2] < smooth[0] / smooth[2]
    assert (rough > smooth**3).all()


def test_light_between_facets_is_absorbed_each_time() -> None:
    """Where the reflectance hardly depends on the angle: the geometric series of reflections with that reflectance.

    n = 30 reflects 0.875 head-on and 0.86 on the mean.  Of the light that comes, F E leaves after one reflection; of
    (1 - E) F each further one lets F E leave and keeps F (1 - E) going, E now the mean over directions.
    """
    kept, mean = 1 - lost_at(0.7, np.inf, 1.0), 1 - lost_table(0.7)[1][-1]
    cosines = (np.arange(4000) + 0.5) / 4000
    shares = np.array([sum(abs(r) ** 2 for r in amplitudes(c, 1.0, 30.0)) / 2 for c in cosines])
    share, steepest = (2 * cosines * shares).mean(), shares[-1]
    drawn = Bsdf(Conductor(n=30.0, k=0.0, roughness=0.7)).draw(direction(1.0, 0.0), 100_000)
    weight = drawn.value[:, 0] / np.maximum(drawn.chance[:, 0], 1e-300)
    going, more = (1 - kept) * share, 0.0
    for _ in range(100):
        more += going * share * mean
        going *= share * (1 - mean)
    # The single lobe meets its facets at its own angles, where F is between the mean and that head-on; 1.2e-3 of the
    # light is the table's error.
    noise = 4 * weight.std() / np.sqrt(100_000) + 1.2e-3
    assert kept * share + more - noise < weight.mean() < kept * steepest + more + noise


def weights_of_glass(roughness: float, here: float, there: float, cosine: float, count: int) -> tuple[Any, Any]:
    """Power over density of light that is drawn, (draw,), and whether it passes."""
    drawn = Bsdf(Dielectric(roughness=roughness), here, there).draw(direction(cosine, 0.0), count, adjoint=True)
    chance = drawn.chance[:, 0]
    return np.divide(drawn.value[:, 0], chance, out=np.zeros(count), where=chance > 0), drawn.event == TRANSMITTED


@pytest.mark.parametrize("index", [1.1, 1.5, 2.5])
@pytest.mark.parametrize("roughness", [0.05, 0.1, 0.3, 0.6, 1.0])
def test_ground_glass_keeps_all_light(roughness: float, index: float) -> None:
    """From both sides at every angle, in every single draw: walks through ground glass get no heavy weights."""
    for here, there in ((1.0, index), (index, 1.0)):
        for cosine in (0.03, 0.2, 0.5, 0.8, 1.0):
            weight, _ = weights_of_glass(roughness, here, there, cosine, 5000)
            # One in some thousand steep facets throws light so low that rounding loses it.
            assert (weight > 0).mean() > 0.999
            np.testing.assert_allclose(weight[weight > 0], 1.0, rtol=1e-12)


@pytest.mark.parametrize("index", [1.1, 1.5, 2.5])
@pytest.mark.parametrize("roughness", [0.3, 1.0])
def test_shares_of_ground_glass_are_those_of_walks_between_facets(roughness: float, index: float) -> None:
    """Reflected shares, averaged over directions by the cosine."""
    cosines = np.sqrt((np.arange(8) + 0.5) / 8)
    for here, there in ((1.0, index), (index, 1.0)):
        walked = np.mean([glass_walks(roughness, here / there, c, 8000)[0] for c in cosines])
        found = []
        for c in cosines:
            weight, passed = weights_of_glass(roughness, here, there, c, 8000)
            found.append((weight * ~passed).mean())
        # 0.015 is what the simple rule for the share of the broad lobe that goes back may be wrong by (see the kernel);
        # 3 standard errors of 64 000 walks of either kind are 0.008.
        assert abs(np.mean(found) - walked) < 0.015 + 0.008, (here, np.mean(found), walked)


#: n + i k of smooth films at 550 and 650 nm from another laboratory: McPeak et al. 2015, ACS Photonics 2, 326.
MCPEAK = {
    "gold": (0.3239 + 2.5972j, 0.1255 + 3.7923j),
    "silver": (0.0438 + 3.6101j, 0.0509 + 4.4602j),
    "copper": (0.7975 + 2.5642j, 0.1042 + 3.7757j),
    "aluminium": (0.7894 + 5.8519j, 1.2464 + 6.8523j),
}


@pytest.mark.parametrize("metal", METALS)
def test_metals_reflect_as_measured(metal: str) -> None:
    """At normal incidence to 0.07 on the edges of gold and copper in the green, 0.04 in the red.

    So far apart are laboratories: Rakic et al. 1998 (Applied Optics 37, 5271) differ by more from McPeak et al.
    """
    m = np.array(MCPEAK[metal])
    found = reflected_share(Bsdf(Conductor(metal=metal)), 1.0)[1:]
    assert (abs(found - abs((m - 1) / (m + 1)) ** 2) < [0.07, 0.04]).all(), found


def test_indices_of_glasses() -> None:
    """At the lines of the makers' data sheets: d 587.5618, F 486.1327, C 656.2725 nm."""
    lines = [587.5618, 486.1327, 656.2725]
    np.testing.assert_allclose(refractive_index("bk7", lines), [1.51680, 1.52238, 1.51432], atol=6e-6)
    np.testing.assert_allclose(refractive_index("fused-silica", lines), [1.45846, 1.46313, 1.45637], atol=6e-6)
    # Segelstein's water is a compilation good to some 1e-3; at 589 nm and 20 degrees C it is 1.3330.
    np.testing.assert_allclose(refractive_index("water", [589.0]), 1.333, atol=1.5e-3)
    np.testing.assert_array_equal(refractive_index(1.3, lines), 1.3)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Lambert(albedo=1.2), "albedo"),
        (lambda: Lambert(albedo="vegtation"), "vegetation"),
        (lambda: Mirror(reflectance=-0.1), "reflectance"),
        (lambda: Dielectric(roughness=1e-5), "roughness"),
        (lambda: Dielectric(roughness=1.5), "roughness"),
        (lambda: Conductor(metal="golt"), "gold"),
        (lambda: Conductor(), "both n and k"),
        (lambda: Conductor(n=0.2), "both n and k"),
        (lambda: Conductor(metal="gold", k=1.0), "either"),
        (lambda: Conductor(n=0.0, k=1.0), "above 0"),
        (lambda: Conductor(n=1.0, k=-1.0), "negative"),
        (lambda: refractive_index("watre", [500]), "water"),
        (lambda: refractive_index("bk7", [250]), "300 to 2500"),
        (lambda: refractive_index(0.0, [250]), "between"),
        (lambda: metal_index("gold", [2500]), "gold"),
    ],
)
def test_refuses(make: Any, word: str) -> None:
    """One line that names the field and the remedy."""
    with pytest.raises((ValueError, DomainError), match=word):
        make()
