"""Eclipses of the Sun in scenes: which scenes are in one, the table of shares, and the Sun's disk and corona."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import skyscatter
from skyscatter.celestial.eclipse import solar_eclipse
from skyscatter.celestial.frames import Sight
from skyscatter.errors import DomainError
from skyscatter.kernels.eclipse import dim_points
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.corona import TERMS, corona_pixels
from skyscatter.solvers.eclipse import eclipse_of, eclipse_table
from skyscatter.solvers.sundisk import disk_correction, sun_lamp

WL = np.array([400.0, 550.0, 800.0])
TOTAL = (42.85, -106.32, "2017-08-21T17:43:50Z")
PARTIAL = (42.85, -106.32, "2017-08-21T17:20:00Z")
THIN = (42.85, -106.32, "2017-08-21T17:42:10Z")
RING = (-48.2051, -70.6549, "2024-10-02T20:25Z")
#: Within the full shadow, the half shadow and the one of a ring, and beside.
PLACES = {"total": TOTAL, "partial": PARTIAL, "ring": RING, "beside": (48.86, 2.35, "2026-08-12T18:00Z")}


def scene(where: tuple[float, float, str], **more):
    return skyscatter.load_model("earth").scene_at(*where, **more)


@pytest.mark.parametrize("name", PLACES)
def test_the_table_is_the_share(name) -> None:
    it = scene(PLACES[name])
    eclipse, table = eclipse_of(it), eclipse_table(it, WL)
    assert eclipse is not None
    offsets = np.random.default_rng(1).normal(size=(3000, 3)) * [4e5, 4e5, 2e4]
    offsets[:500] *= 0.1
    exact, found = eclipse.light_at(offsets, WL), np.ones((len(offsets), WL.size))
    dim_points(table, it.observer.position + offsets, found)
    # straight lines over steps of 1/512 of a function whose second derivative is 5: 5e-6; between the Moon's radii 4e-6
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=2e-5)
    assert np.ptp(exact) > 0.05
    assert np.array_equal(found == 0.0, exact == 0.0)


def test_darkening_counts_where_the_star_has_it() -> None:
    it = scene(PARTIAL)
    even = it.model_copy(update={"star": it.star.model_copy(update={"limb_darkening": False})})
    eclipse, found = eclipse_of(it), np.ones((1, WL.size))
    assert eclipse is not None
    dim_points(eclipse_table(even, WL), it.observer.position[None], found)
    # what stands between the entries of the table
    np.testing.assert_allclose(found[0], 1.0 - eclipse.obscuration, atol=2e-5)


def test_which_scenes_are_in_an_eclipse() -> None:
    it = scene(TOTAL)
    assert eclipse_of(it) is not None
    assert eclipse_of(scene((TOTAL[0], TOTAL[1], "2017-08-22T17:43:50Z"))) is None
    assert eclipse_of(scene((-33.9, 18.4, TOTAL[2]), lights=("sun",))) is None  # the other side of the Earth's day
    # a Sun that was put elsewhere, and one without a place
    moved = it.sun.model_copy(update={"elevation_deg": it.sun.elevation_deg + 0.1})
    assert eclipse_of(it.model_copy(update={"sun": moved})) is None
    assert eclipse_of(it.model_copy(update={"sun": it.sun.model_copy(update={"site": None})})) is None
    # from far above, too, as long as the shadow falls on what is seen
    assert eclipse_of(scene(TOTAL, altitude="36000 km")) is not None
    assert eclipse_table(scene((TOTAL[0], TOTAL[1], "2017-08-22T17:43:50Z")), WL).share.size == 0


def test_reach_is_a_bound() -> None:
    """Where it is said that nothing is covered, no point of the ball is."""
    sight = Sight(48.86, 2.35, "2026-08-12T17:00Z")
    eclipse = solar_eclipse(sight, reach=5e6)
    assert eclipse is not None
    ways = np.random.default_rng(2).normal(size=(4000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    said = []
    for reach in (2e5, 5e5, 1e6, 2e6):
        covered = bool((eclipse.light_at(reach * ways, [500.0]) < 1.0).any())
        said.append(eclipse.reaches(np.zeros(3), reach))
        assert said[-1] or not covered
    assert said == sorted(said)
    assert said[0] != said[-1]


@pytest.mark.parametrize(
    ("where", "camera"),
    [
        *itertools.product((PARTIAL, THIN, RING), ("perspective",)),
        (PARTIAL, "fisheye"),
    ],
)
def test_light_of_the_disk_in_pictures(where, camera) -> None:
    """What is seen of the disk sums to its share of the light, however large the pixels."""
    it = scene(where)
    full = it.model_copy(update={"sun": it.sun.model_copy(update={"site": None})})
    eclipse = eclipse_of(it)
    assert eclipse is not None
    view = {
        "perspective": skyscatter.Perspective(
            width=60, height=60, azimuth_deg=it.sun.azimuth_deg, elevation_deg=it.sun.elevation_deg, fov_deg=1.0
        ),
        "fisheye": skyscatter.Fisheye(width=64, height=64),
    }[camera]
    grid = view.directions(it.observer)
    solid_angle = view.pixel_solid_angle(it.observer).ravel()

    def light(of) -> np.ndarray:
        table = compile_scene(of, WL)
        found = disk_correction(of, table, view, grid)
        rays = grid.reshape(-1, 3)
        direct = np.zeros((len(rays), WL.size))
        inside = np.isfinite(rays[:, 0])
        answer = skyscatter.radiance(
            of, of.observer.position, rays[inside], WL, solver=skyscatter.Single(tolerance=0.1), parts=True
        )
        direct[inside] = answer.layers["direct"]
        if found is not None:
            direct[found[0]] += found[1]
        return solid_angle @ direct

    share = eclipse.light(WL)
    # 0.1 per cent of the whole disk as without an eclipse; of what is left of it cells across its width miss some 1/12
    # squared.  The Moon's edge hides the light that air at the horizon dims least or most: next to nothing so high.
    assert light(it) / light(full) == pytest.approx(share, rel=1e-2)
    lamp = [np.array(sun_lamp(of, compile_scene(of, WL), WL)["irradiance"]) for of in (it, full)]
    # the last digits of a product
    assert lamp[0] / lamp[1] == pytest.approx(share, rel=1e-12)


def test_totality_shows_the_corona_alone() -> None:
    it = scene(TOTAL)
    view = skyscatter.Perspective(
        width=80, height=80, azimuth_deg=it.sun.azimuth_deg, elevation_deg=it.sun.elevation_deg, fov_deg=16.0
    )
    table, grid = compile_scene(it, WL), view.directions(it.observer)
    found = corona_pixels(it, table, view, grid, WL)
    assert found is not None
    at = skyscatter.transmittance(it, it.observer.position, it.observer.position + 1e7 * it.sun.direction, WL)
    total = view.pixel_solid_angle(it.observer).ravel()[found[0]] @ found[1]
    eclipse = eclipse_of(it)
    assert eclipse is not None
    # Baumbach's law from the Moon's limb to 25 radii of the Sun, half the picture's side of 60; integrals of its powers
    low, high = eclipse.moon_radius / eclipse.sun_radius, 27.0
    expected = sum(2 * c / (p - 2) * (low ** (2 - p) - high ** (2 - p)) for c, p in TERMS)
    # the corners of the picture, a thousandth; the Moon's middle off the Sun's by 0.2 % of its radius, and the air
    # towards the picture's edges
    assert total / (table.optics.sun_irradiance.sum(axis=0) * at) == pytest.approx(expected, rel=0.02)
    assert corona_pixels(scene(PARTIAL), table, view, grid, WL) is None
    sun = disk_correction(it, table, view, grid)
    assert sun is None or np.abs(sun[1]).max() == 0.0


def test_planets_shine_in_totality() -> None:
    assert "planets" in scene(TOTAL, lights="auto").lights.shine
    assert "planets" not in scene(PARTIAL, lights="auto").lights.shine


def test_what_walks_leave_out_is_refused() -> None:
    it = scene(TOTAL)
    here, up = it.observer.position, [0.0, 0.0, 1.0]
    with pytest.raises(DomainError, match="solver path"):
        skyscatter.radiance(it, here, up, [550.0], stokes=True)
    with pytest.raises(DomainError, match="1e-3"):
        skyscatter.radiance(it, here, up, [550.0], solver=skyscatter.Orders(tolerance=2e-4))


def test_fluxes_are_refused() -> None:
    from skyscatter.cli.main import main

    asked = ["flux", "earth", "--place", "42.85,-106.32", "--time", TOTAL[2], "--wavelengths", "550", "-q"]
    assert main(asked) != 0
