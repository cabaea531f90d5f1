# %% [markdown]
# # 3 Aerosol from a sky image
#
# A hazy sky is brighter and whiter than a clear one, and brightest around the Sun. How much brighter, at which
# wavelengths and at which angles depends on the particles in it: how many there are (their *optical depth* τ), how
# their extinction falls with wavelength (their *Ångström exponent* α, which tells small from large), how much of the
# light they scatter rather than absorb (their *single-scattering albedo*), and on the ground below.
#
# So the light of a sky can be read backwards. We take a picture of a sky whose haze we know, add noise as a camera
# would, forget what we know, and find it again, with error bars. Then we look whether the error bars are right.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

import skyscatter
from skyscatter.inversion import Normal, sky_image, with_values

quick = bool(os.environ.get("SKYSCATTER_QUICK"))

# %% [markdown]
# ## The picture
#
# A fisheye camera on the ground sees the whole sky through four narrow bands. The model `earth-hazy` stands for the
# truth. With `solver="orders"` all orders of scattering are in it.

# %%
truth = skyscatter.load_model("earth-hazy")
scene = truth.scene(sun_elevation_deg=40, sun_azimuth_deg=200)
wavelengths = [440, 670] if quick else [440, 550, 670, 870]
camera = skyscatter.Fisheye(width=32, height=32)
image = skyscatter.render(scene, camera, wavelengths, solver=skyscatter.Orders(tolerance=0.01))

noise = 0.02
rng = np.random.default_rng(1)
measured = image.radiance * (1 + noise * rng.standard_normal(image.radiance.shape))
measured = skyscatter.SpectralImage(measured, wavelengths, recipe=image.recipe)

fig, axes = plt.subplots(1, len(wavelengths), figsize=(3.4 * len(wavelengths), 3.2), squeeze=False)
for ax, plane, wl in zip(axes[0], np.moveaxis(measured.radiance, -1, 0), wavelengths, strict=True):
    shown = ax.imshow(np.log10(plane), cmap="magma", vmin=-1.9, vmax=0.1)
    ax.set_title(f"{wl} nm")
    ax.axis("off")
fig.colorbar(shown, ax=axes, label="log₁₀ radiance [W m⁻² sr⁻¹ nm⁻¹]", shrink=0.85)
plt.show()

# %% [markdown]
# ## The question
#
# We start from other numbers than the true ones and let four of them free. Each gets a *prior*, what we knew of it
# before: bounds, or a mean with a deviation. Camera and Sun are read from the picture's recipe; nothing else of it is
# used.
#
# Optimal estimation (Rodgers 2000) looks for the numbers **x** with the least cost
#
# $$ J = (\mathbf{y} - F(\mathbf{x}))^T S_\epsilon^{-1} (\mathbf{y} - F(\mathbf{x}))
#    + (\mathbf{x} - \mathbf{x}_a)^T S_a^{-1} (\mathbf{x} - \mathbf{x}_a) $$
#
# **y** are the pixels, F the model of the sky, S_ε the variance of noise and model, and x_a, S_a the prior. The
# derivatives of F come from the same solution as F itself. The covariance of the answer is $\hat S = (K^T
# S_\epsilon^{-1} K + S_a^{-1})^{-1}$, with K the derivatives.

# %%
data = sky_image(measured, noise=noise, pixels=30 if quick else 120)
free = {
    "haze.optical_depth": (0.0, 2.0),
    "haze.angstrom_exponent": Normal(1.3, 0.5),
    "haze.single_scattering_albedo": (0.6, 1.0),
    "ground.albedo": (0.0, 0.6),
}
guess = with_values(truth, {"haze.optical_depth": 0.1, "haze.single_scattering_albedo": 0.8, "ground.albedo": 0.3})
result = skyscatter.fit(guess, data, free, solver=skyscatter.Orders(tolerance=0.01), model_error=0.003)
print(result)

# %% [markdown]
# The last column says how much of each answer comes from the data and how much from the prior: the diagonal of the
# *averaging kernel*. Its sum is the number of *degrees of freedom for signal*: how many numbers the picture has told.
#
# ## Is it right?
#
# We know the truth here. Each number should lie within about two deviations, and all together inside the joint
# region.

# %%
known = {
    "haze.optical_depth": 0.45,
    "haze.angstrom_exponent": 1.08,
    "haze.single_scattering_albedo": 0.9592,
    "ground.albedo": 0.131,
}
for name, value in known.items():
    off = (result.estimate[name] - value) / result.standard_deviation[name]
    print(f"{name:32s} truth {value:.4f}, found {result.estimate[name]:.4f}, off by {off:+.1f} deviations")
print(f"squared distance {result.distance(known):.1f}; 95 % of fits have less than 9.5")
assert result.converged
assert result.distance(known) < 18.5  # 99.9 % of all noise
figure = result.corner(truth=known)
figure  # noqa: B018 - shown by the notebook

# %% [markdown]
# The red lines are the truth. A tilted ellipse says that two numbers go together: a brighter ground and less
# absorbing particles both brighten the sky, so that the data tell their sum better than each of them.
#
# ## The forward residual
#
# Never believe an inversion that does not show what is left over: data minus model, in deviations. It should be
# noise, without a pattern in wavelength or over the sky.

# %%
left = result.residual / np.hypot(result.noise, result.model_error)
print(f"mean {left.mean():+.2f}, scatter {left.std():.2f}; chance of a larger misfit {result.probability:.2f}")
assert abs(left.mean()) < 0.4
result.plot_residual()

# %% [markdown]
# ## What to try
#
# - Leave the ground's albedo at a wrong number (take it out of `free`); see how the residual and the optical depth
#   answer.
# - `method="posterior"` walks through the whole posterior instead of taking it for a normal one (needs
# `pip install emcee corner`).
# - The same on the command line:
#   `skyscatter invert earth-hazy --data sky.nc --noise 2% --free haze.optical_depth=0:2 ...`
