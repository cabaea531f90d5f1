# %% [markdown]
# # 8 Dehazing step by step
#
# A satellite does not see the ground. It sees the ground *through* the air, and the air itself, which shines too.
# This notebook writes down what the satellite measures of one pixel, turns the equation around, and asks how well we
# know the ground afterwards. At the end `skyscatter.dehaze` does all of it in one line.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

import skyscatter
from skyscatter.dehaze import Atmosphere, build_table, load_sensor
from skyscatter.dehaze.forward import reflectance_above, surface_reflectance
from skyscatter.dehaze.sensing import gases
from skyscatter.dehaze.table import Angles

quick = bool(os.environ.get("SKYSCATTER_QUICK"))  # the tests run a smaller version of this notebook
names = ("B02", "B03", "B04") if quick else ("B02", "B03", "B04", "B8A", "B12")  # of Sentinel-2
sun_zenith, haze = 40.0, 0.3  # degrees; optical depth of the aerosol at 550 nm

# %% [markdown]
# ## What the satellite measures
#
# Satellite people divide radiance by what a perfect white ground without air would send: *reflectance*, $\rho = \pi
# L/(E_0\mu_s)$. Three kinds of light arrive:
#
# 1. light that the **air** scattered up and that never saw the ground: the *path reflectance* $\rho_\mathrm{path}$;
# 2. light that came **down** (directly or as skylight, $T_\downarrow$ in all), was reflected by the pixel, and went
#    **straight** up, $t_\mathrm{dir} = e^{-\tau/\mu}$;
# 3. light that was reflected **beside** the pixel and then scattered into our line of sight, $t_\mathrm{dif}$.
#
# Some of the light goes to and fro between ground and air, which sends the share $S$ (*spherical albedo*) back each
# time: $1 + S\varrho + S^2\varrho^2 + \dots = 1/(1-S\varrho)$. In all, with the mean reflectance $\varrho$ of the
# surroundings,
#
# $$ \rho_\mathrm{toa} = \rho_\mathrm{path}
#    + \frac{T_\downarrow\left(t_\mathrm{dir}\,\rho + t_\mathrm{dif}\,\varrho\right)}{1 - S\varrho} . $$
#
# (Tanré et al. 1981; Vermote et al. 1997.) The equation is exact for a Lambertian ground. All the difficulty is in
# its five terms. They come from a solution of all orders of scattering, with polarisation, averaged over each band:

# %%
sensor = load_sensor("sentinel-2a")
bands = [sensor.band(name) for name in names]
centres = np.array([band.centre_nm for band in bands])
atmosphere = Atmosphere(aerosol="continental")
# Terms over haze and angles. Here all pixels have the same angles, and the satellite looks straight down.
table = build_table(atmosphere, bands, Angles.spanned(sun_zenith, 0.0, 0.0), aod=haze)
terms, slopes = table.at(haze, sun_zenith, 0.0, 0.0)  # (band, term), and their derivatives by the optical depth

print("band  nm    path   T↓ t_dir  T↓ t_dif  S")
for name, wavelength, row in zip(names, centres, terms, strict=True):
    print(f"{name:4}  {wavelength:4.0f}  {row[0]:.4f}  {row[1]:.4f}    {row[2]:.4f}    {row[3]:.4f}")
assert np.all(np.diff(terms[:, 0]) < 0)  # the air's own light is blue
assert np.all((terms[:, 1:3].sum(axis=1) < 1) & (terms >= 0).all(axis=1))

# %% [markdown]
# ## A pixel of forest
#
# Forest is dark in visible light: 2 to 5 %. What part of the light above it is the forest's?

# %%
forest = np.array([0.022, 0.048, 0.026, 0.30, 0.065])[: len(names)]
meadow = np.full(len(names), 0.1)  # a brighter surrounding
echo = 1 - terms[:, 3] * meadow
shares = {
    "path: the air": terms[:, 0],
    "direct: the pixel": terms[:, 1] * forest / echo,
    "diffuse: its surroundings": terms[:, 2] * meadow / echo,
}
assert np.allclose(sum(shares.values()), reflectance_above(terms, forest, meadow), rtol=1e-12)

fig, ax = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
low = np.zeros(len(names))
for label, part in shares.items():
    ax.bar(names, part, bottom=low, label=label)
    low = low + part
ax.plot(names, forest, "kD", label="reflectance of the forest")
ax.set(ylabel="reflectance above the air", title=f"forest among meadows, haze {haze}")
ax.legend()
plt.show()
print("share of the light that left the forest itself:", (shares["direct: the pixel"] / low).round(2))
assert shares["direct: the pixel"][0] < 0.15 * low[0]  # in the blue nearly nothing

# %% [markdown]
# ## A scene
#
# Patches of forest, meadow, soil, roofs and water, as bright as they are and a little textured. Above it the
# equation, for each pixel and band, with surroundings like the pixel itself. Gases that absorb (ozone, water vapour,
# oxygen) are factors: $T_\mathrm{above}$ for what lies above the scattering air, water vapour on the way to the
# ground and back.

