"""``skyscatter nebula``: what it refuses, and what it hands to model, camera, solver and files (stand-ins here)."""

from __future__ import annotations

import json
import math
import sys
import types
from types import SimpleNamespace

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS

import skyscatter
from skyscatter.cli.main import main
from skyscatter.cli.nebula_options import as_seen
from skyscatter.cli.parse import parse_angle, parse_field, parse_time
from skyscatter.errors import DomainError
from skyscatter.image import FilterImage, SpectralImage
from skyscatter.image.png import read_png
from skyscatter.solvers.base import Answer
from skyscatter.solvers.state import RenderState
from skyscatter.units import PARSEC

WL = "486.27,500.82,656.46,672.55"


def half_a_state():
    state = RenderState.empty({}, 2, 1)
    state.put(slice(0, 1), Answer(np.ones((1, 1)), np.zeros((1, 1)), samples=np.ones(1, np.int64)))
    return state


class Interrupted(Exception):  # noqa: N818 - the name of what it stands for
    def __init__(self, partial, state):
        self.partial, self.state = partial, state


@pytest.fixture
def fake(monkeypatch, tmp_path):
    """A nebula of 2 x 1 x 4 pc at 400 pc, seen along z, and a render function that notes what it is asked for."""
    calls = SimpleNamespace(scene=None, render=None, stop=False, width=None)
    low = np.array([-1.0, -0.5, -2.0]) * PARSEC
    calls.bounds = (low, -low)
    view = {"ra_deg": 83.8, "dec_deg": -5.4, "distance": 400 * PARSEC}
    view |= {"inclination_deg": 0.0, "azimuth_deg": 0.0, "position_angle_deg": 0.0}
    axes = {"right": np.array([1.0, 0, 0]), "up": np.array([0, 1.0, 0]), "forward": np.array([0, 0, -1.0])}

    def scene(**turned):
        calls.scene = turned
        density = SimpleNamespace(bounds=calls.bounds)
        medium = SimpleNamespace(components=[SimpleNamespace(density=density)])
        return SimpleNamespace(medium=medium, view=SimpleNamespace(**{**view, **turned, **axes}))

    def load_model(name):
        if name == "earth":
            return SimpleNamespace(name="earth", command="sky")
        return SimpleNamespace(name="orion", command="nebula", scene=scene, picture_width=calls.width)

    def render(scene, camera, wavelengths, **options):
        calls.render = {"camera": camera, "wavelengths": wavelengths, **options}
        options["progress"](1.0)
        # A corner of large pictures: nothing here looks at more, and smoothing takes its time.
        shape = min(camera.height, 64), min(camera.width, 64), len(wavelengths)
        cube = 1e-9 * np.random.default_rng(2).random(shape)
        halves = {"half_a": 0.98 * cube, "half_b": 1.02 * cube} if options.get("halves") else {}
        image = SpectralImage(cube, wavelengths, 0.02 * cube, recipe={"model": "orion"}, layers=halves)
        if calls.stop:
            options["checkpoint"].begin(half_a_state())
            raise Interrupted(image, options["checkpoint"].state)
        return image

    monkeypatch.setattr(skyscatter, "load_model", load_model, raising=False)
    monkeypatch.setattr(skyscatter, "render", render, raising=False)
    run = types.ModuleType("skyscatter.solvers.run")
    run.Interrupted = Interrupted
    monkeypatch.setitem(sys.modules, "skyscatter.solvers.run", run)
    monkeypatch.chdir(tmp_path)
    return calls


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--size", "512"], ["size", "512x256"]),
        (["--field-of-view", "wide"], ["field_of_view", "'wide'", "10arcmin or 2pc"]),
        (["--field-of-view", "10"], ["field_of_view", "'10'", "unit"]),
        (["--field-of-view", "-2pc"], ["field_of_view"]),
        (["--field-of-view", "180deg"], ["field_of_view_deg", "below 180"]),
        (["--pixel-scale", "0.5"], ["pixel_scale", "0.5arcsec"]),
        (["--pixel-scale", "1arcsec", "--field-of-view", "2pc"], ["not both"]),
        (["--inclination", "steep"], ["inclination_deg", "'steep'"]),
        (["--position-angle", "400"], ["position_angle_deg", "360"]),
        (["--solver", "orders"], ["solver", "path, single"]),
        (["--solver", "single", "--samples", "3"], ["samples", "--solver path"]),
        (["--solver", "single", "--orders", "3"], ["orders", "--solver path"]),
        (["--solver", "single", "--seed", "3"], ["seed", "--solver path"]),
        (["--solver", "photons", "--tolerance", "1%"], ["tolerance", "--solver path"]),
        (["--photons", "1000"], ["photons", "--solver photons"]),
        (["--solver", "photons", "--radius", "wide"], ["radius", "'wide'"]),
        (["--samples", "3", "--noise", "1%"], ["samples = 3: give samples or noise, not both"]),
        (["--tolerance", "20%"], ["tolerance = 0.2: a relative tolerance between 1e-9 and 0.1"]),
        (["--orders", "0"], ["orders", "1 or more"]),
        (["--filters", "V"], ["filters", "FITS"]),
        (["-o", "a.fits", "--filters", "Z"], ["filter", "no such filter"]),
        (["-o", "a.fits", "--filters", "U,V"], ["'U'", "needs light"]),
        (["-o", "a.fits", "--palette", "sho"], ["palette", "PNG"]),
        (["-o", "a.fits", "--bits", "16"], ["bits", "PNG"]),
        (["--palette", "loud"], ["palette", "sho, hubble"]),
        (["--palette", "V,B"], ["filters", "three"]),
        (["--palette", "sho", "--tone", "filmic"], ["tone", "lupton or linear"]),
        (["--palette", "sho", "--exposure", "3"], ["exposure"]),
        (["--tone", "lupton"], ["tone", "filmic, linear"]),
        (["--stretch", "3"], ["stretch", "palette"]),
        (["--palette", "sho", "--softening", "soft"], ["softening", "above 0"]),
        (["--space", "cmyk"], ["cmyk"]),
        (["--bits", "12"], ["8 or 16"]),
        (["--psf", "box:2"], ["psf", "gaussian:FWHM"]),
        (["--aperture", "2.4m"], ["--exposure-time"]),
        (["--exposure-time", "600s"], ["--aperture"]),
        (["--aperture", "0m", "--exposure-time", "600s"], ["aperture", "2.4m"]),
        (["--aperture", "2.4m", "--exposure-time", "600"], ["exposure_time", "600s"]),
        (["--aperture", "2.4m", "--exposure-time", "6s", "--throughput", "120%"], ["throughput", "100 %"]),
        (["--throughput", "30%"], ["throughput", "--aperture"]),
        (["--resume", "gone.npz"], ["gone.npz"]),
    ],
)
def test_wrong_input_is_refused_in_one_line(fake, capsys, tmp_path, arguments, words):
    named = arguments if "-o" in arguments else ["-o", "out.png", *arguments]
    assert main(["nebula", "orion", *named]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("skyscatter: error: ")
    assert captured.err.count("\n") == 1
    for word in words:
        assert word in captured.err
    assert fake.render is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["orion"], "nothing would be kept"),
        (["earth", "--json"], "skyscatter sky"),
        (["-o", "a.png"], "argument 'model'"),
    ],
)
def test_more_refusals(fake, capsys, arguments, word):
    assert main(["nebula", *arguments]) == 2
    assert word in capsys.readouterr().err.replace("'MODEL'", "'model'")  # older releases of typer shout
    assert fake.render is None


