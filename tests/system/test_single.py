"""Solver ``single`` against an adaptive quadrature that shares nothing with it: closed forms, numpy and scipy.

An Earth with exponential air and haze and a tent of ozone under a point Sun.  The reference walks along the ray with
`scipy.integrate.quad_vec`, piece by piece between all kinks, and sums columns by Gauss-Legendre rules between closely
spaced shells; those columns are themselves checked against `scipy.integrate.quad`.
"""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np
import pytest
from bases import plain, plain_column
from numpy.typing import NDArray
from scipy.integrate import quad_vec

from skyscatter import Component, Ground, Medium, Scene, SpectralTable, Star, Sun, optical_depth, radiance
from skyscatter.media.fields import Exponential, Tent, Uniform
from skyscatter.optics.absorption import TabulatedAbsorption
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.solvers.options import Single
from skyscatter.spectra.solar import SOLAR_RADIUS, disk_mean, limb_darkening

Array = NDArray[np.float64]

R = 6371e3
AIR_SCALE, HAZE_SCALE, TENT = 8e3, 1.2e3, (10e3, 25e3, 40e3)
AIR_TOP, HAZE_TOP = 16 * AIR_SCALE, 16 * HAZE_SCALE
AIR, HAZE, HAZE_ALBEDO, ANGSTROM, G = 1.2e-5, 8e-5, 0.95, 1.3, 0.7
OZONE = (1e-7, 2.2e-6)
ALBEDO = 0.3
WL = np.array([400.0, 600.0])

MEDIUM = Medium(
    planet_radius=R,
    components=(
        Component(
            name="air",
            density=Exponential(scale_height=AIR_SCALE),
            optics=RayleighPowerLaw(coefficient=AIR, wavelength=550),
        ),
        Component(
            name="haze",
            density=Exponential(scale_height=HAZE_SCALE),
            optics=Particles(
                extinction=HAZE,
                angstrom_exponent=ANGSTROM,
                single_scattering_albedo=HAZE_ALBEDO,
                phase=HenyeyGreenstein(g=G),
            ),
        ),
        Component(
            name="ozone",
            density=Tent(base=TENT[0], peak=TENT[1], top=TENT[2]),
            optics=TabulatedAbsorption(coefficient=SpectralTable(wavelengths=(400, 600), values=OZONE)),
        ),
    ),
)
ELEVATIONS = (90.0, 30.0, 5.0, 0.0, -3.0, -6.0)
VIEWS = {
    0.0: (0.0, 45.0, 80.0, 87.0, 89.5),
    10e3: (0.0, 45.0, 80.0, 87.0, 89.5, 93.0, 100.0, 180.0),
    400e3: (180.0, 130.0, 111.0, 109.5, 108.5),  # the ground, the horizon (109.8), the limb
}
AZIMUTH = {True: 180.0, False: 40.0}  # towards the Sun, and 140 degrees away from it

# The reference -------------------------------------------------------------------------------------------------------

SHELLS = np.unique(
    [*TENT, HAZE_TOP, AIR_TOP, 0.0, 0.6e3, 1.2e3, 2.4e3, 4e3, 6e3, 9e3, 14e3, 32e3, 50e3, 64e3, 80e3, 100e3]
)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)
SCATTERING = np.array([AIR * (550 / WL) ** 4, HAZE_ALBEDO * HAZE * (WL / 550) ** -ANGSTROM, 0 * WL])
EXTINCTION = np.array([SCATTERING[0], SCATTERING[1] / HAZE_ALBEDO, OZONE])


def densities(h: Array) -> Array:
    """Densities of the three fields at altitudes, shape (3, ...)."""
    return np.stack(
        [
            np.where(h < AIR_TOP, np.exp(-h / AIR_SCALE), 0),
            np.where(h < HAZE_TOP, np.exp(-h / HAZE_SCALE), 0),
            np.interp(h, TENT, [0.0, 1.0, 0.0]),
        ]
    )


