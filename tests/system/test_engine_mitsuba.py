"""Domes and their Suns in Mitsuba 3: planes of every tilt get the light that skyscatter says.

Tolerance 1 % of the plane's own illuminance in each channel: half a per cent are Mitsuba's pixels, whose first and last
rows it puts on the zenith and the nadir (half a row of 0.7 degrees off), the rest its noise of 0.2 %.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from domes import SUNS, lamp_of, make_dome, normals, own_irradiances
from numpy.typing import NDArray

Array = NDArray[np.float64]
TOLERANCE = 0.01
#: Samples of a plane.
SAMPLES = 16384
#: Distance of the planes and half their size: what one takes from the sky of another is 1e-9.
APART, SIZE = 100.0, 0.01
#: Columns: where Mitsuba's x, y and z point.  Its environment maps are seen from inside with +y up and +z in the middle,
#: +x on the left; the middle of the dome is north and its left half west.
TO_WORLD = np.array([[-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float)


@pytest.fixture(scope="module")
def mitsuba() -> Any:
    mi = pytest.importorskip("mitsuba", reason="Mitsuba is not installed (pip install mitsuba)")
    mi.set_variant("scalar_rgb")
    return mi


@pytest.fixture(scope="module", params=sorted(SUNS))
def sun(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def own(sun: str) -> Array:
    return own_irradiances(sun)


def illuminances(mi: Any, lights: dict[str, Any]) -> Array:
    """What white matt planes get from lights, (normal, 3)."""
    scene = {"type": "scene", "integrator": {"type": "direct", "bsdf_samples": 0, "emitter_samples": 1}, **lights}
    planes = []
    for k, n in enumerate(normals()):
        place = np.array([k * APART, 0.0, 0.0])
        aside = [0, 0, 1] if abs(n[2]) < 0.9 else [1, 0, 0]
        turn = mi.ScalarTransform4f().look_at(origin=place.tolist(), target=(place + n).tolist(), up=aside)
        scene[f"plane{k}"] = {
            "type": "rectangle", "to_world": turn @ mi.ScalarTransform4f().scale(SIZE),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}},
        }  # fmt: skip
        eye = mi.ScalarTransform4f().look_at(origin=(place + n).tolist(), target=place.tolist(), up=aside)
        film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
        sampler = {"type": "multijitter", "sample_count": SAMPLES, "seed": k}
        planes.append({"type": "perspective", "to_world": eye, "fov": 0.5, "film": film, "sampler": sampler})
    world = mi.load_dict(scene)
    return np.pi * np.array([np.array(mi.render(world, sensor=mi.load_dict(p))).reshape(3) for p in planes])


def dome_light(mi: Any, path: Path, to_world: Array = TO_WORLD) -> dict[str, Any]:
    return {"dome": {"type": "envmap", "filename": str(path), "to_world": mi.ScalarTransform4f(to_world.tolist())}}


def sun_light(path: Path) -> dict[str, Any]:
    lamp = lamp_of(path)["sun"]
    direction = [-x for x in lamp["direction"]]
    return {"sun": {"type": "directional", "direction": direction, "irradiance": {"type": "rgb", "value": lamp["rgb"]}}}


@pytest.mark.slow
def test_dome_and_lamp_light_planes_of_every_tilt(mitsuba: Any, sun: str, own: Array, tmp_path: Path) -> None:
    path = make_dome(tmp_path, sun)
    # Apart, for Mitsuba would send half of its samples to the Sun.
    found = illuminances(mitsuba, dome_light(mitsuba, path)) + illuminances(mitsuba, sun_light(path))
    print(sun, np.abs(found / own - 1).max(axis=0), np.abs(found / own - 1).mean(axis=0))
    np.testing.assert_allclose(found, own, rtol=TOLERANCE)


@pytest.mark.slow
def test_dome_that_shows_the_sun(mitsuba: Any, sun: str, own: Array, tmp_path: Path) -> None:
    found = illuminances(mitsuba, dome_light(mitsuba, make_dome(tmp_path, sun, disk=True)))
    print(sun, np.abs(found / own - 1).max(axis=0), np.abs(found / own - 1).mean(axis=0))
    np.testing.assert_allclose(found, own, rtol=TOLERANCE)