def test_defaults(fake, capsys):
    assert main(["nebula", "orion", "-o", "a.png"]) == 0
    assert fake.scene == {}
    asked = fake.render
    expected = {"solver": skyscatter.Path(samples=4), "resume": None, "threads": None}
    assert {key: asked[key] for key in expected} == expected
    assert not {"orders", "stokes"} & set(asked)
    camera = asked["camera"]
    assert (camera.kind, camera.width, camera.height) == ("telescope", 512, 512)
    # all of it: the longer side seen along z is 2 pc, with a margin of 5 %, at 400 pc
    assert camera.pixel_scale_deg * 512 == pytest.approx(math.degrees(1.05 * 2 / 400), rel=1e-9)
    error = capsys.readouterr().err
    assert "at 400 pc" in error
    assert "median noise 2 %, smoothed in the picture; EV -" in error


def test_a_model_says_which_width_shows_it_well(fake):
    fake.width = 0.5 * PARSEC
    for words, width in (([], 0.5), (["--inclination", "30"], None), (["--field-of-view", "1pc"], 1.0)):
        assert main(["nebula", "orion", "--size", "8x8", "-q", "-o", "a.png", *words]) == 0
        across = 2.0 * 1.05 if width is None else width  # turned, all of it: something may stick out
        expected = math.degrees(2 * math.atan(across / 400 / 2))
        found = 8 * fake.render["camera"].pixel_scale_deg
        assert found == pytest.approx(expected, rel=1e-4), words  # 1e-5 between the angle and its tangent


