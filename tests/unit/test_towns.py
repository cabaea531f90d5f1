"""Towns as a user gives them: records, maps, model files, pictures and the command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bases import complaint

import skyscatter
from skyscatter.cli.main import main
from skyscatter.cli.towns import parse_map, parse_town
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.solvers.sequence import field_for, frame
from skyscatter.solvers.townlamps import lamps_of, towards
from skyscatter.surfaces import IsotropicLobe, LambertLobe, Town, TownMap

SPECTRUM = "high-pressure-sodium"
EARTH = skyscatter.load_model("earth-simple")
MAPPED: Any = {"classes": [[0]], "albedos": [0.1], "cell_size": 1.0}
NIGHT = "2026-08-12T23:00Z"


def at_night(*towns: Any, lights: Any = ("towns",)) -> skyscatter.Scene:
    return EARTH.model_copy(update={"towns": towns}).scene_at(47.0, 11.0, NIGHT, lights=lights)


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"latitude_deg": 48}, "give either latitude_deg and longitude_deg, or distance and azimuth_deg"),
        ({}, "give either latitude_deg"),
        ({"latitude_deg": 48, "longitude_deg": 11, "distance": 1e3, "azimuth_deg": 0}, "give either"),
        ({"distance": "20 km", "azimuth_deg": 0, "lobe": IsotropicLobe()}, "shines below the horizon"),
        ({"distance": "20 km", "azimuth_deg": 0, "radius": -1}, "radius"),
    ],
)
def test_refusals(fields: dict[str, Any], told: str) -> None:
    assert told in complaint(lambda: Town(lumens=1e8, spectrum=SPECTRUM, **fields))


def test_a_town_on_earth_needs_an_observer_there() -> None:
    town = Town(latitude_deg=48, longitude_deg=11, lumens=1e8, spectrum=SPECTRUM)
    model = EARTH.model_copy(update={"towns": (town,)})
    assert "give a place and a time" in complaint(lambda: model.scene())
    assert model.scene_at(47.0, 11.0, NIGHT, lights="auto").towns == (town,)


def test_places_on_the_sphere() -> None:
    """A degree of latitude is 1 / 360 of the way around; the pole lies in the north from everywhere."""
    town = Town(latitude_deg=48, longitude_deg=11, radius=0, power=1.0)
    lamps = next(iter(lamps_of(at_night(town), np.array([550.0]))))
    assert lamps.distance == pytest.approx([np.radians(1.0) * EARTH.planet.radius], rel=1e-9)  # rounding
    assert lamps.azimuth == pytest.approx([0.0], abs=1e-9)
    east, north, up = towards(at_night(town), np.array([90.0]), np.array([123.0]))[0]
    assert abs(east) < 1e-12
    assert np.degrees(np.arctan2(north, up)) == pytest.approx(43.0)


def test_lights_name_towns() -> None:
    town = Town(distance="20 km", azimuth_deg=0, power=1.0)
    assert at_night(town, lights="auto").lights.shine[-1] == "towns"  # type: ignore[union-attr]
    assert "towns" not in at_night(lights="auto").lights.shine  # type: ignore[union-attr]
    with pytest.raises(DomainError, match="the model has none"):
        at_night(lights=("towns", "stars"))


@pytest.mark.slow
def test_a_picture_has_a_layer_of_towns() -> None:
    """By day and night alike; left out where the lights leave it out."""
    town = Town(distance="20 km", azimuth_deg=90, lumens=1e8, spectrum=SPECTRUM)
    camera = skyscatter.Panorama(width=16, height=8)
    image = skyscatter.render(at_night(town), camera, [550, 590], parts=True)
    layer = image.layers["towns"]
    assert layer == pytest.approx(image.radiance)  # nothing else shines
    east, north, _ = camera.directions(at_night(town).observer)[3, np.argmax(layer[3, :, 1])]
    assert east > 0.9 > 0.25 > abs(north)  # pixels are 22.5 degrees wide
    assert image.error is not None
    assert np.all(image.error[:4] > 0)
    dark = skyscatter.render(at_night(town, lights=("airglow",)), camera, [550, 590], parts=True)
    assert "towns" not in dark.layers
    by_angle = EARTH.model_copy(update={"towns": (town,)}).scene(sun_elevation_deg=-40)
    found = skyscatter.render(by_angle, camera, [550, 590], solver="single", parts=True)
    assert found.layers["towns"] == pytest.approx(layer, rel=1e-12)  # the same seeds


def test_rays_have_the_glow_of_pictures() -> None:
    night = at_night(Town(distance="20 km", azimuth_deg=90, lumens=1e7, spectrum=SPECTRUM))
    camera = skyscatter.Fisheye(width=9, height=9)
    image = skyscatter.render(night, camera, [550.0, 600.0], parts=True)
    found = skyscatter.radiance(night, night.observer.position, [0, 0, 1], [550.0, 600.0], parts=True)
    np.testing.assert_allclose(found.layers["towns"], image.layers["towns"][4, 4], rtol=1e-9)  # one table
    assert np.all(found.radiance > 0)
    assert np.all(found.error > 0)
    with pytest.raises(DomainError, match="observer"):
        skyscatter.radiance(night, night.observer.position + np.array([0, 0, 9.0]), [0, 0, 1], [550.0])


def test_frames_of_a_sequence_have_towns() -> None:
    town = Town(distance="20 km", azimuth_deg=90, lumens=1e8, spectrum=SPECTRUM)
    camera = skyscatter.Panorama(width=16, height=8)
    night = at_night(town)
    made = frame(field_for([night], camera, [550]), night, camera)
    assert made.radiance == pytest.approx(skyscatter.render(night, camera, [550]).radiance, rel=1e-12)


@pytest.mark.parametrize(
    ("changed", "told"),
    [({"altitude": 30e3}, "altitude"), ({"ground": skyscatter.Ground(map=MAPPED)}, "ground.map")],
)
def test_what_towns_cannot_have_is_refused_before_the_run(changed: dict[str, Any], told: str) -> None:
    night = at_night(Town(distance="20 km", azimuth_deg=90, power=1.0)).model_copy(update=changed)
    with pytest.raises(DomainError, match=told):
        skyscatter.render(night, skyscatter.Panorama(width=8, height=4), [550], solver="single")


def test_polarisation_is_refused() -> None:
    night = at_night(Town(distance="20 km", azimuth_deg=90, power=1.0))
    with pytest.raises(DomainError, match="no polarisation"):
        skyscatter.render(night, skyscatter.Panorama(width=8, height=4), [550], stokes=True)


def test_a_model_file_has_towns(tmp_path: Path) -> None:
    """Written and read again."""
    town = Town.of_people(1e5, distance="20 km", azimuth_deg=0, spectrum="led-4000k")
    path = tmp_path / "own.toml"
    EARTH.model_copy(update={"towns": (town,)}).save(path)
    assert "[[towns]]" in path.read_text(encoding="utf-8")
    assert skyscatter.load_model(str(path)).towns == (town,)  # type: ignore[union-attr]


def test_towns_of_the_command() -> None:
    town = parse_town("20km,135,1e8lm", on_earth=False)
    assert isinstance(town, Town)
    assert (town.distance, town.azimuth_deg, town.lumens, town.radius, town.spectrum) == (
        20e3, 135.0, 1e8, 1000.0, SPECTRUM,
    )  # fmt: skip
    town = parse_town("48.1,11.6,400kW,5km,led-4000k", on_earth=True)
    assert isinstance(town, Town)
    assert (town.latitude_deg, town.watts, town.radius, town.spectrum) == (48.1, 4e5, 5e3, "led-4000k")
    assert parse_town("-33,18,2e6people", on_earth=True).lumens == pytest.approx(5.55e8)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("48.1,11.6,1e8lm", "need --place and --time"), ("20km,135", "give LAT,LON,POWER"), ("20km,135,7", "no unit"),
        ("20km,135,1e8lm,led-9k", "no such lamp"), ("20km,x,1e8lm", "'x' is no angle"), ("20km,0,-5lm", "lumens"),
    ],
)  # fmt: skip
def test_refusals_of_the_command(text: str, told: str) -> None:
    with pytest.raises(DomainError, match=told) as caught:
        parse_town(text, on_earth=False)
    assert "\n" not in str(caught.value)


def test_the_command_lights_its_sky(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With a place by the lights' names, without one beside the Sun; --without towns leaves them out."""
    out = tmp_path / "sky.nc"
    common = ["sky", "earth-simple", "--view", "panorama:180", "--size", "16x8", "--wavelengths", "550", "-q"]
    common += ["-o", str(out)]
    dark = "towns,stars,planets,starlight,zodiacal,airglow,moon"
    night = ["--place", "47,11", "--time", NIGHT]
    assert main([*common, *night, "--lights", "towns", "--town", "20km,90,1e8lm", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["lights"] == ["towns"]
    lit = skyscatter.SpectralImage.load(out).radiance
    assert main([*common, "--sun-elevation", "-60", "--solver", "single", "--town", "20km,90,1e8lm"]) == 0
    assert skyscatter.SpectralImage.load(out).radiance == pytest.approx(lit, rel=1e-6)
    assert main([*common, *night, "--without", dark, "--town", "20km,90,1e8lm"]) == 0
    assert not skyscatter.SpectralImage.load(out).radiance.any()
    refused = (["--town", "48.1,11.6,1e8lm"], [*night, "--lights", "towns"])
    for words in (*refused, [*night, "--lights", "stars", "--town", "20km,90,1e8lm"]):
        capsys.readouterr()
        assert main([*common, *words]) == 2
        assert capsys.readouterr().err.strip().count("\n") == 0


def write_map(path: Path, values: Any, **more: Any) -> None:
    rasterio = pytest.importorskip("rasterio")
    from affine import Affine

    given = {"crs": "EPSG:4326", "transform": Affine(0.01, 0.0, 10.0, 0.0, -0.01, 48.0)} | more
    values = np.asarray(values, np.float32)
    with rasterio.open(
        path, "w", driver="GTiff", height=values.shape[0], width=values.shape[1], count=1, dtype="float32", **given
    ) as file:
        file.write(values, 1)


def test_a_map_is_as_bright_as_its_radiance_says(tmp_path: Path) -> None:
    """L A = P lobe(0) in the band of the satellite; negative pixels and those far away are dark."""
    path, values = tmp_path / "lights.tif", np.zeros((300, 300))
    values[100, 100], values[120, 50], values[0, 0] = 50.0, -3.0, np.nan
    write_map(path, values)
    chart = TownMap(file=str(path), lobe=LambertLobe(), spectrum={"wavelengths": [400, 600], "values": [1, 1]})
    latitude, longitude, watts = chart.read(47.0, 11.0, 6371e3)
    assert (latitude, longitude) == (pytest.approx([46.995]), pytest.approx([11.005]))
    area = (6371e3 * np.radians(0.01)) ** 2 * np.cos(np.radians(46.995))
    # 50 nW cm-2 sr-1 are 5e-4 W m-2 sr-1; Lambert's lobe is 1 / pi; half of the light lies beyond 500 nm.
    assert watts == pytest.approx([5e-4 * area * np.pi / 0.5], rel=1e-6)  # the file has single precision
    assert not chart.model_copy(update={"reach": 100.0}).read(46.0, 11.0, 6371e3)[2].size


def test_a_map_in_metres_is_the_same(tmp_path: Path) -> None:
    from affine import Affine

    place = Affine(500.0, 0.0, 650e3, 0.0, -500.0, 5207e3)
    write_map(tmp_path / "m.tif", [[0.0, 7.0]], crs="EPSG:32632", transform=place)
    latitude, longitude, watts = TownMap(file=str(tmp_path / "m.tif"), lobe=LambertLobe()).read(47.0, 11.0, 6371e3)
    assert latitude == pytest.approx([47.0], abs=0.02)
    assert longitude == pytest.approx([10.98], abs=0.02)
    share = TownMap(file="x", lobe=LambertLobe()).share_of_band
    assert watts == pytest.approx([7e-5 * 500**2 * np.pi / share], rel=1e-6)


def test_maps_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "no.tif").write_text("nothing", encoding="utf-8")
    write_map(tmp_path / "far.tif", [[1.0]])
    for file, told in ((tmp_path / "no.tif", "give a GeoTIFF"), (tmp_path / "none.tif", "no such file")):
        with pytest.raises(SkyscatterError, match=told):
            TownMap(file=str(file)).read(47.0, 11.0, 6371e3)
    with pytest.raises(DomainError, match="does not reach"):
        TownMap(file=str(tmp_path / "far.tif")).read(-30.0, 11.0, 6371e3)
    with pytest.raises(DomainError, match="no such file"):
        parse_map("none.tif,led-4000k", on_earth=True)


@pytest.mark.slow
def test_a_map_of_many_pixels_is_a_town_where_they_are_one(tmp_path: Path) -> None:
    """A hundred thousand pixels, one of them bright: rings of distances against the town alone."""
    values = np.full((400, 300), 1e-9)
    values[80, 100] = 100.0
    write_map(tmp_path / "many.tif", values)
    chart = TownMap(file=str(tmp_path / "many.tif"))
    latitude, longitude, watts = chart.read(47.0, 11.0, 6371e3)
    assert latitude.size > 100_000
    best = int(np.argmax(watts))
    town = Town(
        latitude_deg=float(latitude[best]), longitude_deg=float(longitude[best]), radius=0, watts=float(watts[best]),
        spectrum=SPECTRUM,
    )  # fmt: skip
    camera = skyscatter.Panorama(width=16, height=8)
    one, many = (skyscatter.render(at_night(some), camera, [550]).radiance[:4] for some in (town, chart))
    # Distances of rings are 25 % apart and joined as the power -2.5; errors of walks beside that, 3 of them.
    assert many == pytest.approx(one, rel=0.08)
