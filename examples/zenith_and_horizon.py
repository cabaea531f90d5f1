"""Spectra of the zenith and of the horizon: blue overhead, whitish below, for the air there is optically thick."""

from __future__ import annotations

import os

import numpy as np
from matplotlib.figure import Figure

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.spectra.solar import solar_irradiance

# The size of the figure's pictures has no meaning here; a small one asks for fewer walks.
walks = 16 * int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "256"))

wavelengths = np.arange(380, 781, 5)
scene = skyscatter.load_model("earth").scene(sun_elevation_deg=40, sun_azimuth_deg=180)
views = {"zenith": (0, 90), "horizon, 90° from the Sun": (90, 1)}
directions = [direction_from_azimuth_elevation(*view) for view in views.values()]
answer = skyscatter.radiance(
    scene, scene.observer.position, directions, wavelengths, solver=skyscatter.Path(samples=walks)
)

figure = Figure(figsize=(7, 4), layout="constrained")
axes = figure.subplots()
for name, radiance, error in zip(views, answer.radiance, answer.standard_error, strict=True):
    axes.plot(wavelengths, radiance, label=name)
    axes.fill_between(wavelengths, radiance - 2 * error, radiance + 2 * error, alpha=0.3)
axes.set(xlabel="wavelength [nm]", ylabel="spectral radiance [W m$^{-2}$ sr$^{-1}$ nm$^{-1}$]", ylim=(0, None))
axes.legend()
figure.savefig("zenith_and_horizon.png", dpi=120)

# The Sun's own lines divide out: what is left falls as a power of the wavelength, here between 450 and 650 nm.
reflected = answer.radiance / solar_irradiance(wavelengths)
blue, red = np.searchsorted(wavelengths, [450, 650])
exponents = np.log(reflected[:, blue] / reflected[:, red]) / np.log(650 / 450)
for name, exponent in zip(views, exponents, strict=True):
    print(f"{name}: radiance goes as wavelength to the power -{exponent:.2f}")

# Rayleigh's law would be 4; ozone, aerosol and light scattered again take something off overhead, nearly all below.
assert 2.5 < exponents[0] < 4.2
assert exponents[1] < exponents[0] - 1
