# %% [markdown]
# # 6 Tomography of a cloud from several views
#
# A picture of a nebula is flat: every pixel adds up what lies along its line of sight. From several sides,
# the adding up can be undone. Here a cloud of gas that shines in one line is seen from six directions, with noise, and
# its density is found again, with error bars.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

from skyscatter.inversion import ImageView, VoxelFrame, VoxelLights, VoxelModel, VoxelOptics, reconstruct

quick = bool(os.environ.get("SKYSCATTER_QUICK"))  # the tests run a smaller version of this notebook
cells, pixels, views = (12, 20, 5) if quick else (24, 40, 6)

# %% [markdown]
# ## What an image says
#
# Where the gas is thin, the light of a pixel is the column of the emission $j$ along its line of sight,
#
# $$ L = \int j\,\rho(\mathbf x(t))\,\mathrm dt . $$
#
# The unknown density $\rho$ is given by numbers on a grid of cells (voxels), with straight lines between them. We make
# one up: three blobs.

# %%
frame = VoxelFrame.cube(cells, 1.0)  # a cube from -1 m to 1 m
where = frame.middles()
truth = np.zeros(frame.shape)
for place, width, height in [
    ((0.3, 0.1, 0.0), 0.25, 1.0),
    ((-0.3, -0.3, 0.2), 0.2, 0.8),
    ((0.0, 0.4, -0.4), 0.15, 1.2),
]:
    truth += height * np.exp(-np.sum((where - place) ** 2, axis=-1) / (2 * width**2))
model = VoxelModel(frame, VoxelOptics.columns(), VoxelLights.none(1), np.zeros(1))

# %% [markdown]
# Six observers, spread over half a sphere (an image from the back would tell the same), each with noise of 2 %.

# %%
rng = np.random.default_rng(1)
images = []
for k in range(views):
    tilt, turn = np.arccos(1 - (k + 0.5) / views), k * np.pi * (3 - np.sqrt(5))
    right = np.array([np.cos(turn), np.sin(turn), 0.0])
    towards = np.array([-np.sin(tilt) * np.sin(turn), np.sin(tilt) * np.cos(turn), np.cos(tilt)])
    view = ImageView.parallel(np.zeros((pixels, pixels)), 1.0, towards, right, 1.3)
    light = model.image(truth, view.origins.reshape(-1, 3), view.directions.reshape(-1, 3)).reshape(pixels, pixels, 1)
    sigma = np.full(light.shape, 0.02 * light.max())
    images.append(ImageView.make(light + sigma * rng.normal(size=light.shape), sigma, view.origins, view.directions))

fig, axes = plt.subplots(1, views, figsize=(2.1 * views, 2.3), layout="constrained")
for k, ax in enumerate(axes):
    shown = ax.imshow(images[k].data[..., 0], extent=(-1.3, 1.3, -1.3, 1.3), cmap="magma")
    ax.set(title=f"view {k + 1}", xlabel="x [m]")
_ = fig.colorbar(shown, ax=axes, label="column [m]")

# %% [markdown]
# ## Back to the density
#
# There are more cells than the data can tell apart, so that many densities explain them. We take the one that makes
#
# $$ \tfrac12 \chi^2 + \lambda R(\rho), \qquad \chi^2 = \sum_i \frac{(d_i - L_i(\rho))^2}{\sigma_i^2} $$
#
# smallest, with $R$ the integral of the squared gradient: of all that agree with the data, the smoothest. How much is
# smoothness worth? As much as the data can bear: $\lambda$ is raised until $\chi^2$ equals the number of data, for the
# truth would leave about that much. Densities are never negative. The derivative of $\chi^2$ with respect to all the
# cells comes from one pass backward along the same rays, for about the price of two images.

# %%
found = reconstruct(images, model, deviation=8)
error = np.linalg.norm(found.density[0] - truth) / np.linalg.norm(truth)
print(
    f"chi^2 / data {found.chi2 / found.count:.2f}, relative error {error:.3f}, "
    f"mass {found.density.sum() / truth.sum():.3f} of the truth"
)
print(found.diagnostics["reason"])
assert error < 0.25
assert abs(found.density.sum() / truth.sum() - 1) < 0.05

# %%
fig, axes = plt.subplots(1, 4, figsize=(12, 3), layout="constrained")
cut = cells // 2
panels = [
    ("truth", truth[:, :, cut], "magma"),
    ("estimate", found.density[0][:, :, cut], "magma"),
    ("standard deviation", found.deviation[0][:, :, cut], "viridis"),
    ("estimate - truth", (found.density[0] - truth)[:, :, cut], "RdBu_r"),
]
for ax, (name, values, colours) in zip(axes, panels, strict=True):
    limit = {"vmin": 0, "vmax": truth.max()} if colours == "magma" else {}
    limit = {"vmin": -0.3, "vmax": 0.3} if colours == "RdBu_r" else limit
    drawn = ax.imshow(values.T, origin="lower", extent=(-1, 1, -1, 1), cmap=colours, **limit)
    ax.set(title=name, xlabel="x [m]", ylabel="y [m]")
    fig.colorbar(drawn, ax=ax, shrink=0.8)

# %% [markdown]
# ## Is it believable?
#
# What the estimate leaves over, in units of the noise, should look like noise: no shapes, and a width of one. The error
# bars come from samples of the posterior: data and prior are perturbed by what they may be off, and the estimate is
# made again. They speak of noise, not of what the prior smooths away: at the sharp tops of the blobs the estimate is
# lower than the truth by more than its error bar.

# %%
fig, axes = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
drawn = axes[0].imshow(found.residuals[0][..., 0], vmin=-4, vmax=4, cmap="RdBu_r")
axes[0].set(title="residual of view 1 [sigma]", xlabel="pixel", ylabel="pixel")
fig.colorbar(drawn, ax=axes[0])
every = np.concatenate([r.ravel() for r in found.residuals])
axes[1].hist(every, bins=50, density=True, color="0.6")
x = np.linspace(-4, 4, 100)
axes[1].plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), "k")
axes[1].set(xlabel="residual [sigma]", ylabel="share per sigma", title="all views, and a normal distribution")
print(f"width of the residuals {every.std():.2f}")
assert abs(every.std() - 1) < 0.1

# %% [markdown]
# ## And dust that scatters?
#
# `reconstruct` takes a `SpaceScene` as well: the light of its stars, scattered by dust, is no longer a plain sum, for
# the dust dims the light on its way from the star and to us; the derivatives know that too. With `multiple=2` the light
# that is scattered more than once is computed for the estimate and taken off the images, by turns.
#
#     views = [ImageView.load(path, camera, view) for path, view in zip(files, positions)]
#     found = reconstruct(views, scene, wavelengths, frame=VoxelFrame.cube(32, 1e16), multiple=2)
#     found.save("cloud.npz")
#     cloud = found.field("dust")  # a density to render from any side
