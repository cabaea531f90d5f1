"""Solver ``orders``: closed forms, laws, other solvers, and what it accepts and refuses."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked
from numpy.typing import NDArray
from plane_parallel import THICKNESS, WAVELENGTH, IsotropicLayers, Slab, isotropic_fluxes
from significance import assert_agrees

import skyscatter
from skyscatter.errors import ConvergenceError, DomainError, MissingDataError, SkyscatterError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.media.fields import Exponential, Uniform
from skyscatter.optics.absorption import TabulatedAbsorption
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic, Rayleigh
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.solvers.field import DEFAULT_TOLERANCE
from skyscatter.solvers.fluxes import sphere_rule
from skyscatter.solvers.sweeps import FLOOR

Array = NDArray[np.float64]

R = 6.371e6
WAVELENGTHS = np.array([400.0, 550.0, 750.0])
#: (azimuth, elevation) [degree]; the Sun of every scene stands at azimuth 0.
SIGHTS = ((0.0, 90.0), (40.0, 60.0), (180.0, 30.0), (90.0, 10.0), (10.0, 5.0), (135.0, 2.0))
#: What the tables of columns, densities and phase functions leave.
TABLES = 2e-4

AIR = skyscatter.Component(
    name="air", density=Exponential(scale_height=8e3), optics=RayleighPowerLaw(coefficient=1.2e-5)
)
HAZE = skyscatter.Component(
    name="haze",
    density=Exponential(scale_height=1.5e3),
    optics=Particles(optical_depth=0.3, single_scattering_albedo=0.95, phase=HenyeyGreenstein(g=0.7)),
)


def scene_of(
    *components: skyscatter.Component, sun: float = 30.0, albedo: float = 0.2, radius: float = 0.0, **more: Any
) -> skyscatter.Scene:
    """A scene lit by irradiance 1 from a point in the north, unless it says otherwise."""
    return skyscatter.Scene(
        medium=skyscatter.Medium(planet_radius=R, components=components or (AIR,)),
        ground=skyscatter.Ground(albedo=albedo),
        star=skyscatter.Star(spectrum=1.0, radius=radius),
        sun=skyscatter.Sun(elevation_deg=sun, azimuth_deg=0.0),
        **more,
    )


def towards(sights: Any) -> Array:
    azimuth, elevation = np.array(sights, float).T
    return np.asarray(direction_from_azimuth_elevation(azimuth, elevation))


def look(
    scene: skyscatter.Scene, sights: Any = SIGHTS, solver: str = "orders", altitude: float = 0.0, **more: Any
) -> Any:
    """Radiance at `altitude` above the scene's own observer, seen along sights."""
    wavelengths = more.pop("wavelengths", WAVELENGTHS)
    origin = np.array([0.0, 0.0, R + altitude])
    return skyscatter.radiance(scene, origin, towards(sights), wavelengths, **asked(solver, **more))


@cache
def field_of(sun: float, tolerance: float = DEFAULT_TOLERANCE, hazy: bool = False) -> skyscatter.RadianceField:
    """Air, perhaps with haze, over a grey ground, with the Sun about one elevation."""
    scene = scene_of(AIR, HAZE, sun=sun) if hazy else scene_of(sun=sun)
    return skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=(sun, sun), tolerance=tolerance)


# The first order


LIMB = ((0.0, -90.0), (60.0, -50.0), (0.0, -19.3), (0.0, -19.0), (150.0, -18.8))


@pytest.mark.parametrize(
    "sun", [80.0, 5.0, -6.0, *(pytest.param(e, marks=pytest.mark.slow) for e in (30.0, 0.0, -3.0))]
)
@pytest.mark.parametrize("altitude", [0.0, 8e3, 4e5], ids=["ground", "inside", "space"])
def test_the_first_order_is_that_of_single(sun: float, altitude: float) -> None:
    scene = scene_of(sun=sun)
    sights = SIGHTS if altitude < 1e5 else LIMB
    options: dict[str, Any] = {"altitude": altitude, "parts": True}
    found = look(scene, sights, max_order=1, tolerance=3e-3, **options)
    expected = look(scene, sights, solver="single", **options)
    for name in ("scattered", "ground"):
        one, other = found.layers[name], expected.layers[name]
        # A third of the tolerance at most may go to the first order (measured: a fifth, where air is thick along the
        # horizon); `single` is good to 1e-4.  The faintest rays, in the edge of the planet's shadow, are held to 1e-6
        # of the brightest.
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-6 * other.max())
    assert found.layers["multiple"].max() < FLOOR
    np.testing.assert_allclose(found.layers["direct"], expected.layers["direct"], rtol=TABLES)


@pytest.mark.parametrize("sun", [2.0, -3.0])
def test_the_first_order_under_a_disk_is_the_mean_over_its_points(sun: float) -> None:
    radius = np.degrees(np.arcsin(6.957e8 / 1.495978707e11))
    uniform = scene_of(sun=sun, radius=6.957e8)
    uniform = uniform.model_copy(update={"star": uniform.star.model_copy(update={"limb_darkening": False})})
    found = look(uniform, max_order=1, parts=True).layers["scattered"]
    # Over zenith angles a uniform disk weighs as Gauss-Chebyshev quadrature of the second kind does.
    angle = np.pi * (np.arange(24) + 1) / 25
    weight = np.sin(angle) ** 2 / np.sum(np.sin(angle) ** 2)
    points = [look(scene_of(sun=sun + radius * np.cos(t)), solver="single", parts=True) for t in angle]
    expected = sum(w * p.layers["scattered"] for w, p in zip(weight, points, strict=True))
    # Two points are exact where the light changes as a cubic over the disk; along the edge of the shadow it does not.
    np.testing.assert_allclose(found, expected, rtol=5e-3)