def cuts(p: float, a: float, b: float) -> Array:
    """Ends and crossings of shells between a and b on a line at distance p from the centre, t from its lowest point."""
    square = (R + SHELLS - p) * (R + SHELLS + p)
    t = np.sqrt(square[square > 0])
    t = np.concatenate([-t, [0.0], t])
    return np.concatenate([[a], np.sort(t[(t > a) & (t < b)]), [b]])


def columns(p: float, a: float, b: float) -> Array:
    edges = cuts(p, a, b)
    half = 0.5 * np.diff(edges)[:, None]
    t = 0.5 * (edges[1:] + edges[:-1])[:, None] + half * NODES
    return (densities(np.hypot(p, t) - R) * half * WEIGHTS).sum(axis=(1, 2))


def columns_to(x: Array, sun: Array) -> Array | None:
    """Columns from a point to the Sun; None in the planet's shadow."""
    t, p = x @ sun, float(np.linalg.norm(np.cross(x, sun)))
    if t < 0 and p < R:
        return None
    top = R + AIR_TOP
    return columns(p, t, max(t, np.sqrt(max((top - p) * (top + p), 0.0)))) if p < top else np.zeros(3)


def phases(cosine: float) -> Array:
    henyey = (1 - G * G) / (4 * np.pi * (1 + G * G - 2 * G * cosine) ** 1.5)
    return np.array([3 / (16 * np.pi) * (1 + cosine**2), henyey, 0.0])[:, None]


def reference(origin: Array, ray: Array, sun: Array) -> tuple[Array, Array]:
    """Radiance scattered once and reflected once, for unit irradiance; each (wavelength,)."""
    dark = np.zeros(WL.size)
    start, p, top = origin @ ray, float(np.linalg.norm(np.cross(origin, ray))), R + AIR_TOP
    if p >= top:
        return dark, dark
    end = np.sqrt((top - p) * (top + p))
    enter, ground = max(start, -end), p < R and start < 0
    leave = -np.sqrt((R - p) * (R + p)) if ground else end
    foot = origin - start * ray

    def integrand(t: float) -> Array:
        x = foot + t * ray
        to_sun = columns_to(x, sun)
        if to_sun is None:
            return dark
        source = (densities(np.linalg.norm(x) - R)[:, None] * SCATTERING * phases(ray @ sun)).sum(axis=0)
        return source * np.exp(-(columns(p, enter, t) + to_sun) @ EXTINCTION)

    edges = np.unique([*cuts(p, enter, leave), *shadow_edges(foot, ray, sun, enter, leave)])
    pieces = itertools.pairwise(edges)
    scattered = sum(quad_vec(integrand, a, b, epsrel=1e-6, epsabs=1e-30, norm="max", limit=400)[0] for a, b in pieces)
    if not ground:
        return scattered, dark
    x = foot + leave * ray
    cosine = x @ sun / R
    if cosine <= 0:
        return scattered, dark
    depth = (columns(p, enter, leave) + columns_to(x * (1 + 1e-15), sun)) @ EXTINCTION
    return scattered, ALBEDO / np.pi * cosine * np.exp(-depth)


def shadow_edges(foot: Array, ray: Array, sun: Array, a: float, b: float) -> list[float]:
    """Where the ray crosses the cylinder of the planet's shadow: |x - (x.s) s| = R."""
    u, v = ray - (ray @ sun) * sun, foot - (foot @ sun) * sun
    if u @ u < 1e-14:
        return []
    roots = np.roots([u @ u, 2 * u @ v, v @ v - R * R])
    return [float(t.real) for t in roots if t.imag == 0 and a < t.real < b]


def direction(zenith: float, azimuth: float) -> Array:
    z, a = np.radians([zenith, azimuth])
    return np.array([np.sin(z) * np.sin(a), np.sin(z) * np.cos(a), np.cos(z)])


def point_sun(elevation: float, altitude: float, azimuth: float = 180.0, **kwargs: object) -> Scene:
    return Scene(
        medium=MEDIUM,
        ground=Ground(albedo=ALBEDO),
        star=Star(spectrum=1.0, radius=0),
        sun=Sun(elevation_deg=elevation, azimuth_deg=azimuth),
        altitude=altitude,
        **kwargs,
    )


