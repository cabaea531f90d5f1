"""Skies that hold bodies, fields, lamps and grounds of any material: what they refuse, and what the pieces give."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked
from jsonschema import Draft7Validator as Validator

import skyscatter
from skyscatter import fields
from skyscatter.cli.main import main as cli
from skyscatter.errors import DomainError
from skyscatter.kernels.jit import entry
from skyscatter.kernels.surfaces.shells import add_shell_columns, add_shell_densities
from skyscatter.models.files import parse_model
from skyscatter.models.schema import model_schema
from skyscatter.solvers.surfaces import compile_surfaces
from skyscatter.solvers.worldscene import as_surfaces
from skyscatter.surfaces import (
    Body,
    Box,
    Dielectric,
    Interface,
    Lambert,
    Mirror,
    ParallelLamp,
    PointLamp,
    Rpv,
    Sea,
    Sphere,
    SurfaceMedium,
    SurfaceScene,
    Surroundings,
)

WAVELENGTHS = [450.0, 550.0, 650.0]
BOX = Body(name="box", shape=Box(position=(0, 20, 1), size=(2, 2, 2)), material=Lambert(albedo=0.5))
CLOUD = skyscatter.Component(
    name="cloud",
    density=fields.Box(position=(0, 0, "2 km"), half_sizes=("1 km", "1 km", "100 m")),
    optics={"kind": "particles", "extinction": "20 km-1", "phase": {"kind": "henyey-greenstein", "g": 0.8}},
)
UP = [0.0, 0.0, 1.0]


def world(sun: float = 30.0, model: str = "earth-simple", **held: Any) -> skyscatter.Scene:
    """A sky that holds something, seen from 2 m."""
    whole = skyscatter.load_model(model).model_copy(update=held)
    return whole.scene(sun_elevation_deg=sun, altitude=2.0)


def look(scene: skyscatter.Scene, direction: Any = UP, solver: str = "path", **options: Any) -> Any:
    """Light at the observer."""
    return skyscatter.radiance(scene, scene.observer.position, direction, WAVELENGTHS, **asked(solver, **options))


@pytest.mark.parametrize(
    ("held", "name"),
    [
        ({"bodies": (BOX,)}, "bodies"),
        ({"fields": (CLOUD,)}, "fields"),
        ({"lamps": (PointLamp(position=(0, 0, 5), lumens=800, spectrum="led-4000k"),)}, "lamps"),
        ({"media": (SurfaceMedium(name="water", index="water"),)}, "media"),
        ({"ground": skyscatter.Ground(material=Sea())}, "ground.material"),
    ],
)
def test_other_solvers_refuse_before_the_work(held: dict[str, Any], name: str) -> None:
    """The field because of which, and the solver to take."""
    scene = world(**held)
    assert scene.world == name
    for solver in ("orders", "single") if name != "ground.material" else ("orders",):
        with pytest.raises(DomainError, match=re.escape(f"this scene has {name}; take path")):
            look(scene, solver=solver)
    with pytest.raises(DomainError, match="choose from path"):
        look(scene, solver="photons")
    with pytest.raises(DomainError, match=f"{re.escape(name)} = .*for the solver path alone"):
        skyscatter.solve(scene, WAVELENGTHS)


@pytest.mark.parametrize("option", [{"transmittance": "ratio"}, {"sampling": "free-flight"}, {"tolerance": 1e-3}])
def test_options_without_meaning_are_refused(option: dict[str, Any]) -> None:
    """None is taken and ignored."""
    with pytest.raises(DomainError, match="means nothing"):
        look(world(bodies=(BOX,)), **option)


def test_a_word_in_totality() -> None:
    model = skyscatter.load_model("earth-simple").model_copy(update={"bodies": (BOX,)})
    with pytest.warns(UserWarning, match="in totality"):
        look(model.scene_at(43.4, -4.8, "2026-08-12T18:28Z"))


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ({"bodies": (BOX.model_copy(update={"name": "ground"}),)}, "choose another name"),
        ({"media": (SurfaceMedium(name="air"),)}, "choose another name"),
        ({"bodies": (BOX.model_copy(update={"inside": "honey"}),)}, "no such medium"),
        ({"lamps": (Surroundings(radiance=1.0),)}, "background"),
        ({"fields": (CLOUD.model_copy(update={"density": fields.Everywhere()}),)}, "no field in three dimensions"),
        ({"fields": (CLOUD.model_copy(update={"name": "air"}),)}, "two components of one name"),
    ],
)
def test_what_a_sky_cannot_hold(held: dict[str, Any], message: str) -> None:
    """Each is one line."""
    with pytest.raises(ValueError, match=message):
        world(**held)


@pytest.mark.parametrize("material", [Interface(), Dielectric()])
def test_a_ground_is_opaque(material: Any) -> None:
    with pytest.raises(ValueError, match="opaque"):
        skyscatter.Ground(material=material)


def test_a_ground_is_said_once() -> None:
    with pytest.raises(ValueError, match="leave one of them out"):
        skyscatter.Ground(albedo=0.3, material=Sea())


def test_land_makes_no_light() -> None:
    with pytest.raises(ValueError, match="more than all of it"):
        Rpv(amplitude=0.9, exponent=0.4)
    with pytest.raises(ValueError, match="upwelling"):
        Sea(upwelling=0.6)


def test_twilight_is_warned_of() -> None:
    with pytest.warns(UserWarning, match="sun_elevation_deg = -3"):
        look(world(-3.0, bodies=(BOX,)), samples=2, sampling="march")


@pytest.mark.parametrize("sun", [3.0, 12.0])
def test_a_dim_sun_in_forward_dust_is_warned_of(sun: float) -> None:
    with pytest.warns(UserWarning, match="bright sky around so low a Sun"):
        look(world(sun, "mars", bodies=(BOX,)), samples=2)


def test_at_night_lamps_shine_alone() -> None:
    """Where no air is sunlit the star is no lamp, and nobody is warned of it."""
    lamp = PointLamp(position=(0, 5, 3), power=1.0)
    scene = world(-30.0, lamps=(lamp,))
    assert [one.kind for one in as_surfaces(scene, np.array(WAVELENGTHS)).lamps] == ["point"]
    seen = look(scene, [0, 5 / 29**0.5, -2 / 29**0.5], samples=64)
    # The ground 3 m below the lamp, in clear air: to the percent that the air scatters.
    np.testing.assert_allclose(seen.radiance, 0.1 / np.pi / (4 * np.pi * 9), rtol=0.01)
    above = scene.model_copy(update={"altitude": 4e5})
    assert [one.kind for one in as_surfaces(above, np.array(WAVELENGTHS)).lamps] == ["parallel", "point"]


def test_model_files_hold_worlds() -> None:
    """Written and read again the same; what is misplaced is named with its table."""
    content = skyscatter.load_model("earth-simple").model_dump(mode="json", exclude_none=True)
    content["bodies"] = [BOX.model_dump(mode="json", exclude_none=True)]
    content["fields"] = [CLOUD.model_dump(mode="json", exclude_none=True)]
    model: Any = parse_model(content, "here")
    assert isinstance(model, skyscatter.Model)
    assert model.world == "fields"
    assert parse_model(model.model_dump(mode="json", exclude_none=True), "again") == model
    content["fields"][0]["density"] = {"kind": "exponential", "scale_height": "1 km"}
    with pytest.raises(
        ValueError, match=r"fields\.0 \(cloud\)\.density\.kind = 'exponential': does not fit this table"
    ):
        parse_model(content, "here")


AIR = [
    {"kind": "exponential", "scale_height": "8 km", "top": "60 km"},
    {"kind": "us-standard-1976"},
    {"kind": "tent", "base": "10 km", "peak": "25 km", "top": "40 km"},
    {"kind": "uniform", "base": "0 m", "top": "500 m"},
]


@entry
def columns_once(table, centre, x, d, start, end, outward, beyond, out):  # type: ignore[no-untyped-def]
    add_shell_columns(table, centre, x, d, start, end, outward, beyond, out)


@entry
def densities_once(table, centre, x, y, z, spare, out):  # type: ignore[no-untyped-def]
    add_shell_densities(table, centre, x, y, z, spare, out)


@pytest.fixture(scope="module")
def shells() -> tuple[Any, list[fields.AroundPlanet]]:
    """Shells among media, and the same as fields."""
    radius = 6.371e6
    around = [fields.AroundPlanet(position=(0, 0, -radius), radius=radius, profile=profile) for profile in AIR]
    parts = [
        skyscatter.Component(name=str(k), density=one, optics={"kind": "rayleigh-air"}) for k, one in enumerate(around)
    ]
    scene = SurfaceScene(media=(SurfaceMedium(name="air", components=tuple(parts)),))
    media = compile_surfaces(scene, WAVELENGTHS).media
    assert media.space is None
    return media, around


def test_shells_have_the_columns_of_fields(shells: tuple[Any, list[fields.AroundPlanet]]) -> None:
    """Long and short pieces of rays, along the ground, through the planet, and past it."""
    media, around = shells
    rng = np.random.default_rng(4)
    largest = np.array([one.column([0, 0, 1.0], [3e6, 0, 1.0]) for one in around])
    spare, beyond = np.zeros(4), np.zeros(4)
    for _ in range(400):
        x = np.array([*rng.uniform(-1e4, 1e4, 2), 10 ** rng.uniform(0, 5)])
        d = rng.normal(size=3)
        d[2] *= rng.choice([1.0, 0.02])
        d /= np.linalg.norm(d)
        far = 10 ** rng.uniform(0, 7.5)
        out = np.zeros(4)
        columns_once(media.shells, media.centre, x, d, 0.0, far, spare, beyond, out)
        exact = np.array([one.column(x, x + far * d) for one in around])
        # To 2e-5 of the largest column through the field, as tables of skies; the edge of the uniform one to 2e-3.
        np.testing.assert_array_less(np.abs(out - exact), np.array([2e-5, 2e-5, 2e-4, 2e-3]) * largest + 1e-9)
        if far < 300:
            # Short pieces keep their digits: to 1e-5 of what is there, as the cubics of the density.
            smooth = slice(0, 2)
            np.testing.assert_allclose(out[smooth], exact[smooth], rtol=1e-4, atol=1e-12)


def test_shells_have_the_densities_of_fields(shells: tuple[Any, list[fields.AroundPlanet]]) -> None:
    media, around = shells
    spare = np.zeros(4)
    for h in (-10.0, 0.5, 333.0, 7.7e3, 31e3, 59e3, 2e5):
        point = np.array([3e4, -1e4, 0.0])
        centre = media.centre
        point = centre + (point - centre) * (6.371e6 + h) / np.linalg.norm(point - centre)
        out = np.zeros(4)
        densities_once(media.shells, media.centre, *point, spare, out)
        np.testing.assert_allclose(out, [one.density(point) for one in around], rtol=1e-4, atol=1e-12)


@pytest.mark.filterwarnings("ignore:path does not find")
def test_the_suns_disk_is_seen_as_in_the_sky() -> None:
    """Straight, and in a mirror: radiance of the limb-darkened disk through the air."""
    plain = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30, sun_azimuth_deg=0, altitude=2.0)
    mirror = Body(name="mirror", shape=Box(position=(0, 0, 0.5), size=(20, 20, 1)), material=Mirror(reflectance=1.0))
    scene = world(30.0, bodies=(mirror,)).model_copy(update={"sun": plain.sun})
    for off in (0.0, 0.15, 0.25):
        elevation = np.radians(30 + off)
        d = np.array([0.0, np.cos(elevation), np.sin(elevation)])
        expected = look(plain, d, "single", parts=True).layers["direct"]
        found = look(scene, d, samples=4, parts=True).layers["direct"]
        # Columns by tables, the limb by rings: to 1e-4.
        np.testing.assert_allclose(found, expected, rtol=2e-4)
        mirrored = look(scene, d * [1, 1, -1], samples=64, parts=True)
        np.testing.assert_allclose(mirrored.layers["reflected"], expected, rtol=1e-3)
    beside = np.radians(30.4)
    assert not look(scene, [0, np.cos(beside), np.sin(beside)], samples=4, parts=True).layers["direct"].any()


def test_the_disk_of_parallel_light() -> None:
    """It casts the same light as without a disk on open ground, and a penumbra behind an edge."""
    floor = Body(name="floor", shape=skyscatter.surfaces.Plane(), material=Lambert(albedo=0.8))
    # An edge 10 m above the floor, over the line y = 0, so that its penumbra is 2 x 10 m x tan 1 degree wide.
    sheet = skyscatter.surfaces.Rectangle(position=(0, -50, 10), normal=(0, 0, 1), size=(200, 100))
    roof = Body(name="roof", shape=sheet, material=Lambert(albedo=0.0))
    for darkened in (False, True):
        sun = ParallelLamp(direction=(0, 0, 1), irradiance=1.0, angular_radius_deg=1.0, limb_darkening=darkened)
        scene = SurfaceScene(bodies=(floor, roof), lamps=(sun,))
        for share in (-1.2, -0.5, 0.0, 0.3, 1.2):
            y = share * 10 * np.tan(np.radians(1.0))
            seen = skyscatter.radiance(
                scene, [0, y, 0.5], [0, 0, -1], [550.0], solver=skyscatter.Path(samples=4096, max_order=1, seed=2)
            )
            expected = 0.8 / np.pi * _lit(share, sun)
            assert abs(seen.radiance[0] - expected) <= 4 * seen.error[0] + 2e-4 * expected, (darkened, share)


def _lit(share: float, sun: ParallelLamp) -> float:
    """Share of the light of a disk above a straight edge that lies at -share of its radius."""
    x, y = np.meshgrid(*[(np.arange(2000) + 0.5) / 1000 - 1] * 2)
    square = x**2 + y**2
    inside = square < 1
    limb = np.zeros_like(x)
    limb[inside] = sun.limb(np.sqrt(1 - square[inside]), [550.0])[:, 0]
    return float(limb[y > -share].sum() / limb.sum())


def test_the_world_is_one_scene_of_surfaces() -> None:
    """The planet a sphere, shells around it, the star with its disk, the background all around."""
    scene = world(bodies=(BOX,), fields=(CLOUD,)).model_copy(update={"background": 1e-3})
    made = as_surfaces(scene, np.array(WAVELENGTHS))
    assert [body.name for body in made.bodies] == ["ground", "box"]
    assert isinstance(made.bodies[0].shape, Sphere)
    assert [part.name for part in made.media[0].components] == ["air", "aerosol", "cloud"]
    assert [lamp.name for lamp in made.lamps] == ["star", "background"]
    table = compile_surfaces(made, WAVELENGTHS)
    assert table.media.shells is not None
    assert table.media.space is not None


def test_columns_go_through_clouds() -> None:
    """The cloud of 200 m, straight up: 4 of its own, beside the air's."""
    scene, plain = world(fields=(CLOUD,)), world()
    start, end = scene.observer.position, scene.observer.position + np.array([0.0, 0.0, 1e5])
    parts = skyscatter.optical_depth(scene, start, end, WAVELENGTHS, by_component=True)
    np.testing.assert_allclose(parts[-1], 4.0, rtol=1e-6)
    np.testing.assert_array_equal(
        parts[:-1], skyscatter.optical_depth(plain, start, end, WAVELENGTHS, by_component=True)
    )