@pytest.mark.parametrize("sun", [40.0, -3.0])
def test_polarisation_of_the_first_order_is_that_of_single(sun: float) -> None:
    scene = scene_of(sun=sun, albedo=0.0)
    found, expected = (
        look(scene, solver=solver, stokes=True, **more).stokes
        for solver, more in (("orders", {"max_order": 1, "tolerance": 3e-3}), ("single", {}))
    )
    # As above; Q and U against I.
    assert np.all(np.abs(found - expected) < 1e-3 * expected[..., :1])
    assert np.abs(expected[..., 1]).max() > 0.1 * expected[..., 0].max()


# Closed forms and laws


@pytest.mark.parametrize(
    ("optical_depth", "phase", "stokes"),
    [
        *(pytest.param(t, Rayleigh(), s, id=f"rayleigh-{t:g}-{s}") for t in (0.1, 1.0) for s in (False, True)),
        *(
            pytest.param(0.1, HenyeyGreenstein(g=0.8), s, id=f"forward-0.1-{s}", marks=pytest.mark.slow)
            for s in (False, True)
        ),
        pytest.param(1.0, HenyeyGreenstein(g=0.6), False, id="forward-1-False", marks=pytest.mark.slow),
        *(
            pytest.param(1.0, HenyeyGreenstein(g=0.8), s, id=f"very-forward-1-{s}", marks=pytest.mark.slow)
            for s in (False, True)
        ),
    ],
)
def test_white_furnace(optical_depth: float, phase: Any, stokes: bool) -> None:
    """Nothing absorbs, and light of radiance 1 comes from everywhere outside: it is 1 everywhere."""
    air = skyscatter.Component(
        name="air", density=Exponential(scale_height=8e3), optics=Particles(optical_depth=optical_depth, phase=phase)
    )
    dark = scene_of(air, albedo=1.0, background=1.0).model_copy(update={"star": skyscatter.Star(spectrum=0.0)})
    field = skyscatter.solve(dark, [550.0], sun_elevations_deg=(20, 45), stokes=stokes)
    for altitude in (0.0, 5e3, 4e5):
        elevation = [90.0, 20.0, 2.0] if altitude < 1e5 else [-90.0, -30.0, -19.6]
        answer = field.radiance(np.array([0.0, 0.0, R + altitude]), towards([(0.0, e) for e in elevation]))
        # The tolerance that was asked for.
        np.testing.assert_allclose(answer.radiance, 1.0, rtol=DEFAULT_TOLERANCE)
        if stokes:
            np.testing.assert_allclose(answer.stokes[..., 1:], 0.0, atol=DEFAULT_TOLERANCE)
    for altitude in (0.0, 5e3):
        flux = field.fluxes(altitude)
        np.testing.assert_allclose([flux.diffuse_down, flux.diffuse_up], np.pi, rtol=DEFAULT_TOLERANCE)
        np.testing.assert_allclose(flux.actinic, 4 * np.pi, rtol=DEFAULT_TOLERANCE)
        assert not flux.direct.any()


SLABS = {
    "isotropic": Slab(0.5, 1.0, Isotropic(), 0.6, ground_albedo=0.3),
    "rayleigh": Slab(1.0, 1.0, Rayleigh(), 0.3, ground_albedo=0.0),
    "forward": Slab(2.0, 1.0, HenyeyGreenstein(g=0.75), 0.8, ground_albedo=0.3),
    "white": Slab(1.0, 1.0, Rayleigh(), 0.5, ground_albedo=1.0),
}


def field_of_slab(slab: Slab, **options: Any) -> skyscatter.RadianceField:
    elevation = slab.scene().sun.elevation_deg
    return skyscatter.solve(slab.scene(), [WAVELENGTH], sun_elevations_deg=(elevation, elevation), **options)


@pytest.mark.parametrize(
    "name", ["isotropic", "white", *(pytest.param(n, marks=pytest.mark.slow) for n in ("rayleigh", "forward"))]
)
def test_net_flux_of_a_conservative_slab_is_the_same_at_all_heights(name: str) -> None:
    slab = SLABS[name]
    field = field_of_slab(slab)
    incoming = slab.direct_flux(0.0)
    net = field.fluxes(field.fine.problem.grid.altitudes).net[:, 0]
    assert np.ptp(net) < DEFAULT_TOLERANCE * incoming
    # Between nodes, of which a thin slab has few, fluxes are cubics: twice the tolerance.
    flux = field.fluxes(np.linspace(0, THICKNESS, 13))
    net = flux.net[:, 0]
    assert np.ptp(net) < 2 * DEFAULT_TOLERANCE * incoming
    # What the ground keeps of what falls on it.
    ground = flux.direct[0, 0] + flux.diffuse_down[0, 0]
    assert net[0] == pytest.approx((1 - slab.ground_albedo) * ground, abs=DEFAULT_TOLERANCE * incoming)
    if name == "white":
        assert np.abs(net).max() < DEFAULT_TOLERANCE * incoming
    np.testing.assert_allclose(flux.direct[[0, -1], 0], [slab.direct_flux(slab.optical_thickness), incoming], rtol=1e-5)


