"""Polarised walks among surfaces: fields added up in space, published tables, other solvers, honest errors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked
from coulson_tables import cds
from numpy.typing import NDArray
from polarised_fields import (
    EYE,
    FLOORS,
    LAMP,
    LOOKS,
    POWER,
    facet_stokes,
    gas,
    hidden,
    leg,
    off_the_sea,
    over_floor,
    sights,
    truth,
)
from significance import assert_agrees, largest_t

import skyscatter
from skyscatter.cli.main import main
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image.spectral import SpectralImage
from skyscatter.lights import ParallelLight
from skyscatter.media.medium import Medium
from skyscatter.media.structures import Slab
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.solvers import surface_path
from skyscatter.solvers.base import Asked, Rays
from skyscatter.space import SpaceScene
from skyscatter.spectra.table import SpectralTable
from skyscatter.surfaces.grounds import Sea
from skyscatter.surfaces.lamps import AreaLamp, ParallelLamp, PointLamp
from skyscatter.surfaces.materials import Conductor, Dielectric, Interface, Lambert
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene, Viewpoint
from skyscatter.surfaces.shapes import Box, Plane, Sphere

Array = NDArray[Any]
WAVELENGTHS = np.array([450.0, 650.0])


def walked(scene: Any, o: Array, d: Array, wavelengths: Any = WAVELENGTHS, **options: Any) -> Any:
    given = {"samples": 4096, "seed": 1, "stokes": True} | options
    return skyscatter.radiance(scene, o, d, wavelengths, **asked("path", **given))


def assert_stokes(answer: Any, expected: Array, slack: float = 0.0) -> None:
    """Fail where I, Q, U or V miss `expected` (ray, 4) by more than chance and a share of I."""
    whole = np.broadcast_to(expected[:, None], answer.stokes.shape)
    allowed = largest_t(whole.size) * answer.stokes_error + slack * whole[..., :1] + 1e-12 * whole[..., :1]
    assert np.all(np.abs(answer.stokes - whole) < allowed), (answer.stokes - whole) / allowed


# --- once ---------------------------------------------------------------------------------------------------------


def test_single_scattering_of_a_lamp() -> None:
    """I, Q, U by fields added up; I is that of scalar walks."""
    o, d = sights(*LOOKS)
    answer = walked(over_floor(None), o, d, max_order=1)
    scalar = walked(over_floor(None), o, d, max_order=1, stokes=False)
    np.testing.assert_allclose(answer.radiance, scalar.radiance, rtol=1e-13)
    assert_stokes(answer, truth(None, o, d), 1e-4)  # extinction 1e-5 x metres
    assert np.all(answer.stokes_error[..., 0] < 1e-3 * answer.radiance)


@pytest.mark.parametrize("floor", FLOORS)
def test_light_scattered_once_before_it_is_reflected(floor: str) -> None:
    """The camera sees the gas itself and in a smooth floor; of lamps in the floor such walks know nothing."""
    o, d = sights(*LOOKS)
    # The light of the lamp's image is met by no walk, and that of a second scattering is 1e-5 of the first.
    # Of walks that meet glass few are reflected.
    many = 1 << 16 if floor in ("glass", "total") else 1 << 12
    with pytest.warns(UserWarning, match="off mirrors"):
        answer = walked(over_floor(floor), o, d, max_order=2, samples=many)
    assert_stokes(answer, truth(floor, o, d, images=(False,)), 1e-4)
    assert np.all(answer.stokes_error[..., 0] < 0.01 * answer.radiance)
    assert (np.abs(answer.layers["V"]).max() > 0) == (floor in ("metal", "total"))


def shining_ball(radius: float) -> Body:
    """In the lamp's place, with its power."""
    shine = AreaLamp(power=POWER)
    shape = Sphere(position=tuple(LAMP), radius=radius)
    return Body(name="lamp", shape=shape, material=Lambert(albedo=0), lamp=shine)