WORLDS = Path(__file__).parents[2] / "docs" / "howto-worlds.md"


@pytest.mark.skipif(not WORLDS.is_file(), reason="the pages are not beside an installed package")
@pytest.mark.parametrize("number", [0, 1])
def test_models_of_the_page_are_good(number: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They are checked, shown and rendered as the page says, without naming a solver."""
    text = re.findall(r"```toml\n(.*?)```", WORLDS.read_text(encoding="utf-8"), flags=re.DOTALL)[number]
    file, picture = tmp_path / "world.toml", tmp_path / "world.png"
    file.write_text(text, encoding="utf-8")
    assert cli(["models", "check", str(file)]) == 0
    assert cli(["models", "show", str(file)]) == 0
    shown = capsys.readouterr().out
    assert ("cumulus (Sampled, Particles)", "ground: sea")[number] in shown
    # A smaller field: it is the same code.
    file.write_text(text.replace("cells = 64", "cells = 8"), encoding="utf-8")
    assert not list(Validator(model_schema()).iter_errors(tomllib.loads(text))), "as an editor sees it"
    small = ["--size", "8x6", "--samples", "8", "--wavelengths", "500,600", "--view", "perspective:0,34,50"]
    assert cli(["sky", str(file), *small, "--altitude", "2m", "--subpixels", "2", "-o", str(picture)]) == 0
    assert picture.is_file()
    assert cli(["sky", str(file), "--solver", "orders", "-o", str(picture)]) == 2
    assert "take path" in capsys.readouterr().err
