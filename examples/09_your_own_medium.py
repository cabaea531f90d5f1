# %% [markdown]
# # 9 Your own medium
#
# Every medium of skyscatter, Earth's air or a nebula, is a **sum of components**, and each component is a **density
# field** (where is it?) times an **optical model** (what does it do to light of each wavelength?):
#
# $$ \sigma(\mathbf{x}, \lambda) = \sum_c w_c\, n_c(\mathbf{x})\, \sigma_c(\lambda) . $$
#
# The density $n_c$ has no unit; $\sigma_c$ says how much one unit of it scatters and absorbs per metre. Here we build
# a planet with a fogbow and a purple gas, and a nebula with a spiral, both from formulas and tables of our own.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

import skyscatter
from skyscatter import fields
from skyscatter.media.fields import Tabulated
from skyscatter.optics.absorption import TabulatedAbsorption
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import TabulatedPhase
from skyscatter.optics.rayleigh import RayleighPowerLaw

quick = bool(os.environ.get("SKYSCATTER_QUICK"))  # the tests run a smaller version of this notebook

# %% [markdown]
# ## A density of your own: a table
#
# Air that is in balance with gravity obeys $\mathrm{d}p/\mathrm{d}h = -\varrho g$, and so its density falls with the
# scale height $H = kT/mg$. Let our planet be cold below and warm above: $H$ grows from 5 to 8 km. We integrate $n =
# \exp(-\int \mathrm{d}h/H)$ (leaving out that warmer air is thinner) and hand it over as a table.

# %%
altitude = np.linspace(0, 90e3, 46)  # m
scale_height = 5e3 + 3e3 * np.clip(altitude / 40e3, 0, 1)
fall = np.concatenate([[0.0], np.cumsum(np.diff(altitude) * 0.5 * (1 / scale_height[1:] + 1 / scale_height[:-1]))])
air_density = Tabulated(altitudes=tuple(altitude), densities=tuple(np.exp(-fall)))  # between nodes: straight logarithms

fog_density = Tabulated(
    altitudes=("0 km", "1 km", "2 km", "3 km"), densities=(1.0, 1.0, 0.3, 0.0), interpolation="linear"
)
# Columns of tables are exact: for straight lines the trapezoidal rule is, too.
by_hand = 1000 * (1.0 + 0.65 + 0.15)
assert abs(fog_density.reference_column() / by_hand - 1) < 1e-12

# %% [markdown]
# ## A phase function of your own: a table
#
# Where does scattered light go? The phase function $p(\theta)$ is its density over solid angle, $\int
# p\,\mathrm{d}\Omega = 1$. Droplets of water scatter forward; and a ray that is reflected once inside of a drop comes
# back at an angle which has an extremum, about 138° for red light and 140° for blue. There the rays crowd: the
# rainbow. Droplets of fog are so small that diffraction widens it. We draw such a curve by hand. `TabulatedPhase`
# normalises it.

# %%
cosines = np.concatenate([np.linspace(-1, -0.5, 101), np.linspace(-0.5, 0.8, 66)[1:], np.linspace(0.8, 1, 81)[1:]])
angle = np.degrees(np.arccos(cosines))
bow_wavelengths = (450.0, 550.0, 650.0)
bow_angles = (140.5, 139.2, 138.0)


def droplets(bow_at: float) -> np.ndarray:
    """Light over the scattering angle: a forward lobe (Henyey-Greenstein, g = 0.75), and a bow with its dark side."""
    lobe = (1 - 0.75**2) / (1 + 0.75**2 - 2 * 0.75 * cosines) ** 1.5
    bow = 0.6 * np.exp(-0.5 * ((angle - bow_at - 1) / 1.5) ** 2)
    inside = 0.15 / (1 + np.exp(-(angle - bow_at) / 1.5))  # inside of the bow it is brighter than outside
    return 0.3 * lobe + bow + inside


