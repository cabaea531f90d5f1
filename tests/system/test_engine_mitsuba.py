"""Domes and their Suns in Mitsuba 3: planes of every tilt get the light that skyscatter says.

Tolerance 1 % of the plane's own illuminance in each channel: half a per cent are Mitsuba's pixels, whose first and last
rows it puts on the zenith and the nadir (half a row of 0.7 degrees off), the rest its noise of 0.2 %.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from domes import SUNS, make_dome, normals, own_irradiances
from numpy.typing import NDArray

Array = NDArray[np.float64]
TOLERANCE = 0.01
#: Samples of a plane.
SAMPLES = 65536
#: Distance of the planes and half their size: what one takes from the sky of another is 1e-9.
APART, SIZE = 100.0, 0.01
#: Half of the samples go to each of the lights.
INTEGRATOR = '<integrator type="direct"><integer name="bsdf_samples" value="0"/></integrator>'
#: Columns: where Mitsuba's x, y and z point.  Its environment maps are seen from inside with +y up, +z in the middle
#: and +x on the left; the middle of the dome is north and its left half west.
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


def illuminances(mi: Any, lights: str, folder: Path) -> Array:
    """What white matt planes get from lights, written as a part of a scene in a folder, (normal, 3)."""
    texts, planes = [], []
    for k, n in enumerate(normals()):
        place = np.array([k * APART, 0.0, 0.0])
        aside = [0, 0, 1] if abs(n[2]) < 0.9 else [1, 0, 0]
        at, above, up = (", ".join(f"{x:.12g}" for x in point) for point in (place, place + n, aside))
        texts.append(
            f'<shape type="rectangle"><transform name="to_world"><scale value="{SIZE}"/>'
            f'<lookat origin="{at}" target="{above}" up="{up}"/></transform>'
            '<bsdf type="diffuse"><rgb name="reflectance" value="1, 1, 1"/></bsdf></shape>'
        )
        eye = mi.ScalarTransform4f().look_at(origin=(place + n).tolist(), target=place.tolist(), up=aside)
        film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
        sampler = {"type": "multijitter", "sample_count": SAMPLES, "seed": k}
        planes.append({"type": "perspective", "to_world": eye, "fov": 0.5, "film": film, "sampler": sampler})
    path = folder / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{INTEGRATOR}{lights}{"".join(texts)}</scene>')
    world = mi.load_file(str(path))
    return np.pi * np.array([np.array(mi.render(world, sensor=mi.load_dict(p))).reshape(3) for p in planes])


def dome_light(path: Path, to_world: Array) -> str:
    matrix = " ".join(str(x) for x in to_world.ravel())
    return (
        f'<emitter type="envmap"><string name="filename" value="{path.name}"/>'
        f'<transform name="to_world"><matrix value="{matrix}"/></transform></emitter>'
    )


@pytest.mark.slow
def test_dome_and_lamp_light_planes_of_every_tilt(mitsuba: Any, sun: str, own: Array, tmp_path: Path) -> None:
    make_dome(tmp_path, sun, program="mitsuba")
    found = illuminances(mitsuba, '<include filename="dome.mitsuba.xml"/>', tmp_path)
    print(sun, "greatest", np.abs(found / own - 1).max(axis=0), "mean", np.abs(found / own - 1).mean(axis=0))
    np.testing.assert_allclose(found, own, rtol=TOLERANCE)


@pytest.mark.slow
def test_dome_that_shows_the_sun(mitsuba: Any, sun: str, own: Array, tmp_path: Path) -> None:
    found = illuminances(mitsuba, dome_light(make_dome(tmp_path, sun, disk=True), TO_WORLD), tmp_path)
    print(sun, "greatest", np.abs(found / own - 1).max(axis=0), "mean", np.abs(found / own - 1).mean(axis=0))
    np.testing.assert_allclose(found, own, rtol=TOLERANCE)


@pytest.mark.slow
def test_mirrored_and_turned_domes_are_noticed(mitsuba: Any, own: Array, sun: str, tmp_path: Path) -> None:
    """With east and west, or north and east, exchanged some plane is off by more than the tolerance many times over."""
    path = make_dome(tmp_path, sun, disk=True)
    mirrored = TO_WORLD * np.array([-1, 1, 1, 1])
    swapped = TO_WORLD[[1, 0, 2, 3]]
    for wrong in (mirrored, swapped):
        found = illuminances(mitsuba, dome_light(path, wrong), tmp_path)
        assert np.abs(found / own - 1).max() > 0.3