def test_pictures_of_no_stated_size_have_seeing(fake):
    """The first look is softened as in a telescope, files with data are not, and nor is what was asked for in full."""
    for words, blurred in (
        (["--samples", "8"], True),
        (["--size", "512x512"], False),
        (["--size", "512x512", "--smooth"], True),
        (["--psf", "gaussian:9"], False),
    ):
        assert main(["nebula", "orion", "-q", "-o", "a.png", "-o", "a.nc", "--wavelengths", "550", *words]) == 0
        recipe = json.loads(read_png("a.png").texts["skyscatter-recipe"])
        assert recipe.get("seeing_pixels") == (2.0 if blurred else None)
        assert "seeing_pixels" not in SpectralImage.load("a.nc").recipe
        assert (fake.render["camera"].width, fake.render["camera"].height) == (512, 512)


def test_seeing_keeps_light_and_softens_noise():
    noisy = SpectralImage(np.random.default_rng(4).normal(1.0, 0.1, (64, 64, 2)), [500.0, 600.0])
    assert as_seen(noisy, 0.0) is noisy
    seen = as_seen(noisy, 2.5).radiance
    assert seen.mean() == pytest.approx(1.0, abs=0.01)  # its own chance: 0.1 / 64
    # white noise falls by 2 sigma sqrt(pi), sigma being 2.5 / 2.355: 3.76 times; 64 x 64 values give it to some 5 %
    assert 0.1 / seen.std() == pytest.approx(3.76, rel=0.1)
    point = np.zeros((31, 31, 1))
    point[15, 15] = 1.0
    spread = as_seen(SpectralImage(point, [500.0]), 4.0).radiance[..., 0]
    assert spread[15, 17] / spread[15, 15] == pytest.approx(0.5, rel=1e-6)  # half of the maximum at half the width
    assert spread.sum() == pytest.approx(1.0, rel=1e-4)  # the kernel ends at 4 sigma


def test_everything_given(fake, capsys):
    words = "nebula orion --size 30x20 --field-of-view 10arcmin --inclination 30 --azimuth -10 --position-angle 45 "
    words += f"--wavelengths {WL} --noise 2% --tolerance 1% --max-order 5 --orders 3 --sampling delta --seed 7 "
    words += "--threads 2 --palette sho --stretch 0.2 --softening 5 --bits 16 -o a.png -o b.exr -o c.fits -o d.nc "
    words += "--filters oiii,halpha --psf moffat:30:2.5 --aperture 2.4m --exposure-time 2h --throughput 30% -q"
    assert main(words.split()) == 0
    assert capsys.readouterr() == ("", "")
    assert fake.scene == {"inclination_deg": 30.0, "azimuth_deg": -10.0, "position_angle_deg": 45.0}
    solver = skyscatter.Path(noise=0.02, tolerance=0.01, max_order=5, sampling="delta", seed=7)
    assert [fake.render[key] for key in ("solver", "orders", "threads")] == [solver, 3, 2]
    image = SpectralImage.load("d.nc")
    assert image.sky is not None
    assert image.sky.name == "orion"
    assert image.sky.distance == pytest.approx(400 * PARSEC)
    done = image.recipe["observation"]
    assert done["psf"] == {"kind": "moffat", "fwhm_arcsec": 30.0, "beta": 2.5}
    assert done["collecting_area_m2"] == pytest.approx(math.pi * 1.2**2)
    assert (done["exposure_s"], done["throughput"], done["seed"]) == (7200.0, 0.3, 7)
    assert FilterImage.load("c.fits").names == ("oiii", "halpha")
    with fits.open("c.fits") as hdus:
        middle = WCS(hdus[0].header).celestial.pixel_to_world(14.5, 9.5)
        assert (middle.ra.deg, middle.dec.deg) == pytest.approx((83.8, -5.4))
    told = json.loads(read_png("a.png").texts["skyscatter-picture"])
    assert (told["palette"], told["stretch"], told["softening"]) == ("sho", 0.2, 5.0)