@pytest.mark.parametrize(
    ("optical_thickness", "albedo", "beam_mu", "tolerance"),
    [
        (0.03125, 0.2, 0.1, 1e-3),
        (0.5, 1.0, 0.6, 1e-3),
        (1, 0.9, 1.0, 1e-3),
        pytest.param(5.0, 0.99, 0.4, 2e-3, marks=pytest.mark.slow),
    ],
)
def test_fluxes_of_isotropic_slabs_against_the_integral_equation(
    optical_thickness: float, albedo: float, beam_mu: float, tolerance: float
) -> None:
    slab = Slab(optical_thickness, albedo, Isotropic(), beam_mu)
    up, down = isotropic_fluxes(slab)
    flux = field_of_slab(slab, tolerance=tolerance).fluxes([0.0, THICKNESS])
    np.testing.assert_allclose([flux.diffuse_up[1, 0], flux.diffuse_down[0, 0]], [up, down], rtol=tolerance)
    # Nothing comes from below or above.
    assert max(flux.diffuse_up[0, 0], flux.diffuse_down[1, 0]) < 1e-6 * up


@pytest.mark.slow
def test_a_thick_conservative_slab() -> None:
    """Hundreds of scatterings, whose sum is a slow geometric series: right, or given up with a remedy."""
    slab = Slab(32.0, 1.0, Isotropic(), 0.6)
    layers = IsotropicLayers.solve(32.0, 1.0, 0.6, slab.irradiance, cells=1200)
    mu = np.array([0.3, 0.9])
    try:
        field = field_of_slab(slab)
    except ConvergenceError as error:
        assert "solver path" in str(error)  # noqa: PT017
        return
    for tau, side in ((0.0, 1), (32.0, -1)):
        answer = field.radiance(*slab.rays(tau, side * mu, 1.0))
        expected = layers.radiance(tau, side * mu)
        # Little gets through, and the grid is coarse inside; what is stated must cover what is missing.
        assert np.all(np.abs(answer.radiance[:, 0] - expected) < 3 * answer.standard_error[:, 0])


@pytest.mark.parametrize("phase", [Rayleigh(), HenyeyGreenstein(g=0.6)], ids=["rayleigh", "forward"])
def test_transmission_is_the_same_both_ways_through_a_slab(phase: Any) -> None:
    """T_down at a Sun's zenith angle is T_up at that view angle (Chandrasekhar 1960, section 52)."""
    scene = Slab(0.6, 0.9, phase, 0.5).scene()
    angle = np.array([10.0, 40.0, 60.0, 75.0])
    terms = skyscatter.CorrectionTerms(scene, [WAVELENGTH], sun_elevations_deg=(10.0, 90.0))
    at = terms.at(90 - angle, angle)
    # Two solutions, each of the default tolerance, one through fluxes and one along rays.
    np.testing.assert_allclose(at.transmittance_down, at.transmittance_up, rtol=2 * DEFAULT_TOLERANCE)


# Fluxes


@pytest.mark.parametrize(
    ("hazy", "altitude", "sun"),
    [
        *((hazy, h, e) for hazy in (False, True) for h, e in ((0.0, 30.0), (6e3, 30.0))),
        (False, 0.0, 3.0),
        pytest.param(True, 0.0, 3.0, marks=pytest.mark.slow),
    ],
)
def test_fluxes_are_integrals_of_radiance(altitude: float, sun: float, hazy: bool) -> None:
    field = field_of(sun, hazy=hazy)
    flux = field.fluxes(altitude)
    directions, weights = sphere_rule(0.0)
    answer = field.radiance(np.array([0.0, 0.0, R + altitude]), directions, parts=True)
    diffuse = answer.radiance - answer.layers["direct"]
    down, up = (weights * np.maximum(side * directions[:, 2], 0) @ diffuse for side in (1, -1))
    beam = flux.direct / np.sin(np.radians(sun))
    # The light of the first order is integrated on different grids, to the tolerance.
    for value, expected in (
        (flux.diffuse_down, down), (flux.diffuse_up, up), (flux.actinic, weights @ diffuse + beam),
    ):  # fmt: skip
        np.testing.assert_allclose(value, expected, rtol=2 * DEFAULT_TOLERANCE)


def test_irradiance_on_level_planes_is_the_flux() -> None:
    field = field_of(30.0)
    flux = field.fluxes(2e3)
    down, up = (field.irradiance(2e3, normal) for normal in ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)))
    np.testing.assert_allclose(down, flux.direct + flux.diffuse_down, rtol=2 * DEFAULT_TOLERANCE)
    np.testing.assert_allclose(up, flux.diffuse_up, rtol=2 * DEFAULT_TOLERANCE)
    south, north = (field.irradiance(2e3, (0.0, side, 0.0)) for side in (-1.0, 1.0))
    assert np.all(north > south)  # the Sun is in the north
    # A plane that faces the Sun gets its light whole.
    facing = field.irradiance(2e3, tuple(field.scene.sun.direction)) - field.irradiance(2e3)
    assert np.all(facing > 0.4 * flux.direct)


