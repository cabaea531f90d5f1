# %% [markdown]
# # 7 What single scattering loses
#
# To follow light that is scattered **once** takes one integral along the line of sight. To follow all of it takes a
# good deal more. Many formulas, and fast renderers, stop after the first order. When is that good enough, say to 5 %?
# We compare skyscatter's `"single"` with `"orders"` (skies) and `"path"` (nebulae), and draw maps of the ratio.
#
# An estimate first. Of the light that is scattered once, let the share $q$ be scattered again before it leaves the
# medium, and the same share of that, and so on. Then
#
# $$ L = L_1 + L_1 q + L_1 q^2 + \dots = \frac{L_1}{1-q}, \qquad \frac{L_1}{L} = 1 - q . $$
#
# $q$ grows with the *single-scattering albedo* $\omega$ (the part of the extinction that is scattering, the rest is
# absorption), and with the optical depth $\tau$. In thin media $q \approx c\,\omega\tau$, with a number $c$ that
# depends on the shape.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

import skyscatter
from skyscatter import fields
from skyscatter.media.fields import Exponential
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import Isotropic

quick = bool(os.environ.get("SKYSCATTER_QUICK"))  # the tests run a smaller version of this notebook
depths = np.geomspace(0.01, 4, 6 if quick else 12)  # optical depths
albedos = np.array([0.2, 0.6, 1.0]) if quick else np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])

# %% [markdown]
# ## Skies: optical depth and single-scattering albedo
#
# A solver takes all wavelengths together. Nothing forbids to take *wavelengths as labels*: here label number $k$ has
# an optical depth and an albedo of its own, given by tables over wavelength, and the star has the same light in all
# of them. So one solution fills a whole map.

# %%
tau, omega = (axis.ravel() for axis in np.meshgrid(depths, albedos, indexing="ij"))
labels = 400.0 + np.arange(tau.size)  # "wavelengths"


def table(values: np.ndarray) -> skyscatter.SpectralTable:
    """Values by label."""
    return skyscatter.SpectralTable(wavelengths=tuple(labels), values=tuple(values))


def sky(depth: np.ndarray, albedo: np.ndarray, ground: np.ndarray) -> skyscatter.Scene:
    """Air that scatters into all directions alike, on a planet like the Earth; the Sun stands 30° high."""
    optics = Particles(optical_depth=table(depth), single_scattering_albedo=table(albedo), phase=Isotropic())
    air = skyscatter.Component(name="air", density=Exponential(scale_height="8 km"), optics=optics)
    return skyscatter.Scene(
        medium=skyscatter.Medium(components=(air,), planet_radius="6371 km"),
        ground=skyscatter.Ground(albedo=table(ground)),
        star=skyscatter.Star(spectrum=1.0),
        sun=skyscatter.Sun(elevation_deg=30),
    )


def ratio_at_zenith(scene: skyscatter.Scene) -> np.ndarray:
    """Light scattered once over all light, shape (depth, second axis)."""
    line = (scene.observer.position, [0.0, 0.0, 1.0], labels)
    once = skyscatter.radiance(scene, *line, "single").radiance
    return (once / skyscatter.radiance(scene, *line, "orders").radiance).reshape(len(depths), -1)


black = ratio_at_zenith(sky(tau, omega, np.zeros_like(tau)))

# %% [markdown]
# ## Skies: the ground
#
# The ground sends light up, and air scatters it down to us: that is the second event for this light, so `"single"`
# does not have it. However thin the air, this does **not** go away, for both parts are proportional to $\tau$! The
# Sun lights thin air with $E_0$, the ground of albedo $\varrho$ with the radiance $\varrho E_0\mu_s/\pi$ from the
# whole lower half:
#
# $$ \frac{L_1}{L} \;\to\; \frac{E_0}{E_0 + 2\pi\,\varrho E_0\mu_s/\pi} = \frac{1}{1+2\varrho\mu_s}\qquad(\tau\to0). $$

# %%
grounds = np.array([0.0, 0.3, 1.0]) if quick else np.linspace(0, 1, 11)
tau, ground = (axis.ravel() for axis in np.meshgrid(depths, grounds, indexing="ij"))
labels = 400.0 + np.arange(tau.size)
bright = ratio_at_zenith(sky(tau, np.ones_like(tau), ground))

limit = 1 / (1 + 2 * grounds * np.sin(np.radians(30)))
print("thinnest air over a white ground:", bright[0, -1].round(3), " the formula for no air:", limit[-1].round(3))
# The thinnest air here loses 2 % over a black ground; and seen from 8 km up, a round Earth fills 5 % less than half of
# the view, of which half counts over a white ground.
assert np.all(np.abs(bright[0] / limit - 1) < 0.03)


