"""The table of terms: its grids, its stated error, and what is kept of it between runs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from dehaze_tables import made_up_table

from skyscatter.dehaze import cachefile, table
from skyscatter.dehaze.bands import load_sensor
from skyscatter.dehaze.forward import PATH, Atmosphere, BandAverage, SolvedAir, reflectance_above, surface_reflectance
from skyscatter.dehaze.table import TOLERANCE, Angles, TermsTable, _Builder, build_table, depth_weights, difference
from skyscatter.errors import DomainError

BANDS = tuple(load_sensor("landsat-8").band(name) for name in ("B1", "B5"))  # the bluest, and near infrared
ATMOSPHERE = Atmosphere(aerosol="urban")
ANGLES = Angles((40.0, 41.0), (2.0, 7.0), (90.0, 120.0))
BAR = 0.001  #: reflectance that interpolation may cost


@pytest.fixture(scope="module")
def built() -> TermsTable:
    """A table that ends at a thin haze, for the sake of time; tables of other tests end where they should."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table, "GREATEST_AOD", 0.5)
        return build_table(ATMOSPHERE, BANDS, ANGLES, stokes=False, keep=False)


@pytest.fixture(scope="module")
def smooth() -> TermsTable:
    """Closed forms on the grids of a table: for what is done with a table, whatever it holds."""
    found: TermsTable = made_up_table(ATMOSPHERE, BANDS, ANGLES)
    return found


def check(found: TermsTable, aods: Iterable[float], angles: Angles, own_grids: bool = True) -> None:
    """The table against solutions for amounts of haze and angles between its nodes."""
    rng = np.random.default_rng(7)
    assert 0 < found.error <= BAR

    def solved(aod: float, like: SolvedAir | None = None) -> SolvedAir:
        average = BandAverage(found.bands)
        return SolvedAir(found.atmosphere, aod, average, angles.sun_zenith, stokes=False, like=like)

    thickest = solved(float(found.aod[-1]))
    for aod in aods:
        # On the table's grid the difference is that of interpolation; the stated error comes from samples, so that a
        # point elsewhere may miss it by some of it.  Grids of their own add what they differ by.
        for like, bar in ((thickest, 1.5 * found.error), (None, BAR))[: 1 + own_grids]:
            at = [rng.uniform(*r, 6) for r in (angles.sun_zenith, angles.view_zenith, angles.relative_azimuth)]
            assert difference(solved(aod, like).terms(*at), found.at(aod, *at)[0]) < bar


@pytest.mark.slow
def test_against_solutions_between_the_nodes(built: TermsTable) -> None:
    assert built.aod[0] == 0
    assert built.aod[-1] == pytest.approx(0.5)
    check(built, (0.2,), ANGLES)


def test_depths_beyond_the_table_are_refused_or_clipped_on_request(smooth: TermsTable) -> None:
    end = float(smooth.aod[-1])
    with pytest.raises(DomainError, match=rf"aod = {2 * end:g}.*covers 0 to {end:g}"):
        smooth.at(2 * end, 40.5, 5.0, 100.0)
    clipped, at_the_end = smooth.at(2 * end, 40.5, 5.0, 100.0, clip=True), smooth.at(end, 40.5, 5.0, 100.0)
    np.testing.assert_array_equal(clipped[0], at_the_end[0])


@pytest.mark.slow
def test_a_whole_table_against_solutions() -> None:
    """All amounts of haze; at AOD 1 and more, solutions on other grids differ by more than the table from its own."""
    angles = Angles((31.0, 33.0), (2.0, 11.0), (10.0, 170.0))
    found = build_table(Atmosphere(), BANDS, angles, stokes=False, keep=False)
    check(found, (0.05, 0.6, 1.7), angles, own_grids=False)


def test_slopes_are_derivatives(smooth: TermsTable) -> None:
    for aod in (0.1, 0.27, 0.45):
        (low, _), (high, _) = (smooth.at(aod + side, 40.5, 3.0, 100.0) for side in (-1e-3, 1e-3))
        _, slope = smooth.at(aod, 40.5, 3.0, 100.0)
        np.testing.assert_allclose(slope, (high - low) / 2e-3, atol=1e-4)
    _, at_the_end = smooth.at(smooth.aod[-1], 40.5, 3.0, 100.0)
    assert np.all(np.isfinite(at_the_end))


