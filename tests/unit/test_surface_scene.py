"""Scenes of surfaces: what they refuse, what their tables say, and their model files."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import pytest
from bases import complaint

import skyscatter
from skyscatter import Body, Component, Perspective, SurfaceMedium, SurfaceModel, SurfaceScene, Telescope, Viewpoint
from skyscatter.errors import DomainError, ModelFileError
from skyscatter.geometry.camera import Fisheye, Panorama
from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP, POINT_LAMP, STACK, SURFACE_LAMP, SURROUNDINGS
from skyscatter.models.files import parse_model
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.solvers.base import Answer, Asked, Rays
from skyscatter.solvers.options import Path
from skyscatter.solvers.subpixels import Subpixels, fine_directions
from skyscatter.solvers.surfaces import compile_surfaces
from skyscatter.surfaces.lamps import AreaLamp, ParallelLamp, PointLamp, SpotLamp, Surroundings
from skyscatter.surfaces.materials import Dielectric, Interface, Lambert
from skyscatter.surfaces.meshes import Mesh
from skyscatter.surfaces.shapes import Box, Disk, Plane, Rectangle, Sphere

WL = np.array([450.0, 550.0, 650.0])
FOG = Component(
    name="fog", density={"kind": "everywhere"}, optics=Particles(extinction=0.1, phase=HenyeyGreenstein(g=0.8))
)
BLOB = Component(
    name="blob",
    density={"kind": "sphere", "radius": 2.0},
    optics=Particles(extinction=0.3, single_scattering_albedo=0.5, phase=HenyeyGreenstein(g=0.1)),
)
BLACK = Lambert(albedo=0.0)
MEDIA = (
    SurfaceMedium(name="air"),
    SurfaceMedium(name="foggy", components=(FOG, BLOB)),
    SurfaceMedium(name="fog", components=(FOG,), index=1.1),
    SurfaceMedium(name="water", index="water", priority=3),
)
TANK = Body(name="tank", shape=Box(size=(4, 4, 3)), material=Interface(), inside="foggy")
BALL = Body(name="ball", shape=Sphere(radius=0.5), material=Dielectric(), inside="water")


def scene(*bodies: Body, lamps: Any = (), media: Any = MEDIA) -> SurfaceScene:
    return SurfaceScene(media=media, bodies=bodies, lamps=lamps, viewpoint=Viewpoint(position=(1, -3, 0)))


def test_media_own_their_components() -> None:
    media = compile_surfaces(scene(TANK, BALL), WL).media
    assert media.first.tolist() == [0, 0, 2, 3, 3]
    assert media.constant.tolist() == [True, False, True, True]
    assert media.priority.tolist() == [0, 0, 0, 3]
    assert media.density.tolist() == [1.0, 0.0, 1.0]
    np.testing.assert_allclose(media.extinction, np.array([0, 0, 0.1, 0])[:, None] * np.ones(3))
    np.testing.assert_allclose(media.scattering, media.extinction)
    np.testing.assert_allclose(media.sigma_t[:, 0], [0.1, 0.3, 0.1])
    assert media.rate.tolist() == [0.1, 0.3, 0.1]
    assert media.dispersive.tolist() == [False, False, False, True]
    np.testing.assert_allclose(media.index[:3, 0], [1.0, 1.0, 1.1])
    # The field without end has no term and no bounds of its own; the blob has both.
    assert media.space.term_start.tolist() == [0, 0, 1, 1]
    assert media.space.upper.max(axis=0).tolist() == [0.0, 1.0, 0.0]


def test_a_scene_without_components_has_empty_tables() -> None:
    table = compile_surfaces(SurfaceScene(), WL)
    assert table.media.sigma_s.shape == (0, 3)
    assert table.media.phase.shape[0] == table.media.phase_cdf.shape[0] == 0
    assert table.lamps.power.shape == (0, 3)
    assert table.lamps.stack.shape == (0, STACK)
    assert table.shapes.kind.shape == (0,)
    assert table.media.space is None, "no field is read"


def test_lamps_become_rows() -> None:
    panel = Body(
        name="panel", shape=Rectangle(position=(0, 0, 1.4), normal=(0, 0, -1), size=(1, 2)), material=BLACK,
        lamp=AreaLamp(power=3.0),
    )  # fmt: skip
    lamps = (
        PointLamp(position=(0, 0, 0), power=2.0),
        SpotLamp(position=(0, 0, 5), target=(0, 0, 0), power=1.0, half_angle_deg=30),
        ParallelLamp(direction=(0, 0, 2), irradiance=1.0),
        Surroundings(radiance=0.5),
    )
    table = compile_surfaces(scene(TANK, panel, BALL, lamps=lamps), WL)
    rows = table.lamps
    assert rows.kind.tolist() == [SURFACE_LAMP, POINT_LAMP, POINT_LAMP, PARALLEL_LAMP, SURROUNDINGS]
    assert rows.power[:, 0].tolist() == [3.0, 2.0, 1.0, 1.0, 0.5]
    assert rows.area.tolist() == [2.0, 0, 0, 0, 0]
    assert table.shapes.lamp.tolist() == [-1, 0, -1]
    assert rows.item_first.tolist() == [0, 1, 1, 1, 1, 1]
    assert rows.item.tolist() == [1]
    np.testing.assert_allclose(rows.axis[2], [0, 0, -1])
    np.testing.assert_allclose(rows.position[3], [0, 0, 1])
    # Media around: the tank's; the tank's with the ball's water in it; none.
    assert rows.stack[:, :3].tolist() == [[1, -1, -1], [1, 3, -1], [-1, -1, -1], [-1, -1, -1], [-1, -1, -1]]
    # Shares of the power: through the sphere around everything comes pi R^2 E and pi (4 pi R^2) L.
    corners = np.array([[x, y, z] for x in (-2, 2) for y in (-2, 2) for z in (-1.5, 1.5)])
    reach = np.linalg.norm(np.vstack([corners, [[1, -3, 0], [0, 0, 5]]]) - rows.centre, axis=1).max()
    assert reach <= rows.radius < 1.3 * reach
    power = np.array([3.0, 2.0, 1.0, np.pi * rows.radius**2, 4 * np.pi**2 * rows.radius**2 * 0.5])
    # Half of the photons by power, half evenly.
    np.testing.assert_allclose(rows.share, 0.5 * power / power.sum() + 0.5 / len(power), rtol=1e-12)


def test_items_of_a_lamp_are_chosen_by_their_areas() -> None:
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 3, 0], [5, 5, 0], [6, 6, 0], [7, 7, 0]]
    mesh = Mesh(vertices=vertices, faces=[[0, 1, 2], [0, 1, 3], [4, 5, 6]])
    body = Body(name="sail", shape=mesh, material=BLACK, lamp=AreaLamp(radiance=1.0))
    table = compile_surfaces(scene(body), WL)
    np.testing.assert_allclose(table.lamps.item_cdf, [0.25, 1.0])
    assert table.lamps.area[0] == pytest.approx(2.0)
    np.testing.assert_allclose(table.lamps.power[0], 2 * np.pi)


def test_lamps_across_a_boundary_are_refused() -> None:
    across = Body(
        name="bar", shape=Rectangle(position=(0, 0, 0), normal=(0, 1, 0), size=(6, 0.1)), material=BLACK,
        lamp=AreaLamp(power=1.0),
    )  # fmt: skip
    with pytest.raises(DomainError, match="lamp = 'bar': lies across a boundary of media"):
        compile_surfaces(scene(TANK, across), WL)
    sea = Body(name="sea", shape=Plane(), material=Dielectric(), inside="water")
    with pytest.raises(DomainError, match="come from more than one medium"):
        compile_surfaces(scene(sea, lamps=(Surroundings(radiance=1.0),)), WL)


def test_light_from_outside_needs_a_way_in() -> None:
    endless = (SurfaceMedium(name="fog", components=(FOG,)),)
    for lamp in (Surroundings(radiance=1.0), ParallelLamp(direction=(0, 0, 1), irradiance=1.0)):
        with pytest.raises(DomainError, match="lets no light through; bound that medium"):
            compile_surfaces(scene(lamps=(lamp,), media=endless), WL)
    compile_surfaces(scene(lamps=(PointLamp(position=(0, 0, 0), power=1.0),), media=endless), WL)


def test_optical_depths_have_no_meaning_without_an_end() -> None:
    optics = Particles(optical_depth=1.0, phase=HenyeyGreenstein(g=0.0))
    haze = FOG.model_copy(update={"optics": optics, "name": "haze"})
    with pytest.raises(DomainError, match=r"outside: haze.*give coefficients"):
        compile_surfaces(scene(media=(SurfaceMedium(name="outside", components=(haze,)),)), WL)


def test_a_nebula_becomes_a_scene_without_surfaces() -> None:
    nebula = skyscatter.load_model("reflection-nebula").scene()
    table = compile_surfaces(nebula, WL)
    assert table.shapes.kind.size == 0
    assert table.media.constant.tolist() == [False]
    star = nebula.stars[0]
    row = int(np.flatnonzero(table.lamps.kind == POINT_LAMP)[0])
    np.testing.assert_allclose(table.lamps.power[row], star.spectral_luminosity(WL, nebula.view.distance))
    np.testing.assert_allclose(table.lamps.lobe_value[:2], 1 / (4 * np.pi))
    # The observer, far outside, is not among what photons could meet.
    low, high = nebula.medium.fields[0].bounds
    assert table.lamps.radius < np.linalg.norm(high - low)


REFUSED: tuple[tuple[Any, str], ...] = (
    (lambda: Body(shape=Rectangle(size=(1, 1)), material=Interface(), inside="air"), "rectangle holds no volume"),
    (lambda: Body(shape=Disk(), material=Dielectric(), inside="air"), "disk holds no volume"),
    (lambda: Body(shape=Plane(), material=BLACK, lamp=AreaLamp(power=1.0)), "a plane has no end, and so no power"),
    (lambda: Body(shape=Sphere(), material=Interface(), inside="air", lamp=AreaLamp(power=1)), "not there for light"),
    (lambda: Body(shape=Sphere(), material=Dielectric()), "inside = None: body: its material is a boundary"),
    (lambda: scene(Body(shape=Sphere(), material=Interface(), inside="watr")), "did you mean water?"),
    (lambda: scene(media=()), "media = 0: at least one"),
    (lambda: scene(media=(SurfaceMedium(name="a"), SurfaceMedium(name="a"))), "media = 'a': two of one name"),
    (lambda: SurfaceMedium(name="a", components=(FOG, FOG)), "components = 'fog': two of one name"),
    (lambda: SurfaceMedium(name="a", index="glas"), "index = 'glas'"),
    (lambda: SurfaceMedium(name="a", index=-1.0), "index = -1.0"),
    (lambda: scene(lamps=(Surroundings(radiance=1), Surroundings(radiance=2))), "lamps = 'surroundings': twice"),
    (lambda: Viewpoint(position=(1, 2, 3), target=(1, 2, 3)), "is where the observer stands"),
    (lambda: Viewpoint(position=(0, 0, 3), target=(0, 0, 0)), "nor along the line of sight"),
    (
        lambda: SurfaceMedium(name="a", components=({**FOG.model_dump(), "density": {"kind": "uniform", "top": 1}},)),
        "belongs to a planet",
    ),
)


@pytest.mark.parametrize(("build", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_bad_scenes_are_refused_in_one_line(build: Any, message: str) -> None:
    assert message in complaint(build)


# --- cameras ------------------------------------------------------------------------------------------------------


def test_cameras_look_at_the_target() -> None:
    viewpoint = Viewpoint(position=(1, 2, 3), target=(4, 6, 3), up=(0, 0.3, 1))
    sight = viewpoint.sight
    np.testing.assert_allclose(sight.forward, [0.6, 0.8, 0.0], atol=1e-15)
    axes = np.array([sight.forward, sight.right, sight.up])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert sight.up[2] > 0
    assert sight.right @ [0.8, -0.6, 0.0] > 0.9  # to the right of somebody who looks there
    for camera in (Perspective(width=5, height=3, fov_deg=40.0), Telescope.from_field_of_view(5, 3, 40.0)):
        directions = camera.directions(sight)
        np.testing.assert_allclose(directions[1, 2], sight.forward, atol=1e-15)
        edge = camera.model_copy(update={"width": 1}).directions(sight)
        assert edge.shape == (3, 1, 3)
        across = np.degrees(np.arccos(directions[1, 0] @ directions[1, 4]))
        assert across == pytest.approx(2 * np.degrees(np.arctan(0.8 * np.tan(np.radians(20)))), abs=1e-9)
    turned = Perspective(width=5, height=5, fov_deg=40.0, roll_deg=90.0).directions(sight)
    plain = Perspective(width=5, height=5, fov_deg=40.0).directions(sight)
    np.testing.assert_allclose(turned[2, 4], plain[4, 2], atol=1e-15)  # turned clockwise, its right side looks down


def test_perspective_needs_somewhere_to_look() -> None:
    with pytest.raises(DomainError, match="looks nowhere by itself; give azimuth_deg"):
        Perspective(width=5, height=3).directions(None)
    assert "give both or neither" in complaint(lambda: Perspective(width=5, height=3, elevation_deg=10.0))


@pytest.mark.parametrize(
    "camera",
    [
        Perspective(width=4, height=3, fov_deg=70.0),
        Telescope.from_field_of_view(4, 3, 70.0),
        Panorama(width=6, height=4),
        Fisheye(width=5, height=5),
    ],
    ids=lambda camera: camera.kind,
)
def test_parts_of_pixels_lie_around_their_middles(camera: Any) -> None:
    sight = Viewpoint(position=(0, 0, 0), target=(1, 1, 0)).sight
    grid = camera.directions(sight)
    fine = fine_directions(camera, sight, grid, 3)
    assert fine.shape == (*grid.shape[:2], 9, 3)
    inside = np.isfinite(grid[..., 0])
    np.testing.assert_allclose(fine[inside][:, 4], grid[inside], atol=1e-14)
    x, y = camera.pixel(fine, sight)
    column, row = np.arange(camera.width)[None, :, None], np.arange(camera.height)[:, None, None]
    steps = np.array([-1, 0, 1]) / 3
    moved = np.abs(fine - grid[:, :, None]).max(axis=-1) > 1e-9
    expected_x = np.broadcast_to(column + np.tile(steps, 3), x.shape)
    expected_y = np.broadcast_to(row + np.repeat(steps, 3), y.shape)
    np.testing.assert_allclose(x[moved], expected_x[moved], atol=1e-9)
    np.testing.assert_allclose(y[moved], expected_y[moved], atol=1e-9)
    assert moved.sum() > 0.5 * moved.size


class _Plane:
    """A solver whose radiance is linear in the direction, with errors that are known."""

    @staticmethod
    def check(options: Asked[Path]) -> None:
        assert options.how.samples is None or options.how.samples >= 2

    @staticmethod
    def prepare(scene: Any, rays: Rays, *_: Any) -> int:
        return len(rays.origins)

    @staticmethod
    def solve(context: int, rays: Rays, options: Asked[Path]) -> Answer:
        value = rays.directions @ np.ones((3, 2))
        error = np.full_like(value, 0.3)
        samples = np.full(len(value), options.how.samples)
        assert len(set(rays.numbers.tolist())) == len(value)
        return Answer(value, error, {"order1": 2 * value, "Q_error": error}, samples)


def test_pixels_are_means_of_their_parts() -> None:
    fine = np.random.default_rng(1).normal(size=(7, 4, 3))
    solver = Subpixels(_Plane, fine, 4)
    rays = Rays(np.zeros((3, 3)), np.zeros((3, 3)), np.array([1, 5, 6]))
    assert solver.prepare(None, rays, WL, Asked(Path(samples=20)), 1, None) == 12
    answer = solver.solve(None, rays, Asked(Path(samples=20)))
    mean = fine[[1, 5, 6]].mean(axis=1) @ np.ones((3, 2))
    np.testing.assert_allclose(answer.radiance, mean, atol=1e-14)
    np.testing.assert_allclose(answer.layers["order1"], 2 * mean, atol=1e-14)
    np.testing.assert_allclose(answer.standard_error, 0.15)
    np.testing.assert_allclose(answer.layers["Q_error"], 0.15)
    assert answer.samples.tolist() == [20, 20, 20]
    assert solver.shared(Asked(Path(noise=0.1))).how.noise == pytest.approx(0.2)
    with pytest.raises(DomainError, match="samples = 7: with 4 rays a pixel at least 8"):
        solver.check(Asked(Path(samples=7)))


def test_pictures_with_subpixels(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    """The picture of a solver that is linear in the direction: the mean over the parts; the recipe says how many."""
    from skyscatter.solvers.state import RenderState

    import_module("skyscatter.solvers.render")  # what takes the name from there has done so before it is another
    monkeypatch.setattr("skyscatter.solvers.run.load_solver", lambda *_: _Plane)
    camera, looked = Perspective(width=3, height=2, fov_deg=50.0), scene(BALL)
    image = skyscatter.render(looked, camera, WL[:2], solver=skyscatter.Path(samples=18), subpixels=3)
    directions = fine_directions(camera, looked.observer, camera.directions(looked.observer), 3)
    np.testing.assert_allclose(image.radiance, directions.mean(axis=2) @ np.ones((3, 2)), atol=1e-14)
    np.testing.assert_allclose(image.standard_error, 0.1)
    assert image.recipe["subpixels"] == 3
    assert image.recipe["options"]["samples"] == 18  # two for each part; 32 were it one ray, see `walks_for`
    plain = skyscatter.render(looked, camera, WL[:2], solver=skyscatter.Path(samples=18))
    assert "subpixels" not in plain.recipe
    begun = tmp_path / "begun.zarr"
    RenderState.empty(image.recipe, 6, 2).save(begun)
    with pytest.raises(DomainError, match="was begun with other"):
        skyscatter.render(looked, camera, WL[:2], solver=skyscatter.Path(samples=18), subpixels=2, resume=begun)


def test_subpixels_are_for_surfaces() -> None:
    sky = skyscatter.load_model("earth-simple").scene()
    with pytest.raises(DomainError, match="subpixels = 2: is for scenes of surfaces"):
        skyscatter.render(sky, Fisheye(width=2, height=2), [550.0], subpixels=2)
    with pytest.raises(DomainError, match="subpixels = 0"):
        skyscatter.render(scene(BALL), Fisheye(width=2, height=2), [550.0], solver="path", subpixels=0)
    with pytest.raises(DomainError, match="solver = 'orders': choose from path, photons"):
        skyscatter.render(scene(BALL), Fisheye(width=2, height=2), [550.0])


# --- model files --------------------------------------------------------------------------------------------------

SHIPPED = tuple(name for name in skyscatter.model_names() if skyscatter.load_model(name).command == "render")


def test_the_promised_scenes_are_shipped() -> None:
    assert {"fog-room", "searchlight", "city-skyglow", "light-guide", "milk-and-water"} <= set(SHIPPED)
    assert skyscatter.load_model("star-in-dust").command == "nebula"


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_load_cite_and_come_back(name: str, tmp_path: Any) -> None:
    model = skyscatter.load_model(name)
    assert isinstance(model, SurfaceModel)
    assert model.name == name
    assert model.description.endswith(".")
    assert model.sources
    assert all(len(source) > 20 for source in model.sources)
    model.save(tmp_path / "again.toml")
    assert skyscatter.load_model(tmp_path / "again.toml") == model
    table = compile_surfaces(model.scene(), WL)
    assert len(table.lamps.kind) > 0
    assert table.lamps.share.sum() == pytest.approx(1.0)


def test_the_viewpoint_can_be_elsewhere() -> None:
    model = skyscatter.load_model("fog-room")
    moved = model.scene(position=(1, 1, 1), target=("2 m", 0, 0)).viewpoint
    assert moved.position == (1.0, 1.0, 1.0)
    assert moved.target == (2.0, 0.0, 0.0)
    assert model.scene().viewpoint == model.viewpoint


FILE: dict[str, Any] = {
    "name": "toy",
    "viewpoint": {"position": [0, 0, 0], "target": ["1 m", 0, 0]},
    "bodies": [{"name": "ball", "shape": {"kind": "sphere"}, "material": {"kind": "lambert", "albedo": 0.5}}],
    "lamps": [{"kind": "point", "position": [0, 0, "3 m"], "power": 1.0}],
}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bodys": []}, ["bodys", "did you mean bodies?"]),
        ({"lamps": [{"kind": "points"}]}, ["lamps", "points"]),
        ({"lamps": [{"kind": "point", "position": [0, 0], "power": 1}]}, ["position"]),
        ({"lamps": [{"kind": "point", "position": [0, 0, "3 parsecs"], "power": 1}]}, ["3 parsecs"]),
        ({"lamps": [{"kind": "point", "position": [0, 0, 1], "watts": 1}]}, ["spectrum"]),
        ({"bodies": [{"shape": {"kind": "sphere"}}]}, ["material is missing"]),
        ({"bodies": [{"shape": {"kind": "sphere"}, "material": {"kind": "lambert", "albedo": 2}}]}, ["albedo = 2"]),
        ({"media": [{"name": "a", "index": "glass"}]}, ["index = 'glass'"]),
        ({"camera": {"kind": "planet", "width": 4, "height": 4}}, ["camera = 'planet'"]),
        ({"viewpoint": {"target": [0, 0, 0]}}, ["target", "where the observer stands"]),
    ],
)
def test_bad_files_are_refused_in_one_line(changes: dict[str, Any], words: list[str]) -> None:
    assert parse_model(FILE, "toy.toml").scene().bodies[0].name == "ball"
    with pytest.raises(ModelFileError) as caught:
        parse_model({**FILE, **changes}, "toy.toml")
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