@pytest.mark.parametrize("sun", [*(pytest.param(s, marks=pytest.mark.slow) for s in (80.0, 10.0)), 0.5])
@pytest.mark.parametrize("altitude", [0.0, pytest.param(1.5e4, marks=pytest.mark.slow)])
def test_direct_light_is_the_transmittance(sun: float, altitude: float) -> None:
    scene = scene_of(AIR, HAZE, sun=sun)
    field = skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=(sun, sun), tolerance=0.02)
    start = np.array([0.0, 0.0, R + altitude])
    through = skyscatter.transmittance(scene, start, start + 3e6 * scene.sun.direction, WAVELENGTHS)
    np.testing.assert_allclose(field.fluxes(altitude).direct, through * np.sin(np.radians(sun)), rtol=TABLES)


def test_fluxes_have_the_shape_of_heights_and_suns() -> None:
    field = skyscatter.solve(scene_of(), [550.0], sun_elevations_deg=(-5.0, 40.0), tolerance=0.02)
    flux = field.fluxes(np.array([0.0, 1e3, 2e4])[:, None], sun_elevation_deg=np.array([40.0, 10.0, 0.0, -5.0]))
    assert flux.net.shape == flux.actinic.shape == (3, 4, 1)
    assert np.all(np.diff(flux.diffuse_down, axis=1) < 0)  # the lower the Sun the darker
    assert np.all(np.diff(flux.direct[:, :3], axis=0) > 0)  # the higher the brighter
    assert not flux.direct[0, 3].any()
    np.testing.assert_array_equal(flux.net, flux.direct + flux.diffuse_down - flux.diffuse_up)


# The terms of a bright ground


@pytest.mark.parametrize("albedo", [pytest.param(0.3, marks=pytest.mark.slow), 1.0])
def test_correction_terms_give_what_a_solution_gives(albedo: float) -> None:
    sun, zenith, azimuth = 40.0, np.array([0.0, 30.0, 55.0])[:, None], np.array([20.0, 150.0])
    terms = skyscatter.CorrectionTerms(scene_of(AIR, HAZE), WAVELENGTHS, sun_elevations_deg=(sun, sun)).at(
        sun, zenith, azimuth
    )
    assert np.all((terms.spherical_albedo > 0) & (terms.spherical_albedo < 1))
    # Rays down to the ground at the origin, from above the atmosphere.
    theta, phi = np.broadcast_arrays(np.radians(zenith), np.radians(azimuth))
    up = np.stack([np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta)], axis=-1)
    scene = scene_of(AIR, HAZE, sun=sun, albedo=albedo)
    radiance = skyscatter.radiance(scene, np.array([0.0, 0.0, R]) + 2e5 * up, -up, WAVELENGTHS).radiance
    found = np.pi * radiance / np.sin(np.radians(sun))
    # Exact for a plane; on the sphere the ground that lights the air lies under other Suns (0.1 %), and both sides
    # carry errors of the grid (0.1 %).
    np.testing.assert_allclose(terms.reflectance(albedo), found, rtol=2e-3)


def test_correction_terms_refuse_what_they_do_not_know() -> None:
    terms = skyscatter.CorrectionTerms(scene_of(), [550.0], sun_elevations_deg=(30.0, 40.0), tolerance=0.05)
    for name, arguments in (
        ("view_zenith_deg", (35.0, 90.0)), ("sun_elevation_deg", (0.0, 10.0)), ("sun_elevation_deg", (80.0, 10.0)),
        ("altitude", (35.0, 10.0, 0.0, 0.0)),
    ):  # fmt: skip
        with pytest.raises(DomainError, match=name):
            terms.at(*arguments)


@pytest.mark.parametrize("depth", [1.0, pytest.param(1.2, marks=pytest.mark.slow)])
def test_what_comes_back_to_a_shining_ground_has_settled(depth: float) -> None:
    """The spherical albedo is a few per cent of the light at the ground: its series must have ended as well."""
    air = AIR.model_copy(update={"optics": RayleighPowerLaw(coefficient=1.2e-5, wavelength=660.0)})
    optics = Particles(optical_depth=depth, single_scattering_albedo=0.9, phase=HenyeyGreenstein(g=0.65))
    scene = scene_of(air, HAZE.model_copy(update={"optics": optics}))
    back = [
        skyscatter.CorrectionTerms(
            scene, [WAVELENGTH], sun_elevations_deg=(50.0, 50.0), tolerance=0.01, degree=8, orders_tolerance=share
        ).at(50.0, 0.0).spherical_albedo[0]
        for share in (0.002, 5e-5)
    ]  # fmt: skip
    assert back[0] == pytest.approx(back[1], rel=0.002)


def test_correction_terms_on_a_common_grid() -> None:
    thick = HAZE.model_copy(update={"optics": HAZE.optics.model_copy(update={"optical_depth": 0.6})})
    more = {"sun_elevations_deg": (40.0, 50.0), "tolerance": 0.01, "degree": 6}
    like = skyscatter.CorrectionTerms(scene_of(AIR, thick), WAVELENGTHS, **more)
    own, common = (
        skyscatter.CorrectionTerms(scene_of(AIR, HAZE), WAVELENGTHS, **more, like=which) for which in (None, like)
    )
    assert common.black.problem.grid is like.black.problem.grid
    assert common.shining.problem.grid is like.shining.problem.grid
    for mine, other in zip(own.at(45.0, [0.0, 50.0], 70.0), common.at(45.0, [0.0, 50.0], 70.0), strict=True):
        np.testing.assert_allclose(mine, other, rtol=0.01)  # the tolerance of both
    for changed in ({"sun_elevations_deg": (40.0, 45.0)}, {"degree": 8}):
        with pytest.raises(DomainError, match="like"):
            skyscatter.CorrectionTerms(scene_of(AIR, HAZE), WAVELENGTHS, **{**more, **changed}, like=like)


