# %% [markdown]
# # 1 The colours of the sky, from columns to sRGB
#
# Why is the sky blue overhead and white along the horizon? We answer twice: by hand, with a few lines of numpy, and
# with skyscatter. On the way we meet the chain that stands behind every picture of this package:
#
# **columns** × **cross-sections** → **optical depth** → **radiance spectrum** → **XYZ** → **sRGB**.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image.colour import xyz_weights
from skyscatter.spectra.solar import solar_irradiance

quick = bool(os.environ.get("SKYSCATTER_QUICK"))  # the tests run a smaller version of this notebook
wavelengths = np.arange(380.0, 781.0, 40.0 if quick else 20.0)  # nm, in vacuum
at_550 = np.argmin(np.abs(wavelengths - 550))

# %% [markdown]
# ## Columns
#
# Look straight up: above every square metre stands a *column* of molecules. Its weight is the air pressure, so we can
# count it without climbing:
#
# $$ N = \int_0^\infty n(h)\,\mathrm{d}h = \frac{p}{m\,g} . $$

# %%
pressure, gravity = 101325.0, 9.80665  # Pa, m s-2
mass = 28.964e-3 / 6.02214076e23  # kg, of a mean molecule of air
column = pressure / (mass * gravity)
print(f"{column:.3e} molecules above every square metre")

# %% [markdown]
# ## Cross-sections
#
# A molecule is much smaller than a wavelength. The light's field makes it swing as a dipole, and a dipole that swings
# twice as fast sends out sixteen times the light. Rayleigh's cross-section is, with the refractive index $n$ of air
# that has $N_0$ molecules per volume, and a factor $F \approx 1.05$ because molecules are not quite round,
#
# $$ \sigma(\lambda) = \frac{24\pi^3}{\lambda^4 N_0^2}\left(\frac{n^2-1}{n^2+2}\right)^2 F \;\propto\; \lambda^{-4} . $$
#
# The optical depth of the air is column times cross-section, $\tau = N\sigma$. Of light that comes straight down the
# share $e^{-\tau}$ arrives without having been scattered.

# %%
refractivity, density, king = 2.78e-4, 2.547e25, 1.05  # n - 1 at 550 nm; m-3 at 15 degrees C; F
n2 = (1 + refractivity) ** 2
cross_section = 24 * np.pi**3 * ((n2 - 1) / (n2 + 2)) ** 2 * king / ((wavelengths * 1e-9) ** 4 * density**2)  # m2
by_hand = column * cross_section

# %% [markdown]
# skyscatter holds the same as a *model*: density fields times optical models. We take the shipped Earth, remove ozone
# and aerosol, blacken the ground, and ask for the optical depth of a line from the ground to space.

# %%
earth = skyscatter.load_model("earth")
full = earth.scene(sun_elevation_deg=45, sun_azimuth_deg=180)  # the Sun stands in the south
air = full.model_copy(
    update={"medium": full.medium.without("ozone").without("aerosol"), "ground": skyscatter.Ground(albedo=0.0)}
)
here = air.observer.position  # m, from the centre of the planet
above = here + np.array([0.0, 0.0, 120e3])
tau = skyscatter.optical_depth(air, here, above, wavelengths)
parts = skyscatter.optical_depth(full, here, above, wavelengths, by_component=True)

fig, ax = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
for component, depth in zip(full.medium.components, parts, strict=True):
    ax.semilogy(wavelengths, np.where(depth > 1e-4, depth, np.nan), label=component.name)
ax.semilogy(wavelengths, by_hand, "k:", label="air, by hand")
ax.set(xlabel="wavelength [nm]", ylabel="vertical optical depth", ylim=(1e-3, 1))
ax.legend()
plt.show()
print(f"air at {wavelengths[at_550]:.0f} nm: by hand {by_hand[at_550]:.4f}, skyscatter {tau[at_550]:.4f}")

# By hand the refractive index has no dispersion: 4 % too little at 380 nm, right at 550 nm, 2 % too much at 780 nm.
assert abs(by_hand[at_550] / tau[at_550] - 1) < 0.02

# %% [markdown]
# ## Scattered once, by hand
#
# Take air as flat layers. Sunlight $E_0$ comes down at the zenith angle with cosine $\mu_s$ and is weakened to $E_0
# e^{-t/\mu_s}$ at the depth $t$. There a layer $\mathrm{d}t$ scatters the share $p(\theta)\,\mathrm{d}t/\mu$ into our
# line of sight, whose zenith angle has the cosine $\mu$; on its way down to us it is weakened by $e^{-(\tau-t)/\mu}$.
# In all,
#
# $$ L = E_0\,p(\theta)\int_0^\tau e^{-t/\mu_s}\,e^{-(\tau-t)/\mu}\,\frac{\mathrm{d}t}{\mu}
#      = E_0\,p(\theta)\,\frac{\mu_s}{\mu_s-\mu}\left(e^{-\tau/\mu_s}-e^{-\tau/\mu}\right),
#    \qquad p(\theta)=\frac{3}{16\pi}\left(1+\cos^2\theta\right) . $$

