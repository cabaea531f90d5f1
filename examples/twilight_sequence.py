"""Twilight from sunset to night: one solution, seven positions of the Sun, each strip with its own exposure."""

from __future__ import annotations

import os
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

import skyscatter

width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "300"))
wavelengths = np.arange(400, 721, 40)
elevations = [0, -3, -6, -9, -12, -15, -18]

scene = skyscatter.load_model("earth").scene(sun_azimuth_deg=180)
camera = skyscatter.Panorama(width=width, height=width // 4, elevation_min_deg=0, elevation_max_deg=90)
field = skyscatter.solve(scene, wavelengths, sun_elevations_deg=(-18, 0))
grid = camera.directions(scene.observer)

figure = Figure(figsize=(7.0, 2.0 * len(elevations)), layout="constrained")
zenith = []
for axes, elevation in zip(figure.subplots(len(elevations), 1), elevations, strict=True):
    seen = field.radiance(scene.observer.position, grid, sun_elevation_deg=elevation)
    image = skyscatter.SpectralImage(seen.radiance, wavelengths)
    exposure = image.auto_exposure()
    axes.imshow(image.picture(exposure=exposure))
    axes.set_axis_off()
    axes.set_title(f"Sun {elevation}°, exposure value {exposure:.1f}", fontsize=9)
    zenith.append(float(seen.radiance[0, 0].mean()))
figure.savefig("twilight_sequence.png", dpi=80)

print("zenith:", " ".join(f"{value:.2g}" for value in zenith), "W m-2 sr-1 nm-1")
assert all(later < sooner for sooner, later in pairwise(zenith))
