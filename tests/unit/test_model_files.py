"""Model files: the shipped ones, and what a user's own may say or not."""

from __future__ import annotations

import re
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest

from skyscatter import Model, Scene, load_model, model_names, optical_depth
from skyscatter.cli.main import main
from skyscatter.errors import ModelFileError
from skyscatter.models.files import parse_model

SHIPPED = ("earth", "earth-hazy", "earth-maritime", "earth-observatory", "earth-simple", "mars", "titan")

GOOD = """
name = "toy"
description = "A \\"quoted\\" planet with a back\\\\slash and a\\nnew line."
sources = ["nowhere"]

[planet]
name = "Toy"
radius = "1000 km"

[ground]
albedo = { wavelengths = [400, 700], values = [0.1, 0.3] }

[star]
spectrum = "blackbody"
temperature = 4000
limb_darkening = false

[[components]]
name = "air"
density = { kind = "exponential", scale_height = "8 km" }
optics = { kind = "rayleigh", coefficient = 1e-5 }

[[components]]
name = "dust"
weight = 0.5
density = { kind = "tabulated", altitudes = [0, "1 km"], densities = [1.0, 0.5] }
optics = { kind = "particles", optical_depth = 0.1, phase = { kind = "draine", g = 0.7, alpha = 0.5 } }
"""


def test_the_promised_models_are_shipped() -> None:
    assert set(SHIPPED) <= set(model_names())


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_model_loads_and_cites_its_sources(name: str) -> None:
    model = load_model(name)
    assert model.name == name
    assert model.description.endswith(".")
    assert model.sources
    assert all(len(s) > 20 for s in model.sources)
    assert model.top == max(c.density.top_altitude for c in model.components) > 0


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_model_round_trips(name: str, tmp_path: Path) -> None:
    model = load_model(name)
    assert parse_model(tomllib.loads(model.to_toml()), "text") == model
    model.save(tmp_path / "copy.toml")
    assert load_model(tmp_path / "copy.toml") == model
    assert load_model(str(tmp_path / "copy.toml")).to_toml() == model.to_toml()


#: Vertical optical depths at 550 nm that the models' descriptions state or imply; half of the last digit and the
#: spread of the sources (Titan's haze: Tomasko et al. 2008, 8.1, and some 1.1 of Rayleigh scattering).
DEPTHS = {
    "earth": (0.18, 0.02), "earth-hazy": (0.58, 0.03), "earth-maritime": (0.23, 0.03), "earth-simple": (0.17, 0.02),
    "earth-observatory": (0.17, 0.02), "mars": (0.5, 0.05), "titan": (9.2, 0.5),
}  # fmt: skip


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_model_has_the_stated_optical_depth(name: str) -> None:
    model = load_model(name)
    radius = model.planet.radius
    tau = optical_depth(
        Scene(medium=model.medium), [0, 0, radius], [0, 0, radius + model.top], [400.0, 550.0, 700.0], by_component=True
    )
    assert np.all(np.isfinite(tau))
    assert tau.min() >= 0
    expected, spread = DEPTHS[name]
    assert tau.sum(axis=0)[1] == pytest.approx(expected, abs=spread)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_model_makes_scenes(name: str) -> None:
    scene = load_model(name).scene(sun_elevation_deg=-4, sun_azimuth_deg=250, altitude="10 km")
    assert scene.altitude == 1e4
    assert scene.sun.elevation_deg == -4
    assert np.all((scene.ground.reflectance([400.0, 700.0]) >= 0) & (scene.ground.reflectance([400.0, 700.0]) <= 1))


def test_a_model_of_ones_own(tmp_path: Path) -> None:
    path = tmp_path / "toy.toml"
    path.write_text(GOOD, encoding="utf-8")
    model = load_model(path)
    assert model.planet.radius == 1e6
    assert model.components[1].density.altitudes == (0.0, 1000.0)
    assert model.description == 'A "quoted" planet with a back\\slash and a\nnew line.'
    assert parse_model(tomllib.loads(model.to_toml()), "text") == model