@pytest.mark.slow
def test_light_that_comes_to_thin_gas_by_way_of_a_mirror() -> None:
    """Half of the light is the lamp's image, which walks meet by chance, and of walks to thin gas few went on.

    With roulette by what walks carry alone 27 to 41 % of it were missing at 500 000 walks, and a thousandth stated.
    """
    scene = over_floor("metal")
    scene = scene.model_copy(update={"bodies": (*scene.bodies, shining_ball(0.15)), "lamps": ()})
    o, d = sights(*LOOKS)
    answer = walked(scene, o, d, samples=1 << 18, max_order=3)
    # A ball of 0.15 m a metre away: (0.15 / 1)^2 / 2 at most of a point's light, on its axis.
    assert_stokes(answer, truth("metal", o, d), 0.012)
    assert np.all(answer.stokes_error[..., 0] < 0.05 * answer.radiance)


# --- surfaces that are not smooth ---------------------------------------------------------------------------------


def sunlit(material: Any, toward: Array, media: tuple[SurfaceMedium, ...] = ()) -> SurfaceScene:
    inside = {"inside": "below"} if media else {}
    return SurfaceScene(
        media=(SurfaceMedium(name="vacuum"), *media),
        bodies=(Body(name="floor", shape=Plane(), material=material, **inside),),
        lamps=(ParallelLamp(name="sun", direction=tuple(toward), irradiance=1.0),),
        viewpoint=Viewpoint(position=(0, 0, 1), target=(0, 1, 1)),
    )


SUN = direction_from_azimuth_elevation(20.0, 35.0)
GLANCES = direction_from_azimuth_elevation(np.array([20.0, 35.0, 200.0, 60.0]), np.array([-35.0, -25.0, -80.0, -40.0]))
UNPOLARISED = np.array([[1.0, 0.0, 0.0, 0.0]])


def test_glitter_is_polarised_by_its_facets() -> None:
    """Sunlight by waves: P(slopes) / (4 cos m_z^4 (1 + Lambda + Lambda')) times what one facet does to fields."""
    sea = Sea(wind_speed=8, index=1.34, foam=0.0)
    o = np.broadcast_to([0.0, 0.0, 1.0], GLANCES.shape)
    answer = walked(sunlit(sea, SUN), o, GLANCES, samples=16, max_order=1)
    wo, wi = -GLANCES, np.broadcast_to(SUN, GLANCES.shape)
    m = (wo + wi) / np.linalg.norm(wo + wi, axis=1, keepdims=True)
    slope2 = (1 - m[:, 2] ** 2) / m[:, 2] ** 2
    lobe = np.exp(-slope2 / sea.slope**2) / (np.pi * sea.slope**2) / (4 * wo[:, 2] * m[:, 2] ** 4)
    lobe /= 1 + hidden(sea.slope, wo[:, 2]) + hidden(sea.slope, wi[:, 2])
    expected = lobe[:, None] * facet_stokes(1.34, np.repeat(UNPOLARISED, len(wo), axis=0), wi, wo)
    np.testing.assert_allclose(answer.stokes[:, 0], expected, rtol=1e-9, atol=1e-12 * expected[:, 0].max())
    assert np.abs(expected[:, 1:3] / expected[:, :1]).max() > 0.5


def test_foam_and_water_shine_unpolarised() -> None:
    """Q and U are those of the same sea without foam and upwelling, but for what foam covers; I is more."""
    o = np.broadcast_to([0.0, 0.0, 1.0], GLANCES.shape)
    clear = walked(sunlit(Sea(wind_speed=8, foam=0.0), SUN), o, GLANCES, samples=16, max_order=1)
    foamy = walked(sunlit(Sea(wind_speed=8, foam=0.2, upwelling=0.05), SUN), o, GLANCES, samples=16, max_order=1)
    np.testing.assert_allclose(foamy.stokes[..., 1:], 0.8 * clear.stokes[..., 1:], rtol=1e-9, atol=1e-15)
    assert np.all(foamy.radiance > 0.8 * clear.radiance)


@pytest.mark.parametrize("kind", ["metal", "glass"])
def test_rough_mirrors_polarise_by_their_facets(kind: str) -> None:
    """Angle and degree of a slightly rough floor are those of one facet; what met several, 1 % here, is not."""
    material, index = (Conductor(n=0.6, k=2.1, roughness=0.1), 0.6 + 2.1j)
    media: tuple[SurfaceMedium, ...] = ()
    if kind == "glass":
        material, index, media = Dielectric(roughness=0.1), 1.5, (SurfaceMedium(name="below", index=1.5),)  # type: ignore[assignment]
    glances = direction_from_azimuth_elevation(np.array([20.0, 24.0, 15.0]), np.array([-35.0, -32.0, -40.0]))
    o = np.broadcast_to([0.0, 0.0, 1.0], glances.shape)
    answer = walked(sunlit(material, SUN, media), o, glances, samples=16, max_order=1)
    expected = facet_stokes(
        index, np.repeat(UNPOLARISED, 3, axis=0), np.broadcast_to(SUN, glances.shape), -glances
    )  # fmt: skip
    found = answer.stokes[:, 0, 1:] / answer.radiance[:, :1]
    np.testing.assert_allclose(found, expected[:, 1:] / expected[:, :1], rtol=0.01, atol=2e-4)


