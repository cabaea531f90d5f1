"""Optical depth along slant paths through the air, and its ratio to the vertical one: the air mass."""

from __future__ import annotations

import numpy as np

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation

model = skyscatter.load_model("earth")
scene = model.scene()
observer = scene.observer.position

elevation = np.array([90.0, 60.0, 30.0, 20.0, 10.0, 5.0])
# Any end outside the atmosphere will do: above its top there is nothing.
ends = observer + 3e6 * direction_from_azimuth_elevation(np.zeros_like(elevation), elevation)
depth = skyscatter.optical_depth(scene, observer, ends, [550.0], by_component=True)[..., 0]
air_mass = depth / depth[0]

names = [component.name for component in scene.medium.components]
print("elevation  Kasten & Young  " + "  ".join(f"{name:>8}" for name in names))
# Kasten & Young (1989), Appl. Opt. 28, 4735: a fit to the refracted paths through a standard atmosphere.
formula = 1 / (np.sin(np.radians(elevation)) + 0.50572 * (elevation + 6.07995) ** -1.6364)
for angle, expected, row in zip(elevation, formula, air_mass, strict=True):
    print(f"{angle:8.0f}°  {expected:14.3f}  " + "  ".join(f"{value:8.3f}" for value in row))

# Ozone stands high, so that the Earth's roundness shortens its slant paths; aerosol lies low. Down to 10 degrees the
# straight paths of air agree with the formula, which knows refraction, to half a per cent.
assert np.all(np.abs(air_mass[:-1, 0] / formula[:-1] - 1) < 5e-3)
