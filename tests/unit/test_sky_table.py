"""Many rays from one place are joined from nodes over the sky: what that costs, against every ray solved by itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.kernels.skyrows import below_place, place_rays
from skyscatter.solvers.field import RadianceField
from skyscatter.solvers.sequence import field_for
from skyscatter.solvers.skytable import FAINT, MISSED, MISSED_OF_ERROR, angle_cells, frame_of

WAVELENGTHS = [400, 550, 700]
#: That of the default; the fields are solved coarsely, which is quick and changes nothing here.
TOLERANCE = 5e-3
PANORAMA = skyscatter.Panorama(width=360, height=120, elevation_min_deg=-15)
WIDE = skyscatter.Panorama(width=480, height=160, elevation_min_deg=-15)
SPHERE = skyscatter.Panorama(width=720, height=180, elevation_min_deg=-90)
FISHEYE = skyscatter.Fisheye(width=160, height=160)
ORBIT = skyscatter.Perspective(width=240, height=160, azimuth_deg=137, elevation_deg=-20, fov_deg=40)
PLANET = skyscatter.PlanetView(width=160, height=160)
LOW = skyscatter.Panorama(width=720, height=60, elevation_min_deg=-4, elevation_max_deg=2)
#: Rays that are solved by themselves too.
JUDGED = 400


def solved(
    model: str, elevation: float, camera: Any, altitude: float = 0.0, stokes: bool = False
) -> tuple[RadianceField, Any, Any, Any]:
    scene = skyscatter.load_model(model).scene(sun_elevation_deg=elevation, sun_azimuth_deg=137, altitude=altitude)
    field = field_for([scene], camera, WAVELENGTHS, tolerance=0.02, stokes=stokes)
    object.__setattr__(field, "tolerance", TOLERANCE)  # that by which the table is judged
    directions = camera.directions(scene.observer).reshape(-1, 3)
    directions = np.ascontiguousarray(directions[np.isfinite(directions[:, 0])])
    return field, field.at(scene.sun), np.tile(scene.observer.position, (len(directions), 1)), directions


CASES = [
    ("earth-simple", -5.0, PANORAMA, 0.0),
    ("earth-simple", 50.0, FISHEYE, 0.0),
    *(
        (m, e, c, 0.0)
        for m in ("earth-hazy", "earth-maritime", "mars")
        for e in (-5.0, 0.0, 4.0, 89.0)
        for c in (PANORAMA, FISHEYE)
    ),
    ("titan", 30.0, FISHEYE, 0.0),
    *(("earth", e, c, 10e3) for e in (-5.0, 30.0) for c in (WIDE, skyscatter.Fisheye(width=240, height=240))),
    ("earth", 20.0, ORBIT, 400e3),
    ("earth-simple", 50.0, PLANET, 8e6),  # straight below the air is seen alike over many degrees of the planet
    *((m, e, PLANET, h) for m, e, h in (("earth", 20.0, 2e6), ("earth", 5.0, 8e6), ("earth-hazy", 0.0, 2e7))),
    *((m, e, PLANET, h) for m, e, h in (("earth", 0.0, 400e3), ("earth", -20.0, 36e6), ("mars", 20.0, 8e6))),
]  # fmt: skip


@pytest.mark.parametrize("stokes", [False, True])
@pytest.mark.parametrize(
    ("model", "elevation", "camera", "altitude"),
    [pytest.param(*case, marks=() if case[0] == "earth-simple" else pytest.mark.slow) for case in CASES],
)
def test_joined_rays_are_as_rays_by_themselves(
    model: str, elevation: float, camera: Any, altitude: float, stokes: bool
) -> None:
    """Rays that the table itself did not compare: one in a hundred may miss what it allows, none ten times as much.

    In the mean square they are within a third of it.  All of this holds for every Stokes parameter, in units of the
    whole light.
    """
    field, table, origins, directions = solved(model, elevation, camera, altitude, stokes)
    sky = field.sky_table(table, origins, directions, 2)
    assert sky is not None
    chosen = np.random.default_rng(0).choice(len(directions), JUDGED, replace=False)
    quick = field.look(table, origins[chosen], directions[chosen], False, sky)
    slow = field.look(table, origins[chosen], directions[chosen], False)
    scale = np.maximum(slow.radiance, FAINT * slow.radiance.max(axis=0))
    stated = slow.standard_error / np.maximum(slow.radiance, 1e-300)
    allowed = np.maximum(MISSED * TOLERANCE, MISSED_OF_ERROR * np.maximum(stated, quick.standard_error / scale))
    for here, there in pairs(quick, slow):
        off = np.abs(here - there) / scale
        assert np.mean(off > allowed) < 0.01
        assert (off / allowed).max() < 10
        assert np.sqrt(np.mean((off / allowed) ** 2)) < 0.3
    # What is missed lies within the error that is stated, of which this is a small part.
    floor = MISSED * TOLERANCE * FAINT * slow.radiance.max(axis=0)
    assert np.mean(np.abs(quick.radiance - slow.radiance) > quick.standard_error + floor) < 0.005


def test_the_air_ends_softly_at_its_top() -> None:
    """Through its last kilometres light falls to nothing, of which the logarithms that are joined know none."""
    field, table, origins, directions = solved("earth-simple", 0.0, PLANET, 400e3)
    sky = field.sky_table(table, origins, directions, 2)
    assert sky is not None
    radius, top = field.scene.medium.radius, field.scene.medium.top
    tangent = radius + top * np.array([0.9, 0.95, 0.97, 0.98, 0.99])
    down, azimuth = np.arccos(tangent / (radius + 400e3)), np.radians(137.0)
    rays = np.stack([np.cos(down) * np.sin(azimuth), np.cos(down) * np.cos(azimuth), -np.sin(down)], axis=-1)
    quick, slow = (field.look(table, origins[:5], rays, False, by).radiance for by in (sky, None))
    np.testing.assert_allclose(quick, slow, rtol=0.03)  # 1.5 % off at most; 16 % with a node at the top itself


def test_a_night_from_orbit_has_a_table() -> None:
    """Away from a Sun under the horizon light is so faint that nothing is promised of it, and rays need not agree."""
    camera = skyscatter.Perspective(width=240, height=160, azimuth_deg=317, elevation_deg=-17, fov_deg=60)
    field, table, origins, directions = solved("earth-simple", -15.0, camera, 400e3)
    sky = field.sky_table(table, origins, directions, 2)
    assert sky is not None
    chosen = np.random.default_rng(0).choice(len(directions), JUDGED, replace=False)
    quick, slow = (field.look(table, origins[chosen], directions[chosen], False, by) for by in (sky, None))
    lit = slow.radiance > 0
    assert np.mean(slow.radiance[lit] < field.fine.unseen) > 0.03
    assert np.all(np.abs(quick.radiance - slow.radiance) <= quick.standard_error + MISSED * field.fine.unseen)


def pairs(quick: Any, slow: Any) -> list[tuple[Any, Any]]:
    """Radiances of two answers, and their Q, U and V where they have them."""
    layers = [(quick.layers[name], slow.layers[name]) for name in "QUV" if name in slow.layers]
    return [(quick.radiance, slow.radiance), *layers]


@pytest.mark.parametrize(
    ("altitude", "camera", "ways"), [(0.0, FISHEYE, [1.0]), (300.0, SPHERE, [1.0, -1.0]), (5e6, PLANET, [-1.0])]
)
def test_polarised_light_is_joined_straight_up_and_down(altitude: float, camera: Any, ways: list[float]) -> None:
    """The meridian plane turns about the vertical, and on it is the one of the conventions."""
    field, table, origins, directions = solved("earth-simple", 30.0, camera, altitude, True)
    up = origins[0] / np.linalg.norm(origins[0])
    sky = field.sky_table(table, origins, directions, 1)
    assert sky is not None
    across = np.cross(up, table.optics.disk_axis) / np.linalg.norm(np.cross(up, table.optics.disk_axis))
    tilts = [0.0, 1e-7, 1e-5, 1e-3]
    for way in ways:
        rays = np.array([way * up + tilt * side * across for tilt in tilts for side in (1, -1)])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        quick = field.look(table, origins[:8], rays, False, sky)
        slow = field.look(table, origins[:8], rays, False)
        assert np.abs(slow.layers["Q"][-1] / slow.radiance[-1]).max() > 0.01
        for here, there in pairs(quick, slow):
            np.testing.assert_allclose(here, there, rtol=0, atol=MISSED * TOLERANCE * slow.radiance.max())


@pytest.mark.parametrize("altitude", [2.0, 300.0, 1e3])
def test_the_ground_is_joined_up_to_the_horizon(altitude: float) -> None:
    """Within a degree below the horizon the way to the ground grows by many times: there are few rows, and all hold.

    Nodes that crowd at the horizon over the elevation itself miss ten to sixty times what is allowed there.  One ray in
    a hundred may miss it, as elsewhere: one of 400 beneath the Sun misses 1.4 times as much.
    """
    field, table, origins, directions = solved("earth", 30.0, LOW, altitude)
    sky = field.sky_table(table, origins, directions, 2)
    assert sky is not None
    assert (sky.near, sky.band) == (sky.disk, 0.0)  # no rays but those of the Sun's disk are left to themselves
    below = frame_of(origins[0], table.optics.disk_axis).of(directions)[0] < sky.edges.horizon
    some = np.random.default_rng(1).choice(np.flatnonzero(below), JUDGED, replace=False)
    quick = field.look(table, origins[some], directions[some], False, sky)
    slow = field.look(table, origins[some], directions[some], False)
    off = np.abs(quick.radiance / slow.radiance - 1)
    assert np.mean(off > MISSED * TOLERANCE) < 0.01
    assert off.max() < 3 * MISSED * TOLERANCE


def test_the_error_is_that_of_rays_by_themselves() -> None:
    """Both compare a coarser solution at a few azimuths of each height: alike but for which ones."""
    field, table, origins, directions = solved("earth-simple", 10.0, FISHEYE)
    sky = field.sky_table(table, origins, directions, 1)
    some = slice(None, None, 97)
    quick, slow = (field.look(table, origins[some], directions[some], False, s) for s in (sky, None))
    ratio = quick.standard_error / slow.standard_error
    # Rays solved alone are compared at azimuths of their own; a factor of two is what that makes of the worst of few.
    assert 0.5 < np.median(ratio) < 2.0


def test_parts_sum_to_the_whole_and_the_disk_has_its_edge() -> None:
    field, table, origins, directions = solved("earth-simple", 30.0, FISHEYE)
    sky = field.sky_table(table, origins, directions, 1)
    whole = field.look(table, origins, directions, False, sky)
    parts = field.look(table, origins, directions, True, sky)
    np.testing.assert_allclose(sum(parts.layers.values()), whole.radiance, rtol=1e-9)
    beside = np.linalg.norm(directions - table.optics.disk_axis, axis=1) < 0.05
    slow = field.look(table, origins[beside], directions[beside], True)
    np.testing.assert_allclose(
        parts.layers["direct"][beside], slow.layers["direct"], rtol=1e-6, atol=1e-12 * slow.layers["direct"].max()
    )


def test_few_rays_and_other_places_are_solved_as_they_are() -> None:
    field, table, origins, directions = solved("earth-simple", 20.0, PANORAMA)
    assert field.sky_table(table, origins[:500], directions[:500], 1) is None
    moved = origins + np.linspace(0, 9, len(origins))[:, None] * [0.0, 0.0, 1.0]
    assert field.sky_table(table, moved, directions, 1) is None


def test_tiles_and_threads_change_no_bit() -> None:
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=20)
    pictures = [
        skyscatter.render(
            scene, FISHEYE, WAVELENGTHS, solver=skyscatter.Orders(tolerance=0.02), threads=threads
        ).radiance
        for threads in (1, 3)
    ]
    np.testing.assert_array_equal(*pictures)


def test_rays_past_the_air_need_no_table() -> None:
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=20.0, altitude="400 km")
    field = skyscatter.solve(scene, [550.0], sun_elevations_deg=(15.0, 25.0), tolerance=0.02)
    grid = skyscatter.Fisheye(width=80, height=80).directions(scene.observer).reshape(-1, 3)
    up = np.ascontiguousarray(grid[np.isfinite(grid[:, 0])])
    origins = np.broadcast_to(scene.observer.position, up.shape)
    assert field.sky_table(field.at(scene.sun), origins, up, 1) is None


def test_rays_are_placed_where_cubics_hold() -> None:
    """Cubics of both angles are joined exactly, on each side of the horizon by nodes of that side.

    Below the horizon they are cubics of `below_place`.
    """
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origin, sun = np.array([1.0, 2.0, 3.0]), np.array([0.6, 0.0, 0.8])
    frame = frame_of(origin, sun)
    below, horizon = np.linspace(-np.pi / 2, -0.1, 7), -0.05
    elevation = np.concatenate([below, np.linspace(0.0, np.pi / 2, 9)])
    turns = np.pi * np.arange(-1, 18) / 16
    row, column, cell = (np.empty((3000, n), np.int64) for n in (4, 4, 2))
    across, along, odd, share, high = (np.empty((3000, n)) for n in (4, 4, 4, 2, 1))
    slant = np.array([6372e3, 6372e3**2 - 6371e3**2, 0.0, 1e4])

    def places(angles: Any) -> Any:
        found = [below_place.py_func(a, slant) if a < horizon else a for a in angles.tolist()]
        return np.array(found)

    place_rays(
        directions, np.array([*frame, sun]), places(elevation), elevation[0], elevation[-1], below.size, horizon, slant,
        turns, 100, row, across, column, along, odd, cell, share, high[:, 0],
    )  # fmt: skip
    seen, turn = frame.of(directions)
    np.testing.assert_allclose(high[:, 0], seen, rtol=0, atol=1e-14)
    cubic = np.polynomial.Polynomial([0.3, -1.0, 0.5, 0.2])
    at = np.clip(seen, elevation[0], elevation[-1])
    known = cubic(places(elevation))[row]
    # Between the last node below the horizon and the horizon itself they go on, here over an angle of many nodes.
    np.testing.assert_allclose((across * known).sum(axis=1), cubic(places(at)), rtol=1e-9, atol=1e-9)
    assert np.all((row < below.size) == (seen < horizon)[:, None])
    # A cubic of the azimuth that is even at both ends does not change where nodes beyond them are mirrored.
    inner = (turn > turns[2]) & (turn < turns[-3])
    np.testing.assert_allclose((along * cubic(turns[1:-1])[column]).sum(axis=1)[inner], cubic(turn[inner]), atol=1e-12)
    # What is odd in the azimuth is zero at both ends: cubics of mirrored nodes know its sign on either side.
    wave = np.sin(turns[1:-1])
    left = np.sign(directions @ frame.beside)
    np.testing.assert_allclose((odd * wave[column]).sum(axis=1), left * np.sin(turn), atol=5e-5)
    assert column.min() == 0
    assert column.max() == turns.size - 3
    number, weight = angle_cells(directions @ sun, 100)
    np.testing.assert_array_equal(cell, number)
    np.testing.assert_allclose(share, weight, rtol=0, atol=1e-9)
