"""Aerosols that are not solved for: what stands for them, against 6SV 1.1, and what they do to standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sixs_scenes import SixsScene, covered, judged, sixs_terms, stored_table

from skyscatter.dehaze import physical
from skyscatter.dehaze.aerosols import aerosol_optics, aerosol_spectrum, site_names
from skyscatter.dehaze.bands import Sensor
from skyscatter.dehaze.coefficients import two_rows
from skyscatter.dehaze.flat import DEGREE, Haze, rayleigh_moments, solve_flat
from skyscatter.dehaze.forward import BACK, DIFFUSE, DIRECT, PATH, Atmosphere
from skyscatter.dehaze.passband import Band
from skyscatter.dehaze.table import Angles, TermsTable
from skyscatter.dehaze.unsolved import ANGLES, imitated, imitations, optics_of
from skyscatter.optics.phase import draine_value

GEOMETRIES = sorted({key[2] for key in sixs_terms()})
NEAR = next(key[2] for key in sixs_terms())  # that of `stored_table`


def flat(air, extinction, albedo, moments, cosines=(0.5, 0.9)):
    """Terms of one atmosphere, straight down and up again."""
    haze = Haze(*(np.array([a]) for a in (extinction, albedo)), moments[None], np.ones((1, 1)))
    return solve_flat(np.array([air]), haze, np.array(cosines), np.array([0]), np.array([1]), np.array([-0.9]))


@pytest.mark.parametrize("extinction", [1e-9, 0.4])
def test_no_light_is_lost(extinction: float) -> None:
    """What does not arrive at the ground has left upwards: the mean of 1 - T over a uniform sky is S."""
    from numpy.polynomial.legendre import leggauss

    nodes, weights = leggauss(12)
    mu, w = 0.5 * (nodes + 1), 0.5 * weights
    moments = 0.5 ** np.arange(DEGREE + 1) if extinction > 1e-3 else rayleigh_moments()
    terms = flat(0.3, extinction, 1.0, moments, tuple(mu))
    assert 2 * (w * mu) @ (1 - terms.through[0]) == pytest.approx(terms.back[0], rel=2e-3)


def test_spherical_albedo_of_air() -> None:
    """6SV 1.1, 443 nm, optical depth 0.2377: 0.1732 with polarisation, which changes it by half a per cent."""
    assert flat(0.2377, 1e-9, 1.0, rayleigh_moments()).back[0] == pytest.approx(0.1732, rel=0.01)


def test_shipped_optics_are_those_of_mie_theory() -> None:
    wl = np.array([550.0])
    for name in ("biomass-burning", "hawaii larger"):
        extinction, albedo, phase = aerosol_optics(name, wl, np.cos(np.radians(ANGLES)))
        kept = optics_of(name, wl)
        assert kept.extinction == pytest.approx(extinction, rel=0.01)
        assert kept.albedo == pytest.approx(albedo, abs=0.003)
        assert kept.phase[0] == pytest.approx(4 * np.pi * phase[0], rel=0.03)
    assert kept.moments[0, 1] == pytest.approx(0.72, abs=0.05)
    assert optics_of("desert", wl).moments[0, 1] == pytest.approx(aerosol_spectrum("desert", wl)[2][0], abs=0.003)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_a_smoke_imitated_from_another_haze_is_that_of_6s(geometry: tuple[float, float, float]) -> None:
    """6S's own smoke from 6S's own continental haze: the difference is all that this adds, and it is known from 6S."""
    depths = sorted({aod for _, aod, _ in sixs_terms()})
    table, wanted, known = six_table("continental", geometry), "biomass-burning", six_table("biomass-burning", geometry)
    wl = np.array([band.effective_wavelength for band in table.bands])
    found = imitated(table, optics_of("continental", wl), {wanted: optics_of(wanted, wl)})[wanted]
    short = slice(0, 6)  # beyond 1 um the two differ in the tables of the refractive index
    for k, aod in enumerate(depths):
        ours, six, before = (t.values[k, 0, 0, 0, short] for t in (found, known, table))
        off, change = np.abs(ours - six), np.abs(before - six)
        assert np.all(off[:, PATH] < 0.0003 + 0.006 * aod + 0.1 * change[:, PATH]), (aod, ours[:, PATH], six[:, PATH])
        through = [t[:, DIRECT] + t[:, DIFFUSE] for t in (ours, six)]
        assert through[0] == pytest.approx(
            through[1], rel=0.002 + 0.04 * aod
        )  # their albedos differ by 0.01 in the blue
        assert np.all(off[:, BACK] < 0.004)


def six_table(aerosol: str, geometry: tuple[float, float, float]) -> TermsTable:
    """6S's terms as a table; straight light is no output of it, and half stands for it."""
    depths = np.array(sorted({aod for _, aod, _ in sixs_terms()}))
    wl = sixs_terms()[aerosol, depths[0], geometry][:, 0]
    sensor = Sensor.from_shapes("six", {f"{w:g} nm": (float(w), 2.0) for w in wl})
    terms = np.array([sixs_terms()[aerosol, aod, geometry][:, 1:] for aod in depths])
    values = np.stack([terms[..., 0], 0.5 * terms[..., 1], 0.5 * terms[..., 1], terms[..., 2]], axis=-1)
    nodes = [np.array([angle]) for angle in geometry]
    shaped = values.reshape(depths.size, 1, 1, 1, wl.size, 4)
    return TermsTable(sensor.bands, Atmosphere(aerosol=aerosol), depths, *nodes, shaped, 0.0)


