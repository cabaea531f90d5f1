# %% [markdown]
# # 5 How much dust is in a dark globule?
#
# Small dark clouds stand before the stars of the Milky Way like holes in the sky. They are no holes: dust takes the
# light of what is behind, and how much it takes tells how much of it there is. Some of these globules will soon form
# a star.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

import skyscatter
from skyscatter import fields, inversion
from skyscatter.inversion.matter import SOLAR_MASS
from skyscatter.optics.dust import MIXTURES
from skyscatter.units import PARSEC

quick = bool(os.environ.get("SKYSCATTER_QUICK"))  # the tests run a smaller version of this notebook
size = 36 if quick else 64  # pixels
distance, mixture = "125 pc", "milky-way-5.5"  # dust of dense clouds, R_V = 5.5

# %% [markdown]
# ## A globule
#
# Gas in balance between its own gravity and its pressure forms a Bonnor-Ebert sphere: flat inside, falling as $r^{-2}$
# farther out, with an edge where the pressure of the surroundings takes over. The globule B 68 is described by one
# with a radius of 0.06 pc and the dimensionless radius 6.9 (Alves, Lada & Lada 2001). Ours has the same shape; $A_V$
# through its middle is 6 mag, so that something still shines through. Behind it is an even glow: the unresolved stars
# of the Galaxy.

# %%
ball = fields.BonnorEbert(radius="0.06 pc", dimensionless_radius=6.9)
optics = skyscatter.Dust(visual_extinction=6.0, mixture=mixture)
globule = skyscatter.Component(name="dust", density=ball, optics=optics)
glow = 1e-6  # W m-2 sr-1 nm-1
scene = skyscatter.SpaceScene(
    medium=skyscatter.Medium(components=(globule,)), background=glow, view=skyscatter.View(distance=distance)
)
camera = skyscatter.Telescope.from_length(size, size, 0.18 * PARSEC, scene.view.distance)
bands = [550.0, 800.0, 1600.0]  # nm: V, I, H
picture = np.asarray(skyscatter.render(scene, camera, bands, solver="single").radiance, float)
noise = 0.01 * glow
picture = picture + noise * np.random.default_rng(1).standard_normal(picture.shape)

fig, axes = plt.subplots(1, 3, figsize=(10, 3.3), layout="constrained")
half = 0.5 * size * camera.pixel_scale_deg * 60
for ax, band, image in zip(axes, bands, np.moveaxis(picture, 2, 0), strict=True):
    drawn = ax.imshow(image / glow, vmin=0, vmax=1.05, cmap="magma", extent=(half, -half, -half, half))
    ax.set(title=f"{band:g} nm", xlabel="east [arcmin]")
axes[0].set_ylabel("north [arcmin]")
fig.colorbar(drawn, ax=axes, label="brightness / that beside the globule")
plt.show()

# %% [markdown]
# Dust takes less of red and infrared light, so that the globule becomes transparent there.
#
# ## From brightness to extinction
#
# $$ \frac{I}{I_0} = e^{-\tau_\lambda}, \qquad A_V = 1.0857\,\tau_V =
# 1.0857\,\tau_\lambda\,\frac{\sigma_V}{\sigma_\lambda} . $$
#
# In visible light the middle of the globule is lost in the noise: $A_V$ has no upper limit there. At 800 nm it is well
# measured, if we know the dust's extinction curve. The noise of $A_V$ grows as $e^{\tau}$.

# %%
visual, error = inversion.extinction_map(picture[..., 1], glow, noise, wavelength_nm=bands[1], mixture=mixture)
print(f"A_V up to {np.nanmax(visual):.1f} ± {np.nanmax(error):.1f} mag; {np.isnan(visual).sum()} pixels too dark")

# %% [markdown]
# ## From extinction to density
#
# One magnitude stands for $N_H = 1 / (1.0857\,\sigma_V)$ hydrogen nucleons per area, with a known mass of dust for
# each. The density of a *spherical* cloud is the inverse Abel transform of its column. Taken literally,
#
# $$ n(r) = -\frac{1}{\pi}\int_r^\infty \frac{\mathrm{d}N}{\mathrm{d}y}\,\frac{\mathrm{d}y}{\sqrt{y^2 - r^2}} , $$
#
# it needs the derivative of noisy data, and the noise grows towards the middle. So we ask instead: which smooth,
# non-negative profiles are likely, given the map? How smooth, the data decide.

# %%
cloud = inversion.dust_from_extinction(
    visual, camera.pixel_scale_deg * 3600, distance, error, mixture=mixture, averaged=False
)
per_volume = optics.hydrogen_per_volume(ball.reference_column())
truth = per_volume * ball.profile(cloud.radius)

fig, (left, middle, right) = plt.subplots(1, 3, figsize=(12, 3.5), layout="constrained")
drawn = left.imshow(visual, extent=(half, -half, -half, half), vmin=0)
left.set(title="A_V [mag]", xlabel="east [arcmin]", ylabel="north [arcmin]")
fig.colorbar(drawn, ax=left, shrink=0.8)
pc = cloud.radius / PARSEC
middle.fill_between(pc, cloud.lower / 1e6, cloud.upper / 1e6, color="tab:orange", alpha=0.4, lw=0, label="68 % band")
middle.plot(pc, cloud.hydrogen_density / 1e6, color="tab:red", label="estimate")
middle.plot(pc, truth / 1e6, "k--", lw=1, label="truth")
middle.set(xlabel="radius [pc]", ylabel="hydrogen nucleons [cm⁻³]", yscale="log")
middle.set_ylim(1e-3 * truth.max() / 1e6, 3 * truth.max() / 1e6)
middle.legend()
drawn = right.imshow(
    cloud.inversion.residual / error, vmin=-4, vmax=4, cmap="RdBu_r", extent=(half, -half, -half, half)
)
right.set(title="residual / noise", xlabel="east [arcmin]")
fig.colorbar(drawn, ax=right, shrink=0.8)
plt.show()

# %% [markdown]
# ## The mass
#
# Its integral over the sphere is the mass; the sum over the map's pixels must be the same, for it needs no symmetry.

# %%
r = np.linspace(0, 0.06 * PARSEC, 4000)
dust = MIXTURES[mixture]
true_mass = dust.per_hydrogen * np.trapezoid(4 * np.pi * r**2 * per_volume * ball.profile(r), r)
for label, mass, doubt in (
    ("dust, from the profile", cloud.dust_mass, cloud.dust_mass_error),
    ("dust, from the map", cloud.map_dust_mass, cloud.map_dust_mass_error),
    (f"gas, {dust.gas_to_dust:g} times as much", cloud.gas_mass, cloud.gas_mass_error),
):
    print(f"{label:30s} {mass / SOLAR_MASS:.5f} solar masses ± {100 * doubt / mass:.2f} %")
print(f"{'dust, truth':30s} {true_mass / SOLAR_MASS:.5f} solar masses")
assert abs(cloud.dust_mass - true_mass) < 4 * cloud.dust_mass_error < 0.2 * true_mass

# %% [markdown]
# What these errors leave out: a distance that is 10 % wrong changes the mass by 20 % (`distance_error`); grains that
# have grown, or another $R_V$, change $\sigma_V$ by tens of per cent; and light that the globule scatters, or that
# shines in front of it, makes it look thinner than it is (`foreground`).