# %%
sun = full.sun.direction  # a unit vector towards the Sun
irradiance = solar_irradiance(wavelengths)  # W m-2 nm-1, outside the atmosphere


def scattered_once(depth: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Radiance of flat air of an optical depth, scattered once [W m-2 sr-1 nm-1]."""
    mu, mu_s, cos_theta = direction[2], sun[2], direction @ sun
    phase = 3 / (16 * np.pi) * (1 + cos_theta**2)
    return irradiance * phase * mu_s / (mu_s - mu) * (np.exp(-depth / mu_s) - np.exp(-depth / mu))


views = {"zenith": 90.0, "10° high": 10.0, "2° high": 2.0}
directions = direction_from_azimuth_elevation(90.0, list(views.values()))  # in the east, aside from the Sun
flat = np.stack([scattered_once(tau, direction) for direction in directions])
single = skyscatter.radiance(air, here, directions, wavelengths, "single").radiance
orders = skyscatter.radiance(air, here, directions, wavelengths, "orders").radiance

fig, axes = plt.subplots(1, 3, figsize=(10, 3.2), layout="constrained")
for ax, name, *lines in zip(axes, views, flat, single, orders, strict=True):
    for line, label in zip(lines, ("once, flat, by hand", "once, round Earth", "all orders"), strict=True):
        ax.plot(wavelengths, line, label=label)
    ax.set(title=name, xlabel="wavelength [nm]", ylim=(0, None))
axes[0].set_ylabel("radiance [W m$^{-2}$ sr$^{-1}$ nm$^{-1}$]")
axes[0].legend()
plt.show()

error = np.abs(flat / single - 1).max(axis=1)
print("largest error of the flat formula:", ", ".join(f"{n} {e:.1%}" for n, e in zip(views, error, strict=True)))
print("share of light scattered more than once, in the blue:", (1 - single[:, 1] / orders[:, 1]).round(2))
# Overhead the Earth's roundness changes the Sun's path through the air by a few thousandths.
assert error[0] < 0.01
assert np.all(single < orders)

# %% [markdown]
# Two lessons. *Flat air* is good overhead and useless at the horizon, where a round Earth makes paths finite. And light
# is often scattered *twice and more*, most where the air is thick: in the blue, and along the horizon. Therefore
# `"orders"`, which adds all orders of scattering up, is skyscatter's default.
#
# ## Why the horizon is white
#
# Forget about everything but the thickness of the air, $L \propto 1-e^{-\tau/\mu}$. Thin air sends us light in
# proportion to $\tau\propto\lambda^{-4}$: blue. Along the horizon $\tau/\mu$ exceeds 1 at *every* wavelength. Then
# the air is like a fog: we see as far as optical depth 1 or so, from which each wavelength sends the same share of
# sunlight. A longer path adds nothing any more. So the exponent $\alpha$ of the share $L/E_0\propto\lambda^{-\alpha}$
# of sunlight that we get falls from 4 towards 0. (Scattered again, light is weighed with $\lambda^{-4}$ once more:
# all orders are bluer.)

# %%
elevations = np.array([90, 60, 40, 30, 20, 15, 10, 7, 5, 3, 2, 1])
ring = direction_from_azimuth_elevation(90.0, elevations)
sky = skyscatter.radiance(air, here, ring, wavelengths).radiance
thin = irradiance * by_hand  # light of very thin air
blue, red = np.argmin(np.abs(wavelengths - 460)), np.argmin(np.abs(wavelengths - 660))


def exponent(radiance: np.ndarray) -> np.ndarray:
    """Exponent of wavelength with which the share of sunlight falls between blue and red."""
    share = radiance / irradiance
    return np.log(share[..., blue] / share[..., red]) / np.log(wavelengths[red] / wavelengths[blue])


fig, ax = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
ax.plot(elevations, exponent(sky), "o-", label="all orders")
ax.plot(elevations, exponent(skyscatter.radiance(air, here, ring, wavelengths, "single").radiance), "s--", label="once")
ax.axhline(exponent(thin), color="k", ls=":", label="very thin air")
ax.set(xlabel="elevation of the view [degree]", ylabel=r"exponent $\alpha$", xscale="log", ylim=(0, 4.5))
ax.set_xticks([1, 2, 5, 10, 20, 45, 90], ["1", "2", "5", "10", "20", "45", "90"])
ax.legend()
plt.show()
assert exponent(sky)[0] > 3
assert exponent(sky)[-1] < 1.5

# %% [markdown]
# ## From spectra to colours
#
# The eye keeps three numbers of a spectrum, sums weighted by three curves, $X=\int L\,\bar x\,\mathrm{d}\lambda$ and
# so on. On a grid of wavelengths these sums are one **matrix product**, with a matrix $W$ of shape (wavelength, 3). A
# second matrix turns XYZ into the red, green and blue of sRGB, and a curve (about a power 1/2.2) encodes them for the
# screen:
#
# $$ (X, Y, Z) = L\,W, \qquad (R, G, B) = (X, Y, Z)\,M^\mathsf{T} . $$

# %%
weights = xyz_weights(wavelengths)  # (wavelength, 3), with 683 lm/W in it: Y is in cd m-2
to_rgb = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])  # IEC 61966-2-1


def screen(radiance: np.ndarray) -> np.ndarray:
    """Colours on the screen, 0 to 1, of spectra (..., wavelength), each as bright as the screen can show it."""
    linear = np.maximum(radiance @ weights @ to_rgb.T, 0)
    linear /= linear.max(axis=-1, keepdims=True)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


fig, ax = plt.subplots(figsize=(6.4, 3), layout="constrained")
for k, name in enumerate("XYZ"):
    ax.plot(wavelengths, weights[:, k], color=("C3", "C2", "C0")[k], label=name)
ax.set(xlabel="wavelength [nm]", ylabel="weight [lm W$^{-1}$ nm]", title="the matrix W")
ax.legend()
plt.show()

image = skyscatter.SpectralImage(sky[None], wavelengths)  # pictures are (y, x, wavelength)
assert np.allclose(image.xyz()[0], sky @ weights, rtol=1e-9)
# The standard prints its matrix with four decimals, which is what they differ by.
assert np.allclose(image.rgb()[0], sky @ weights @ to_rgb.T, rtol=2e-3)

# %% [markdown]
# Colours side by side, all made as bright as the screen can: what differs is the hue, not the brightness. White of sRGB
# is daylight, a mixture of Sun and sky; so sunlight without sky is a little warm.

# %%
rows = {
    "the Sun above the air": np.repeat(irradiance[None], len(elevations), axis=0),
    "very thin air": np.repeat(thin[None], len(elevations), axis=0),
    "once, flat, by hand": np.stack([scattered_once(tau, direction) for direction in ring]),
    "all orders, air alone": sky,
    "all orders, the shipped Earth": skyscatter.radiance(full, here, ring, wavelengths).radiance,
}
fig, axes = plt.subplots(len(rows), 1, figsize=(8, 4.2), layout="constrained")
for ax, (name, spectra) in zip(axes, rows.items(), strict=True):
    ax.imshow(screen(spectra)[None], aspect="auto")
    ax.set_title(name, fontsize=9, loc="left", pad=2)
    ax.set_yticks([])
    ax.set_xticks([])
axes[-1].set_xticks(range(len(elevations)), [f"{e}°" for e in elevations])
axes[-1].set_xlabel("elevation of the view")
plt.show()

# %% [markdown]
# ## The whole sky
#
# A camera is a grid of directions. `render` asks for all of them at once; the Earth now has its ozone, aerosol and
# ground.

# %%
size = 48 if quick else 360
camera = skyscatter.Fisheye(width=size, height=size)
picture = skyscatter.render(full, camera, wavelengths)
fig, ax = plt.subplots(figsize=(5, 5), layout="constrained")
ax.imshow(picture.picture(exposure=picture.auto_exposure() - 1))  # twice as bright as the automatic
ax.set_title("Sun 45° high in the south (below the middle); east is left", fontsize=9)
ax.set_axis_off()
plt.show()

middle = picture.xyz()[size // 2, size // 2]
x, y = middle[:2] / middle.sum()
print(f"zenith: {middle[1]:.0f} cd/m2, chromaticity x, y = {x:.3f}, {y:.3f} (daylight white has 0.313, 0.329)")
assert 1000 < middle[1] < 6000
assert x < 0.27

# %% [markdown]
# ## Try it
#
# * Put the Sun at 5° (`sun_elevation_deg=5`). Which parts of the formulas change?
# * Where would the horizon's exponent be on a planet with a tenth of our air? `air.medium.component("air")` has a
#   `weight`.
# * Replace `to_rgb` by that of another colour space, and look where colours become negative.