# Other solvers


PATHS = {
    # name: components, Sun, altitude, sights, walks
    "air by day": ((AIR,), 30.0, 0.0, SIGHTS, 4096),
    "air at dusk": ((AIR,), -3.0, 0.0, SIGHTS[:4], 8192),
    "haze": ((AIR, HAZE), 30.0, 0.0, SIGHTS, 8192),
    "haze from space": ((AIR, HAZE), 20.0, 4e5, ((0.0, -90.0), (100.0, -40.0), (0.0, -19.4)), 4096),
}


@pytest.mark.parametrize("name", PATHS)
def test_all_orders_against_path(name: str) -> None:
    components, sun, altitude, sights, walks = PATHS[name]
    scene = scene_of(*components, sun=sun)
    found = look(scene, sights, altitude=altitude)
    expected = look(scene, sights, solver="path", altitude=altitude, samples=walks)
    assert np.median(expected.standard_error / expected.radiance) < 0.01
    # Half the tolerance beyond chance: that is what the default tolerance stands for in the mean.
    assert_agrees(found.radiance, expected.radiance, expected.standard_error, slack=DEFAULT_TOLERANCE)


@pytest.mark.slow
def test_stokes_vectors_against_path() -> None:
    scene = scene_of(AIR, HAZE, sun=20.0)
    found, expected = look(scene, stokes=True), look(scene, solver="path", stokes=True, samples=8192)
    allowed = 4.5 * expected.stokes_error + DEFAULT_TOLERANCE * expected.stokes[..., :1]
    # 4.5 standard errors of 15 degrees of freedom: one of 72 values lies beyond by chance in 3 % of all seeds.
    assert np.all(np.abs(found.stokes - expected.stokes) < allowed)
    assert np.max(np.abs(expected.stokes[..., 1]) / expected.stokes[..., 0]) > 0.2


def test_mars_against_path() -> None:
    scene = skyscatter.load_model("mars").scene(sun_elevation_deg=40.0, sun_azimuth_deg=0.0)
    sights = ((0.0, 90.0), (90.0, 45.0), (180.0, 20.0), (60.0, 8.0))
    arguments = (scene, scene.observer.position, towards(sights), [450.0, 650.0])
    found = skyscatter.radiance(*arguments)
    expected = skyscatter.radiance(*arguments, solver=skyscatter.Path(samples=8192))
    assert_agrees(found.radiance, expected.radiance, expected.standard_error, slack=2 * DEFAULT_TOLERANCE)


@pytest.mark.slow
def test_the_deep_night_does_not_shine() -> None:
    """Beside Suns for which no light is left, interpolation must not swing: each order made a thousandfold of it."""
    scene = skyscatter.load_model("earth").scene()
    coarse = skyscatter.solve(scene, [540.0], sun_elevations_deg=(-10, 10), tolerance=0.01)
    fine = skyscatter.solve(scene, [540.0], sun_elevations_deg=(-12, 5), tolerance=0.005)
    suns = [-5.0, 0.0, 4.0]
    found, expected = (f.fluxes(0.0, sun_elevation_deg=suns).diffuse_down for f in (coarse, fine))
    np.testing.assert_allclose(found, expected, rtol=0.01)
    assert max(coarse.fine.sums.orders, coarse.coarse.sums.orders) < 15


def test_isotropic_scattering_on_a_small_planet_against_path() -> None:
    """The light that is scattered knows no azimuth; the height of the Sun along a ray does."""
    grains = Particles(extinction=5e-5, single_scattering_albedo=0.95, phase=Isotropic())
    cloud = skyscatter.Component(name="cloud", density=Exponential(scale_height=8000.0), optics=grains)
    scene = skyscatter.Scene(
        medium=skyscatter.Medium(components=(cloud,), planet_radius=600e3), ground=skyscatter.Ground(albedo=0.3),
        sun=skyscatter.Sun(elevation_deg=2.0, azimuth_deg=0.0),
    )  # fmt: skip
    rays = scene.observer.position, towards(((0.0, 5.0), (180.0, 5.0), (90.0, 40.0), (0.0, 85.0)))
    found = skyscatter.radiance(scene, *rays, [550.0])
    expected = skyscatter.radiance(scene, *rays, [550.0], solver=skyscatter.Path(samples=4096))
    assert_agrees(found.radiance, expected.radiance, expected.standard_error, slack=DEFAULT_TOLERANCE)


@pytest.mark.parametrize("order", [2, 3])
def test_max_order_is_that_of_path(order: int) -> None:
    scene = scene_of(sun=20.0, albedo=0.5)
    found = look(scene, max_order=order)
    expected = look(scene, solver="path", max_order=order, samples=4096)
    assert_agrees(found.radiance, expected.radiance, expected.standard_error, slack=DEFAULT_TOLERANCE)
    assert np.all(found.radiance < look(scene).radiance)


# Errors


