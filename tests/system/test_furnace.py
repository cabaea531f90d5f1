"""Laws that hold for every medium: the white furnace, reciprocity, and the conservation of energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from asking import asked
from plane_parallel import THICKNESS, Slab
from significance import assert_agrees

import skyscatter
from skyscatter.media.fields import Exponential
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic, Rayleigh

RAYLEIGH, FORWARD = Rayleigh(), HenyeyGreenstein(g=0.8)


def furnace(optical_depth: float, phase: Any) -> skyscatter.Scene:
    """Air that absorbs nothing over a white ground, with light of radiance 1 from everywhere outside and no Sun."""
    optics = Particles(optical_depth=optical_depth, phase=phase)
    air = skyscatter.Component(name="air", density=Exponential(scale_height=8000.0), optics=optics)
    return skyscatter.Scene(
        medium=skyscatter.Medium(planet_radius=6.371e6, components=(air,)),
        ground=skyscatter.Ground(albedo=1.0),
        star=skyscatter.Star(spectrum=0.0),
        background=1.0,
    )


def sights(altitude: float) -> np.ndarray:
    """Up, slanting and level; from space downwards, slanting to the ground, and grazing the air."""
    elevation = np.radians([90.0, 20.0, 2.0] if altitude < 1e5 else [-90.0, -30.0, -19.6])
    return np.stack([np.zeros(3), np.cos(elevation), np.sin(elevation)], axis=-1)


def assert_white(scene: skyscatter.Scene, altitude: float, worst_error: float, **options: Any) -> None:
    position = np.array([0.0, 0.0, scene.medium.planet_radius + altitude])
    answer = skyscatter.radiance(scene, position, sights(altitude), [550.0], **asked("path", **options))
    assert answer.standard_error.max() < worst_error
    # Nothing but chance and the column tables (1e-4) may part the answer from 1.
    assert_agrees(answer.radiance, 1.0, answer.standard_error, slack=1e-4)


ALTITUDES = pytest.mark.parametrize("altitude", [0.0, 5e3, 4e5], ids=["ground", "inside", "space"])
PHASES = pytest.mark.parametrize("phase", [RAYLEIGH, FORWARD], ids=["rayleigh", "forward"])


@ALTITUDES
@PHASES
@pytest.mark.parametrize("optical_depth", [0.1, pytest.param(1.0, marks=pytest.mark.slow)])
def test_white_furnace_by_plain_walks(optical_depth: float, phase: Any, altitude: float) -> None:
    # Every walk that is scattered brings home exactly 1; the error is that of the share of walks that are not.
    # 0.1 % is the bar of the furnace.
    assert_white(furnace(optical_depth, phase), altitude, 1e-3, samples=2**18, sampling="free-flight")


@pytest.mark.parametrize(
    "altitude",
    [pytest.param(0.0, marks=pytest.mark.slow), 5e3, pytest.param(4e5, marks=pytest.mark.slow)],
    ids=["ground", "inside", "space"],
)
@pytest.mark.parametrize(
    "phase", [RAYLEIGH, pytest.param(FORWARD, marks=pytest.mark.slow)], ids=["rayleigh", "forward"]
)
@pytest.mark.parametrize(
    ("optical_depth", "samples", "bar"),
    # Marched walks carry weights whose spread grows with every leg, and nothing absorbs here: 0.1 % is in reach for
    # thin air only, and thick air gets the bar that a second of walks can reach.
    [pytest.param(0.1, 2**18, 1e-3, marks=pytest.mark.slow, id="thin"), pytest.param(1.0, 2**15, 5e-2, id="thick")],
)
def test_white_furnace(optical_depth: float, samples: int, bar: float, phase: Any, altitude: float) -> None:
    assert_white(furnace(optical_depth, phase), altitude, bar, samples=samples)


PAIRS = ((1.0, 0.5), (0.9, 0.2), (0.6, 0.3))


# Not transmission over a bright ground: light that comes from below is no mirror image of light from above.
@pytest.mark.parametrize(
    ("transmitted", "albedo"), [*(pytest.param(False, a, marks=pytest.mark.slow) for a in (0.0, 0.6)), (True, 0.0)]
)
def test_reciprocity_of_a_slab(transmitted: bool, albedo: float) -> None:
    """I(mu; mu0) / mu0 keeps its value when light and observer change places (Chandrasekhar 1950, section 13)."""
    value, error = [], []
    for pair in PAIRS:
        for mu0, mu in (pair, pair[::-1]):
            slab = Slab(1.0, 0.9, HenyeyGreenstein(g=0.5), mu0, 1.0, ground_albedo=albedo)
            tau, side = (1.0, -1.0) if transmitted else (0.0, 1.0)
            answer = slab.radiance(tau, side * mu, 1.0, samples=16384)
            value.append(answer.radiance[0] / mu0)
            error.append(answer.standard_error[0] / mu0)
    v, e = np.array(value).reshape(-1, 2), np.array(error).reshape(-1, 2)
    assert np.all(e < 0.01 * v)
    # The first order is a quadrature to 1e-4 in each of the two.
    assert_agrees(v[:, 0], v[:, 1], np.hypot(e[:, 0], e[:, 1]), slack=3e-4)


@pytest.mark.parametrize(
    ("optical_thickness", "phase"), [(0.5, Isotropic()), pytest.param(1.0, RAYLEIGH, marks=pytest.mark.slow)]
)
@pytest.mark.slow
def test_nothing_is_lost_without_absorption(optical_thickness: float, phase: Any) -> None:
    slab = Slab(optical_thickness, 1.0, phase, 0.6, 1.0, ground_albedo=0.3)
    options = {"nodes": 16, "azimuths": 4, "samples": 2048}
    up, up_error = slab.flux(0.0, True, **options)
    down, down_error = slab.flux(optical_thickness, False, **options)
    into_ground = 0.7 * (down + slab.direct_flux(optical_thickness))
    # 16 nodes in mu leave 1e-4 of the fluxes of slabs like these (measured against 48 nodes).
    assert_agrees(up + into_ground, slab.direct_flux(0.0), np.hypot(up_error, 0.7 * down_error), slack=3e-4)


@pytest.mark.slow
def test_reflected_transmitted_and_absorbed_light_is_all_light() -> None:
    slab = Slab(1.0, 0.8, Isotropic(), 0.6, 1.0, ground_albedo=0.3)
    up, up_error = slab.flux(0.0, True, samples=2048)
    down, down_error = slab.flux(1.0, False, samples=2048)
    ground = 0.7 * (down + slab.direct_flux(1.0))
    absorbed, absorbed_error = absorption(slab)
    total_error = np.sqrt(up_error**2 + (0.7 * down_error) ** 2 + absorbed_error**2)
    # Mean radiance has an infinite slope at the edges of a slab; 8 Gauss nodes of depth leave 5e-4 of what is absorbed.
    assert_agrees(up + ground + absorbed, slab.direct_flux(0.0), total_error, slack=1e-3)


def absorption(slab: Slab) -> tuple[float, float]:
    """Power absorbed by a slab per area, (1 - omega) times the integral of radiance over directions and depth."""
    x, w = np.polynomial.legendre.leggauss(8)
    depth, depth_weight = 0.5 * (x + 1) * slab.optical_thickness, 0.5 * w * slab.optical_thickness
    y, v = np.polynomial.legendre.leggauss(12)
    mu, weight = np.concatenate([-0.5 * (y + 1), 0.5 * (y + 1)]), np.concatenate([0.5 * v, 0.5 * v])
    total, variance = 0.0, 0.0
    for tau, share in zip(depth, depth_weight, strict=True):
        answer = slab.radiance(tau, mu, 1.0, samples=512)
        beam = slab.irradiance * np.exp(-tau / slab.beam_mu)
        total += share * (2 * np.pi * float(weight @ answer.radiance[:, 0]) + beam)
        variance += (share * 2 * np.pi) ** 2 * float(weight**2 @ answer.standard_error[:, 0] ** 2)
    lost = 1 - slab.single_scattering_albedo
    return lost * total, lost * float(np.sqrt(variance))


def test_slab_helper_puts_observers_where_it_says() -> None:
    origin, sight = Slab(2.0, 1.0, RAYLEIGH).rays(0.5, -0.5, np.pi)
    assert origin[2] - 1e7 * THICKNESS == pytest.approx(0.75 * THICKNESS, abs=1e-3)  # float64 at 1e10 m: 2e-6 m
    # Light that travels down and back towards the Sun is seen above, away from the Sun, which stands in the north.
    assert sight == pytest.approx([0.0, -np.sqrt(0.75), 0.5], abs=1e-12)
