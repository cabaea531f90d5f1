"""What sky.js makes of a table in a browser, beside Python's numbers and the pictures of ``skyscatter sky``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from window_skies import WAVELENGTHS, in_browser, picture_difference, pixels

import skyscatter
from skyscatter.geometry.camera import camera_from_view
from skyscatter.geometry.vectors import azimuth_elevation_from_direction
from skyscatter.window.table import SkySettings, SkyTableFile, default_table, make_table

VIEWS = {
    "landscape": {"kind": "landscape"},
    "panorama": {"kind": "panorama"},
    "fisheye": {"kind": "fisheye"},
    "perspective:170,8,50": {"kind": "perspective", "azimuth": 170, "elevation": 8, "fov": 50},
}


def test_numbers_are_those_of_python(tmp_path: Path) -> None:
    """Directions and XYZ of pixels of all views, with changes and the Sun's disk; below 1e-3 they are the same."""
    table = SkyTableFile.from_bytes(default_table())
    size, change = (96, 64), {"haze": 1.2, "ozone": 0.8, "ground": 1.1}
    cases = [
        (name, sun, change if k % 2 else {}) for k, (name, sun) in enumerate(zip(VIEWS, (35, 5, 62, -5), strict=True))
    ]
    asked = [(VIEWS[name], sun, changed) for name, sun, changed in cases]
    script = f"""
    const picture = new SkyPicture(canvas);
    picture.setTable(buffer);
    out.backend = picture.backend;
    out.cases = {json.dumps(asked)}.map(([view, sun, change]) => {{
      picture.set({{sunElevation: sun, sunAzimuth: 200, view, change}});
      const found = [];
      for (let y = 1; y < {size[1]}; y += 5) for (let x = 1; x < {size[0]}; x += 5) {{
        found.push([x, y, picture.direction(x, y), picture.xyz(x, y)]);
      }}
      return found;
    }});
    """
    out = in_browser(table.to_bytes(), script, tmp_path, size)
    observer = SkySettings().scene().observer
    for (name, sun, changed), found in zip(cases, out["cases"], strict=True):
        camera = camera_from_view(name, *size, 200.0, observer)
        grid = camera.directions(observer)
        for x, y, seen, xyz in found:
            if seen is None:
                assert np.isnan(grid[y, x]).all()
                assert xyz is None
                continue
            azimuth, elevation = azimuth_elevation_from_direction(grid[y, x])
            assert seen["elevation"] == pytest.approx(elevation, abs=1e-9)
            assert (seen["azimuth"] - azimuth + 180) % 360 - 180 == pytest.approx(0, abs=1e-9)
            np.testing.assert_allclose(xyz, table.xyz(grid[y, x], sun, 200.0, change=changed), rtol=1e-3)


def test_both_backends_draw_the_same(tmp_path: Path) -> None:
    """WebGL2 in single precision and JavaScript in double: single steps of 8 bits may differ, where one rounds."""
    out = in_browser(
        default_table(),
        """
        const other = document.createElement("canvas");
        [other.width, other.height] = [canvas.width, canvas.height];
        const pictures = [new SkyPicture(canvas), new SkyPicture(other, {backend: "javascript"})];
        out.backends = pictures.map(picture => picture.backend);
        out.shown = pictures.map(picture => {
          picture.setTable(buffer);
          picture.set({sunElevation: 6, sunAzimuth: 185});
          picture.draw();
          return [picture.exposure, picture.canvas.toDataURL()];
        });
        """,
        tmp_path,
        (120, 60),
    )
    if out["backends"][0] != "webgl2":
        pytest.skip("this chromium has no WebGL2: the shader is not tested")
    (exposure, first), (again, second) = out["shown"]
    assert exposure == again
    a, b = pixels(first, tmp_path), pixels(second, tmp_path)
    steps = np.abs(a - b) * 255
    assert steps.max() <= 2.01  # beside the Sun glare is gathered otherwise, from afar to one point
    assert (steps > 0.5).mean() < 0.03


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "sun", "view", "size"),
    [
        ("earth", 20.0, "landscape", (480, 240)),
        ("earth", 2.0, "perspective:170,8,50", (320, 240)),
        ("earth", -4.0, "landscape", (480, 240)),
        ("earth", -10.0, "panorama", (360, 180)),
        ("earth", 50.0, "fisheye", (240, 240)),
        ("earth-hazy", 8.0, "landscape", (480, 240)),
        ("mars", 15.0, "landscape", (480, 240)),
        ("mars", -1.0, "landscape", (480, 240)),
    ],
)
def test_pictures_are_those_of_the_command(
    model: str, sun: float, view: str, size: tuple[int, int], tmp_path: Path
) -> None:
    """The whole chain, with the Sun's disk, glare, exposure, tone and dither, beside a PNG of ``skyscatter sky``."""
    settings = SkySettings(model)
    table = default_table() if model == "earth" else make_table(settings).to_bytes()
    scene = settings.scene().model_copy(update={"sun": skyscatter.Sun(elevation_deg=sun, azimuth_deg=180.0)})
    image = skyscatter.render(scene, camera_from_view(view, *size, 180.0, scene.observer), WAVELENGTHS)
    image.save(tmp_path / "sky.png")
    name, _, rest = view.partition(":")
    shown = (
        {"kind": name, **dict(zip(("azimuth", "elevation", "fov"), map(float, rest.split(",")), strict=True))}
        if rest
        else {"kind": name}
    )
    out = in_browser(
        table,
        f"""
        const picture = new SkyPicture(canvas);
        picture.setTable(buffer);
        picture.set({{sunElevation: {sun}, sunAzimuth: 180, view: {json.dumps(shown)}}});
        picture.draw();
        out.exposure = picture.exposure;
        out.url = canvas.toDataURL();
        """,
        tmp_path,
        size,
    )
    assert out["exposure"] == pytest.approx(image.auto_exposure(), abs=0.02)
    from PIL import Image

    with Image.open(tmp_path / "sky.png") as file:
        exact = np.asarray(file.convert("RGBA"), float) / 255
    drawn = pixels(out["url"], tmp_path)
    np.testing.assert_array_equal(drawn[..., 3], exact[..., 3])
    inside = exact[..., 3] > 0
    found = picture_difference(drawn[..., :3], exact[..., :3])[inside]
    # A step of 8 bits is 0.3 to 0.8 in dark colours, and both pictures round by the same pattern.
    assert np.median(found) < 0.5
    assert np.percentile(found, 99) < 1.5
    assert found.max() < 2.5