def test_a_model_built_in_python_is_the_model_of_the_file() -> None:
    content = tomllib.loads(GOOD)
    assert Model(**content) == parse_model(content, "text")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('radius = "1000 km"', "", ["planet.radius is missing", "add it"]),
        ('radius = "1000 km"', "radius = -5", ["planet", "radius = -5", "positive length"]),
        ('radius = "1000 km"', 'radius = "5 lightyears"', ["planet.radius", "lightyears", "km"]),
        ('name = "toy"', "", ["name is missing"]),
        (
            'name = "toy"',
            'name = "toy"\ncolour = "red"',
            ["colour = 'red'", "no such field", "there are name, description"],
        ),
        ("temperature = 4000", "temperature = -1", ["star", "temperature = -1", "positive"]),
        ("temperature = 4000", 'temperature = "hot"', ["star.temperature", "hot"]),
        ("values = [0.1, 0.3]", "values = [0.1, 1.3]", ["ground", "albedo = 1.3", "between 0 and 1"]),
        ("values = [0.1, 0.3]", "values = [0.1]", ["ground.albedo", "same length"]),
        (
            "coefficient = 1e-5",
            "coefficient = -1e-5",
            ["components.0 (air).optics", "coefficient = -1e-05", "never negative"],
        ),
        (
            "coefficient = 1e-5",
            "coeficient = 1e-5",
            ["components.0 (air).optics", "coeficient = 1e-05", "did you mean coefficient?"],
        ),
        ("[planet]", "[plannet]", ["plannet: no such field", "did you mean planet?"]),
        ('radius = "1000 km"', 'raduis = "1000 km"', ["planet", "raduis = '1000 km'", "did you mean radius?"]),
        ('name = "toy"', 'name = "toy"\nsource = []', ["source: no such field", "did you mean sources?"]),
        (
            "wavelengths = [400, 700]",
            "wavelength = [400, 700]",
            ["ground.albedo.wavelength: no such field", "did you mean wavelengths?"],
        ),
        ('kind = "exponential"', 'kin = "exponential"', ["components.0 (air).density.kin", "did you mean kind?"]),
        ('kind = "exponential", ', "", ["components.0 (air).density.kind is missing"]),
        ("weight = 0.5", "weight = -0.5", ["components.1 (dust)", "weight = -0.5"]),
        (
            "weight = 0.5",
            "wieght = 0.5",
            ["components.1 (dust)", "wieght = 0.5", "no such field", "did you mean weight?"],
        ),
        (
            "densities = [1.0, 0.5]",
            "densities = [1.0, -0.5]",
            ["components.1 (dust).density.densities.1 = -0.5: is never negative"],
        ),
        ('kind = "draine"', 'kind = "drain"', ["components.1 (dust).optics", "drain", "henyey-greenstein"]),
        ('kind = "exponential"', 'kind = "exp"', ["components.0 (air).density", "exp", "exponential"]),
        ("g = 0.7", "g = 1.7", ["components.1 (dust).optics", "g = 1.7", "between -1 and 1"]),
        ('name = "dust"', 'name = "air"', ["air", "rename one"]),
        ("optical_depth = 0.1", "optical_depth = nan", ["components.1 (dust).optics", "optical_depth", "nan"]),
        ('sources = ["nowhere"]', "sources = 5", ["sources = 5"]),
    ],
)
def test_wrong_files_are_refused_in_one_line(tmp_path: Path, old: str, new: str, words: list[str]) -> None:
    assert old in GOOD
    path = tmp_path / "wrong.toml"
    path.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ModelFileError) as caught:
        load_model(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"name = ", ["is not TOML"]), (b"\xff\xfe", ["is not TOML"])],
)
def test_broken_files(tmp_path: Path, content: bytes, words: list[str]) -> None:
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(ModelFileError) as caught:
        load_model(path)
    assert "\n" not in str(caught.value)
    assert all(word in str(caught.value) for word in words)


def test_unknown_names_and_missing_files_say_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match=r"pluto: no such model; choose from .*earth.*titan.*\.toml"):
        load_model("pluto")
    with pytest.raises(ModelFileError, match="cannot be read"):
        load_model(tmp_path / "absent.toml")
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(ModelFileError, match="cannot be read"):
        load_model(tmp_path / "folder.toml")