table = np.stack([droplets(at) for at in bow_angles], axis=1)  # (angle, wavelength)
phase = TabulatedPhase(
    cos_theta=tuple(cosines), wavelengths=bow_wavelengths, values=tuple(tuple(row) for row in table.tolist())
)
over_sphere = 2 * np.pi * np.trapezoid(phase.value(cosines, bow_wavelengths), cosines, axis=0)
print("integral over the sphere:", over_sphere, " mean cosine:", phase.mean_cosine([550.0]).round(3))
assert np.allclose(over_sphere, 1, rtol=1e-9)

# %% [markdown]
# ## Absorption of your own: a table
#
# A gas that takes out the green, as a cross-section per molecule and a column of molecules. (For numbers in a file
# there is `TabulatedAbsorption(file="my_gas.csv", ...)`.)

# %%
wavelengths = np.array([440.0, 510, 580, 650]) if quick else np.arange(400.0, 701.0, 40.0)
nodes = np.arange(400.0, 701.0, 20.0)
green = 3e-24 * np.exp(-0.5 * ((nodes - 545) / 40) ** 2)  # m2
gas = TabulatedAbsorption(
    cross_section=skyscatter.SpectralTable(wavelengths=tuple(nodes), values=tuple(green)), column_m2=1.2e23
)

# %% [markdown]
# ## The planet
#
# Components by name, a ground, a star, and the numbers of the planet. Everything is checked when it is made: a wrong
# name, unit or range gives one line that says what would be right.

# %%
planet = skyscatter.Model(
    name="fogbow",
    description="A small planet with low fog and a purple gas.",
    planet=skyscatter.Planet(name="Fogbow", radius="4000 km"),
    ground=skyscatter.Ground(albedo=0.1),
    star=skyscatter.Star(spectrum="blackbody", temperature=5200, radius=6.0e8, distance="0.7 au"),
    components=(
        skyscatter.Component(name="air", density=air_density, optics=RayleighPowerLaw(coefficient=1.5e-5)),
        skyscatter.Component(
            name="fog",
            density=fog_density,
            optics=Particles(optical_depth=0.15, single_scattering_albedo=1.0, phase=phase),
        ),
        skyscatter.Component(name="purple gas", density=air_density, optics=gas),
    ),
)
try:
    skyscatter.Planet(name="Fogbow", radius="-4000 km")
except ValueError as error:
    print("A wrong radius:", str(error).splitlines()[1].split("[")[0].strip())

scene = planet.scene(sun_elevation_deg=12, sun_azimuth_deg=180)
here = scene.observer.position
depth = skyscatter.optical_depth(scene, here, here + np.array([0, 0, planet.top]), wavelengths, by_component=True)

fig, axes = plt.subplots(1, 3, figsize=(10.5, 3.2), layout="constrained")
height = np.linspace(0, 40e3, 300)
for component in planet.components[:2]:
    axes[0].plot(component.density.density(height), height / 1e3, label=component.name)
axes[0].set(xlabel="density (relative)", ylabel="altitude [km]")
for k, at in enumerate(bow_wavelengths):
    axes[1].semilogy(angle, phase.value(cosines, [at])[:, 0], color=("C0", "C2", "C3")[k], label=f"{at:.0f} nm")
axes[1].set(xlabel="scattering angle [degree]", ylabel="phase function [sr$^{-1}$]")
for component, line in zip(planet.components, depth, strict=True):
    axes[2].plot(wavelengths, line, label=component.name)
axes[2].set(xlabel="wavelength [nm]", ylabel="vertical optical depth", ylim=(0, None))
for ax in axes:
    ax.legend(fontsize=8)
plt.show()
# Optical depth = column times coefficient: of the gas, its molecules times their cross-section.
assert np.allclose(depth[2], 1.2e23 * np.interp(wavelengths, nodes, green), rtol=1e-9)

# %% [markdown]
# ## The model file
#
# A model is a TOML file, which says the same as the Python above and can be given to others. What is loaded is
# *equal* to what was saved.

# %%
planet.save("fogbow.toml")
again = skyscatter.load_model("fogbow.toml")
assert again == planet
for line in planet.to_toml().splitlines()[:22]:
    print(line if len(line) < 110 else line[:107] + "...")

