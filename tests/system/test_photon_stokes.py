"""Polarised photons: against fields added up in three dimensions, published tables, symmetries; honest errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked
from coulson_tables import cds
from numpy.typing import NDArray
from polarised_fields import FLOORS, LAMP, LOOKS, gas, over_floor, sights, truth
from significance import assert_mean_of_runs, largest_t, runs_of_power

import skyscatter
from skyscatter.errors import DomainError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.surfaces.lamps import ParallelLamp, PointLamp
from skyscatter.surfaces.materials import Dielectric, Interface, Lambert
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene, Viewpoint
from skyscatter.surfaces.shapes import Box, Plane

Array = NDArray[Any]
WAVELENGTHS = np.array([450.0, 650.0])


def photons(scene: SurfaceScene, o: Array, d: Array, **options: Any) -> Any:
    given = {"samples": 32, "photons": 1 << 14, "seed": 1, "stokes": True} | options
    return skyscatter.radiance(scene, o, d, WAVELENGTHS, **asked("photons", **given))


# --- first order --------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("direct", [True, False])
def test_single_scattering_of_a_lamp(direct: bool) -> None:
    """I, Q, U by fields added up; I is that of scalar light but for rounding; E across the plane of scattering."""
    o, d = sights(*LOOKS)
    options: dict[str, Any] = {"max_order": 1, "radius": 0.03, "direct": direct}
    answer = photons(over_floor(None), o, d, **options)
    scalar = photons(over_floor(None), o, d, **options, stokes=False)
    # Two variants of the kernel may round differently: 2^-53 for each of a photon's some hundred factors.
    np.testing.assert_allclose(answer.radiance, scalar.radiance, rtol=1e-13)
    expected = np.repeat(truth(None, o, d)[:, None], 2, axis=1)
    # Squared radius over squared distance from the lamp, for photons that are gathered: 1e-3; extinction 1e-5 x metres.
    slack = 1e-3 * expected[..., :1]
    allowed = largest_t(24, 31) * answer.stokes_error[..., :3] + slack
    assert np.all(np.abs(answer.stokes - expected)[..., :3] < allowed)
    assert np.all(answer.stokes_error[..., 0] < 0.1 * answer.radiance)
    # All of a line's points have one plane of scattering: the axis is exact, point by point.
    if direct:
        n = np.cross(d, LAMP - o)
        chi = 0.5 * np.arctan2(answer.layers["U"], answer.layers["Q"])[:, 0]
        v = np.array([0.0, 0.0, 1.0]) - d[:, 2:] * d
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        field = np.cos(chi)[:, None] * v + np.sin(chi)[:, None] * np.cross(v, d)
        across = np.abs(np.sum(field * n, axis=1)) / np.linalg.norm(n, axis=1)
        np.testing.assert_allclose(across, 1.0, atol=1e-9)
        assert not answer.layers["V"].any()


def test_degree_of_light_scattered_through_one_angle() -> None:
    """A lamp so far away that all along a short line the angle is one: Q / I = -sin^2 / (1 + cos^2)."""
    elevation = 35.0
    box = Box(position=(0, 0, 0), size=(1, 1, 1))
    for away in (0.0, 40.0, 90.0, 140.0):
        scene = SurfaceScene(
            media=(SurfaceMedium(name="vacuum"), SurfaceMedium(name="gas", components=(gas(1e-6),))),
            bodies=(Body(name="box", shape=box, material=Interface(), inside="gas"),),
            lamps=(ParallelLamp(name="sun", azimuth_deg=0.0, elevation_deg=elevation, irradiance=1.0),),
            viewpoint=Viewpoint(position=(0, 0, 0), target=(0, 1, 0)),
        )
        # In the meridian of the light, so that the plane of scattering is that of reference.
        d = direction_from_azimuth_elevation(np.array([0.0, 0.0]), np.array([elevation - away, elevation - away / 2]))
        answer = photons(scene, np.zeros((2, 3)), d, samples=4, photons=64, max_order=1)
        mu = np.cos(np.radians([away, away / 2]))
        ratio = answer.layers["Q"] / answer.radiance
        # Chords of the table of 1024 cells.
        np.testing.assert_allclose(ratio, np.repeat((-(1 - mu**2) / (1 + mu**2))[:, None], 2, axis=1), atol=1e-5)
        assert np.abs(answer.layers["U"]).max() < 1e-9 * answer.radiance.max()


@pytest.mark.slow
@pytest.mark.parametrize("floor", FLOORS)
def test_light_scattered_once_before_and_after_reflection(floor: str) -> None:
    """Both ends at a smooth plane: photons that were reflected first, walks that are reflected on their way."""
    o, d = sights(*LOOKS)
    # Of walks that meet glass few are reflected: many of them are needed for errors that are normal.
    effort = (
        {"samples": 2048, "photons": 1 << 10} if floor in ("glass", "total") else {"samples": 64, "photons": 1 << 14}
    )
    answer = photons(over_floor(floor), o, d, max_order=3, radius=0.06, estimator="paths", **effort)
    expected = np.repeat(truth(floor, o, d)[:, None], 2, axis=1)
    # The disk of 0.06 m blurs light of an image over 0.85 m away by R^2 / 8 x 6 / r^2 = 0.4 %, half of all at most.
    allowed = largest_t(32, 63) * answer.stokes_error + 2e-3 * expected[..., :1]
    assert np.all(np.abs(answer.stokes - expected) < allowed)
    assert np.all(answer.stokes_error[..., 0] < 0.06 * answer.radiance)
    circular = np.abs(expected[..., 3]) / expected[..., 0]
    assert (circular.max() > 0.05) == (floor in ("metal", "total"))


def test_brewster_angle() -> None:
    """What glass reflects of a white wall at atan(n) is wholly polarised, across the plane of incidence."""
    angle = np.degrees(np.arctan(1.5))
    scene = SurfaceScene(
        media=(SurfaceMedium(name="vacuum"), SurfaceMedium(name="glass", index=1.5)),
        bodies=(
            Body(name="floor", shape=Plane(), material=Dielectric(), inside="glass"),
            Body(name="wall", shape=Plane(position=(0, 5, 0), normal=(0, -1, 0)), material=Lambert(albedo=0.8)),
        ),
        lamps=(PointLamp(name="lamp", position=(0, 3, 2), power=1.0),),
        viewpoint=Viewpoint(position=(0, 0, 1), target=(0, 5, 1)),
    )
    d = direction_from_azimuth_elevation(np.zeros(2), np.array([angle - 90, angle - 75]))
    answer = photons(scene, np.broadcast_to([0.0, 0.0, 1.0], d.shape), d, samples=64, max_order=2)
    lit = answer.radiance[0] > 0
    assert lit.all()
    ratio = answer.layers["Q"] / answer.radiance
    np.testing.assert_allclose(ratio[0], -1.0, atol=1e-10)
    assert np.all(ratio[1] > -0.95)
    assert np.abs(answer.layers["U"]).max() < 1e-12 * answer.radiance.max()


# --- all orders ---------------------------------------------------------------------------------------------------


def slab_rays(reference: Path, upwards: bool) -> tuple[Array, Array, Array]:
    """Rays into a slab from above or below its middle, and what corrected tables say: I, Q, U (ray, 3)."""
    sun, chosen_mu, chosen_phi = SUN, [8, 11], [0, 2, 3, 5]
    _, mu, _ = cds(reference, "I", upwards, "1")
    signs = {"I": 1.0, "Q": -1.0, "U": -1.0}
    table = [sign * cds(reference, name, upwards, "1")[2][0, sun] for name, sign in signs.items()]
    expected = np.stack(table, axis=-1)[chosen_mu][:, chosen_phi].reshape(-1, 3)
    side = 1.0 if upwards else -1.0
    m, phi = np.meshgrid(mu[chosen_mu], np.radians(30.0 * np.array(chosen_phi)), indexing="ij")
    # Half of the rays are the mirror images of the others: U changes its sign.
    m, phi = (np.concatenate([a.ravel(), s * a.ravel()]) for a, s in ((m, 1), (phi, -1)))
    assert m.min() > 0.5
    sine = np.sqrt(1 - m**2)
    d = np.stack([sine * np.sin(phi), sine * np.cos(phi), -side * m], axis=-1)
    # The middle of each ray's way through the slab lies above the middle of the box.
    return -d * (0.51 / m)[:, None], d, np.concatenate([expected, expected * [1, 1, -1]])


#: Row of the tables: the Sun 53 degrees from the zenith.
SUN = 3


@pytest.mark.slow
@pytest.mark.parametrize("power", [0.006, 0.0015])
def test_rayleigh_slab_against_corrected_coulson_tables(power: float, reference: Path) -> None:
    """Optical depth 1; a box twelve times as wide as it is thick, from above and from below.

    All rays share their photons, so these are judged: the mean of I over rays over that of the tables, and how much of
    the tables' Q and U there is (by least squares).
    """
    mu0, _, _ = cds(reference, "I", True, "1")
    scene = SurfaceScene(
        media=(SurfaceMedium(name="vacuum"), SurfaceMedium(name="gas", components=(gas(1.0),))),
        bodies=(Body(name="slab", shape=Box(size=(12, 12, 1)), material=Interface(), inside="gas"),),
        lamps=(ParallelLamp(name="sun", direction=(0, (1 - mu0[SUN] ** 2) ** 0.5, mu0[SUN]), irradiance=np.pi),),
        viewpoint=Viewpoint(position=(0, 0, -0.6), target=(0, 1, 0)),
    )
    parts = [slab_rays(reference, upwards) for upwards in (True, False)]
    o, d, expected = (np.concatenate(part) for part in zip(*parts, strict=True))
    sides = (slice(0, len(o) // 2), slice(len(o) // 2, None))
    options: dict[str, Any] = {"radius": 0.12, "photons": 1 << 16, "samples": 2}

    def shares(stokes: Array) -> Array:
        """Of I, Q and U, from above and from below, (side, 3)."""
        by_side = []
        for side in sides:
            found, known = stokes[side], expected[side]
            weight = np.concatenate([np.ones_like(known[:, :1]), known[:, 1:]], axis=1)
            by_side.append((found * weight).sum(axis=0) / (known * weight).sum(axis=0))
        return np.array(by_side)

    def run(seed: int, **more: Any) -> Array:
        return skyscatter.radiance(scene, o, d, [550.0], **asked("photons", seed=seed, **options, **more)).stokes[
            :, 0, :3
        ]

    # Q and U, half of I and less, are known to three times that.
    powers = power * np.array([1.0, 3.0, 3.0])
    runs = runs_of_power(lambda seed: shares(run(seed, stokes=True)), powers)
    print(runs.mean(axis=0), runs.std(axis=0) / np.sqrt(len(runs)), len(runs))
    # Sides six mean free paths away, balls of 0.12 beside the slab's faces: 1e-3 of I each, 3e-3 of Q and U.
    assert_mean_of_runs(runs, 1.0, powers, np.array([1e-3, 3e-3, 3e-3]))
    # Scalar light is wrong by more than that, at single rays.
    scalar = np.mean([
        skyscatter.radiance(scene, o, d, [550.0], **asked("photons", seed=k, **options)).radiance[:, 0]
        for k in range(24)
    ], axis=0)  # fmt: skip
    assert np.abs(scalar / expected[:, 0] - 1).max() > 0.03


# --- errors and refusals ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_errors_are_the_spread_over_seeds() -> None:
    """Variance over seeds in the mean over rays and parameters against the stated one: chi-squared."""
    o, d = sights(*LOOKS)
    seeds = 24
    options = {"max_order": 3, "radius": 0.1, "samples": 8, "photons": 1 << 11}
    answers = [photons(over_floor("metal"), o, d, seed=100 + s, **options) for s in range(seeds)]
    found = np.array([a.stokes for a in answers])[..., 0, :]
    stated = np.mean([a.stokes_error[:, 0] ** 2 for a in answers], axis=0)
    some = stated > 0  # V is zero where no mirror is seen
    ratio = found.var(axis=0, ddof=1)[some] / stated[some]
    # Four rays share their photons: no more than four independent values are counted of the sixteen.
    assert ratio.mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / (4 * (seeds - 1))))


def test_light_that_loses_its_polarisation_is_scalar() -> None:
    """Components without a matrix depolarise: the same photons, the same radiance, no Q, U, V."""
    o, d = sights(*LOOKS)
    options: dict[str, Any] = {"radius": 0.1, "samples": 4, "photons": 1 << 11, "max_order": 1}
    scene = over_floor(None, 0.3, HenyeyGreenstein(g=0.2))
    polarised, scalar = photons(scene, o, d, **options), photons(scene, o, d, **options, stokes=False)
    np.testing.assert_allclose(polarised.radiance, scalar.radiance, rtol=1e-14)
    assert not polarised.stokes[..., 1:].any()


def test_rough_glass_is_refused() -> None:
    floor = Body(name="floor", shape=Plane(), material=Dielectric(roughness=0.2), inside="below")
    scene = over_floor("glass").model_copy(update={"bodies": (floor,)})
    with pytest.raises(DomainError, match="roughness"):
        photons(scene, *sights(*LOOKS))