def test_no_components_is_refused(tmp_path: Path) -> None:
    content = tomllib.loads(GOOD) | {"components": []}
    with pytest.raises(ModelFileError, match="at least one component"):
        parse_model(content, "text")


def test_all_that_is_wrong_is_said_in_one_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "wrong.toml"
    text = GOOD.replace('radius = "1000 km"', 'raduis = "1000 km"').replace("coefficient = 1e-5", 'coefficient = "2 s"')
    text = text.replace('kind = "draine"', 'kind = "drain"').replace("densities = ", "values = ")
    text = text.replace("temperature = 4000", 'temperature = "30 deg"').replace('"8 km"', "-8")
    path.write_text(text.replace("weight = 0.5", "weight = true"), encoding="utf-8")
    assert main(["models", "check", str(path)]) == 2
    lines = [line.removeprefix(f"skyscatter: error: {path}: ") for line in capsys.readouterr().err.splitlines()]
    assert [line.split(" = ")[0].split(":")[0] for line in lines] == [
        "planet.raduis", "star.temperature", "components.0 (air).density.scale_height",
        "components.0 (air).optics.coefficient", "components.1 (dust).density.values",
        "components.1 (dust).optics.phase.kind", "components.1 (dust).weight",
    ]  # fmt: skip
    assert "'30 deg': give a temperature, such as \"4000 K\"" in lines[1]
    assert lines[2].endswith("= -8: must be a positive length")
    assert lines[4].endswith("no such field; did you mean densities?")
    assert "no such kind here; did you mean draine? there are isotropic, rayleigh," in lines[5]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("expo", "did you mean exponential? there are exponential, uniform, tent, gaussian, chapman, tabulated, us-"),
        ("sphere", "does not fit a planet with its air; choose exponential, uniform,"),
        ("everywhere", "does not fit a planet with its air; choose exponential, uniform,"),
    ],
)
def test_kinds_are_those_of_the_place(kind: str, words: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        parse_model(tomllib.loads(GOOD.replace('kind = "exponential"', f'kind = "{kind}"')), "text")
    message = str(caught.value).splitlines()[0]
    assert message.startswith(f"text: components.0 (air).density.kind = '{kind}': ")
    assert words in message
    assert "plummer" not in message


def test_kinds_of_nebulae_and_scenes_are_their_own() -> None:
    component = {"name": "a", "density": {"kind": "exponentia"}, "optics": {"kind": "mee"}}
    for content, there, absent in (
        ({"view": {}, "components": [component]}, "there are sphere, gaussian-sphere", "everywhere"),
        ({"media": [{"name": "a", "components": [component]}], "viewpoint": {}}, "everywhere", "us-standard-1976"),
    ):
        with pytest.raises(ModelFileError) as caught:
            parse_model({"name": "x", **content}, "text")
        density = next(line for line in str(caught.value).splitlines() if ".density.kind" in line)
        assert there in density
        assert absent not in density
    with pytest.raises(ModelFileError, match=r"camera\.kind = 'orb': no such kind here; there are panorama, fisheye"):
        parse_model({"name": "x", "viewpoint": {}, "camera": {"kind": "orb"}}, "text")


def test_a_misspelt_model_is_guessed() -> None:
    with pytest.raises(ModelFileError, match=r"marss: no such model; did you mean mars\?"):
        load_model("marss")


def test_a_planet_smaller_than_its_air_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = r'planet\.radius = 1000 m is less than the height of its air, \d+ m; if kilometres are meant, give "1000 km"'
    path = tmp_path / "toy.toml"
    path.write_text(GOOD.replace('"1000 km"', '"1000 m"'))
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["models", "check", str(path)]) == 0
    assert re.search(told, capsys.readouterr().err)
    with pytest.warns(UserWarning, match=told):
        load_model(path).scene()
    path.write_text(GOOD)
    assert main(["models", "check", str(path)]) == 0  # and any warning is an error