def test_polarised_light_off_the_sea() -> None:
    """Gas above the sea that a lamp lights, seen in the waves: by quadrature over both slopes and along each ray."""
    scene = SurfaceScene(
        media=(SurfaceMedium(name="vacuum"), SurfaceMedium(name="gas", components=(gas(1e-5),))),
        bodies=(
            Body(name="room", shape=Box(position=(0, 0, 2), size=(6, 6, 3.9)), material=Interface(), inside="gas"),
            Body(name="sea", shape=Plane(), material=Sea(wind_speed=5, index=1.34, foam=0.0)),
        ),
        lamps=(PointLamp(name="lamp", position=tuple(LAMP), power=POWER),),
        viewpoint=Viewpoint(position=tuple(EYE), target=(0, 0, 0)),
    )
    # From below the gas: all of the second order is scattered first, and then reflected.
    d = direction_from_azimuth_elevation(np.array([80.0, 150.0, -30.0]), np.array([-35.0, -50.0, -65.0]))
    o = np.array([-0.5, -0.5, 0.04]) + np.zeros_like(d)
    both, first = (walked(scene, o, d, samples=n, max_order=k) for n, k in ((1 << 18, 2), (1 << 10, 1)))
    slope = Sea(wind_speed=5).slope
    foot = o - d * (o[:, 2:] / d[:, 2:])
    expected = np.array([
        off_the_sea(slope, 1.34, -sight, lambda wi, x=x: leg(None, x, wi, (0.0, np.inf), None))
        for x, sight in zip(foot, d, strict=True)
    ])  # fmt: skip
    found = both.stokes[..., :3] - first.stokes[..., :3]
    error = np.hypot(both.stokes_error, first.stokes_error)[..., :3]
    assert np.all(np.abs(expected[:, 1:3] / expected[:, :1]).max(axis=0) > 0.2)
    assert np.all(error < 0.02 * expected[:, None, :1])
    # 24 nodes or 36 of each slope differ by 1e-4.
    assert_agrees(found, np.repeat(expected[:, None, :3], 2, axis=1), error + 2e-4 * expected[:, None, :1])


# --- all orders ---------------------------------------------------------------------------------------------------


def slab_rays(reference: Path) -> tuple[Array, Array, Array, Array]:
    """Rays through a slab of z between -0.5 and 0.5 from above and below, what tables say of them, and its light's way.

    I, Q and U (ray, 3) of 16 directions, half of them mirror images of the others.
    """
    row, cosines, azimuths = 3, [5, 8, 11, 14], [1, 2, 4, 5]
    rays: list[Any] = []
    for upwards in (True, False):
        mu0, mu, _ = cds(reference, "I", upwards, "1")
        table = np.stack([cds(reference, name, upwards, "1")[2][0, row] for name in "IQU"], axis=-1) * [1, -1, -1]
        m, phi = (a.ravel() for a in np.meshgrid(mu[cosines], np.radians(30.0 * np.array(azimuths)), indexing="ij"))
        phi = phi * np.where(np.arange(m.size) % 2, 1.0, -1.0)
        sine = np.sqrt(1 - m**2)
        d = np.stack([sine * np.sin(phi), sine * np.cos(phi), (-m if upwards else m)], axis=-1)
        expected = table[cosines][:, azimuths].reshape(-1, 3)
        expected[:, 2] *= np.sign(phi)
        rays.append((-d * (0.51 / m)[:, None], d, expected))
    toward = np.array([0, (1 - mu0[row] ** 2) ** 0.5, mu0[row]])
    o, d, expected = (np.concatenate(part) for part in zip(*rays, strict=True))
    return o, d, expected, toward