@pytest.mark.parametrize(
    ("sun", "hazy"),
    [
        (40.0, False),
        pytest.param(40.0, True, marks=pytest.mark.slow),
        pytest.param(2.0, False, marks=pytest.mark.slow),
        pytest.param(2.0, True, marks=pytest.mark.slow),
        pytest.param(-4.0, False, marks=pytest.mark.slow),
    ],
)
def test_the_stated_error_covers_the_difference_from_a_finer_solution(sun: float, hazy: bool) -> None:
    sights = [(a, e) for a in (0.0, 60.0, 120.0, 180.0) for e in (3.0, 10.0, 30.0, 60.0, 85.0)]
    origin, directions = np.array([0.0, 0.0, R]), towards(sights)
    answer = field_of(sun, hazy=hazy).radiance(origin, directions)
    finer = field_of(sun, DEFAULT_TOLERANCE / 4, hazy).radiance(origin, directions)
    difference = np.abs(answer.radiance - finer.radiance)
    # An estimate, not a bound: nine in ten within, all within three times.
    assert np.mean(difference <= answer.standard_error) >= 0.9
    assert np.all(difference <= 3 * answer.standard_error)
    # And it is of the size that was asked for.
    assert np.median(answer.standard_error / answer.radiance) < 2 * DEFAULT_TOLERANCE


# Symmetry


def test_stokes_vectors_are_symmetric_about_the_suns_plane() -> None:
    scene = scene_of(AIR, HAZE, sun=20.0)
    left, right = ([(side * a, e) for a in (20.0, 75.0, 140.0) for e in (5.0, 30.0, 70.0)] for side in (1, -1))
    one, other = (look(scene, seen, stokes=True, tolerance=0.03).stokes for seen in (left, right))
    # Rays of a bundle share one course: the same arithmetic but for signs and rounding.
    np.testing.assert_allclose(other, one * [1, 1, -1, -1], rtol=1e-5, atol=1e-7 * one[..., 0].max())
    across = look(scene, [(0.0, 10.0), (0.0, 60.0), (180.0, 40.0)], stokes=True, tolerance=0.03).stokes
    np.testing.assert_allclose(across[..., 2:], 0.0, atol=1e-7 * across[..., 0].max())


def test_isotropic_scattering_polarises_nothing() -> None:
    fog = skyscatter.Component(
        name="fog", density=Exponential(scale_height=2e3), optics=Particles(optical_depth=1.0, phase=Isotropic())
    )
    scene = scene_of(fog)
    polarised, scalar = look(scene, stokes=True), look(scene)
    np.testing.assert_allclose(polarised.radiance, scalar.radiance, rtol=1e-6)  # single precision in the field
    assert not polarised.stokes[..., 1:].any()


def test_scalar_light_misses_the_radiance_of_air() -> None:
    """Mishchenko, Lacis & Travis (1994), JQSRT 51, 491: by several per cent, of either sign."""
    scene = scene_of(albedo=0.0)
    ratio = look(scene).radiance / look(scene, stokes=True).radiance
    assert ratio.max() > 1.01
    assert ratio.min() < 0.99


# The same numbers


def test_same_bits_for_any_number_of_threads() -> None:
    scene = scene_of(AIR, HAZE)
    one, two = (look(scene, SIGHTS[:4], stokes=True, threads=threads, tolerance=0.03) for threads in (1, 2))
    assert np.array_equal(one.stokes, two.stokes)
    assert np.array_equal(one.stokes_error, two.stokes_error)
    camera = skyscatter.Panorama(width=24, height=12)
    one, two = (
        skyscatter.render(scene, camera, WAVELENGTHS[:2], solver=skyscatter.Orders(tolerance=0.03), threads=threads)
        for threads in (1, 2)
    )
    assert np.array_equal(one.radiance, two.radiance, equal_nan=True)


def test_rays_do_not_depend_on_their_neighbours() -> None:
    field = field_of(30.0, hazy=True)
    sights = [(a, e) for e in (3.0, 40.0) for a in (0.0, 50.0, 100.0, 230.0)]
    origin, directions = np.array([0.0, 0.0, R]), towards(sights)
    whole = field.radiance(origin, directions).radiance
    back = field.radiance(origin, directions[::-1]).radiance[::-1]
    alone = np.array([field.radiance(origin, d).radiance for d in directions])
    np.testing.assert_array_equal(back, whole)
    # Large bundles read the Sun's light from a table, small ones compute it, and points of a course are laid for all
    # of its rays: a tenth of the tolerance of 0.5 %.
    np.testing.assert_allclose(alone, whole, rtol=DEFAULT_TOLERANCE / 10)


@pytest.mark.slow
def test_a_field_answers_as_the_solver_does() -> None:
    """One solved for all Suns, and one solved for the rays that were asked."""
    field = skyscatter.solve(scene_of(), WAVELENGTHS)
    for sun in (60.0, 5.0, -3.0):
        expected = look(scene_of(sun=sun))
        found = field.radiance(np.array([0.0, 0.0, R]), towards(SIGHTS), sun_elevation_deg=sun)
        # Two grids, each of which answers for its own error, that of the horizon in twilight being the largest.
        allowed = DEFAULT_TOLERANCE * expected.radiance + expected.standard_error + found.standard_error
        assert np.all(np.abs(found.radiance - expected.radiance) < allowed)
    turned = field.radiance(np.array([0.0, 0.0, R]), towards(SIGHTS) @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).T,
                            sun_azimuth_deg=270.0).radiance  # fmt: skip
    straight = field.radiance(np.array([0.0, 0.0, R]), towards(SIGHTS)).radiance
    np.testing.assert_allclose(turned, straight, rtol=1e-6)  # single precision in the field


