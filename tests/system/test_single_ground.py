"""Light reflected once by grounds of any material: by quadrature as by walks among surfaces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from significance import assert_agrees

import skyscatter
from skyscatter.cli.main import main
from skyscatter.errors import DomainError
from skyscatter.surfaces import Conductor, Lambert, Mirror, Mosaic, RossLi, Rpv, Sea

WAVELENGTHS = [450.0, 550.0, 650.0]
LAND = Rpv(amplitude=0.1, exponent=0.7, asymmetry=-0.15)
CHESS = Mosaic(
    classes=np.indices((9, 9)).sum(axis=0) % 2, materials=(LAND, Lambert(albedo=0.8)), rest=Sea(), cell_size=500
)


def over(material: Any, sun: float, **place: Any) -> skyscatter.Scene:
    """Clear air over some ground, seen from 2 km."""
    model = skyscatter.load_model("earth-simple").model_copy(update={"ground": skyscatter.Ground(material=material)})
    return model.scene(sun_elevation_deg=sun, sun_azimuth_deg=180, altitude=2000.0, **place)


def downwards() -> Any:
    """Towards the glitter, beside it, away from it, and to the sky."""
    east = np.radians([180, 180, 180, 0, 90, 90])
    up = np.radians([-60, -30, -12, -30, -20, 20])
    return np.stack([np.sin(east) * np.cos(up), np.cos(east) * np.cos(up), np.sin(up)], axis=-1)


@pytest.mark.parametrize("sun", [60.0, 12.0])
@pytest.mark.parametrize(
    "material",
    [
        Lambert(albedo=0.3),
        LAND,
        RossLi(isotropic=0.2, volumetric=0.1, geometric=0.03),
        Sea(wind_speed=7),
        Conductor(metal="aluminium", roughness=0.5),
        CHESS,
    ],
    ids=lambda material: material.kind,
)
def test_first_order_is_that_of_walks(material: Any, sun: float) -> None:
    scene = over(material, sun)
    rays = scene.observer.position, downwards(), WAVELENGTHS
    once = skyscatter.radiance(scene, *rays, "single", parts=True)
    walks = skyscatter.radiance(scene, *rays, skyscatter.Path(samples=1024, max_order=1))
    assert np.all(once.layers["ground"][:5] > 0)
    assert np.all(once.layers["ground"][5] == 0)
    # Both are quadratures, to 1e-4 each, and the Sun's disk in seven points misses the glitter by another 1e-4.
    assert np.all(walks.standard_error < 2e-3 * walks.radiance)
    assert_agrees(once.radiance, walks.radiance, walks.standard_error, slack=3e-4)


def test_a_lambertian_material_is_an_albedo() -> None:
    one = over(Lambert(albedo=0.3), 30.0)
    other = one.model_copy(update={"ground": skyscatter.Ground(albedo=0.3)})
    rays = one.observer.position, downwards(), WAVELENGTHS, "single"
    np.testing.assert_allclose(
        skyscatter.radiance(one, *rays).radiance, skyscatter.radiance(other, *rays).radiance, rtol=1e-13
    )


def test_polarised_light_over_land_is_that_over_lambertian_ground() -> None:
    """Land does not polarise: Q and U are the air's alone."""
    scene = over(LAND, 30.0)
    plain = scene.model_copy(update={"ground": skyscatter.Ground(albedo=0.0)})
    rays = scene.observer.position, downwards(), WAVELENGTHS, "single"
    found, air = (skyscatter.radiance(one, *rays, stokes=True) for one in (scene, plain))
    np.testing.assert_array_equal(found.layers["Q"], air.layers["Q"])
    assert np.all(found.radiance[:5] > air.radiance[:5])


@pytest.mark.parametrize(
    ("material", "asked", "words"),
    [
        (Mirror(reflectance=0.9), {}, "mirror.*is smooth.*take path"),
        (Mosaic(classes=[[0]], materials=(Mirror(reflectance=0.9),), rest=Sea(), cell_size=9), {}, "mirror.*is smooth"),
        (Sea(), {"stokes": True}, "polarises what it reflects.*take path"),
    ],
)
def test_what_it_cannot_is_refused(material: Any, asked: dict[str, Any], words: str) -> None:
    scene = over(material, 30.0)
    with pytest.raises(DomainError, match=words):
        skyscatter.radiance(scene, scene.observer.position, downwards(), WAVELENGTHS, "single", **asked)


def test_a_picture_by_command(tmp_path: Path) -> None:
    """The glitter lies below the Sun and not beside it."""
    file, picture = tmp_path / "sea.toml", tmp_path / "sea.exr"
    ground = skyscatter.Ground(material=Sea(wind_speed=5))
    skyscatter.load_model("earth-simple").model_copy(update={"ground": ground}).save(file)
    asked = "--solver single --view perspective:180,-20,100 --altitude 100m --sun-elevation 20 --size 21x7"
    assert main(["sky", str(file), *asked.split(), "-o", str(picture)]) == 0
    light = skyscatter.SpectralImage.load(picture).radiance[..., 0]
    assert light[5, 10] > 5 * light[5, 0] > 0
