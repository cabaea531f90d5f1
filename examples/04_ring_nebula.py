# %% [markdown]
# # 4 The shell of a ring nebula
#
# A dying star sheds its outer layers; its hot core makes them glow. What looks like a ring is mostly a shell: at its
# rim the line of sight runs a long way through the gas, in the middle only through two walls. From a picture we shall
# find the shape of such a shell, and from its brightness how many electrons a cubic centimetre holds.

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import skyscatter
from skyscatter import fields, inversion
from skyscatter.units import PARSEC

quick = bool(os.environ.get("SKYSCATTER_QUICK"))  # the tests run a smaller version of this notebook
distance, inclination = 790 * PARSEC, 60.0  # m (Gaia's, rounded); degrees: an assumption, see below

# %% [markdown]
# ## The shape
#
# Let the density be the same on similar ellipsoids. Then the picture depends on one *elliptical* radius alone,
#
# $$ N(X, Y) = \frac{a\,c}{b}\,F(q), \qquad q^2 = \frac{X^2}{a^2} + \frac{Y^2}{b^2}, \qquad
#    b^2 = a^2\cos^2 i + c^2\sin^2 i , $$
#
# with $a$ the equatorial and $c$ the polar radius of a spheroid whose axis makes the angle $i$ with the line of
# sight. For a shell that is densest at $q = 1$ the function $F$ is a one-dimensional integral. So the fit has eight
# numbers: the centre, two radii, an angle, the thickness, the brightness, and that of the sky.
#
# The first picture is a photographic plate, if the reference folder has it (`SKYSCATTER_REFERENCE`): M 57 in the
# Digitized Sky Survey. A plate's density is not proportional to the light, and the bright ring has saturated it. It
# tells where the nebula is and how it is turned, **not** how dense it is. Without the plate we take a made-up one.


# %%
def shell_scene(radius: float, width: float, stretch: float, angle_deg: float, density: float) -> skyscatter.SpaceScene:
    """A prolate shell of glowing hydrogen, `density` electrons per m3 on its ridge."""
    shell = fields.GaussianShell(radius=radius, width=width, axes=(1, 1, stretch))
    gas = skyscatter.Component(name="gas", density=shell, optics=skyscatter.GasLines(electron_density=density))
    view = skyscatter.View(distance=distance, inclination_deg=inclination, position_angle_deg=angle_deg)
    return skyscatter.SpaceScene(medium=skyscatter.Medium(components=(gas,)), view=view)


def line_image(scene: skyscatter.SpaceScene, size: int, width: float) -> tuple[np.ndarray, float]:
    """H-alpha surface brightness [W m-2 sr-1], and the pixels' angle [arcsec]."""
    camera = skyscatter.Telescope.from_length(size, size, width, distance)
    image = skyscatter.render(scene, camera, [655.461, 656.461, 657.461], solver="single")
    return np.asarray(image.radiance, float).sum(axis=2), camera.pixel_scale_deg * 3600  # three cells of 1 nm


def without_stars(image: np.ndarray) -> np.ndarray:
    """True where a pixel stands out of its surroundings by five times the noise, and beside such pixels."""
    from scipy.ndimage import binary_dilation, median_filter

    excess = image - median_filter(image, 7)
    return binary_dilation(excess > 5 * 1.48 * np.median(np.abs(excess)), iterations=1)


folder = Path(os.environ.get("SKYSCATTER_REFERENCE", "reference")) / "nebula_images"
if (folder / "M57_dss_300.fits").is_file():
    from astropy.io import fits

    with fits.open(folder / "M57_dss_300.fits") as file:
        plate = np.asarray(file[0].data, float)[::-1][80:220, 80:220]  # row 0 at the top: north up, east on the left
        scale = abs(file[0].header["CDELT2"]) * 3600  # arcsec
    block = 4 if quick else 2
    n = 140 // block
    plate = plate[: n * block, : n * block].reshape(n, block, n, block).mean(axis=(1, 3))
    scale *= block
    source = "M 57, plate (DSS)"
else:
    print("The plate is not here (set SKYSCATTER_REFERENCE): a made-up picture takes its place.")
    made = shell_scene(0.11 * PARSEC, 0.03 * PARSEC, 1.45, 60.0, 5e8)
    plate, scale = line_image(made, 35 if quick else 70, 0.9 * PARSEC)
    plate = 3000 + 12000 * plate / plate.max()
    plate += 300 * np.random.default_rng(1).standard_normal(plate.shape)
    source = "made-up picture"

stars = without_stars(plate)
found = inversion.fit_shell(plate, mask=stars, profile="gaussian", pixel_size=scale, robust=True)
for name, value in found.parameters.items():
    print(f"{name:20s} {value:10.3f} ± {found.errors[name]:.3f}")

# %%
fig, axes = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
half = 0.5 * plate.shape[0] * scale
shown = {source: np.where(stars, np.nan, plate), "fitted shell": found.fitted_image, "residual": found.residual}
for ax, (title, image) in zip(axes, shown.items(), strict=True):
    span = np.nanmax(np.abs(found.residual)) if title == "residual" else None
    limits = {"vmin": -span, "vmax": span, "cmap": "RdBu_r"} if span else {"vmin": plate.min(), "vmax": plate.max()}
    drawn = ax.imshow(image, extent=(half, -half, -half, half), **limits)
    ax.set_title(title, fontsize=9)
    ax.set_xlabel("east [arcsec]")
    fig.colorbar(drawn, ax=ax, shrink=0.8)
axes[0].set_ylabel("north [arcsec]")
plt.show()