def test_the_inverse_of_interpolated_terms(smooth: TermsTable) -> None:
    """Through the table and back: the surface, to far better than 1e-4."""
    rng = np.random.default_rng(3)
    aod, sun, view = rng.uniform(0.0, 0.5, 50), rng.uniform(40, 41, 50), rng.uniform(2, 7, 50)
    terms, _ = smooth.at(aod, sun, view, 95.0)
    rho, around = rng.uniform(0.0, 0.8, (2, 50, len(BANDS)))
    np.testing.assert_allclose(surface_reflectance(terms, reflectance_above(terms, rho)), rho, atol=1e-10)
    above = reflectance_above(terms, rho, around)
    np.testing.assert_allclose(surface_reflectance(terms, above, around), rho, atol=1e-10)


def test_azimuths_are_folded(smooth: TermsTable) -> None:
    for same in (-100.0, 260.0, 460.0):
        np.testing.assert_allclose(smooth.at(0.3, 40.5, 5.0, same)[0], smooth.at(0.3, 40.5, 5.0, 100.0)[0], rtol=1e-12)


def test_arguments_broadcast(smooth: TermsTable) -> None:
    terms, slopes = smooth.at(np.array([0.1, 0.2])[:, None], 40.5, np.array([2.0, 3.0, 4.0]), 100.0)
    assert terms.shape == slopes.shape == (2, 3, len(BANDS), 4)
    np.testing.assert_allclose(terms[1, 2], smooth.at(0.2, 40.5, 4.0, 100.0)[0], rtol=1e-12)


# Kept tables


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(cachefile.VARIABLE, str(tmp_path))
    return tmp_path


def clear(**changes: object) -> TermsTable:
    """The cheapest table: air alone, straight down."""
    given = {"angles": Angles((40.0, 40.0), (0.0, 0.0), (0.0, 0.0)), "bands": BANDS[1:], **changes}
    return build_table(Atmosphere(aerosol="none"), given.pop("bands"), given.pop("angles"), stokes=False, **given)  # type: ignore[arg-type]


def test_a_table_is_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = clear()
    (path,) = folder.rglob("*.npz")

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("solved again")

    with monkeypatch.context() as patch:
        patch.setattr(table, "SolvedAir", refuse)
        again = clear()
        with pytest.raises(AssertionError, match="solved again"):
            clear(bands=BANDS[:1])  # another question is another file
        with pytest.raises(AssertionError, match="solved again"):
            clear(keep=False)
    np.testing.assert_array_equal(again.values, first.values)
    assert again.error == first.error
    path.write_bytes(path.read_bytes()[:100])  # a broken file is made anew
    np.testing.assert_array_equal(clear().values, first.values)
    assert path.stat().st_size > 100
    assert len(list(folder.rglob("*"))) == 2  # that file and its folder


def test_nothing_is_kept_where_nothing_can_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(cachefile.VARIABLE, str(tmp_path / "file" / "below"))
    assert clear().values.shape == (1, 1, 1, 1, 1, 4)


def test_a_known_depth_has_a_table_around_it() -> None:
    known = build_table(
        ATMOSPHERE, BANDS[1:], Angles((40.0, 40.0), (0.0, 0.0), (0.0, 0.0)), aod=0.2, stokes=False, keep=False
    )
    np.testing.assert_allclose(known.aod, [0.16, 0.2, 0.24])
    terms, slopes = known.at(0.2, 40.0, 0.0)
    np.testing.assert_array_equal(terms, known.values[1, 0, 0, 0])
    assert np.all(slopes[:, 0] > 0)  # more haze, more path reflectance


@pytest.mark.parametrize("aod", [-0.1, 5.5, float("nan")])
def test_depths_out_of_range(aod: float) -> None:
    with pytest.raises(DomainError, match=f"aod = {aod}.*between 0 and 5"):
        clear(aod=aod, keep=False)


# Ranges of angles