# %%
covers = np.array([  # B02, B03, B04, B8A, B12
    [0.022, 0.048, 0.026, 0.30, 0.065],  # forest
    [0.034, 0.085, 0.045, 0.42, 0.14],  # meadow
    [0.08, 0.12, 0.17, 0.26, 0.30],  # soil
    [0.20, 0.24, 0.29, 0.35, 0.36],  # roofs
    [0.03, 0.03, 0.012, 0.003, 0.001],  # water
])  # fmt: skip
size = 48 if quick else 96
random = np.random.default_rng(3)
y, x = np.mgrid[:size, :size] / size
place, kind = random.uniform(0, 1, (60, 2)), random.choice(5, 60, p=[0.3, 0.25, 0.25, 0.1, 0.1])
nearest = ((y[..., None] - place[:, 0]) ** 2 + (x[..., None] - place[:, 1]) ** 2).argmin(axis=-1)
cover = kind[nearest]
truth = np.moveaxis(covers[cover], -1, 0)[: len(names)] * random.lognormal(0, 0.1, (size, size))

gas = gases(bands, np.array([sun_zenith]), np.array([0.0]), atmosphere.pressure_hpa)
above = gas.above[0][:, None, None]
wet = terms.copy()
wet[:, 0] *= gas.half[0]  # what the air scatters has crossed half of the water vapour
wet[:, 1:3] *= gas.water[0][:, None]
wet = wet[:, None, None]  # (band, 1, 1, term), for all pixels
seen = above * reflectance_above(wet, truth)

# %% [markdown]
# ## Backwards
#
# For surroundings like the pixel, $\varrho = \rho$, the equation can be solved for $\rho$. With $T =
# T_\downarrow(t_\mathrm{dir}+t_\mathrm{dif})$ and the light of the ground, $\rho' =
# \rho_\mathrm{toa}/T_\mathrm{above} - \rho_\mathrm{path}$,
#
# $$ \rho = \frac{\rho'}{T + S\rho'} . $$

# %%
net = seen / above - wet[..., 0]
by_hand = net / (wet[..., 1] + wet[..., 2] + wet[..., 3] * net)
assert np.allclose(by_hand, surface_reflectance(wet, seen / above), rtol=1e-12)
assert np.abs(by_hand - truth).max() < 1e-12

wrong = haze * 1.2  # what if we believe in more haze than there is?
guess = table.at(wrong, sun_zenith, 0.0, 0.0)[0].copy()
guess[:, 0] *= gas.half[0]
guess[:, 1:3] *= gas.water[0][:, None]
too_much = surface_reflectance(guess[:, None, None], seen / above)


def colours(cube: np.ndarray) -> np.ndarray:
    """Red, green and blue bands as a picture; 25 % reflectance is white."""
    return np.clip(cube[[2, 1, 0]].transpose(1, 2, 0) / 0.25, 0, 1) ** (1 / 2.2)


fig, axes = plt.subplots(1, 4, figsize=(10, 2.9), layout="constrained")
views = {"the ground": truth, "from space": seen, "by hand": by_hand, f"haze taken as {wrong:.2f}": too_much}
for ax, (title, cube) in zip(axes, views.items(), strict=True):
    ax.imshow(colours(cube), interpolation="nearest")
    ax.set_title(title)
    ax.set_axis_off()
plt.show()

# %% [markdown]
# The haze is not written on the image. With a fifth too much of it forest and water come out a little too dark; with
# much more, darker than black.
#
# ## How wrong, if the haze is wrong?
#
# Let the believed optical depth be off by $\Delta\tau$. To first order the surface is off by $\Delta\rho =
# (\partial\rho/\partial\tau)\,\Delta\tau$, at a fixed measurement. From the equation above, with primes for
# derivatives by $\tau$ (the table has them),
#
# $$ \frac{\partial\rho}{\partial\tau} = -\frac{(1-S\rho)^2}{T}
#    \left[\rho_\mathrm{path}' + \frac{T'\rho}{1-S\rho} + \frac{T S'\rho^2}{(1-S\rho)^2}\right] . $$
#
# Haze adds light ($\rho_\mathrm{path}' > 0$) and takes light away ($T' < 0$). Over dark ground the first wins, over
# bright ground the second. In between lies a reflectance that haze does not change at all: it is invisible there!

# %%
rho = np.linspace(0, 0.6, 61)[:, None]  # (surface, band)
through, through_slope = terms[:, 1] + terms[:, 2], slopes[:, 1] + slopes[:, 2]
bounce = 1 - terms[:, 3] * rho
change = slopes[:, 0] + through_slope * rho / bounce + through * slopes[:, 3] * rho**2 / bounce**2
slope = -change * bounce**2 / through

# The same by finite differences: a measurement, inverted with a little more and a little less haze.
step = 0.01
measured = reflectance_above(terms, rho)
more, less = (surface_reflectance(table.at(haze + d, sun_zenith, 0.0, 0.0)[0], measured) for d in (step, -step))
# The next term of the difference is of the order of step squared.
assert np.abs((more - less) / (2 * step) - slope).max() < 1e-3