def single(scene: Scene, rays: list[Array], tolerance: float | None = None) -> dict[str, Array]:
    answer = radiance(
        scene, scene.observer.position, np.array(rays), WL, solver=Single(tolerance=tolerance), parts=True
    )
    assert np.all(answer.standard_error == 0)
    return answer.layers | {"radiance": answer.radiance}


# The tests -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lowest", [0.0, 5e3, 24e3, 39e3])
def test_columns_of_the_reference(lowest: float) -> None:
    """The judge is judged first."""
    p = R + lowest
    for a, b in [(-1.5e6, 1.5e6), (0.0, 1e6), (-3e5, 1e5), (2e5, 2.01e5)]:
        for f in range(3):
            expected = plain_column(
                lambda h, f=f: float(densities(np.array(h))[f]), R, *np.array([[a, 0, p], [b, 0, p]]), SHELLS
            )
            # Far below the 1e-4 that it has to judge.
            assert columns(p, a, b)[f] == pytest.approx(expected, rel=1e-8, abs=1e-6)


@lru_cache(maxsize=256)
def reference_rays(elevation: float, altitude: float, first: bool) -> tuple[list[Array], Array, Array]:
    """Rays of `VIEWS`, alternately towards and away from the Sun (the other half if not `first`)."""
    scene = point_sun(elevation, altitude)
    rays = [direction(z, AZIMUTH[(k % 2 == 0) == first]) for k, z in enumerate(VIEWS[altitude])]
    both = [reference(scene.observer.position, ray, scene.sun.direction) for ray in rays]
    return rays, np.array([s for s, _ in both]), np.array([g for _, g in both])


def compare(elevation: float, altitude: float, first: bool) -> None:
    rays, scattered, ground = reference_rays(elevation, altitude, first)
    got = single(point_sun(elevation, altitude), rays)
    # The requirement.  The irradiance is 1: 1e-14 of it is seen by nobody.
    np.testing.assert_allclose(got["scattered"], scattered, rtol=1e-4, atol=1e-14, err_msg="scattered")
    np.testing.assert_allclose(got["ground"], ground, rtol=1e-4, atol=1e-14, err_msg="ground")
    np.testing.assert_allclose(got["radiance"], scattered + ground, rtol=1e-4, atol=1e-14)
    assert not got["direct"].any(), "a point Sun has no disk to be seen"


@pytest.mark.parametrize(
    "elevation", [90.0, 5.0, -6.0, *(pytest.param(e, marks=pytest.mark.slow) for e in (30.0, 0.0, -3.0))]
)
@pytest.mark.parametrize("altitude", VIEWS)
def test_against_adaptive_quadrature(elevation: float, altitude: float) -> None:
    compare(elevation, altitude, first=True)


@pytest.mark.slow
@pytest.mark.parametrize("elevation", ELEVATIONS)
@pytest.mark.parametrize("altitude", VIEWS)
def test_against_adaptive_quadrature_other_azimuths(elevation: float, altitude: float) -> None:
    compare(elevation, altitude, first=False)


@pytest.mark.parametrize("altitude", VIEWS)
def test_tolerance_controls_the_error(altitude: float) -> None:
    """Against the same tables at the tightest tolerance, so that nothing but the quadrature differs."""
    errors = []
    for elevation in ELEVATIONS:
        scene = point_sun(elevation, altitude)
        rays = [direction(z, a) for z in VIEWS[altitude] for a in AZIMUTH.values()]
        exact = single(scene, rays, 1e-8)["scattered"]
        lit = exact > 1e-14
        found = []
        for tolerance in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
            found.append(np.abs(single(scene, rays, tolerance)["scattered"][lit] / exact[lit] - 1).max())
        errors.append(found)
    worst = np.max(errors, axis=0)
    # The pair of rules must agree on every piece within the tolerance, and the better one is used; where they agree
    # by luck, two pieces may err the same way.  The tables have kinks at the edges of their cells, which a rule may
    # step over: below 1e-4 that sets the floor.
    assert np.all(worst[:3] < [1e-2, 1e-3, 2e-4]), worst
    assert np.all(worst[3:] < 5e-5), worst
    assert worst[4] < worst[2] / 3 < worst[1] / 3 < worst[0] / 9, "tighter is better"


