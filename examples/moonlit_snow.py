"""Snow under the full Moon, eight times as bright as grass is, and few stars."""

from __future__ import annotations

import os

import numpy as np

import skyscatter

width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "320"))
wavelengths = np.arange(380, 781, 40 if width < 200 else 10)

air = skyscatter.load_model("earth")
snowy = air.model_copy(update={"ground": skyscatter.Ground(albedo="snow")})
camera = skyscatter.Panorama(
    width=width, height=width * 3 // 8, fov_deg=120, centre_azimuth_deg=285, elevation_min_deg=-12, elevation_max_deg=33
)
ground = {}
for name, model in (("grass", air), ("snow", snowy)):
    scene = skyscatter.sky_at((67.9, 20.2), "2026-01-04T02:30Z", model=model, altitude="500 m")
    image = skyscatter.render(scene, camera, wavelengths)
    ground[name] = float(image.luminance()[-1].mean())
image.save("moonlit_snow.png", tone="eye")  # rods see most of it, in the blue grey that painters take for moonlight
print(f"the ground below: {ground['grass']:.2g} cd m-2 of grass, {ground['snow']:.2g} of snow")
assert ground["snow"] > 4 * ground["grass"]