# %% [markdown]
# The residual is no noise: a real nebula has a halo and filaments, and the plate is saturated. The errors above are
# those of the model *if it were true*. But the outline is well measured: an ellipse of the axis ratio
# $b/a$, turned from north through east.
#
# ## What the outline cannot tell
#
# Only $b$ is seen, not $c$ and $i$: a long shell seen nearly end-on has the same outline as a short one from the side.
# Without more knowledge (velocities would help) this much remains, all directions of the axis being equally likely:

# %%
guess = inversion.deproject(found, "prolate")
known = inversion.deproject(found, "prolate", inclination_deg=(inclination, 5.0))
print(f"seen axis ratio {found.ratio[0]:.3f} ± {found.ratio[1]:.3f}, axis at {guess.axis_position_angle_deg:.0f}°")
for label, answer in (("nothing known", guess), (f"i = {inclination:g} ± 5°", known)):
    low, high = answer.axis_ratio_range
    value, error = answer.axis_ratio
    print(f"{label:14s}: c / a = {value:.2f} ± {error:.2f}, 95 % from {low:.2f} to {high:.2f}")

# %% [markdown]
# ## The density, from a picture of a line
#
# Photons of H-alpha are made when electrons and protons recombine: the light per volume is
#
# $$ j = \frac{\alpha_{\mathrm{eff}}(T)\,h\nu}{4\pi}\,n_e\,n_p , \qquad n_e \approx n_p . $$
#
# So a calibrated line image gives the density. We make one with skyscatter: a shell of this shape, $n_e$ = 500 cm⁻³
# on its ridge, with 2 % of noise, and forget what we know.

# %%
truth = 5e8  # m-3
metres = distance * np.pi / 648000  # one arcsec at this distance
equator = guess.equatorial_radius * metres
thickness = min(found.parameters["thickness"], 0.3)
size, width = (32, 4.2 * equator) if quick else (64, 4.2 * equator)
scene = shell_scene(equator, thickness * equator, known.axis_ratio[0], guess.axis_position_angle_deg, truth)
clean, angle = line_image(scene, size, width)
sigma = 0.02 * clean.max()
line = clean + sigma * np.random.default_rng(2).standard_normal(clean.shape)
again = inversion.fit_shell(line, sigma, profile="gaussian", pixel_size=angle * metres, averaged=False)

# %% [markdown]
# The fit's `brightness` is $j$ times $ac/b$; the depth $c/b$ follows from the inclination, if that is known.

# %%
density, errors = {}, {}
for label, knowledge in (("inclination unknown", None), ("inclination 60 ± 5°", (inclination, 5.0))):
    depth = inversion.deproject(again, "prolate", inclination_deg=knowledge)
    emissivity = again.parameters["brightness"] / (depth.equatorial_radius * depth.depth[0])
    density[label] = float(inversion.electrons_from_emissivity(emissivity)) / 1e6
    shares = [0.5 * again.errors["brightness"] / again.parameters["brightness"], 0.5 * depth.depth[1] / depth.depth[0]]
    errors[label] = density[label] * float(np.hypot(*shares))
    print(f"{label}: n_e = {density[label]:.0f} ± {errors[label]:.0f} cm⁻³ on the ridge (truth {truth / 1e6:.0f})")
assert abs(density["inclination 60 ± 5°"] - truth / 1e6) < 4 * errors["inclination 60 ± 5°"] < 100

# %% [markdown]
# ## Without a model of the shell
#
# If the nebula were a sphere, no shape of the profile had to be assumed: the inverse Abel transform finds it. Here is
# the same gas as a sphere, its centre, background and smoothness unknown.

# %%
ball = shell_scene(equator, thickness * equator, 1.0, 0.0, truth)
clean, angle = line_image(ball, size, width)
sigma = 0.02 * clean.max()
line = clean + sigma * np.random.default_rng(3).standard_normal(clean.shape)
gas = inversion.gas_from_line_image(line, angle, distance, sigma, averaged=False)
true_density = truth * np.sqrt(ball.medium.components[0].density.profile(gas.radius))

fig, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
pc = gas.radius / PARSEC
left.fill_between(pc, gas.lower / 1e6, gas.upper / 1e6, color="tab:orange", alpha=0.4, lw=0, label="68 % band")
left.plot(pc, gas.electron_density / 1e6, color="tab:red", label="estimate")
left.plot(pc, true_density / 1e6, "k--", lw=1, label="truth")
left.set(xlabel="radius [pc]", ylabel="electrons [cm⁻³]")
left.legend()
drawn = right.imshow(gas.inversion.residual / sigma, vmin=-4, vmax=4, cmap="RdBu_r")
right.set(title="residual / noise", xlabel="x [pixel]", ylabel="y [pixel]")
fig.colorbar(drawn, ax=right)
plt.show()
sun = 1.98841e30
print(
    f"centre {gas.inversion.centre[0]:.2f}, {gas.inversion.centre[1]:.2f} ± {gas.inversion.centre_error[0]:.2f} pixel"
)
print(f"ionised gas: {gas.mass / sun:.3f} ± {gas.mass_error / sun:.3f} solar masses, if it fills its volume evenly")
assert abs(gas.electron_density.max() / truth - 1) < 0.1

# %% [markdown]
# Outside and inside the shell the band is wide in $n_e$ though the light is faint: a root of a small number is not so
# small. And if the gas is clumpy, filling a share $f$ of its volume, its clumps are denser by $1/\sqrt f$, its mass
# less by $\sqrt f$: `filling_factor` says so.