def draw(ax: plt.Axes, y: np.ndarray, values: np.ndarray, label: str) -> None:
    """A map of the ratio with its contours, over optical depth."""
    mesh = ax.contourf(depths, y, values.T, levels=np.linspace(0, 1, 21), cmap="viridis")
    lines = ax.contour(depths, y, values.T, levels=[0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95], colors="w", linewidths=1)
    ax.clabel(lines, fmt=lambda v: f"{v:.0%}", fontsize=8)
    ax.set(xscale="log", xlabel="optical depth", ylabel=label)
    ax.figure.colorbar(mesh, ax=ax, label="scattered once / all orders")


fig, (left, right) = plt.subplots(1, 2, figsize=(10.5, 3.8), layout="constrained")
draw(left, albedos, black, "single-scattering albedo")
left.set_title("zenith, black ground", fontsize=10)
draw(right, grounds, bright, "albedo of the ground")
right.set_title("zenith, no absorption in the air", fontsize=10)
plt.show()

# %% [markdown]
# ## Nebulae: a sphere of dust around its star
#
# A uniform sphere with a star in the middle; $\tau$ is counted from the middle to the edge. The geometry is kinder than
# that of a flat sky: from everywhere the way out is at most a diameter long.
#
# Here the answer comes from random walks, which have a *standard error*, and a check that needs no other code: where
# nothing is absorbed, everything gets out. Of the star's light $\Phi$ the share $e^{-\tau}$ comes directly, so that the
# scattered light over all directions and the whole disk must be
#
# $$ 4\pi\int_0^R L(b)\,2\pi b\,\mathrm{d}b = \Phi\left(1-e^{-\tau}\right) \qquad (\omega = 1). $$
#
# The integral over the distance $b$ from the middle becomes smooth with $b = R\sin u$; 16 Gauss points in $u$ will do.
# The labels now count albedos; every optical depth is a run of its own.

# %%
PARSEC = 3.0857e16  # m
flux = 1e27  # W nm-1, of the star
labels = 400.0 + np.arange(albedos.size)
nodes, node_weights = np.polynomial.legendre.leggauss(16)
u = np.pi / 4 * (nodes + 1)
b = PARSEC * np.sin(u)
rings = 2 * np.pi * b * PARSEC * np.cos(u) * np.pi / 4 * node_weights  # m2
origins = np.stack([b, np.zeros(16), np.full(16, 5 * PARSEC)], axis=-1)


def nebula(depth: float) -> skyscatter.SpaceScene:
    """A sphere of that optical depth, with all the albedos."""
    optics = Particles(extinction=depth / PARSEC, single_scattering_albedo=table(albedos), phase=Isotropic())
    dust = skyscatter.Component(name="dust", density=fields.Sphere(radius="1 pc"), optics=optics)
    star = skyscatter.PointStar(spectrum=skyscatter.SpectralTable(wavelengths=(300.0, 900.0), values=(flux, flux)))
    return skyscatter.SpaceScene(medium=skyscatter.Medium(components=(dust,)), stars=(star,))


once, everything, errors = [], [], []
for depth in depths:
    line = (nebula(depth), origins, [0.0, 0.0, -1.0], labels)
    walks = skyscatter.radiance(*line, solver=skyscatter.Path(samples=128 if quick else 2048))
    once.append(4 * np.pi * rings @ skyscatter.radiance(*line, "single").radiance / flux)
    everything.append(4 * np.pi * rings @ walks.radiance / flux)
    errors.append(4 * np.pi * np.sqrt(rings**2 @ walks.standard_error**2) / flux)
once, everything, errors = np.array(once), np.array(everything), np.array(errors)

expected = 1 - np.exp(-depths)
deviation = (everything[:, -1] - expected) / errors[:, -1]
print("light that gets out / light that must:", (everything[:, -1] / expected).round(3))
print("in standard errors:                   ", deviation.round(1))
# Beyond five of them a right code is once in 6000 cases, by the t distribution of 15 degrees of freedom. The first
# order, and the integral over the disk, are good to a thousandth.
assert np.all(np.abs(everything[:, -1] - expected) < 5 * errors[:, -1] + 1e-3 * expected)

# %%
sphere = once / everything
fig, (left, right) = plt.subplots(1, 2, figsize=(10.5, 3.8), layout="constrained")
draw(left, albedos, sphere, "single-scattering albedo")
left.set_title("scattered light of a sphere around its star", fontsize=10)
right.semilogx(depths, 1 - black[:, -1], "o-", label="sky, black ground")
right.semilogx(depths, 1 - sphere[:, -1], "s-", label="sphere")
right.axhline(0.05, color="k", ls=":", label="5 %")
right.set(xlabel="optical depth", ylabel="lost by single scattering", ylim=(0, 1), title="nothing absorbed")
right.legend()
plt.show()

# %% [markdown]
# ## Five per cent
#
# Where do the maps cross 95 %? In the product $\omega\tau$ the answer is nearly one number for each shape.


