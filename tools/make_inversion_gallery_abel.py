"""Pictures of inversions of round objects: truth, estimate with its band, error, residual.

python tools/make_inversion_gallery_abel.py [shell|axisymmetric|globule ...]

They go to docs/gallery/inversion; that of the profiles, abel_pairs.png, is made by
benchmarks/abel_profiles.py --pictures.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import skyscatter
from skyscatter import fields, inversion
from skyscatter.atomic import atomic_path
from skyscatter.units import PARSEC

GALLERY = Path(__file__).resolve().parent.parent / "docs" / "gallery" / "inversion"


def keep(figure: Any, name: str) -> None:
    """Write a figure into the gallery."""
    GALLERY.mkdir(parents=True, exist_ok=True)
    with atomic_path(GALLERY / name) as path:
        figure.savefig(path, dpi=80)
    plt.close(figure)
    print(f"written to {GALLERY / name}")


def panel(figure: Any, ax: Any, image: np.ndarray, title: str, **options: Any) -> None:
    """An image with its scale."""
    drawn = ax.imshow(image, **options)
    ax.set_title(title, fontsize=10)
    figure.colorbar(drawn, ax=ax, shrink=0.75)


def shell() -> None:
    """An inclined prolate shell, its columns by skyscatter's own fields."""
    size, centre = 72, (34.3, 37.6)
    view = skyscatter.View(inclination_deg=60.0, position_angle_deg=40.0)
    field = fields.Shell(inner=15.0, outer=20.0, axes=(1, 1, 1.5))
    offsets = (np.arange(3) + 0.5) / 3 - 0.5
    x = (np.arange(size)[:, None] + offsets).ravel() - centre[0]
    up = centre[1] - (np.arange(size)[:, None] + offsets).ravel()
    points = x[None, :, None] * view.right + up[:, None, None] * view.up
    clean = field.column(points - 200 * view.forward, points + 200 * view.forward)
    clean = clean.reshape(size, 3, size, 3).mean(axis=(1, 3))
    sigma = 0.15 * clean.max()
    data = clean + sigma * np.random.default_rng(1).standard_normal(clean.shape) + 5.0
    found = inversion.fit_shell(data, sigma)
    fig, axes = plt.subplots(1, 4, figsize=(15, 3.6), layout="constrained")
    panel(fig, axes[0], data, "image: noise 15 % of the maximum")
    panel(fig, axes[1], found.fitted_image, "fitted shell")
    error = found.fitted_image - found.parameters["background"] - clean
    span = np.abs(error).max()
    panel(fig, axes[2], error, "fitted - true column", vmin=-span, vmax=span, cmap="RdBu_r")
    panel(fig, axes[3], found.residual / sigma, "residual / noise", vmin=-4, vmax=4, cmap="RdBu_r")
    keep(fig, "shell_fit.png")

    # What the inclination may be: spheroids that are seen like this one.
    b = np.sqrt(np.cos(np.radians(60)) ** 2 + (1.5 * np.sin(np.radians(60))) ** 2)
    fig, ax = plt.subplots(figsize=(5.5, 3.8), layout="constrained")
    tilt = np.radians(np.linspace(22, 90, 200))
    seen, doubt = 1 / found.ratio[0], found.ratio[1] / found.ratio[0] ** 2
    low, high = (np.sqrt(((seen + s * doubt) ** 2 - np.cos(tilt) ** 2) / np.sin(tilt) ** 2) for s in (-2, 2))
    ax.fill_between(np.degrees(tilt), low, high, alpha=0.5, lw=0, label="seen alike (95 %)")
    ax.plot([60], [1.5], "k*", ms=12, label="truth")
    for given, colour in ((None, "tab:red"), ((60.0, 5.0), "tab:green")):
        answer = inversion.deproject(found, "prolate", inclination_deg=given)
        label = "nothing known" if given is None else "i = 60 ± 5°"
        (i, di), (r, dr) = answer.inclination_deg, answer.axis_ratio
        ax.errorbar([i], [r], xerr=[di], yerr=[dr], fmt="o", color=colour, capsize=3, label=label)
    ax.set(xlabel="inclination [degree]", ylabel="c / a", ylim=(1, 3.5), title=f"seen axis ratio {1 / b:.3f}")
    ax.legend()
    keep(fig, "shell_degeneracy.png")