@pytest.mark.parametrize(
    ("arguments", "scale"),
    [
        (["--pixel-scale", "2arcsec"], 2.0 / 3600.0),
        (["--field-of-view", "4pc"], math.degrees(4 / 400) / 20),
        (["--field-of-view", "1deg"], math.degrees(2 * math.tan(math.radians(0.5))) / 20),
    ],
)
def test_scale_of_the_picture(fake, arguments, scale):
    assert main(["nebula", "orion", "--size", "20x10", "--json", *arguments]) == 0
    assert fake.render["camera"].pixel_scale_deg == pytest.approx(scale, rel=1e-9)


def test_a_tall_picture_holds_the_whole_nebula(fake):
    assert main(["nebula", "orion", "--size", "40x10", "--json"]) == 0
    # 1 pc high over 10 pixels is coarser than 2 pc over 40
    assert fake.render["camera"].pixel_scale_deg == pytest.approx(math.degrees(1.05 * 1 / 400 / 10), rel=1e-9)


def test_an_endless_nebula_needs_a_width(fake, capsys):
    fake.bounds = (np.full(3, -np.inf), np.full(3, np.inf))
    assert main(["nebula", "orion", "--json"]) == 2
    assert "--field-of-view" in capsys.readouterr().err


def test_json(fake, capsys):
    arguments = ["nebula", "orion", "--json", "--wavelengths", WL, "--solver", "single", "--size", "8x6"]
    arguments += [
        "--aperture",
        "1m",
        "--exposure-time",
        "60s",
        "--seed",
        "3",
        "-o",
        "a.png",
        "--palette",
        "oiii,hbeta,sii",
    ]
    assert main(arguments) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["view"]["distance_pc"] == pytest.approx(400.0)
    assert (summary["model"], summary["size"], summary["solver"]) == ("orion", [8, 6], "single")
    assert (summary["noise"], summary["seed"], summary["exposure_ev"]) == (None, None, None)
    assert summary["observation"]["seed"] == 3  # of the photons; the solver has no use for it
    assert (summary["complete"], summary["outputs"]) == (True, ["a.png"])
    told = json.loads(read_png("a.png").texts["skyscatter-picture"])
    assert told["filters"] == ["oiii", "hbeta", "sii"]


def test_narrow_bands_get_wavelengths_of_their_own(fake):
    assert main(["nebula", "orion", "--size", "4x3", "-o", "a.png", "--palette", "hoo"]) == 0
    assert {654.46, 656.46, 658.46, 500.82} <= set(fake.render["wavelengths"].round(9))
    assert main(["nebula", "orion", "--size", "4x3", "-o", "a.fits", "--filters", "V,nii"]) == 0
    assert 658.53 in fake.render["wavelengths"]
    assert main(["nebula", "orion", "--size", "4x3", "-o", "a.fits"]) == 0
    np.testing.assert_array_equal(fake.render["wavelengths"], np.arange(380.0, 781.0, 10.0))
    assert main(["nebula", "orion", "--size", "4x3", "-o", "a.png", "--palette", "sho", "--wavelengths", WL]) == 0
    assert fake.render["wavelengths"].size == 4  # what is named is what is computed


def test_accuracy_of_the_light_scattered_once(fake):
    assert main(["nebula", "orion", "--size", "4x3", "--json", "--solver", "single", "--tolerance", "1e-5"]) == 0
    assert fake.render["solver"].tolerance == 1e-5