def as_room(toward: Array) -> SurfaceScene:
    return SurfaceScene(
        media=(SurfaceMedium(name="vacuum"), SurfaceMedium(name="gas", components=(gas(1.0),))),
        bodies=(Body(name="slab", shape=Box(size=(400, 400, 1)), material=Interface(), inside="gas"),),
        lamps=(ParallelLamp(name="sun", direction=tuple(toward), irradiance=np.pi),),
        viewpoint=Viewpoint(position=(0, 0, -0.6), target=(0, 1, 0)),
    )


def as_nebula(toward: Array) -> SpaceScene:
    layer = gas(1.0).model_copy(update={"density": Slab(half_thickness=0.5)})
    light = ParallelLight(direction=tuple(toward), irradiance=SpectralTable(wavelengths=(550.0,), values=(np.pi,)))
    return SpaceScene(medium=Medium(components=(layer,)), parallel=(light,))


@pytest.mark.parametrize(
    ("made", "samples", "power"),
    [
        pytest.param(as_room, 1 << 13, 0.01, id="room"),
        pytest.param(as_room, 1 << 17, 0.003, id="room well", marks=pytest.mark.slow),
        pytest.param(as_nebula, 1 << 17, 0.003, id="nebula", marks=pytest.mark.slow),
    ],
)
def test_rayleigh_slab_against_corrected_coulson_tables(made: Any, samples: int, power: float, reference: Path) -> None:
    """Optical depth 1 under light 53 degrees from the zenith: I, Q, U in 32 directions from above and below."""
    o, d, expected, toward = slab_rays(reference)
    answer = walked(made(toward), o, d, [550.0], samples=samples)
    error = answer.stokes_error[:, 0, :3]
    assert np.median(error / expected[:, :1]) < power
    assert_agrees(answer.stokes[:, 0, :3], expected, error)
    # Together they see less: in proportion to the tables.
    share = (answer.stokes[:, 0, :3] * expected).sum(axis=0) / (expected**2).sum(axis=0)
    unsure = np.sqrt((error**2 * expected**2).sum(axis=0)) / (expected**2).sum(axis=0)
    assert_agrees(share, 1.0, unsure)
    scalar = walked(made(toward), o, d, [550.0], samples=samples, stokes=False)
    assert np.abs(scalar.radiance[:, 0] / expected[:, 0] - 1).max() > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("floor", [None, *FLOORS])
def test_fog_over_a_floor_is_that_of_photons(floor: str | None) -> None:
    """A ball that shines in fog of an optical depth near 1, over metal, a mirror or glass: all orders of both."""
    scene = over_floor(floor, 0.3)
    scene = scene.model_copy(update={"bodies": (*scene.bodies, shining_ball(0.3)), "lamps": ()})
    o, d = sights(*LOOKS)
    walks = walked(scene, o, d, samples=1 << 17)
    gathered = skyscatter.radiance(
        scene, o, d, WAVELENGTHS, **asked("photons", samples=128, photons=1 << 14, seed=2), stokes=True
    )
    # The radius blurs by less than 1e-3, as in single scattering.
    error = np.sqrt(walks.stokes_error**2 + gathered.stokes_error**2 + (1e-3 * walks.radiance[..., None]) ** 2)
    assert np.median(error[..., 0] / walks.radiance) < 0.03
    assert_agrees(walks.stokes, gathered.stokes, error)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["earth", "earth-maritime"])
@pytest.mark.parametrize("elevation", [50.0, 8.0])
def test_a_sky_with_a_body_far_behind_is_the_plain_sky(name: str, elevation: float) -> None:
    """The sky's own walks with polarisation, I to V, in clear air and with Mie's aerosol."""
    model = skyscatter.load_model(name)
    box = Body(name="box", shape=Box(position=(0, -300, 1), size=(1, 1, 1)), material=Lambert(albedo=0.3))
    azimuths, elevations = np.array([0, 60, 120, 200, 300, 30.0]), np.array([60, 30, 15, 5, -10, 85.0])
    d = direction_from_azimuth_elevation(azimuths, elevations)
    answers = []
    for bodies, samples, how in (((), 1 << 13, {}), ((box,), 1 << 14, {"sampling": "march"})):
        scene = model.model_copy(update={"bodies": bodies}).scene(
            sun_elevation_deg=elevation, sun_azimuth_deg=120, altitude="2 m"
        )
        answers.append(walked(scene, scene.observer.position, d, samples=samples, **how))
    plain, world = answers
    assert np.median(world.standard_error / world.radiance) < 0.01
    error = np.hypot(plain.stokes_error, world.stokes_error)
    # The tables of shells end in the fourth digit.
    assert_agrees(world.stokes, plain.stokes, np.hypot(error, 3e-4 * plain.radiance[..., None]))