def test_parts_sum_to_the_whole() -> None:
    answer = look(scene_of(radius=6.957e8), [*SIGHTS, (0.0, 30.0)], parts=True)
    assert set(answer.layers) == {"direct", "scattered", "ground", "multiple"}
    np.testing.assert_allclose(sum(answer.layers.values()), answer.radiance, rtol=1e-12)  # rounding
    assert answer.layers["direct"][-1].min() > 1e3  # the Sun's disk
    assert not answer.layers["direct"][:-1].any()
    assert not answer.samples.any()


# Files


def test_a_field_comes_back_from_its_file(tmp_path: Path) -> None:
    field = skyscatter.solve(scene_of(AIR, HAZE), [550.0], sun_elevations_deg=(20.0, 40.0), tolerance=0.02, stokes=True)
    field.save(tmp_path / "field.npz")
    again = skyscatter.RadianceField.load(tmp_path / "field.npz")
    assert (again.scene, again.tolerance, again.stokes, again.zenith) == (
        field.scene,
        field.tolerance,
        True,
        field.zenith,
    )
    origin, directions = np.array([0.0, 0.0, R + 100.0]), towards(SIGHTS)
    one, two = (f.radiance(origin, directions, sun_elevation_deg=25.0) for f in (field, again))
    np.testing.assert_array_equal(one.stokes, two.stokes)
    np.testing.assert_array_equal(one.stokes_error, two.stokes_error)
    for a, b in zip(field.fluxes(1e3), again.fluxes(1e3), strict=True):
        np.testing.assert_array_equal(a, b)
    assert [path.name for path in tmp_path.iterdir()] == ["field.npz"]


def test_files_that_are_no_fields_are_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(MissingDataError, match="no such file"):
        skyscatter.RadianceField.load(tmp_path / "none.npz")
    good = tmp_path / "good.npz"
    skyscatter.solve(scene_of(), [550.0], sun_elevations_deg=(30.0, 30.0), tolerance=0.05).save(good)
    content = dict(np.load(good))
    bad = {
        "text.npz": b"this is not a field",
        "half.npz": good.read_bytes()[: good.stat().st_size // 2],
    }
    for name, raw in bad.items():
        (tmp_path / name).write_bytes(raw)
    for name, changes in {
        "version.npz": {"version": np.array(99)},
        "shape.npz": {"fine_moments": content["fine_moments"][:-1]},
        "scene.npz": {"scene": np.array("{}")},
    }.items():
        np.savez(tmp_path / name, **(content | changes))
        bad[name] = b""
    missing = {name: value for name, value in content.items() if name != "zenith"}
    np.savez(tmp_path / "missing.npz", **missing)
    for name in [*bad, "missing.npz"]:
        with pytest.raises(SkyscatterError, match=f"{name}: not a radiance field") as caught:
            skyscatter.RadianceField.load(tmp_path / name)
        assert "\n" not in str(caught.value)


# What is refused


def refusal(function: Any, *arguments: Any, **options: Any) -> str:
    with pytest.raises(DomainError) as caught:
        function(*arguments, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_field_refuses_what_it_does_not_cover() -> None:
    field = skyscatter.solve(scene_of(), [550.0], sun_elevations_deg=(20.0, 40.0), tolerance=0.05)
    up, origin = towards([(0.0, 90.0)])[0], np.array([0.0, 0.0, R])
    for sun in (80.0, -5.0):
        text = refusal(field.radiance, origin, up, sun_elevation_deg=sun)
        assert text.startswith(f"sun_elevation_deg = {sun}")
        assert "solve with wider sun_elevations_deg" in text
        assert "solve a wider range" in refusal(field.fluxes, 0.0, sun_elevation_deg=sun)
    # From space a long way off: other suns at the ground that is seen.
    far = np.array([0.0, -3 * R, 0.0])
    assert "sun_elevations_deg" in refusal(field.radiance, far, -far / np.linalg.norm(far))
    assert "altitude" in refusal(field.fluxes, -1.0)
    assert "altitude" in refusal(field.fluxes, 1e7)
    assert "normal" in refusal(field.irradiance, 0.0, (0.0, 0.0, 2.0))
    assert "inside the planet" in refusal(field.radiance, origin * 0.9, up)
    assert "unit vectors" in refusal(field.radiance, origin, 2 * up)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"sun_elevations_deg": (40.0, 20.0)}, "sun_elevations_deg"),
        ({"sun_elevations_deg": (-100.0, 20.0)}, "sun_elevations_deg"),
        ({"tolerance": 1e-5}, "tolerance"),
        ({"tolerance": 0.5}, "tolerance"),
        ({"wavelengths": [700, 500]}, "increase"),
    ],
)
def test_solve_refuses_in_one_line(options: dict[str, Any], words: str) -> None:
    wavelengths = options.pop("wavelengths", [550.0])
    assert words in refusal(skyscatter.solve, scene_of(), wavelengths, **options)


@pytest.mark.parametrize(("name", "value"), [("max_order", 0), ("threads", 0)])
def test_solve_refuses_numbers_that_mean_nothing(name: str, value: int) -> None:
    assert name in refusal(skyscatter.solve, scene_of(), [550.0], **{name: value})


# Odd places


