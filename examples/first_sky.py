"""The first sky: load a model, place the Sun, look around, save a picture."""

from __future__ import annotations

import os

import numpy as np

import skyscatter

width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "256"))

model = skyscatter.load_model("earth")
scene = model.scene(sun_elevation_deg=10, sun_azimuth_deg=250)
camera = skyscatter.Panorama(width=width, height=width // 4, elevation_min_deg=0, centre_azimuth_deg=250)
image = skyscatter.render(scene, camera, np.arange(380, 781, 10))
image.save("first_sky.png")

luminance = image.luminance()
print(f"first_sky.png: median luminance of the sky {np.median(luminance):.0f} cd/m2")

# With the Sun 10 degrees high, a clear sky has one to a few thousand cd/m2.
assert 500 < np.median(luminance) < 5000