def test_light_adds_up() -> None:
    """Parts sum to the whole; light scales with the irradiance and with nothing else."""
    scene = point_sun(20, 10e3, background=0.7)
    rays = [direction(z, 30) for z in VIEWS[10e3]]
    got = single(scene, rays)
    np.testing.assert_array_equal(got["radiance"], got["scattered"] + got["ground"] + got["direct"])
    twice = single(scene.model_copy(update={"star": Star(spectrum=2.0, radius=0)}), rays)
    for part, factor in (("scattered", 2), ("ground", 2), ("direct", 1)):
        np.testing.assert_allclose(twice[part], factor * got[part], rtol=1e-12)  # rounding


def test_background_is_dimmed_by_the_air_and_hidden_by_the_ground() -> None:
    scene = point_sun(20, 10e3, background=0.7)
    rays = [direction(z, 30) for z in VIEWS[10e3]]
    got = single(scene, rays)["direct"]
    here = scene.observer.position
    tau = np.array([optical_depth(scene, here, here + 5e6 * ray, WL) for ray in rays[:-2]])
    # Tabulated against exact columns: a few 1e-5 of optical depths of a few.
    np.testing.assert_allclose(got[:-2], 0.7 * np.exp(-tau), rtol=1e-4)
    assert not got[-2:].any(), "the ground is in the way"


def test_ground_term_in_clear_view() -> None:
    """Straight down on a planet with hardly any air: albedo / pi times the cosine."""
    thin = Component(name="air", density=Exponential(scale_height=8e3), optics=RayleighPowerLaw(coefficient=1e-15))
    for elevation in (90.0, 30.0, 3.0, -1.0):
        scene = point_sun(elevation, 1e3).model_copy(update={"medium": Medium(planet_radius=R, components=(thin,))})
        got = single(scene, [direction(180, 0)])["ground"][0]
        # Air of optical depth 1e-11.
        np.testing.assert_allclose(got, ALBEDO / np.pi * max(np.sin(np.radians(elevation)), 0), rtol=1e-9)


def test_direct_sun() -> None:
    star = Star(spectrum=1.0)
    scene = point_sun(25, 0.0).model_copy(update={"star": star})
    radius = np.degrees(np.arcsin(SOLAR_RADIUS / star.distance))
    shares = np.array([0.0, 0.5, 0.9, 0.99])
    rays = [direction(65 - s * radius, 180) for s in shares]
    here = scene.observer.position
    got = single(scene, [*rays, direction(65 - 1.01 * radius, 180)])["direct"]
    through = np.exp([-optical_depth(scene, here, here + 5e6 * ray, WL) for ray in rays])
    mean = 1 / (np.pi * np.sin(np.radians(radius)) ** 2)
    expected = mean * limb_darkening(np.sqrt(1 - shares**2), WL) / disk_mean(WL)
    # Columns to 1e-4; the darkening is linear between 64 rings, coarse only at the very limb.
    np.testing.assert_allclose(got[:3], (expected * through)[:3], rtol=3e-4)
    np.testing.assert_allclose(got[3], (expected * through)[3], rtol=2e-2)
    assert not got[4].any(), "beside the disk"
    behind = single(point_sun(-1, 0.0).model_copy(update={"star": star}), [direction(91, 180)])
    assert not behind["direct"].any(), "the ground hides the Sun below the horizon"


def disk_average(elevation: float, altitude: float, rays: list[Array], part: str) -> Array:
    """Mean over 6 x 24 points of a limb-darkened disk, each a scene of its own."""
    radius = np.degrees(np.arcsin(SOLAR_RADIUS / Star().distance))
    x, w = np.polynomial.legendre.leggauss(6)
    square = 0.5 * (x + 1)
    angle = 2 * np.pi * (np.arange(24) + 0.5) / 24
    total, norm = 0.0, 0.0
    for s, weight in zip(square, w, strict=True):
        limb = weight * limb_darkening(np.sqrt(1 - s), WL)
        for a in angle:
            e = elevation + radius * np.sqrt(s) * np.sin(a)
            azimuth = 180 + radius * np.sqrt(s) * np.cos(a) / np.cos(np.radians(elevation))
            total = total + limb * single(point_sun(e, altitude, azimuth), rays, 1e-5)[part]
            norm = norm + limb
    return total / norm