# %%
def crossing(values: np.ndarray) -> np.ndarray:
    """Optical depth at which each column of a map falls to 95 %; nan if it does not."""
    found = []
    for column in values.T:
        k = np.argmax(column < 0.95)
        share = (column[k - 1] - 0.95) / (column[k - 1] - column[k]) if k else np.nan
        found.append(np.exp(np.log(depths[k - 1]) + share * np.log(depths[k] / depths[k - 1])))
    return np.array(found)


print("albedo ω        " + " ".join(f"{a:6.1f}" for a in albedos))
for name, values in (("sky:    ω τ at 5 %", black), ("sphere: ω τ at 5 %", sphere)):
    print(name.ljust(16) + " ".join(f"{p:6.3f}" for p in albedos * crossing(values)))
assert np.all(albedos * crossing(black) < 0.06)
assert np.all(albedos * crossing(sphere) < 0.1)

# %% [markdown]
# * A sky over dark ground: while $\omega\tau \lesssim 0.03$. That is clear air beyond 750 nm, and nothing that we
#   call a sky.
# * A sky over bright ground: never, if $2\varrho\mu_s > 0.05$.
# * A sphere around its star: while $\omega\tau \lesssim 0.05$. That is dust of less than 0.1 magnitudes of
#   extinction.
#
# A flat layer loses more than a sphere, since light along the layer has a long way to go and hardly a way out.
# Pictures say the same. A hazy sky, with the same exposure; then a star that lights a cloud from its edge.

# %%
size = 16 if quick else 120
wavelengths = np.arange(400.0, 721.0, 160.0 if quick else 40.0)
hazy = skyscatter.load_model("earth-hazy").scene(sun_elevation_deg=30)
camera = skyscatter.Fisheye(width=size, height=size)
pair = [skyscatter.render(hazy, camera, wavelengths, solver) for solver in ("single", "orders")]
exposure = pair[1].auto_exposure() - 0.5

fig, axes = plt.subplots(1, 3, figsize=(10, 3.3), layout="constrained")
for ax, image, name in zip(axes, pair, ("scattered once", "all orders"), strict=False):
    ax.imshow(image.picture(exposure=exposure))
    ax.set_title(name)
kept = axes[2].imshow(pair[0].luminance() / pair[1].luminance(), vmin=0, vmax=1)
fig.colorbar(kept, ax=axes[2], label="ratio of luminances")
for ax in axes:
    ax.set_axis_off()
plt.show()
lost = 1 - np.nanmedian(pair[0].luminance() / pair[1].luminance())
print(f"half of this sky loses more than {lost:.0%} of its light")
assert lost > 0.2

# %%
star = skyscatter.PointStar(position=("1.1 pc", "0.3 pc", "0.3 pc"), temperature=15000, luminosity=1000)
dust = skyscatter.Component(
    name="dust",
    density=fields.Plummer(radius="0.5 pc", cut="2 pc"),
    optics=Particles(extinction=10 / PARSEC, single_scattering_albedo=0.9, phase=Isotropic()),
)
cloud = skyscatter.SpaceScene(medium=skyscatter.Medium(components=(dust,)), stars=(star,))
telescope = skyscatter.Telescope.from_length(size, size, "4 pc", cloud.view.distance)
views = {
    "scattered once": skyscatter.render(cloud, telescope, [550.0], "single"),
    "all orders": skyscatter.render(cloud, telescope, [550.0], solver=skyscatter.Path(samples=16 if quick else 128)),
}
through = skyscatter.optical_depth(cloud, [0, 0, -2 * PARSEC], [0, 0, 2 * PARSEC], [550.0])[0]
peak = np.percentile(views["all orders"].radiance, 99)
fig, axes = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
for ax, (name, image) in zip(axes, views.items(), strict=True):
    shown = ax.imshow(image.radiance[..., 0] / peak, norm="log", vmin=1e-3, vmax=1, cmap="magma", extent=(-2, 2, -2, 2))
    ax.set(title=name, xlabel="west [pc]", ylabel="north [pc]")
fig.colorbar(shown, ax=axes, shrink=0.8, label="radiance / brightest")
plt.show()
faint = np.median(views["scattered once"].radiance) / np.median(views["all orders"].radiance)
print(f"optical depth through the middle {through:.1f}; the median pixel keeps {faint:.0%} of its light")
assert faint < 0.8

# %% [markdown]
# ## Try it
#
# * Let the particles scatter forward (`HenyeyGreenstein(g=0.8)` from `skyscatter.optics.phase`). Does the zenith lose
#   more or less?
# * Where on the sky does single scattering do best? The map of the hazy sky has the answer; why is it there?
# * Compare `"orders"` with `max_order=2`: how much of the loss does the second order mend?