# %% [markdown]
# From the command line, `skyscatter models show fogbow.toml --plot profiles.png` draws it, and `skyscatter sky
# fogbow.toml -o sky.png` renders it.
#
# ## What it looks like
#
# With the star in our back, we look for the bow around the point opposite to it, 12° below the horizon: the bow has a
# radius of some 41°, so its top should stand 29° high. Then the planet from space, with the purple gas thick at the
# limb.

# %%
size = (32, 20) if quick else (240, 150)
camera = skyscatter.Perspective(width=size[0], height=size[1], azimuth_deg=0, elevation_deg=25, fov_deg=100)
bow = skyscatter.render(scene, camera, wavelengths)
away = planet.scene(sun_elevation_deg=35, sun_azimuth_deg=240, altitude="9000 km")
globe = skyscatter.render(
    away, skyscatter.PlanetView(width=size[1], height=size[1]), wavelengths, "single" if quick else "orders"
)

fig, (left, right) = plt.subplots(1, 2, figsize=(10.5, 3.9), layout="constrained", width_ratios=[1.58, 1])
left.imshow(bow.picture())
left.set_title("away from the star")
right.imshow(globe.picture())
right.set_title("from space")
for ax in (left, right):
    ax.set_axis_off()
plt.show()

# %%
up = np.arange(20.0, 38.1, 0.5)
north = np.stack([0 * up, np.cos(np.radians(up)), np.sin(np.radians(up))], axis=-1)
profile = skyscatter.radiance(scene, here, north, wavelengths).radiance
red = np.argmin(np.abs(wavelengths - 650))
slow = np.interp(up, up[[0, -1]], profile[[0, -1], red])  # the sky beside the bow
top = float(up[(profile[:, red] / slow).argmax()])
print(f"the bow in red light stands {top:.1f}° high; from the table, 180° - 139° - 12° = 29°")
assert abs(top - 29) < 1.5

# %% [markdown]
# ## A nebula: densities in three dimensions
#
# Shapes are records in `skyscatter.fields`, and combine as formulas: `a + b`, `2 * a`, `a * b`, `a**2`,
# `a.carved_by(b)`, `a.rotated(...)`, `a.warped(...)`. For a density that no shape has, compute it with numpy on a
# grid and hand over the array, or, for large ones, the name of a file. Ours is a disk with two spiral arms,
#
# $$ n = e^{-(r/0.5\,\mathrm{pc})^2}\left[0.1 + \cos^4\!\left(\phi - k\ln r\right)\right]
#    e^{-z^2/2h(r)^2}, \qquad h = 0.03\,\mathrm{pc} + 0.06\,r . $$

# %%
PARSEC = 3.0857e16  # m
cells = 40 if quick else 112