# --- errors -------------------------------------------------------------------------------------------------------


def test_errors_are_the_spread_over_seeds() -> None:
    """Variance over seeds in the mean over rays and parameters against the stated one: chi-squared."""
    o, d = sights(*LOOKS)
    seeds = 40
    answers = [walked(over_floor(None, 0.5), o, d, samples=256, seed=100 + s) for s in range(seeds)]
    found = np.array([a.stokes[:, 0, :3] for a in answers])
    stated = np.mean([a.stokes_error[:, 0, :3] ** 2 for a in answers], axis=0)
    ratio = found.var(axis=0, ddof=1) / stated
    # Parameters of a ray go together: four independent values are counted.
    assert ratio.mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / (4 * (seeds - 1))))


def test_walks_that_are_gone_on_with_are_those_made_at_once() -> None:
    o, d = sights(*LOOKS)
    scene, rays = over_floor(None, 0.5), Rays(o.copy(), d.copy(), np.arange(len(o)))
    few, many = (Asked(skyscatter.Path(samples=n, seed=3), stokes=True) for n in (32, 64))
    context = surface_path.prepare(scene, rays, WAVELENGTHS, few, 1, None)
    walks = surface_path.no_walks(context, len(o), many)
    surface_path.solve(context, rays, few, walks)
    continued, whole = surface_path.solve(context, rays, many, walks), surface_path.solve(context, rays, many)
    np.testing.assert_array_equal(continued.stokes, whole.stokes)
    np.testing.assert_array_equal(continued.stokes_error, whole.stokes_error)


def test_light_that_loses_its_polarisation_is_scalar() -> None:
    """Components without a matrix depolarise: the same walks, the same radiance, no Q, U, V."""
    o, d = sights(*LOOKS)
    scene = over_floor(None, 0.3, HenyeyGreenstein(g=0.2))
    polarised, scalar = (walked(scene, o, d, samples=64, stokes=stokes) for stokes in (True, False))
    np.testing.assert_allclose(polarised.radiance, scalar.radiance, rtol=1e-13)
    assert not polarised.stokes[..., 1:].any()


def test_parts_and_orders_of_polarised_light_add_up() -> None:
    o, d = sights(*LOOKS)
    with pytest.warns(UserWarning, match="off mirrors"):
        answer = walked(over_floor("metal", 0.3), o, d, samples=64, parts=True, orders=2)
    parts = sum(answer.layers[name] for name in ("direct", "scattered", "reflected", "multiple"))
    np.testing.assert_allclose(parts, answer.radiance, rtol=1e-12)
    once = answer.layers["scattered"] + answer.layers["reflected"]
    np.testing.assert_allclose(answer.layers["order1"], once, rtol=1e-12)


#: Gas around a star, at a right angle to which its light is polarised.
GAS_NEBULA = """
name = "gas"
[view]
distance = "100 pc"
[[components]]
name = "gas"
density = { kind = "sphere", radius = "1 pc" }
optics = { kind = "rayleigh", coefficient = 1e-18, wavelength = "550 nm" }
[[stars]]
temperature = 8000
luminosity = 150
"""


@pytest.mark.parametrize("command", ["nebula", "render"])
def test_by_command(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--stokes` writes Q, U and V beside the radiance, and the summary has their degree."""
    (tmp_path / "gas.toml").write_text(GAS_NEBULA)
    model = str(tmp_path / "gas.toml") if command == "nebula" else "fog-room"
    out = tmp_path / "polarised.exr"
    given = ["--solver", "path", "--samples", "32", "--wavelengths", "550", "--stokes", "--json", "-o", str(out)]
    assert main([command, model, "--size", "12x8", *given]) == 0
    told = json.loads(capsys.readouterr().out)["polarisation"]
    image = SpectralImage.load(out)
    assert {"Q", "U", "V", "Q_error", "U_error", "V_error"} <= set(image.layers)
    assert 0.02 < told["mean_degree"] <= told["maximum_degree"] < 1.01