@pytest.mark.parametrize("elevation", [30.0, 5.0, 0.0, -3.0])
def test_solar_disk_is_the_mean_over_its_points(elevation: float) -> None:
    rays = [direction(z, 180) for z in (0.0, 45.0, 80.0, 89.0)]
    scene = point_sun(elevation, 0.0).model_copy(update={"star": Star(spectrum=1.0)})
    expected = disk_average(elevation, 0.0, rays, "scattered")
    got = single(scene, rays, 1e-5)["scattered"]
    # The solver takes 7 points and one scattering angle for the whole disk: that is good to 1e-4 as long as the light
    # does not change much across it; a grazing ray towards a Sun that touches the horizon is the worst case.
    np.testing.assert_allclose(got[:3], expected[:3], rtol=7e-4)
    np.testing.assert_allclose(got[3], expected[3], rtol=2.5e-3)


def test_emission_of_a_glowing_absorber() -> None:
    """One component that absorbs and glows: L = emission / absorption (1 - exp(-tau)), whatever the path."""
    glow, sigma = 2e-6, 1e-4
    component = Component(
        name="glow", density=Uniform(top=1e4), optics=TabulatedAbsorption(coefficient=sigma), emission=glow
    )
    scene = point_sun(30, 0.0).model_copy(update={"medium": Medium(planet_radius=R, components=(component,))})
    rays = [direction(z, 0) for z in (0.0, 60.0, 85.0, 90.0)]
    here = scene.observer.position
    tau = np.array([optical_depth(scene, here, here + 5e6 * ray, WL) for ray in rays])
    got, expected = single(scene, rays)["scattered"], glow / sigma * (1 - np.exp(-tau))
    np.testing.assert_allclose(got[:3], expected[:3], rtol=1e-4)  # the requirement
    # Horizontally the optical depth is 36: nearby columns are differences of tabulated ones, a few 1e-6 of 36.
    np.testing.assert_allclose(got[3], expected[3], rtol=3e-4)


def test_nothing_to_see_outside_the_atmosphere() -> None:
    got = single(point_sun(30, 400e3), [direction(0, 0), direction(90, 0), direction(60, 180)])
    assert not got["radiance"].any()


def test_shadow_is_dark() -> None:
    """Sun 20 degrees below the horizon: no air below 128 km is lit above the observer."""
    assert not single(point_sun(-20, 0.0), [direction(0, 0), direction(60, 0)])["radiance"].any()


def test_rays_do_not_depend_on_their_company() -> None:
    scene = point_sun(5, 0.0)
    rays = [direction(z, a) for z in (0, 30, 60, 85, 91) for a in range(0, 360, 10)]
    together = single(scene, rays)["radiance"]
    alone = np.concatenate([single(scene, [ray])["radiance"] for ray in rays[::17]])
    np.testing.assert_array_equal(together[::17], alone)


def test_plain_twin_of_the_kernel() -> None:
    from skyscatter.kernels.single import make_scratch, single_rays
    from skyscatter.solvers.compile import compile_scene

    scene = point_sun(5, 10e3)
    table = compile_scene(scene, WL)
    rays = np.array([direction(80, 180), direction(100, 20)])
    origins = np.ascontiguousarray(np.broadcast_to(scene.observer.position, rays.shape))
    out = [np.empty((2, WL.size)) for _ in range(3)]
    plain(single_rays)(table, origins, rays, 0.05, make_scratch(table), *out)
    out[1] *= table.optics.albedo  # the kernel's ground is white
    got = single(scene, list(rays), 0.05)
    for part, values in zip(("scattered", "ground", "direct"), out, strict=True):
        # The twin calls the library's exponential (3e-10) and rounds differently.
        np.testing.assert_allclose(values, got[part], rtol=1e-8, err_msg=part)