def axisymmetric() -> None:
    """A hollow barrel whose axis lies in the picture, with a gap and an uneven noise."""
    rows, columns, axis = 56, 64, 30.7

    def wide(r: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.exp(-(r**2) / 100 - (z - 28) ** 2 / 260)

    def narrow(r: np.ndarray, z: np.ndarray) -> np.ndarray:
        return 0.85 * np.exp(-(r**2) / 36 - (z - 28) ** 2 / 160)

    y, x = np.mgrid[:rows, :columns].astype(float)
    clean = np.sqrt(np.pi) * (10 * wide(x - axis, y) - 6 * narrow(x - axis, y))
    sigma = clean.max() * np.where(y > 36, 0.10, 0.03)
    data = clean + sigma * np.random.default_rng(3).standard_normal(clean.shape) + 2.0
    data[14:19, 36:41] = np.nan
    found = inversion.invert_axisymmetric(data, sigma, averaged=False)
    truth = wide(found.radius[None], found.along[:, None]) - narrow(found.radius[None], found.along[:, None])
    fig, axes = plt.subplots(1, 5, figsize=(17, 3.6), layout="constrained")
    panel(fig, axes[0], data, "image (noise 3 and 10 %, a gap)")
    limits = {"vmin": 0, "vmax": truth.max(), "aspect": "auto"}
    panel(fig, axes[1], truth, "true density (r to the right)", **limits)
    panel(fig, axes[2], found.density, "estimate", **limits)
    span = np.abs(found.density - truth).max()
    panel(fig, axes[3], found.density - truth, "estimate - truth", vmin=-span, vmax=span, cmap="RdBu_r", aspect="auto")
    panel(fig, axes[4], found.residual / sigma, "residual / noise", vmin=-4, vmax=4, cmap="RdBu_r")
    keep(fig, "abel_axisymmetric.png")
    print(f"axis {found.axis_position:.3f} ± {found.axis_error:.3f}, true {axis}")


def globule() -> None:
    """The dust of a Bonnor-Ebert globule, from a picture rendered before an even background."""
    size, ball = 64, fields.BonnorEbert(radius="0.06 pc", dimensionless_radius=6.9)
    optics = skyscatter.Dust(visual_extinction=6.0, mixture="milky-way-5.5")
    medium = skyscatter.Medium(components=(skyscatter.Component(name="dust", density=ball, optics=optics),))
    scene = skyscatter.SpaceScene(medium=medium, background=1e-6, view=skyscatter.View(distance="125 pc"))
    camera = skyscatter.Telescope.from_length(size, size, 0.18 * PARSEC, scene.view.distance)
    image = np.asarray(skyscatter.render(scene, camera, [800.0], solver="single").radiance, float)[..., 0]
    image = image + 1e-8 * np.random.default_rng(1).standard_normal(image.shape)
    options = {"wavelength_nm": 800.0, "mixture": "milky-way-5.5"}
    visual, error = inversion.extinction_map(image, 1e-6, 1e-8, **options)
    angle = camera.pixel_scale_deg * 3600
    found = inversion.dust_from_extinction(visual, angle, "125 pc", error, mixture="milky-way-5.5", averaged=False)
    per_volume = optics.hydrogen_per_volume(ball.reference_column())
    truth = per_volume * ball.profile(found.radius)
    pc = found.radius / PARSEC
    fig, axes = plt.subplots(1, 4, figsize=(16, 3.6), layout="constrained")
    panel(fig, axes[0], image / 1e-6, "brightness at 800 nm / background", vmin=0, cmap="magma")
    panel(fig, axes[1], visual, "A_V [mag]", vmin=0)
    axes[2].fill_between(
        pc, (found.lower - truth) / 1e6, (found.upper - truth) / 1e6, alpha=0.4, lw=0, color="tab:orange"
    )
    axes[2].plot(pc, (found.hydrogen_density - truth) / 1e6, color="tab:red")
    axes[2].axhline(0, color="k", lw=0.6)
    title = f"estimate - truth with band; truth up to {truth.max() / 1e6:,.0f}"
    axes[2].set(xlabel="radius [pc]", ylabel="hydrogen [cm⁻³]")
    axes[2].set_title(title, fontsize=10)
    panel(fig, axes[3], found.inversion.residual / error, "residual / noise", vmin=-4, vmax=4, cmap="RdBu_r")
    keep(fig, "globule.png")


if __name__ == "__main__":
    made = {"shell": shell, "axisymmetric": axisymmetric, "globule": globule}
    for name in sys.argv[1:] or made:
        if name not in made:
            raise SystemExit(f"{name}: there are {', '.join(made)}")
        made[name]()