def spiral_plane(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The disk's density in its middle plane, and its thickness; lengths in pc."""
    r = np.hypot(x, y)
    arms = np.cos(np.arctan2(y, x) - 2.2 * np.log(np.maximum(r, 1e-3))) ** 4
    return np.exp(-((r / 0.5) ** 2)) * (0.1 + arms), 0.03 + 0.06 * r


steps = (np.arange(cells) + 0.5) / cells * 2 - 1  # middles of cells, -1 to 1 pc
x, y, z = np.meshgrid(steps, steps, 0.4 * steps, indexing="ij")
plane, thickness = spiral_plane(x, y)
np.save("spiral.npy", (plane * np.exp(-0.5 * (z / thickness) ** 2)).astype(np.float32))
spiral = fields.VoxelGrid(file="spiral.npy", low=("-1 pc", "-1 pc", "-0.4 pc"), high=("1 pc", "1 pc", "0.4 pc"))

# The column through the disk, against the Gaussian's integral; trilinear cells of the size d widen a curve a little.
point = np.array([0.35, 0.2])
column = spiral.column([*point * PARSEC, -PARSEC], [*point * PARSEC, PARSEC]) / PARSEC
middle, thick = spiral_plane(*point)
print(f"column at {point} pc: {column:.4f} pc, by formula {np.sqrt(2 * np.pi) * middle * thick:.4f} pc")
assert abs(column / (np.sqrt(2 * np.pi) * middle * thick) - 1) < (0.1 if quick else 0.02)

# %% [markdown]
# Around it a broken bubble, from shapes: a shell, made patchy by turbulence, and opened along the axis by two lobes.

# %%
shell = fields.GaussianShell(radius="0.8 pc", width="0.04 pc")
patches = fields.Turbulence(outer_scale="0.5 pc", inner_scale="0.05 pc", deviation=0.8, seed=4)
opening = fields.BipolarLobes(length="1.1 pc", width="1.1 pc")
bubble = fields.Sampled(field=(shell * patches).carved_by(opening), cells=cells)

# Dust of our own in the disk: its optics are tables, its phase function a number; the bubble's gas glows in H-alpha.
grains = Particles(
    extinction=skyscatter.SpectralTable(wavelengths=(400, 550, 700), values=tuple(np.array([18, 12, 8]) / PARSEC)),
    single_scattering_albedo=skyscatter.SpectralTable(wavelengths=(400, 700), values=(0.55, 0.7)),
    phase={"kind": "henyey-greenstein", "g": 0.5},
)
nebula = skyscatter.NebulaModel(
    name="pinwheel",
    description="A dusty spiral in a broken bubble of glowing gas.",
    view=skyscatter.View(ra_deg=100, dec_deg=20, distance="500 pc", inclination_deg=55, position_angle_deg=30),
    components=(
        skyscatter.Component(name="spiral", density=spiral, optics=grains),
        skyscatter.Component(name="bubble", density=bubble, optics=skyscatter.GasLines(electron_density=1.5e8)),
    ),
    stars=(skyscatter.PointStar(name="centre", position=(0, 0, "0.08 pc"), temperature=9000, luminosity=500),),
)
nebula.save("pinwheel.toml")
assert skyscatter.load_model("pinwheel.toml").components[1] == nebula.components[1]  # paths of files become absolute

# %%
pixels = 24 if quick else 112
fig, axes = plt.subplots(1, 3, figsize=(10.5, 3.7), layout="constrained")
for ax, inclination in zip(axes, (0, 55, 90), strict=True):
    turned = nebula.scene(inclination_deg=inclination)
    telescope = skyscatter.Telescope.from_length(pixels, pixels, "2.2 pc", turned.view.distance)
    image = skyscatter.render(
        turned, telescope, [450.0, 550.0, 650.0], solver=skyscatter.Path(samples=4 if quick else 16)
    )
    ax.imshow(image.picture(exposure=-6))
    ax.set_title(f"inclination {inclination}°")
    ax.set_axis_off()
plt.show()

# The light of the bubble alone needs no walk: emission times column. H-alpha of 1 pc of such gas, case B:
edge_on = nebula.scene(inclination_deg=90)
gas_only = edge_on.model_copy(update={"medium": edge_on.medium.without("spiral"), "stars": ()})
start, forward = np.array([0.6 * PARSEC, -5 * PARSEC, 0.0]), np.array([0.0, 1.0, 0.0])
seen = skyscatter.radiance(gas_only, start, forward, [450.0, 550.0, 650.0], "single").radiance
width = 100.0  # nm, of the cell of 650 nm, over which the line is averaged
per_metre = nebula.components[1].optics.line_emissivity("halpha")
expected = per_metre * bubble.column(start, start + 10 * PARSEC * forward) / width
print(f"H-alpha of the bubble: {seen[2]:.3e} W m-2 sr-1 nm-1, emissivity times column {expected:.3e}")
assert abs(seen[2] / expected - 1) < 1e-3

# %% [markdown]
# ## Try it
#
# * Give the planet the Mie droplets that the curve imitates: `skyscatter.optics.mie.MieAerosol`. Where is the second
#   bow?
# * Wind the arms tighter. Let the star move out of the middle.
# * `spiral.warped("0.1 pc", "0.6 pc", seed=1)` and `spiral + 0.2 * bubble`: what would you see in scattered light?
