"""The shipped models: complete, honest about their sources, and of the optical depths that they state."""

from __future__ import annotations

import numpy as np
import pytest

import skyscatter
from skyscatter.optics.mie import MieAerosol
from skyscatter.plotting import vertical_optical_depth

NAMES = ("earth", "earth-hazy", "earth-maritime", "earth-observatory", "earth-simple", "mars", "titan")
NEBULAE = ("dark-globule", "dusty-disk", "hii-region", "reflection-nebula", "ring-nebula", "turbulent-pillar")


#: Scenes with lamps, and a nebula that is there for its lamp; tests/unit/test_surface_scene.py reads them all.
LAMPS = ("city-skyglow", "fog-room", "light-guide", "milk-and-water", "searchlight", "star-in-dust")


def test_the_shipped_models_are_these() -> None:
    assert tuple(skyscatter.model_names()) == tuple(sorted((*NAMES, *NEBULAE, *LAMPS)))


@pytest.mark.parametrize("name", NAMES)
def test_a_model_cites_sources_and_survives_being_written(name: str, tmp_path) -> None:
    model = skyscatter.load_model(name)
    assert model.name == name
    assert len(model.description) > 20
    assert model.sources
    model.save(tmp_path / "copy.toml")
    assert skyscatter.load_model(tmp_path / "copy.toml") == model


@pytest.mark.parametrize(
    ("name", "component", "depth"),
    [
        ("earth", "air", 0.0971),  # Bodhaine et al. 1999 over the standard atmosphere
        ("earth", "aerosol", 0.05),
        ("earth-hazy", "haze", 0.45),
        ("earth-maritime", "sea salt", 0.08),
        ("earth-maritime", "water-soluble", 0.02),
        ("earth-observatory", "stratosphere", 0.005),
        ("earth-simple", "air", 13.558e-6 * 8000),
        ("earth-simple", "aerosol", 0.04 * 0.55**-0.8),
        ("mars", "gas", 2.28e-7 * 10860),
        ("mars", "dust", 0.5),
        ("titan", "gas", 2.436e30 * 5.10e-31 * 1.04 * (532 / 550) ** 4.1),  # column times cross section
        ("titan", "haze above 80 km", 1.012e7 * 550**-2.339),  # the power laws of Tomasko et al. 2008
        ("titan", "haze 30 to 80 km", 2.029e4 * 550**-1.409),
        ("titan", "haze below 30 km", 6.270e2 * 550**-0.9706),
    ],
)
def test_vertical_optical_depths_at_550_nm(name: str, component: str, depth: float) -> None:
    found = vertical_optical_depth(skyscatter.load_model(name).medium.component(component), [550.0])[0]
    # Rounded in the files to three or four digits; the tops of exponential shells cut off up to 6e-4; the column of
    # Titan's gas was summed with another interpolation.
    assert found == pytest.approx(depth, rel=6e-3)


def test_the_dust_of_mars_scatters_as_the_landers_saw() -> None:
    dust = skyscatter.load_model("mars").medium.component("dust").optics
    _, albedo, asymmetry = dust.optical_properties([444.0, 671.0])
    # 0.76 and 0.94 by Tomasko et al. 1999; the refractive index here is good to 30 %.
    np.testing.assert_allclose(albedo, [0.76, 0.94], atol=0.05)
    assert asymmetry[0] > asymmetry[1] > 0.65  # blue goes forward more than red


@pytest.mark.parametrize("name", ["earth-maritime", "mars"])
def test_the_tables_of_mie_models_are_quickly_made(name: str) -> None:
    particles = [component.optics for component in skyscatter.load_model(name).components]
    modes = [mode for optics in particles if isinstance(optics, MieAerosol) for mode in optics.modes]
    largest = max(mode.sizes(380e-9)[0].max() for mode in modes)
    # The cost grows with the square of the size parameter; 268 (16 um) takes some 2 s for a picture, 500 would take 7.
    assert 2 * np.pi * largest / 380e-9 < 300