def test_stated_exposure(fake, capsys):
    words = ["--size", "4x3", "--json", "--exposure", "-20", "-o", "a.png", "--tone", "linear"]
    assert main(["nebula", "orion", *words]) == 0
    assert json.loads(capsys.readouterr().out)["exposure_ev"] == -20.0
    assert json.loads(read_png("a.png").texts["skyscatter-picture"])["ev100"] == -20.0


def test_interruption_keeps_what_is_finished(fake, capsys, tmp_path):
    fake.stop = True
    assert main(["nebula", "orion", "-o", "a.fits", "--size", "4x3"]) == 130
    assert (tmp_path / "a.fits.partial.zarr" / "values" / "c").is_dir()
    error = capsys.readouterr().err
    assert "skyscatter nebula orion -o a.fits --size 4x3 --resume a.fits.partial.zarr" in error
    assert "interrupted with 50.0 %" in error
    assert SpectralImage.load("a.partial.fits").sky is not None
    assert not (tmp_path / "a.fits").exists()


def test_angles_lengths_and_times():
    assert parse_angle("30arcsec", "a") == pytest.approx(1 / 120)
    assert parse_angle("2 mas", "a") == pytest.approx(2 / 3600e3)
    assert parse_field("1.5deg") == ("angle", 1.5)
    assert parse_field("10 arcmin") == ("angle", pytest.approx(1 / 6))
    assert parse_field("2pc") == ("length", pytest.approx(2 * PARSEC))
    assert parse_field("1e16m") == ("length", 1e16)
    assert (parse_time("20min", "t"), parse_time("2 h", "t"), parse_time("5s", "t")) == (1200.0, 7200.0, 5.0)
    for wrong in ("", "arcmin", "0deg", "nandeg", "1parsecs", "3"):
        with pytest.raises(DomainError):
            parse_field(wrong)


def test_photons_are_asked_for_with_their_options(fake):
    words = "--solver photons --photons 5000 --radius 0.01pc --estimator both --samples 8 -o out.png -q"
    assert main(["nebula", "orion", *words.split(), "--wavelengths", "450,550,650"]) == 0
    solver = fake.render["solver"]
    assert (solver.name, solver.samples, solver.photons, solver.estimator) == ("photons", 8, 5000, "both")
    assert solver.radius == pytest.approx(0.01 * PARSEC)


def test_pictures_are_smoothed_and_data_are_not(fake):
    for words, even in (
        ([], True),
        (["--no-smooth"], False),
        (["--samples", "3"], False),  # no halves of an odd number, and nobody asked for them
        (["--sampling", "free-flight"], False),
        (["--size", "24x24"], False),
        (["--size", "24x24", "--smooth"], True),
    ):
        assert main(["nebula", "orion", "-q", "-o", "a.png", "-o", "a.nc", "--wavelengths", "550", *words]) == 0
        assert ("smoothed" in json.loads(read_png("a.png").texts["skyscatter-recipe"])) is even
        assert bool(fake.render.get("halves")) is even
        data = SpectralImage.load("a.nc")
        assert "smoothed" not in data.recipe
        assert data.layers == {}
        # the walks themselves, as the stand-in has them
        np.testing.assert_array_equal(data.error, 0.02 * data.radiance)


def test_what_has_nothing_to_smooth_says_so(fake, capsys):
    for words, told in (
        (["-o", "a.nc", "--smooth"], "PNG"),
        (["-o", "a.png", "--denoise", "--smooth"], "--denoise does too"),
        (["-o", "a.png", "--solver", "single", "--smooth"], "no noise"),
        (["-o", "a.png", "--smooth", "--azimuths", "0:90:45"], "several sides"),
    ):
        assert main(["nebula", "orion", "-q", *words]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "smooth" in error
        assert told in error


def test_pictures_take_fewer_wavelengths_than_data(fake):
    for words, count in (
        (["-o", "a.png"], 14),
        (["-o", "a.png", "-o", "a.nc"], 41),
        (["-o", "a.png", "--wavelengths", "450,550"], 2),
    ):
        assert main(["nebula", "orion", "-q", "--size", "8x8", *words]) == 0
        assert len(fake.render["wavelengths"]) == count
