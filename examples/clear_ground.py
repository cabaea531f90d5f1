"""A landscape under haze as a satellite sees it, and the landscape again, with what remains unknown of it."""

import os

import numpy as np

import skyscatter
from skyscatter.dehaze import Atmosphere, Flag, build_table, load_sensor
from skyscatter.dehaze.forward import reflectance_above
from skyscatter.dehaze.sensing import gases
from skyscatter.dehaze.table import Angles

size = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "128"))
names = ("B02", "B03", "B04", "B8A", "B12")
sun, haze = 40.0, 0.3

# Leaves and soil in patches.
leaves = np.array([0.027, 0.058, 0.031, 0.36, 0.085])
soil = np.array([0.09, 0.13, 0.18, 0.27, 0.30])
y, x = np.mgrid[:size, :size] / size
share = np.clip(0.5 + 0.8 * np.sin(9 * x + 2 * np.sin(5 * y)) * np.sin(7 * y), 0, 1)
surface = leaves[:, None, None] * (1 - share) + soil[:, None, None] * share

# The air above it: terms of the forward model, and what gases leave of the light.
sensor = load_sensor("sentinel-2a")
bands = [sensor.band(name) for name in names]
atmosphere = Atmosphere(aerosol="urban")
table = build_table(atmosphere, bands, Angles.spanned(sun, 0.0, 0.0), aod=haze)
terms, _ = table.at(haze, sun, 0.0, 0.0)
gas = gases(bands, np.array([sun]), np.array([0.0]), atmosphere.pressure_hpa)
terms[:, 0] *= gas.half[0]
terms[:, 1:3] *= gas.water[0][:, None]
seen = gas.above[0][:, None, None] * reflectance_above(terms[:, None, None], surface)

found = skyscatter.dehaze(
    seen, sensor="sentinel-2a", bands=names, sun_zenith_deg=sun, aerosol="urban", aod=haze, adjacency=False
)
error = found.reflectance - surface
print(f"above the air the ground is off by {np.abs(seen - surface).mean():.3f} in the mean")
print(f"corrected by {np.abs(error).mean():.1e}, known to {found.sigma.mean():.4f}")
print(f"share of pixels taken for water: {np.mean(found.mask & int(Flag.WATER) > 0):.2f}")
assert np.abs(error).max() < 1e-4
