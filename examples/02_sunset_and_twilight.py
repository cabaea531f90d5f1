# %% [markdown]
# # 2 Sunset and twilight
#
# The Sun goes down: it turns orange, the shadow of the Earth rises in the east under a pink belt, and overhead the sky
# turns to a deep blue that has little to do with the blue of noon. This notebook follows the light through all three.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image.colour import spectrum_to_xyz, xyz_to_rgb

quick = bool(os.environ.get("SKYSCATTER_QUICK"))  # the tests run a smaller version of this notebook
wavelengths = np.arange(380.0, 781.0, 80.0 if quick else 20.0)  # nm
scene = skyscatter.load_model("earth").scene(sun_azimuth_deg=270)  # the Sun goes down in the west
here, radius = scene.observer.position, scene.observer.planet_radius


def hue(spectra: np.ndarray) -> np.ndarray:
    """Colours on the screen of spectra (..., wavelength), each as bright as the screen can show it."""
    linear = np.maximum(xyz_to_rgb(spectrum_to_xyz(spectra, wavelengths)), 0)
    linear = linear / linear.max(axis=-1, keepdims=True)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def chromaticity(spectra: np.ndarray) -> np.ndarray:
    """CIE 1931 x, y of spectra (..., wavelength)."""
    xyz = spectrum_to_xyz(spectra, wavelengths)
    return xyz[..., :2] / xyz.sum(axis=-1, keepdims=True)


# %% [markdown]
# ## The setting Sun
#
# Sunlight that reaches us without being scattered is $E = E_0\,e^{-\tau(e)}$. In flat air the path at the elevation $e$
# would be longer than the vertical one by $1/\sin e$, without end at the horizon. The Earth is round: at a height
# $h \ll R$ a horizontal ray is only $\sqrt{2Rh}$ away, so that the horizon's path through air of scale height $H$ has
#
# $$ \frac{\tau(0)}{\tau(90°)} \approx \int_0^\infty e^{-t^2/2RH}\,\frac{\mathrm{d}t}{H} = \sqrt{\frac{\pi R}{2H}} . $$

# %%
elevations = np.array([90.0, 60, 45, 30, 20, 15, 10, 7, 5, 3, 2, 1, 0])
ends = here + 3e6 * direction_from_azimuth_elevation(270.0, elevations)  # anywhere outside the air
depth = skyscatter.optical_depth(scene, here, ends, wavelengths, by_component=True)
names = [component.name for component in scene.medium.components]
sunlight = scene.star.irradiance(wavelengths, scene.star_distance) * np.exp(-depth.sum(axis=1))

fig, (left, right) = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
for k, name in enumerate(names):
    left.plot(elevations, depth[:, k, -1] / depth[0, k, -1], "o-", ms=3, label=name)
left.plot(elevations[:-1], 1 / np.sin(np.radians(elevations[:-1])), "k:", label="flat, 1 / sin e")
left.set(xlabel="elevation of the Sun [degree]", ylabel="path / vertical path", yscale="log", ylim=(0.9, 100))
left.legend()
right.imshow(hue(sunlight)[None], aspect="auto", extent=(0, len(elevations), 0, 1))
right.set_xticks(np.arange(len(elevations)) + 0.5, [f"{e:.0f}" for e in elevations])
right.set(yticks=[], xlabel="elevation of the Sun [degree]", title="colour of the Sun through the air")
plt.show()

horizon = depth[-1, 0, -1] / depth[0, 0, -1]
estimate = np.sqrt(np.pi * radius / (2 * 8000))
print(f"air along the horizon: {horizon:.1f} times the vertical; the formula with H = 8 km says {estimate:.1f}")
# The scale height of real air is 8.4 km at the ground, and 6 to 7 km above 10 km.
assert abs(horizon / estimate - 1) < 0.1