fig, ax = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
for k, name in enumerate(names):
    ax.plot(rho[:, 0], 0.05 * slope[:, k], label=name)
ax.axhline(0, color="k", lw=0.5)
ax.set(xlabel="reflectance of the surface", ylabel="error of the result", title="haze overestimated by 0.05")
ax.legend()
plt.show()
blind = [float(np.interp(0, slope[:, k], rho[:, 0])) for k in range(len(names))]
print("invisible haze:", ", ".join(f"{n} at {b:.2f}" for n, b in zip(names, blind, strict=True)))
assert np.all(slope[0] < 0)
assert np.all(slope[-1] > 0)

# %% [markdown]
# ## Finding the haze
#
# That dark ground reacts most is a curse and a blessing: it tells how much haze there is. Old practice: choose pixels
# that ought to be dark, and take the haze that gives them the reflectance which such pixels have. Here we know that
# forest has 0.026 in the red, give or take a tenth (a standard deviation, of a whole forest, not of a pixel):

# %%
dark = cover == 0
light = float(np.mean((seen / above)[2][dark]))  # B04, red
trial = np.linspace(0.8, 1.2, 81) * haze  # what the table covers
found = []
for depth in trial:
    row = table.at(depth, sun_zenith, 0.0, 0.0)[0][2].copy()
    row[0] *= gas.half[0, 2]
    row[1:3] *= gas.water[0, 2]
    found.append(float(surface_reflectance(row, light)))
found = np.array(found)
depths = [float(np.interp(-r, -found, trial)) for r in (0.026, 0.026 * 1.1, 0.026 * 0.9)]
sigma = 0.5 * abs(depths[1] - depths[2])
print(f"haze from the forest: {depths[0]:.3f} ± {sigma:.3f}; in truth {haze}")
assert abs(depths[0] - haze) < 2 * sigma
assert all(trial[0] < d < trial[-1] for d in depths)  # inside of the table

fig, ax = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
ax.plot(trial, found, label="the forest's red, inverted")
ax.axhspan(0.026 * 0.9, 0.026 * 1.1, alpha=0.2, color="C2", label="what we know of forests")
ax.axvline(haze, color="k", ls=":", label="truth")
ax.set(xlabel="optical depth of the haze", ylabel="reflectance")
ax.legend()
plt.show()

# %% [markdown]
# ## All of it in one line
#
# `skyscatter.dehaze` weighs the dark pixels of *all* bands, over many kinds of dark ground, into a probability of the
# haze, makes a map of it, and hands its uncertainty down to each pixel. (The tests give it the haze; its search
# solves a dozen atmospheres, half a minute the first time.)

# %%
given = {"aod": haze} if quick else {}
result = skyscatter.dehaze(
    seen, sensor="sentinel-2a", bands=names, sun_zenith_deg=sun_zenith, aerosol="continental", adjacency=False, **given
)
amount = result.aerosol["aod"]
error = result.reflectance - truth
print(f"haze {amount['mean']:.3f} ± {amount['sigma']:.3f}; in truth {haze}")
print("error of the ground, root mean square:", np.sqrt((error**2).mean(axis=(1, 2))).round(4))
print("standard deviation that is stated:    ", np.sqrt((result.sigma**2).mean(axis=(1, 2))).round(4))
print("error without any correction:         ", np.sqrt(((seen - truth) ** 2).mean(axis=(1, 2))).round(4))
assert abs(amount["mean"] - haze) <= 2 * amount["sigma"]
assert np.sqrt((error**2).mean()) < 0.1 * np.sqrt(((seen - truth) ** 2).mean())

fig, axes = plt.subplots(1, 3, figsize=(9.5, 3.3), layout="constrained")
axes[0].imshow(colours(np.asarray(result.reflectance)), interpolation="nearest")
axes[0].set_title("without its haze")
top = max(3e-3, float(np.abs(error[0]).max()))
shown = axes[1].imshow(error[0], cmap="RdBu_r", vmin=-top, vmax=top, interpolation="nearest")
axes[1].set_title("error, blue band")
fig.colorbar(shown, ax=axes[1], shrink=0.8)
shown = axes[2].imshow(result.sigma[0], vmin=0, interpolation="nearest")
axes[2].set_title("stated standard deviation")
fig.colorbar(shown, ax=axes[2], shrink=0.8)
for ax in axes:
    ax.set_axis_off()
plt.show()

# %% [markdown]
# Our scene was made with the equation that also corrects it, so errors this small say that the *algebra* is right. How
# right the physics is has to be judged with images made otherwise: by Monte Carlo walks over mapped ground, and
# with tables of another code. [docs/validation-dehaze.md](../docs/validation-dehaze.md) and its neighbours do that.
#
# ## Try it
#
# * Use another `aerosol` for the correction than for the scene (`"urban"` holds soot). Which covers suffer?
# * Leave `aerosol=` out: three kinds are tried and weighed. How much larger does `sigma` become?
# * Blur `truth` and use it as the environment: `reflectance_above(wet, truth, blurred)`. What does the correction
#   without adjacency do to the edges?