def test_observers_anywhere_and_rays_that_miss() -> None:
    scene = scene_of(sun=20.0, background=0.25)
    top = scene.medium.top
    rays = [
        # origin, direction, may see the background alone
        ((0.0, 0.0, R), (0.0, 1.0, 0.0), False),  # along the ground
        ((0.0, 0.0, R), (0.0, 0.0, -1.0), False),  # at one's feet
        ((0.0, 0.0, R + 0.5 * top), (0.0, 0.6, -0.8), False),
        ((0.0, 0.0, R + top), (0.0, 0.0, 1.0), True),  # from the edge outwards
        ((0.0, 0.0, R + 10 * top), (0.0, 1.0, 0.0), True),  # passes by
        ((0.0, 0.0, R + 10 * top), (0.0, 0.0, 1.0), True),  # turns its back
        ((0.0, -2 * R, R + 0.3 * top), (0.0, 1.0, 0.0), False),  # the limb from afar
        ((0.0, -2 * R, R - 1.0), (0.0, 1.0, 0.0), False),  # the ground at a glance
    ]
    origins, directions = (np.array([ray[k] for ray in rays]) for k in (0, 1))
    answer = skyscatter.radiance(scene, origins, directions, WAVELENGTHS)
    path = skyscatter.radiance(scene, origins, directions, WAVELENGTHS, solver=skyscatter.Path(samples=4096))
    assert np.all(np.isfinite(answer.radiance))
    empty = np.array([ray[2] for ray in rays])
    np.testing.assert_allclose(answer.radiance[empty], 0.25, rtol=1e-6)  # the last wisp of air
    assert_agrees(
        answer.radiance[~empty], path.radiance[~empty], path.standard_error[~empty], slack=2 * DEFAULT_TOLERANCE
    )


def test_rays_that_all_miss_need_no_light() -> None:
    scene = scene_of()
    answer = skyscatter.radiance(scene, [0.0, 0.0, 2 * R], [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], WAVELENGTHS)
    assert not answer.radiance.any()
    assert answer.radiance.shape == (2, 3)
    none = skyscatter.radiance(scene, np.zeros((0, 3)), np.zeros((0, 3)), WAVELENGTHS)
    assert none.radiance.shape == (0, 3)


def test_a_medium_that_only_absorbs() -> None:
    soot = skyscatter.Component(
        name="soot",
        density=Uniform(top=1e3),
        optics=TabulatedAbsorption(coefficient=skyscatter.SpectralTable(wavelengths=(400, 800), values=(1e-3, 1e-3))),
    )
    scene = scene_of(soot, sun=40.0, albedo=0.3, background=0.5)
    found = look(scene, ((0.0, 90.0), (90.0, 30.0)))
    start = np.array([0.0, 0.0, R])
    through = skyscatter.transmittance(scene, start, start + 1e5 * towards(((0.0, 90.0), (90.0, 30.0))), WAVELENGTHS)
    np.testing.assert_allclose(found.radiance, 0.5 * through, rtol=TABLES)
    down = look(scene, ((0.0, -90.0),), altitude=2e3, max_order=1, parts=True)
    sunlight = np.exp(-1.0 / np.sin(np.radians(40.0))) * np.sin(np.radians(40.0))
    # Plane-parallel slant paths: 1e-4 of a sphere's at this height.
    np.testing.assert_allclose(down.layers["ground"], 0.3 / np.pi * sunlight * np.exp(-1.0), rtol=5e-4)


def test_emission_and_background_are_scattered() -> None:
    glow = skyscatter.Component(
        name="glow", density=Exponential(scale_height=8e3), optics=Particles(optical_depth=0.5, phase=Rayleigh()),
        emission=2e-5,
    )  # fmt: skip
    scene = scene_of(glow, albedo=0.5, background=0.1)
    dark = scene.model_copy(update={"star": skyscatter.Star(spectrum=0.0)})
    found = look(dark, parts=True)
    expected = look(dark, solver="path", samples=8192)
    assert_agrees(found.radiance, expected.radiance, expected.standard_error, slack=DEFAULT_TOLERANCE)
    assert np.ptp(found.radiance[1:2] - look(dark, ((200.0, 60.0),)).radiance) < 1e-6  # no Sun, no azimuth
    single = look(dark, solver="single", parts=True)
    # The solvers count the medium's own light as different parts.
    one, other = (a.layers["direct"] + a.layers["scattered"] for a in (found, single))
    np.testing.assert_allclose(one, other, rtol=1e-3)


def test_interrupting_the_solution_leaves_a_state_to_go_on_from(tmp_path: Path) -> None:
    from skyscatter.solvers.run import Interrupted

    def stop(share: float) -> None:
        if share > 0.1:
            raise KeyboardInterrupt

    scene, camera = scene_of(), skyscatter.Panorama(width=16, height=8)
    with pytest.raises(Interrupted) as caught:
        skyscatter.render(scene, camera, [550.0], progress=stop)
    assert not caught.value.state.done.any()
    caught.value.state.save(tmp_path / "state.zarr")
    resumed = skyscatter.render(scene, camera, [550.0], resume=tmp_path / "state.zarr")
    whole = skyscatter.render(scene, camera, [550.0])
    np.testing.assert_array_equal(resumed.radiance, whole.radiance)


def test_progress_goes_from_nought_to_one() -> None:
    shares: list[float] = []
    look(scene_of(), progress=shares.append)
    assert all(0 <= share <= 1 for share in shares)
    assert shares[-1] == 1
    assert len(shares) > 3