# %% [markdown]
# Ozone is different: it stands some 22 km high, where a line to the horizon crosses it at a slant, not along it. So
# ozone is not what reddens the Sun; but remember its slant path.
#
# ## The sky, from day to dusk
#
# `solve` computes the light in the whole atmosphere once, for a range of positions of the Sun; after that every view
# is a look-up. Each panorama below shows the upper half of the sky, from north over east, south and west, to north
# again. The brightness falls by a factor of thousands between them: each has an exposure of its own.

# %%
field = skyscatter.solve(scene, wavelengths, sun_elevations_deg=(-8, 8), tolerance=0.01)
width = 48 if quick else 420
camera = skyscatter.Panorama(width=width, height=width // 6, elevation_min_deg=0, elevation_max_deg=60)
grid = camera.directions(scene.observer)

suns = [6, 2, 0, -3, -6]
fig, axes = plt.subplots(len(suns), 1, figsize=(8, 7.8), layout="constrained")
for ax, sun in zip(axes, suns, strict=True):
    image = skyscatter.SpectralImage(field.radiance(here, grid, sun_elevation_deg=sun).radiance, wavelengths)
    ax.imshow(image.picture(exposure=image.auto_exposure() - 0.5), extent=(0, 360, 0, 60), aspect="auto")
    ax.set_title(f"Sun at {sun}°: median luminance {np.median(image.luminance()):.3g} cd/m$^2$", fontsize=9)
    ax.set(yticks=[0, 30, 60], xticks=[])
axes[-1].set_xticks([0, 90, 180, 270, 360], ["north", "east", "south", "west", "north"])
axes[2].set_ylabel("elevation [degree]")
plt.show()

# %% [markdown]
# ## The shadow of the Earth
#
# When the Sun stands $\delta$ below the horizon, we are in the shadow of the Earth, and above us the sunlight begins at
# the height
#
# $$ h = R\left(\frac{1}{\cos\delta}-1\right) \approx \frac{R\,\delta^2}{2} . $$
#
# Look away from the Sun at the elevation $e$. At the distance $t$ we are $R\cos\delta + t\sin(e-\delta)$ from the
# shadow's axis: if $e > \delta$ this grows until it reaches $R$ and the line comes out into the light; if $e <
# \delta$ it never does. So the shadow's edge in the east rises **as fast as the Sun sinks**. Its edge is not sharp,
# for light that has just grazed the Earth has lost its blue (and much else) on the way: it is dim and red. Scattered
# back to us in front of the blue-grey shadow, it makes the *Belt of Venus*.

# %%
depths = np.array([1.0, 2.0, 3.0, 4.0])
rise = np.linspace(0.25, 25, 34 if quick else 100)
east = direction_from_azimuth_elevation(90.0, rise)
profiles = np.stack([field.radiance(here, east, sun_elevation_deg=-d).radiance for d in depths])  # (sun, view, nm)
redness = chromaticity(profiles)[..., 0]
belt = rise[redness.argmax(axis=1)]

fig, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
left.imshow(hue(profiles).swapaxes(0, 1)[::-1], aspect="auto", extent=(0.5, 4.5, 0, 25), interpolation="nearest")
left.hlines(depths, depths - 0.5, depths + 0.5, color="k", label="edge of the shadow, e = $\\delta$")
left.set(xticks=depths, xlabel="depth of the Sun $\\delta$ [degree]", ylabel="elevation in the east [degree]")
left.set_title("colours in the east, all as bright", fontsize=10)
left.legend(fontsize=8)
for d, line in zip(depths, redness, strict=True):
    right.plot(rise, line, label=f"$\\delta$ = {d:.0f}°")
    right.plot(rise[line.argmax()], line.max(), "k.")
right.set(xlabel="elevation in the east [degree]", ylabel="CIE x: larger is redder")
right.legend()
plt.show()
print("reddest elevation:", ", ".join(f"{b:.1f}° at Sun -{d:.0f}°" for b, d in zip(belt, depths, strict=True)))
# The belt lies above the geometric edge, since what grazes the ground is extinguished, and rises with it.
assert np.all(belt > depths)
assert np.all(np.diff(belt) > 0)

# %% [markdown]
# The belt at its best, with the Sun 2° below the western horizon, as a camera that faces east sees it:

# %%
pixels = (48, 24) if quick else (480, 240)
lens = skyscatter.Perspective(width=pixels[0], height=pixels[1], azimuth_deg=90, elevation_deg=15, fov_deg=60)
view = lens.directions(scene.observer)
up = view[..., 2] > 0  # above the horizon
cube = np.full((*up.shape, wavelengths.size), np.nan)
cube[up] = field.radiance(here, view[up], sun_elevation_deg=-2).radiance
image = skyscatter.SpectralImage(cube, wavelengths)
fig, ax = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
ax.imshow(image.picture(exposure=image.auto_exposure() - 0.5))
ax.axhline(lens.pixel(direction_from_azimuth_elevation(90.0, 2.0))[1], color="w", lw=0.8, ls=":")
ax.set_axis_off()
ax.set_title("towards the east, Sun at -2°; dotted: edge of the shadow by geometry", fontsize=9)
plt.show()

# %% [markdown]
# ## Ozone's blue
#
# Rayleigh scattering alone would make the zenith of dusk pale and yellowish: its light has come along a grazing path,
# on which the blue has been scattered out. What keeps the zenith blue is **ozone**. It absorbs orange and red,
# weakly, in its *Chappuis bands* about 600 nm (its vertical optical depth is 0.04 there). The sunlight of dusk
# crosses the ozone layer along a grazing path, which is as long as some thirty vertical ones. So: solve once more,
# without ozone.

# %%
without = scene.model_copy(update={"medium": scene.medium.without("ozone")})
bare = skyscatter.solve(without, wavelengths, sun_elevations_deg=(-8, 8), tolerance=0.01)
sinking = np.arange(8.0, -8.1, -2.0)
zenith = {
    name: np.stack([f.radiance(here, [0, 0, 1], sun_elevation_deg=s).radiance for s in sinking])
    for name, f in (("with ozone", field), ("without", bare))
}

fig, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
strips = np.stack([hue(light) for light in zenith.values()])
left.imshow(strips, aspect="auto", extent=(9, -9, 0, 2))
left.set(xlabel="elevation of the Sun [degree]", yticks=(1.5, 0.5), title="colour of the zenith")
left.set_yticklabels(zenith)
dusk = np.argmin(np.abs(sinking + 6))
for name, light in zenith.items():
    right.plot(wavelengths, light[dusk] * 1e6, label=name)
right.set(xlabel="wavelength [nm]", ylabel="radiance [$\\mu$W m$^{-2}$ sr$^{-1}$ nm$^{-1}$]", ylim=(0, None))
right.set_title("zenith, Sun at -6°")
right.legend()
plt.show()

x_with, x_without = (chromaticity(light)[dusk, 0] for light in zenith.values())
orange = np.argmin(np.abs(wavelengths - 600))
taken = -np.log(zenith["with ozone"][dusk, orange] / zenith["without"][dusk, orange])
overhead = depth[0, names.index("ozone"), orange]
print(f"CIE x of the zenith at Sun -6°: {x_with:.3f} with ozone, {x_without:.3f} without (white: 0.313)")
print(f"at {wavelengths[orange]:.0f} nm ozone takes {taken:.2f} optical depths: {taken / overhead:.0f} vertical ones")
assert x_with < x_without - 0.05
assert 5 < taken / overhead < 40

# %% [markdown]
# At noon ozone changes next to nothing; at dusk it decides on the colour (Hulburt 1953, *J. Opt. Soc. Am.* 43, 113).
#
# ## Try it
#
# * How high is the shadow above you when the Sun is at -6°, the end of civil twilight? At -18°?
# * Take the aerosol away as well. Is the belt brighter or dimmer?
# * Twilight on Mars: `skyscatter.load_model("mars")`. Why is *its* sunset blue?