def test_ranges_are_rounded_outwards() -> None:
    angles = Angles.spanned([31.2, 32.9], [[2.1], [11.0]], [-170.0, 10.0])
    assert angles == Angles((31.0, 33.0), (2.0, 11.0), (10.0, 170.0))
    assert Angles.spanned(85.0, [84.9, 85.0], 0.0).view_zenith == (84.5, 85.0)
    assert Angles.spanned(30.3, 0.0, [0.0, 170.0]) == Angles((30.3, 30.3), (0.0, 0.0), (0.0, 0.0))


@pytest.mark.parametrize(
    ("field", "value", "arguments"),
    [
        ("sun_zenith", 85.5, (85.5, 0.0, 0.0)), ("sun_zenith", -1.0, ([-1.0, 30.0], 0.0, 0.0)),
        ("view_zenith", 90.0, (30.0, [0.0, 90.0], 0.0)),
    ],
)  # fmt: skip
def test_angles_out_of_range(field: str, value: float, arguments: tuple[object, object, object]) -> None:
    with pytest.raises(DomainError, match=f"{field} = {value}.*between 0 and 85 degrees"):
        Angles.spanned(*arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("azimuth", [0.0, 37.5, 180.0])
def test_azimuths_fold_to_half_a_turn(azimuth: float) -> None:
    around = np.array([azimuth, -azimuth, 360 - azimuth, azimuth + 720])
    np.testing.assert_allclose(table.fold_azimuth(around), azimuth, atol=1e-12)


# Interpolation


@pytest.mark.parametrize("n", [1, 2, 3, 5, 9, 17])
def test_polynomials_pass_unchanged(n: int) -> None:
    nodes = table.lobatto(3.0, 7.0, n)
    x = np.linspace(3.0, 7.0, 41)
    weights = table.polynomial_weights(nodes, x)
    np.testing.assert_allclose(weights.sum(axis=-1), 1.0, rtol=1e-12)
    for degree in range(n):
        np.testing.assert_allclose(weights @ (nodes / 5) ** degree, (x / 5) ** degree, atol=1e-11)
    np.testing.assert_array_equal(table.polynomial_weights(nodes, nodes), np.eye(n))
    if n > 1:  # beyond the ends the end's value holds
        np.testing.assert_array_equal(table.polynomial_weights(nodes, [0.0, 9.0]), np.eye(n)[[0, -1]])


@pytest.mark.slow
def test_one_direction_is_solved_on_the_grid_of_the_thickest_haze() -> None:
    """Thick haze needs the finer grid; on that of clear air its path reflectance in the blue was a tenth too dark."""
    atmosphere = Atmosphere(aerosol="urban")
    band = load_sensor("sentinel-2a").band("B01")
    made = build_table(atmosphere, [band], Angles.spanned(35.0, 5.0, 100.0), stokes=False, keep=False)
    own = SolvedAir(atmosphere, 1.0, BandAverage([band]), (35.0, 35.0), stokes=False).terms(35.0, 5.0, 100.0)
    # 0.001 is what is asked of the table; another grid differs by some tenths of the solution's tolerance of 0.01.
    found = made.at(1.0, 35.0, 5.0, 100.0)[0]
    assert abs(found[0, PATH] - own[0, PATH]) < 0.001


def test_what_is_met_between_the_nodes_is_no_node(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nodes that crowd at the thick end made the polynomial swing at small depths, two hundred times the noise."""
    angles = Angles.spanned(30.0, 5.0, 60.0)
    builder = _Builder(ATMOSPHERE, BANDS, angles, TOLERANCE, True, None, None)
    smooth = made_up_table(ATMOSPHERE, BANDS, angles)

    def noisy(aod: float, nodes: object = None) -> np.ndarray:
        return smooth.at(aod, 30.0, 5.0, 60.0)[0] + 1e-4 * np.sin(1e4 * aod + np.arange(8).reshape(2, 4))

    monkeypatch.setattr(builder, "terms", noisy)
    monkeypatch.setattr(builder, "air", lambda aod: None)
    monkeypatch.setattr(builder, "refine_angles", lambda aod: None)
    depths = builder.build(None)["aod"]
    swing = np.abs(depth_weights(depths, np.linspace(0, 2, 200))).sum(axis=-1).max()
    assert swing < 12, (depths, swing)
