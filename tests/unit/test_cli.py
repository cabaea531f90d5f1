"""The command line: what it refuses and how, what it loads, and what it hands to the solver (a stand-in here)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import types
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import model_validator

import skyscatter
from skyscatter.cli import common, polarised
from skyscatter.cli.main import main
from skyscatter.cli.parse import parse_noise, parse_show, parse_size, parse_wavelengths
from skyscatter.errors import DomainError, ModelFileError, SkyscatterError
from skyscatter.geometry.sun import sun_position
from skyscatter.image.colour import xyz_weights
from skyscatter.optics.base import Coefficients
from skyscatter.record import Record
from skyscatter.solvers.base import Answer
from skyscatter.solvers.state import Checkpoint, RenderState

HEAVY = ("numba", "astropy", "colour", "matplotlib")


class Image:
    """Stands in for SpectralImage: notes where it was saved."""

    polarised = False

    def __init__(self):
        self.radiance = np.array([[[2.0, np.nan]]])
        self.standard_error = np.array([[[0.02, np.nan]]])
        self.saved = {}

    def auto_exposure(self):
        return 12.5

    def mean_colour(self):
        return {"chromaticity": [0.3, 0.3], "temperature_K": 7000, "dominant_wavelength_nm": 480.0}

    def save(self, path, **options):
        self.saved[Path(path).name] = options
        Path(path).write_text("image")


class PolarisedImage(Image):
    """Two pixels, of degree 0.5 and 0.25 at 450 nm and twice that at 550 nm, and one outside the field."""

    polarised = True

    def __init__(self):
        super().__init__()
        self.wavelengths = np.array([450.0, 550.0])
        self.radiance = np.array([[[2.0, 2.0], [4.0, 4.0], [np.nan, np.nan]]])
        self.standard_error = 0.01 * self.radiance
        q = self.radiance * np.array([0.5, 0.25, 0.0])[None, :, None] * [1.0, 2.0]
        self.layers = {"Q": 0.6 * q, "U": -0.8 * q, "V": 0 * q}


def state(finished):
    """That of a picture of two pixels."""
    made = RenderState.empty({}, 2, 1)
    one = np.ones((finished, 1))
    made.put(slice(0, finished), Answer(one, 0 * one, samples=np.ones(finished, np.int64)))
    return made


class Interrupted(Exception):  # noqa: N818 - the name of what it stands for
    def __init__(self, partial, state):
        self.partial, self.state = partial, state


@pytest.fixture
def fake(monkeypatch, tmp_path):
    """A model, a scene and a render function that record what they are asked for."""
    calls = SimpleNamespace(scene=None, render=None, image=Image(), stop=False, finished=1)

    class Place(Record):
        altitude: float

        @model_validator(mode="after")
        def _check(self):
            if self.altitude < 0:
                raise DomainError("altitude", self.altitude, "never below the ground")
            return self

    def scene(**options):
        calls.scene = options
        Place(altitude=options["altitude"])
        return SimpleNamespace(
            observer=SimpleNamespace(altitude=options["altitude"], planet_radius=6371e3, atmosphere_top=1e5),
            sun=SimpleNamespace(
                elevation_deg=options["sun_elevation_deg"],
                azimuth_deg=options["sun_azimuth_deg"],
            ),
            star_distance=options.get("sun_distance_au", 1.5) * 149597870700.0,
            lights=None,
        )

    def scene_at(latitude, longitude, time, altitude, lights=None):
        sun = sun_position(latitude, longitude, time, altitude)
        found = scene(**{f"sun_{name}": value for name, value in sun._asdict().items()}, altitude=altitude)
        found.sun.site, found.lights = None, lights(sun.elevation_deg)
        return found

    def load_model(name):
        if name not in ("earth", "mars"):
            raise ModelFileError(name, "no such model; choose earth or mars")
        planet = SimpleNamespace(name=name.capitalize())
        return SimpleNamespace(name=name, command="sky", planet=planet, scene=scene, scene_at=scene_at)

    def render(scene, camera, wavelengths, **options):
        calls.render = {"camera": camera, "wavelengths": wavelengths, **options}
        options["progress"](1.0)
        if calls.stop:
            options["checkpoint"].begin(state(calls.finished), options["resume"])
            raise Interrupted(calls.image, options["checkpoint"].state)
        return calls.image

    monkeypatch.setattr(skyscatter, "load_model", load_model, raising=False)
    monkeypatch.setattr(skyscatter, "render", render, raising=False)
    run = types.ModuleType("skyscatter.solvers.run")
    run.Interrupted = Interrupted
    monkeypatch.setitem(sys.modules, "skyscatter.solvers.run", run)
    monkeypatch.chdir(tmp_path)
    return calls


def finished(checkpoint):
    """Pixels in a checkpoint."""
    made = RenderState.empty({}, 2, 1)
    Checkpoint("other.zarr").begin(made, checkpoint)
    return made.done.sum()


def refused(capsys, arguments):
    """The one line that a refused command prints."""
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("skyscatter: error: ")
    return lines[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--bogus"], ["--bogus"]),
        (["earth", "mars"], ["mars"]),
        (["--size", "512"], ["size", "'512'", "512x256"]),
        (["--size", "0x4"], ["size", "'0x4'"]),
        (["--size", "-3x4"], ["size", "'-3x4'"]),
        (["--size", "99999x4"], ["65536"]),
        (["--wavelengths", "380:780"], ["wavelengths", "START:STOP:STEP"]),
        (["--wavelengths", "780:380:5"], ["wavelengths", "stop not below start"]),
        (["--wavelengths", "380:780:0"], ["step"]),
        (["--wavelengths", "380:780:1e-9"], ["wavelengths", "at most"]),
        (["--wavelengths", "550,450"], ["wavelengths", "increase"]),
        (["--wavelengths", "blue"], ["wavelengths", "'blue'", "380:780:5"]),
        (["--wavelengths", "380:blue:5"], ["wavelengths", "'380:blue:5'", "380:780:5"]),
        (["--wavelengths", "0,1"], ["positive"]),
        (
            ["--solver", "path", "--noise", "0"],
            ["noise = 0.0: a relative standard error between 0 and 1, such as 0.01"],
        ),
        (["--solver", "path", "--noise", "200%"], ["noise = 2.0"]),
        (["--noise", "little"], ["noise = 'little': a relative standard error between 0 and 1"]),
        (["--solver", "path", "--samples", "1"], ["samples = 1: a whole number, at least 2"]),
        (["--samples", "many"], ["samples", "'many'"]),
        (["--samples", "1.5"], ["samples", "'1.5'"]),
        (["--samples"], ["--samples", "argument"]),
        (["--solver", "path", "--samples", "4", "--noise", "1%"], ["samples = 4: give samples or noise, not both"]),
        (["--seed", "-1"], ["seed = -1", "from 0 to 2^63 - 1"]),
        (["--seed", "9" * 30], ["seed", "2^63 - 1"]),
        (["--show", "phase"], ["show", "'phase'", "degree"]),
        (["--show", "colour:550"], ["show", "'colour:550'", "degree:550"]),
        (["--show", "degree:"], ["show", "'degree:'", "degree:550"]),
        (["--show", "degree:blue"], ["show", "'degree:blue'", "degree:550"]),
        (["--show", "degree:555"], ["555", "the nearest is 550 nm"]),
        (["--show", "degree", "--wavelengths", "1000:1500:100"], ["none is visible", "1000"]),
        (["--show", "degree", "--tone", "linear"], ["tone", "--show degree"]),
        (["--show", "angle", "--exposure", "12"], ["exposure", "--show angle"]),
        (["--show", "angle", "--space", "srgb"], ["space", "--show angle"]),
        (["--threads", "0"], ["threads", "'0'"]),
        (["--max-order", "0"], ["max_order = 0: a whole number, at least 1"]),
        (["--solver", "magic"], ["solver", "'magic'", "orders, path, single"]),
        (["--solver", "single", "--samples", "3"], ["samples", "single"]),
        (["--solver", "single", "--noise", "1%"], ["noise", "single"]),
        (["--solver", "single", "--max-order", "3"], ["max_order", "single", "--solver orders"]),
        (["--solver", "single", "--seed", "3"], ["seed = 3", "single", "--solver path"]),
        (["--samples", "16"], ["samples = 16", "orders", "--solver path"]),
        (["--noise", "1%"], ["noise = 0.01", "orders", "--solver path"]),
        (["--tolerance", "0"], ["tolerance = 0.0: a relative tolerance between 0.0001 and 0.1"]),
        (["--tolerance", "20%"], ["tolerance = 0.2"]),
        (["--tolerance", "fine"], ["tolerance = 'fine'", "between"]),
        (["--altitude", "high"], ["altitude", "'high'", "km"]),
        (["--view", "globe"], ["view", "'globe'", "fisheye"]),
        (["--view", "perspective:0,0,200"], ["fov_deg", "200", "below 180"]),
        (["--view", "planet"], ["altitude", "above"]),
        (["--sun-elevation", "91"], ["sun_elevation", "91"]),
        (["--sun-azimuth", "1000"], ["sun_azimuth", "1000"]),
        (["--sun-elevation", "nan"], ["sun_elevation", "nan"]),
        (["--sun-elevation", "low"], ["sun_elevation", "'low'"]),
        (["--place", "48,2"], ["place", "--time"]),
        (["--time", "2026-06-21"], ["time", "--place"]),
        (["--place", "48,2", "--time", "2026-06-21", "--sun-elevation", "3"], ["place", "--sun-elevation"]),
        (["--place", "48,2", "--time", "2026-06-21", "--sun-azimuth", "3"], ["place", "--sun-azimuth"]),
        (["--place", "Paris", "--time", "2026-06-21"], ["place", "'Paris'", "48.86,2.35"]),
        (["--place", "95,2", "--time", "2026-06-21"], ["latitude", "95"]),
        (["--place", "48,2", "--time", "noon"], ["time", "'noon'", "ISO 8601"]),
        (["--exposure", "bright"], ["exposure", "'bright'", "auto"]),
        (["--tone", "neon"], ["tone", "'neon'", "filmic"]),
        (["--space", "cmyk"], ["cmyk", "srgb"]),
        (["--space", "acescg"], ["acescg", "srgb"]),
        (["--bits", "12"], ["bits", "12", "8 or 16"]),
        (["-o", "sky.gif"], ["sky.gif", ".png"]),
        (["-o", "nowhere/sky.png"], ["nowhere", "folder"]),
        (["-o", "folder.png"], ["folder.png", "folder"]),
        (["-o", "sky.png", "-o", "./sky.png"], ["twice"]),
        (["--resume", "gone.npz"], ["gone.npz", "no such checkpoint"]),
        (["pluto"], ["pluto", "earth or mars"]),
        (["--altitude", "-5m"], ["altitude = -5.0", "never below"]),
    ],
)
def test_wrong_input_is_refused_in_one_line(fake, capsys, tmp_path, arguments, words):
    (tmp_path / "folder.png").mkdir()
    line = refused(capsys, ["sky", *(["-o", "out.png"] if "-o" not in arguments else []), *arguments])
    for word in words:
        assert word in line
    assert fake.render is None
    assert not (tmp_path / "out.png").exists()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ([], "nothing would be kept"),
        (["-o", "a.exr", "--show", "degree"], "PNG"),
        (["-o", "a.exr", "--tone", "linear"], "PNG"),
        (["--json", "--bits", "16"], "PNG"),
    ],
)
def test_options_without_effect_are_refused(fake, capsys, arguments, word):
    assert word in refused(capsys, ["sky", *arguments])
    assert fake.render is None


def test_folder_without_permission_is_refused(fake, capsys, monkeypatch):
    monkeypatch.setattr("os.access", lambda *_: False)  # root may write everywhere, so the answer is played
    assert "may not be written to" in refused(capsys, ["sky", "-o", "sky.png"])


@pytest.mark.parametrize(
    "arguments", [["models", "show"], ["models", "show", "pluto"], ["models", "check", "gone.toml"], ["models", "x"]]
)
def test_wrong_models_are_refused(fake, capsys, arguments):
    refused(capsys, arguments)


def test_plot_of_unknown_kind_is_refused(fake, capsys):
    assert ".svg" in refused(capsys, ["models", "show", "earth", "--plot", "model.bmp"])


def test_defaults(fake, capsys):
    assert main(["sky", "-o", "sky.png"]) == 0
    assert fake.scene == {"sun_elevation_deg": 30.0, "sun_azimuth_deg": 180.0, "altitude": 1000.0}
    camera = fake.render["camera"]
    assert (camera.kind, camera.width, camera.height, camera.centre_azimuth_deg) == ("panorama", 1280, 480, 180.0)
    # 120 degrees wide, and as many degrees to a pixel upwards; a sixth below the horizon, which is 1.015 degrees deep
    assert (camera.fov_deg, camera.elevation_max_deg - camera.elevation_min_deg) == (120.0, pytest.approx(45.0))
    assert camera.elevation_min_deg == pytest.approx(-7.5 - 1.015, abs=1e-3)  # the digits given
    assert fake.render["wavelengths"][[0, 1, -1]].tolist() == [380, 390, 780]
    expected = {"solver": skyscatter.Orders(), "threads": None}
    assert {key: fake.render[key] for key in expected} == expected
    assert fake.render["resume"] is None
    assert fake.image.saved == {"sky.png": {"exposure": 12.5, "tone": "photograph", "space": "srgb", "bits": 8}}
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "Sun at elevation 30.00°" in captured.err
    assert "solver orders, median estimated error 1 %;" in captured.err


@pytest.mark.parametrize(
    ("words", "altitude", "kind", "size"),
    [
        ("", 1000.0, "panorama", (1280, 480)),
        ("--altitude 2m", 2.0, "panorama", (1280, 480)),
        ("--altitude 400km", 4e5, "panorama", (1280, 480)),
        ("--altitude 36000km", 36e6, "planet", (256, 256)),
        ("--altitude 36000km --size 9x8", 36e6, "planet", (9, 8)),
        ("--size 640x240", 1000.0, "panorama", (640, 240)),
        ("--view panorama", 0.0, "panorama", (360, 180)),
        ("--view landscape:90,60", 0.0, "panorama", (1280, 480)),
        ("--north", 0.0, "panorama", (360, 180)),  # domes are of the whole sphere, from the ground
        ("--no-sun", 0.0, "panorama", (360, 180)),
        ("--solver path", 1000.0, "panorama", (480, 180)),  # walks cost a hundred times more a pixel
        ("--stokes", 1000.0, "panorama", (480, 180)),
    ],
)
def test_the_view_suits_the_observer(fake, words, altitude, kind, size):
    fake.image = PolarisedImage() if "stokes" in words else fake.image
    assert main(["sky", "-o", "sky.fits", "-q", *words.split()]) == 0
    camera = fake.render["camera"]
    assert (fake.scene["altitude"], camera.kind, (camera.width, camera.height)) == (altitude, kind, size)
    whole = words in ("--view panorama", "--north", "--no-sun")
    assert kind == "planet" or (camera.fov_deg == 360.0) == whole


def test_everything_given(fake, capsys):
    words = "sky mars --sun-elevation -6 --sun-azimuth 250 --altitude 400km --view fisheye-equisolid --size 30x20"
    words += " --wavelengths 450,550nm,0.65um --solver path --noise 2% --seed 7 --threads 2 --order-limit 3"
    words += " --exposure -1.5 --tone linear --space rec2020 --bits 16 -o a.png -o b.exr -o c.fits -o d.nc --quiet"
    assert main(words.split()) == 0
    assert fake.scene == {"sun_elevation_deg": -6.0, "sun_azimuth_deg": 250.0, "altitude": 400e3}
    asked = fake.render
    assert (asked["camera"].projection, asked["camera"].width, asked["camera"].height) == ("equisolid", 30, 20)
    assert asked["wavelengths"].tolist() == [450, 550, 650]
    assert [asked[key] for key in ("solver", "threads")] == [skyscatter.Path(noise=0.02, seed=7, max_order=3), 2]
    png = {"exposure": -1.5, "tone": "linear", "space": "rec2020", "bits": 16}
    assert fake.image.saved == {"a.png": png, "b.exr": {}, "c.fits": {}, "d.nc": {}}
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(("text", "value"), [("2%", 0.02), ("0.001", 0.001)])
def test_accuracy_and_order_limit_of_the_default_solver(fake, capsys, text, value):
    assert main(["sky", "--json", "--tolerance", text, "--max-order", "2"]) == 0
    assert fake.render["solver"] == skyscatter.Orders(tolerance=value, max_order=2)
    assert json.loads(capsys.readouterr().out)["tolerance"] == value


@pytest.mark.parametrize(("asked", "words"), [("0.5%", ", more than the 0.5 % asked for;"), ("1%", "error 1 %;")])
def test_a_missed_tolerance_is_said(fake, capsys, asked, words):
    assert main(["sky", "--tolerance", asked, "-o", "sky.png"]) == 0
    assert f"{words} EV" in capsys.readouterr().err


def test_place_and_time_set_the_sun(fake):
    assert main(["sky", "--place", "-33.9,151.2", "--time", "2026-12-21T02:00Z", "-o", "sky.png", "-q"]) == 0
    # Sydney, two hours after its clock noon: high in the north-west
    assert 70 < fake.scene["sun_elevation_deg"] < 85
    assert 0.983 < fake.scene["sun_distance_au"] < 0.985
    assert fake.render["camera"].centre_azimuth_deg == pytest.approx(fake.scene["sun_azimuth_deg"])


@pytest.mark.parametrize("arguments", [["--stokes"], ["--show", "degree"], ["--stokes", "--show", "angle:550"]])
def test_polarised_light(fake, capsys, arguments):
    fake.image = PolarisedImage()
    command = ["sky", "--json", "--wavelengths", "450,550", "-o", "a.png", "-o", "b.exr", "--bits", "16", *arguments]
    assert main(command) == 0
    assert fake.render["stokes"] is True
    show = arguments[-1].partition(":")[0]
    png = {
        "--stokes": {"exposure": 12.5, "tone": "photograph", "space": "srgb", "bits": 16},
        "degree": {"show": "degree", "wavelength": None, "bits": 16},
        "angle": {"show": "angle", "wavelength": 550.0, "bits": 16},
    }[show]
    assert fake.image.saved == {"a.png": png, "b.exr": {}}
    polarisation = json.loads(capsys.readouterr().out)["polarisation"]
    weights = xyz_weights([450.0, 550.0])[:, 1]
    factor = 2.0 if show == "angle" else weights @ [1.0, 2.0] / weights.sum()
    assert polarisation["mean_degree"] == pytest.approx(0.375 * factor)
    assert polarisation["maximum_degree"] == pytest.approx(0.5 * factor)
    assert polarisation["wavelength_nm"] == (550.0 if show == "angle" else None)
    assert main(command[:1] + command[2:]) == 0
    assert f"degree of linear polarisation {37.5 * factor:.2g} % on average" in capsys.readouterr().err


def test_unpolarised_light_is_the_default(fake, capsys):
    assert main(["sky", "--json"]) == 0
    assert "stokes" not in fake.render
    assert json.loads(capsys.readouterr().out)["polarisation"] is None
    assert parse_show("colour") == ("colour", None, None)


@pytest.mark.parametrize("case", ["dark", "invisible"])
def test_where_no_degree_is_defined_it_is_null(case):
    image = PolarisedImage()
    if case == "dark":
        image.radiance = 0 * image.radiance
    else:
        image.wavelengths = np.array([1000.0, 1100.0])
    assert polarised.summary(image) == {
        "mean_degree": None,
        "maximum_degree": None,
        "wavelength_nm": None,
    }


def test_a_solver_without_polarisation_refuses_in_one_line(fake, capsys, monkeypatch):
    def render(*_, **options):
        raise DomainError("stokes", options["stokes"], "means nothing to the solver single; leave it out")

    monkeypatch.setattr(skyscatter, "render", render, raising=False)
    assert "stokes = True" in refused(capsys, ["sky", "--stokes", "--solver", "single", "-o", "a.png", "-q"])


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (1.0, "100 %"), (0.996, "100 %"), (0.5, "50 %"), (0.0123, "1.2 %"), (2e-6, "0.0002 %"), (12.0, "1200 %"),
        (0.0, "0 %"),
    ],
)  # fmt: skip
def test_per_cent_without_exponents(share, text):
    assert common.percent(share) == text


def test_folder_that_takes_no_files_is_refused(fake, capsys, monkeypatch):
    def refuse(**_):
        raise FileNotFoundError(2, "No such file or directory")  # what /proc answers, even to root

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    assert "takes no new files" in refused(capsys, ["sky", "-o", "sky.png"])
    assert fake.render is None


@pytest.mark.parametrize(
    ("solver", "errors"),
    [
        ("orders", {"noise": None, "estimated_error": 0.01, "seed": None}),
        ("path", {"noise": 0.01, "estimated_error": None, "seed": 0}),
        ("single", {"noise": None, "estimated_error": None, "seed": None}),
    ],
)
def test_json_is_one_object_on_stdout(fake, capsys, solver, errors):
    assert main(["sky", "--json", "--sun-elevation", "10", "--solver", solver, "-o", "sky.exr"]) == 0
    captured = capsys.readouterr()
    summary = json.loads(captured.out)
    assert captured.err == ""
    assert summary["sun"] == {"elevation_deg": 10.0, "azimuth_deg": 180.0, "distance_au": 1.5}
    assert {name: summary[name] for name in errors} == errors
    assert summary["outputs"] == ["sky.exr"]
    assert (summary["solver"], summary["model"], summary["complete"]) == (solver, "earth", True)
    assert (summary["exposure_ev"], summary["skyscatter"]) == (12.5, skyscatter.__version__)
    assert summary["colour"]["dominant_wavelength_nm"] == 480.0
    assert summary["seconds"] >= 0


def test_interruption_keeps_what_is_finished(fake, capsys, tmp_path):
    fake.stop = True
    assert main(["sky", "earth", "-o", "my sky.png", "--resume=old.zarr"]) == 2  # there is no such checkpoint
    capsys.readouterr()
    state(1).save("old.zarr")
    assert main(["sky", "earth", "-o", "my sky.png", "--resume", "old.zarr"]) == 130
    assert fake.render["resume"] == Path("old.zarr")
    assert not (tmp_path / "my sky.png").exists()
    assert (tmp_path / "my sky.partial.png").exists()
    assert finished("old.zarr") == 1
    err = capsys.readouterr().err
    assert "skyscatter sky earth -o 'my sky.png' --resume old.zarr" in err
    assert "interrupted with 50.0 %" in err
    fake.stop = False
    assert main(["sky", "earth", "-o", "my sky.png", "--resume", "old.zarr"]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"my sky.png"}


def test_a_finished_picture_is_not_replaced_by_an_unfinished_one(fake, capsys, tmp_path):
    fake.stop = True
    (tmp_path / "sky.png").write_text("finished")
    assert main(["sky", "-o", "sky.png"]) == 130
    assert (tmp_path / "sky.png").read_text() == "finished"
    assert finished("sky.png.partial.zarr") == 1
    assert "--resume sky.png.partial.zarr" in capsys.readouterr().err
    # Another run at the same place says what it will replace.
    assert main(["sky", "-o", "sky.png"]) == 130
    assert "sky.png.partial.zarr of an interrupted run will be replaced" in capsys.readouterr().err


def test_nothing_is_written_where_nothing_was_finished(fake, capsys, tmp_path):
    fake.stop, fake.finished = True, 0
    assert main(["sky", "-o", "sky.png", "--json"]) == 130
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr() == ("", "skyscatter: interrupted\n")


def test_no_clobber_refuses_before_any_work(fake, capsys, tmp_path):
    (tmp_path / "b.exr").write_text("old")
    line = refused(capsys, ["sky", "-o", "a.png", "-o", "b.exr", "--no-clobber"])
    assert "b.exr" in line
    assert "--no-clobber" in line
    assert fake.render is None
    assert main(["sky", "-o", "a.png", "--no-clobber"]) == 0


@pytest.mark.parametrize("words", [["--json", "out.json"], ["--json", "-"], ["--json=out.json"]])
@pytest.mark.parametrize("command", [["sky"], ["dehaze", "in.tif"], ["invert", "earth"]])
def test_json_is_a_flag_everywhere(capsys, command, words):
    line = refused(capsys, [*command, *words])
    assert "write --json > FILE" in line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--progress", "dots"], "choose one of auto, bar, log, none"),
        (["--quiet", "--verbose"], "contradicts --quiet"),
        (["--quiet", "--progress", "log"], "contradicts --quiet"),
        (["--checkpoint", "5"], "give a time above 0 with its unit"),
    ],
)
def test_what_is_said_and_kept_is_checked(fake, capsys, words, said):
    assert said in refused(capsys, ["sky", "-o", "sky.png", *words])


def test_a_picture_that_cannot_be_written_leaves_the_way_to_go_on(fake, capsys, monkeypatch, tmp_path):
    def full(path, **options):
        raise SkyscatterError("sky.png: cannot be written: the disk is full")

    def render(scene, camera, wavelengths, **options):
        options["checkpoint"].begin(state(2))
        return fake.image

    monkeypatch.setattr(skyscatter, "render", render)
    monkeypatch.setattr(fake.image, "save", full)
    assert main(["sky", "-o", "sky.png"]) == 2
    err = capsys.readouterr().err
    assert "the disk is full" in err
    assert "--resume sky.png.partial.zarr" in err
    assert (tmp_path / "sky.png.partial.zarr").exists()


def test_interruption_without_outputs_keeps_a_checkpoint(fake, capsys, tmp_path):
    fake.stop = True
    assert main(["sky", "--json"]) == 130
    assert (tmp_path / "skyscatter.partial.zarr").exists()
    assert json.loads(capsys.readouterr().out)["complete"] is False


def test_keyboard_interrupt_elsewhere_is_130(fake, capsys, monkeypatch):
    def stop(name):
        raise KeyboardInterrupt

    monkeypatch.setattr(skyscatter, "load_model", stop, raising=False)
    assert main(["sky", "-o", "sky.png"]) == 130
    assert capsys.readouterr().err == "skyscatter: interrupted\n"


def test_an_unexpected_error_is_1(fake, capsys, monkeypatch):
    def broken(name):
        raise RuntimeError("two\nlines")

    monkeypatch.setattr(skyscatter, "load_model", broken, raising=False)
    assert main(["sky", "-o", "sky.png"]) == 1
    err = capsys.readouterr().err
    assert err.startswith("skyscatter: internal error: RuntimeError: two lines")
    assert err.count("\n") == 1
    monkeypatch.setenv("SKYSCATTER_TRACEBACK", "1")
    with pytest.raises(RuntimeError):
        main(["sky", "-o", "sky.png"])


@pytest.mark.parametrize(("solver", "name"), [("path", "noise"), ("orders", "estimated_error")])
def test_an_unknown_error_is_null(fake, capsys, solver, name):
    fake.image.standard_error = None
    assert main(["sky", "--json", "--solver", solver]) == 0
    assert json.loads(capsys.readouterr().out)[name] is None


def test_resume_is_taken_out_of_the_command():
    assert common.without_resume(["sky", "--resume", "a", "-o", "b"]) == ["sky", "-o", "b"]
    assert common.without_resume(["sky", "--resume=a", "-o", "b"]) == ["sky", "-o", "b"]


def test_wavelength_ranges_include_both_ends():
    np.testing.assert_allclose(parse_wavelengths("380:780:5"), np.arange(380, 781, 5))
    # 0.1 is not exact in binary, yet the last node belongs to the range; tolerance is rounding
    np.testing.assert_allclose(parse_wavelengths("500:501:0.1"), np.linspace(500, 501, 11), rtol=1e-15)
    assert parse_wavelengths("380:389:5").tolist() == [380, 385]
    assert parse_wavelengths("550").tolist() == [550]


def test_noise_in_percent_or_as_a_fraction():
    assert parse_noise("1%") == parse_noise("0.01") == 0.01
    assert parse_noise(None) is None


def test_size_defaults_to_the_view():
    assert parse_size(None, "panorama-upper") == (360, 90)
    assert parse_size(None, "perspective:0,0,50") == (384, 256)
    assert parse_size("3X2", "fisheye") == (3, 2)


def loaded_by(arguments):
    """Exit status and heavy modules loaded by a command, in a process of its own."""
    code = (
        "import sys\n"
        "from skyscatter.cli.main import main\n"
        f"status = main({arguments!r})\n"
        f"print('LOADED', [name for name in {HEAVY!r} if name in sys.modules], status)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["--help"], 0),
        (["sky", "--help"], 0),
        (["nebula", "--help"], 0),
        (["models", "--help"], 0),
        (["--version"], 0),
        (["info"], 0),
        ([], 2),
        (["sky", "--size", "big", "-o", "x.png"], 2),
        (["sky", "--bogus"], 2),
        (["sky", "-o", "x.gif"], 2),
        (["sky", "-o", "x.png", "--tone", "neon"], 2),
        (["nebula", "m", "-o", "x.png", "--palette", "neon"], 2),
        (["nebula", "m", "-o", "x.fits", "--filters", "neon"], 2),
    ],
)
def test_help_and_argument_errors_load_nothing_heavy(arguments, status):
    assert loaded_by(arguments) == f"LOADED [] {status}"


def test_importing_the_package_loads_nothing_heavy():
    code = f"import sys, skyscatter; raise SystemExit(str([n for n in {HEAVY!r} if n in sys.modules] or ''))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"skyscatter {skyscatter.__version__}\n"


def test_the_package_runs_as_a_module():
    # In a process of its own: the program changes what signals do.
    done = subprocess.run([sys.executable, "-m", "skyscatter", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"skyscatter {skyscatter.__version__}\n"


@pytest.mark.parametrize(
    ("words", "home"),
    [(["info"], {}), (["info"], {"HOME": "/nonexistent"}), (["models", "check", "earth"], {"HOME": "/nonexistent"})],
)
def test_no_home_is_needed(home, words, tmp_path):
    lost = ("HOME", "NUMBA_CACHE_DIR", "SKYSCATTER_CACHE", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR")
    environment = {name: value for name, value in os.environ.items() if name not in lost} | home
    command = [sys.executable, "-m", "skyscatter", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_info_lists_versions_and_the_cache(capsys, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/some/where")
    assert main(["info"]) == 0
    out = capsys.readouterr().out
    assert np.__version__ in out
    assert "/some/where" in out


class Optics:
    """Grey scattering, a little absorption, isotropic."""

    def __init__(self, scattering):
        self.scattering = scattering

    def coefficients(self, wavelengths, column):
        one = np.ones(len(wavelengths))
        return Coefficients(self.scattering * one, 1e-6 * one, 0 * one)

    def phase_function(self, wavelengths):
        return SimpleNamespace(value=lambda cosine, wl: np.full((len(cosine), len(wl)), 1 / (4 * np.pi)))


@pytest.fixture
def small_model(monkeypatch):
    """A model of a scatterer and a pure absorber, each 8 km deep."""
    density = SimpleNamespace(density=lambda h: np.exp(-np.asarray(h) / 8e3), vertical_column=lambda h: 8e3)
    components = [
        SimpleNamespace(name="air", weight=1.0, density=density, optics=Optics(1e-5)),
        SimpleNamespace(name="soot", weight=2.0, density=density, optics=Optics(0.0)),
    ]
    model = SimpleNamespace(
        name="small",
        command="sky",
        description="two components",
        sources=["a test"],
        planet=SimpleNamespace(name="Earth", radius=6371e3),
        top=1e5,
        components=components,
    )
    monkeypatch.setattr(skyscatter, "load_model", lambda name: model, raising=False)
    monkeypatch.setattr(skyscatter, "model_names", lambda: ["small"], raising=False)
    return model


def test_models_are_listed(small_model, capsys):
    assert main(["models"]) == 0
    assert capsys.readouterr().out == "skies (skyscatter sky):\n  small  two components\n"


def test_a_model_is_shown_with_its_optical_depths_and_sources(small_model, capsys):
    assert main(["models", "show", "small"]) == 0
    out = capsys.readouterr().out
    assert "0.088" in out  # (1e-5 + 1e-6) x 8000
    assert "0.104" in out  # with twice the absorber's 1e-6 x 8000
    assert "- a test" in out
    assert "radius 6371 km" in out


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_a_model_is_drawn(small_model, tmp_path, suffix):
    path = tmp_path / f"model.{suffix}"
    assert main(["models", "show", "small", "--plot", str(path)]) == 0
    start = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[suffix]
    assert path.read_bytes().startswith(start)
    assert list(tmp_path.iterdir()) == [path]


def test_the_drawing_shows_densities_depths_and_phase_functions(small_model):
    from skyscatter.plotting import model_figure

    profiles, depths, phases = model_figure(small_model).axes
    assert [line.get_label() for line in depths.get_lines()] == ["air", "soot", "all"]
    assert len(profiles.get_lines()) == 2
    (phase,) = phases.get_lines()  # the absorber scatters nothing
    assert phase.get_label() == "air"
    np.testing.assert_allclose(depths.get_lines()[2].get_ydata(), 0.104, rtol=1e-12)  # rounding


def test_a_good_model_passes_the_check(small_model, capsys):
    assert main(["models", "check", "small.toml"]) == 0
    assert capsys.readouterr().out == "small.toml: good (2 components, 1 sources)\n"


def test_a_model_with_negative_scattering_fails_the_check(small_model, capsys):
    small_model.components[0].optics.scattering = -1e-5
    assert "component air: scattering" in refused(capsys, ["models", "check", "small.toml"])


def test_a_model_without_any_air_fails_the_check(small_model, capsys):
    small_model.components[0].density.vertical_column = lambda h: 0.0
    assert "vertical column" in refused(capsys, ["models", "check", "small.toml"])