def test_nothing_stands_for_no_haze() -> None:
    table = six_table("continental", NEAR)
    assert imitations([replace(table, atmosphere=Atmosphere(aerosol="none"))]) == []
    assert [t.atmosphere.aerosol for t in imitations([table])] == list(site_names())


def test_two_deviations_stand_for_many() -> None:
    apart = np.random.default_rng(1).normal(size=(9, 2, 3, 2, 2))
    rows = two_rows(apart)
    for value in (-0.3, 0.0, 0.7):
        every, two = (((a[:, 0] * value + a[:, 1]) ** 2).sum(axis=0) for a in (apart, rows))
        assert two == pytest.approx(every, rel=1e-12)


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables that were solved before, of one geometry."""
    monkeypatch.setattr(physical, "build_table", stored_table)


def scenes(*aerosols: str, depths: tuple[float, ...] = (0.35,)) -> list[SixsScene]:
    return [SixsScene(a, d, NEAR, "coast") for a in aerosols for d in depths]


def test_truth_of_6s_hazes_is_where_sigma_says(solved: None) -> None:
    """Two kinds of haze of those that are solved for, and two of others."""
    kinds = ("continental", "maritime", "biomass-burning", "fine")
    found = [(scene, judged(scene)) for scene in scenes(*kinds)]
    share = covered(j for _, j in found)
    assert np.all((share > 0.55) & (share < 0.9)), share
    off = np.array([(j.aod - s.aod) / j.aod_sigma for s, j in found])
    assert np.all(np.abs(off) < 2.5)
    assert "others" in found[0][1].probabilities
    assert sum(found[0][1].probabilities.values()) == pytest.approx(1, abs=1e-3)


def test_other_aerosols_are_in_sigma(solved: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without them hazes that are not solved for are outside of sigma far more often."""
    with_others = covered(judged(scene) for scene in scenes("fine"))
    monkeypatch.setattr(physical, "imitations", lambda tables: [])
    without = covered(judged(scene) for scene in scenes("fine"))
    assert np.mean(with_others) > np.mean(without) + 0.1, (with_others, without)


def test_a_depth_that_is_given_has_other_aerosols_too(solved: None) -> None:
    scene = SixsScene("fine", 0.35, NEAR, "city")
    named, unnamed = (judged(scene, aod=0.35, aod_sigma=0.02, **kind) for kind in ({"aerosol": "continental"}, {}))
    assert np.all(np.median(unnamed.sigma, axis=(1, 2)) > np.median(named.sigma, axis=(1, 2)))


def test_an_asymmetry_is_no_phase_function(solved: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """6S's continental haze, told by depth, albedo and asymmetry: the path reflectance is off, and sigma says so."""
    wl = np.linspace(400.0, 2400.0, 41)
    told = optics_of("continental", wl)
    rows = zip(wl, told.extinction, told.albedo, told.moments[:, 1], strict=True)
    file = tmp_path / "own.csv"
    lines = ["wavelength_nm,extinction,single_scattering_albedo,asymmetry", *(",".join(map(str, r)) for r in rows)]
    file.write_text("\n".join(lines))

    def solve(atmosphere: Atmosphere, bands: Sequence[Band], angles: Angles, **_: object) -> TermsTable:
        """As solved for with that phase function: the continental table, and the difference between the two."""
        known = stored_table(Atmosphere(aerosol="continental"), bands, angles)
        at = np.array([band.effective_wavelength for band in bands])
        true, cosines = optics_of("continental", at), np.cos(np.radians(ANGLES))
        g = true.moments[:, 1]
        phase = 4 * np.pi * draine_value(cosines, g[:, None], 0.0)
        flat = true._replace(moments=g[:, None] ** np.arange(DEGREE + 1), phase=phase)
        return imitated(known, true, {str(file): flat})[str(file)]

    monkeypatch.setattr(physical, "build_table", solve)
    scene = SixsScene("continental", 0.5, NEAR, "city")
    found = judged(scene, aod=0.5, aerosol=str(file))
    monkeypatch.setattr(physical, "shaped", lambda table: [])
    before = judged(scene, aod=0.5, aerosol=str(file))
    short = slice(0, 7)  # at 2.2 um 6S's haze is another one
    assert covered([before])[short].min() < 0.1
    assert covered([found])[short].min() > 0.6
    assert np.abs(found.error[short]).mean() < np.abs(before.error[short]).mean()
