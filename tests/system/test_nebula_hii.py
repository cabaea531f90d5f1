"""A region of ionised hydrogen: its size, all of its H-beta, and the colour of its lines, from pictures."""

from __future__ import annotations

import numpy as np
import pytest
from nebulae import Array

from skyscatter.geometry.telescope import Telescope
from skyscatter.image.spectral import SpectralImage
from skyscatter.lights import PointStar
from skyscatter.media.fronts import Front
from skyscatter.media.ionised import front_radii
from skyscatter.media.medium import Component, Medium
from skyscatter.media.operations import Power, Product
from skyscatter.media.shapes import GaussianSphere, Sphere
from skyscatter.media.structures import Slab
from skyscatter.optics.dust import Dust, dust_properties
from skyscatter.optics.lines import GasLines
from skyscatter.solvers.render import render
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.cells import cell_edges
from skyscatter.units import PARSEC

#: Wavelengths [nm] around H-beta and H-alpha, whose cells hold all of the line.
GRID = (485.268, 486.268, 487.268, 655.461, 656.461, 657.461)
BETA, ALPHA = slice(0, 3), slice(3, 6)
DISTANCE = 400 * PARSEC
#: Case B at 10000 K, low density: recombination coefficients of hydrogen [m3 s-1] and energy of an H-beta photon [J]
#: (Osterbrock & Ferland 2006, Astrophysics of Gaseous Nebulae, tables 2.1 and 4.2; alpha_eff from their emissivity of
#: 1.24e-25 erg cm3 s-1).
ALPHA_B, ALPHA_BETA, BETA_PHOTON = 2.59e-19, 3.04e-20, 4.085e-19
HYDROGEN = 1e8


def star() -> PointStar:
    return PointStar(temperature=38000.0, luminosity=1e5)


def gas(density: object) -> Component:
    return Component(name="gas", density=density, optics=GasLines(electron_density=HYDROGEN))


def line_radiance(image: SpectralImage, line: slice, layer: str | None = None) -> Array:
    """Radiance of a line [W m-2 sr-1], (y, x)."""
    values = image.radiance if layer is None else image.layers[layer]
    low, high = cell_edges(GRID)
    total: Array = (values * (high - low))[..., line].sum(axis=-1)
    return total


def picture(components: tuple[Component, ...], length: float, pixels: int = 96) -> tuple[SpectralImage, Array]:
    """A picture of gas in the light of its lines, and the solid angles [sr] of its pixels."""
    scene = SpaceScene(medium=Medium(components=components), view=View(distance=DISTANCE, inclination_deg=30.0))
    camera = Telescope.from_length(pixels, pixels, length, DISTANCE)
    image = render(scene, camera, GRID, solver="single", parts=True)
    scale = np.radians(camera.pixel_scale_deg)
    x, y = np.meshgrid(*2 * [(np.arange(pixels) + 0.5 - pixels / 2) * scale])
    return image, scale**2 / (1 + x * x + y * y) ** 1.5


def stromgren_sphere() -> tuple[float, Sphere]:
    """Radius by the closed form, and the region itself by the front that is found in uniform gas."""
    photons = star().ionising_photons()
    expected = float((3 * photons / (4 * np.pi * ALPHA_B * HYDROGEN**2)) ** (1 / 3))
    rows, columns = 5, 8
    theta, phi = np.meshgrid(np.pi * np.arange(rows) / 4, 2 * np.pi * np.arange(columns) / 8, indexing="ij")
    ways = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    radii = front_radii(
        lambda points: np.ones(len(points)), (0, 0, 0), ways, hydrogen_density=HYDROGEN, ionising_photons=photons,
        limit=3 * expected,
    )  # fmt: skip
    assert np.ptp(radii) < 1e-6 * expected
    return expected, Sphere(radius=float(radii[0]))


def test_stromgren_sphere() -> None:
    """Radius from the second moment of the picture, and H-beta over the whole sky, against the closed forms."""
    expected, front = stromgren_sphere()
    image, solid = picture((gas(front),), 2.4 * expected)
    beta = line_radiance(image, BETA)
    pixels = beta.shape[0]
    x, y = np.meshgrid(*2 * [(np.arange(pixels) + 0.5 - pixels / 2) * np.sqrt(solid.max())])
    # A uniform sphere is as bright as its chords: the mean square offset is 2/5 of the radius squared.
    radius = DISTANCE * np.sqrt(2.5 * np.average(x * x + y * y, weights=beta * solid))
    luminosity = 4 * np.pi * DISTANCE**2 * np.sum(beta * solid)
    closed = star().ionising_photons() * ALPHA_BETA / ALPHA_B * BETA_PHOTON
    print(
        f"radius {radius / PARSEC:.4f} pc ({radius / expected - 1:+.2%}), H-beta {luminosity:.4e} W ({luminosity / closed - 1:+.2%})"  # noqa: E501
    )
    # The rates themselves: fits within 0.7 % and 1 % of the tables.
    assert abs(radius / expected - 1) < 0.005
    assert abs(luminosity / closed - 1) < 0.015


def test_sphere_as_its_own_rates_have_it() -> None:
    """The same with the package's own rates: only the pixels are left, 96 of them across."""
    from skyscatter.media.ionised import case_b_luminosity, stromgren_radius

    photons = star().ionising_photons()
    expected, front = stromgren_sphere()
    assert abs(front.radius / stromgren_radius(photons, HYDROGEN) - 1) < 1e-6
    image, solid = picture((gas(front),), 2.4 * expected)
    for line, name in ((BETA, "hbeta"), (ALPHA, "halpha")):
        luminosity = 4 * np.pi * DISTANCE**2 * np.sum(line_radiance(image, line) * solid)
        ratio = luminosity / case_b_luminosity(photons, name)
        print(f"{name}: {ratio - 1:+.3%} from Q alpha_eff / alpha_B")
        assert abs(ratio - 1) < 1e-3


@pytest.mark.slow
def test_front_in_a_cloud_uses_every_photon() -> None:
    """A star beside the middle of a Gaussian cloud: whatever the density, H-beta counts the ionising photons.

    Where rays get out of the gas photons escape, so the cloud is so large that none does.
    """
    from skyscatter.media.ionised import case_b_luminosity

    photons = star().ionising_photons()
    size = stromgren_sphere()[0]
    place = np.array([0.35 * size, 0.0, 0.2 * size])
    cloud = GaussianSphere(width=2 * size)
    rows, columns = 49, 96
    theta = np.pi * np.arange(rows) / (rows - 1)
    theta, phi = np.meshgrid(theta, 2 * np.pi * np.arange(columns) / columns, indexing="ij")
    ways = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    radii = front_radii(
        cloud.density, place, ways.reshape(-1, 3), hydrogen_density=HYDROGEN, ionising_photons=photons, limit=6 * size
    ).reshape(rows, columns)
    assert radii.max() < 1.5 * size
    radii[0], radii[-1] = radii[0, 0], radii[-1, 0]
    # An edge as soft as this adds about 3 (width / radius)^2, a thousandth, to the volume.
    front = Front(radii=tuple(map(tuple, radii)), position=tuple(place), width=0.02 * size)
    image, solid = picture((gas(Product(fields=(Power(field=cloud, exponent=2.0), front))),), 4 * size, 24)
    luminosity = 4 * np.pi * DISTANCE**2 * np.sum(line_radiance(image, BETA) * solid)
    ratio = luminosity / case_b_luminosity(photons)
    print(f"front from {radii.min() / PARSEC:.3f} to {radii.max() / PARSEC:.3f} pc, H-beta {ratio - 1:+.3%}")
    # The soft edge, the bilinear front between directions 3.75 degrees apart, and the pixels.
    assert abs(ratio - 1) < 1e-2


@pytest.mark.parametrize("visual", [0.0, 1.0, 4.0])
def test_balmer_decrement(visual: float) -> None:
    """H-alpha is 2.86 times H-beta; dust in front reddens it as its extinction says, pixel by pixel."""
    size = 1.5 * PARSEC
    components = (gas(Sphere(radius=size)),)
    if visual:
        # Square to the line of sight, which leans by 30 degrees from the model's z axis.
        towards = View(inclination_deg=30.0).matrix[2]
        curtain = Slab(
            half_thickness=0.1 * PARSEC,
            half_width=10 * PARSEC,
            axis=tuple(towards),
            position=tuple(3 * PARSEC * towards),
        )
        column = 0.2 * PARSEC
        # A_V through 0.2 pc of dust: 1.0857 tau(550 nm), by hydrogen so that it counts along the line of sight.
        hydrogen = (
            visual / (2.5 / np.log(10)) / (column * float(dust_properties("milky-way-3.1", [550.0]).cross_section[0]))
        )
        components += (Component(name="curtain", density=curtain, optics=Dust(hydrogen_density=hydrogen)),)
    image, _ = picture(components, 2.4 * size, 24)
    alpha, beta = line_radiance(image, ALPHA, "direct"), line_radiance(image, BETA, "direct")
    seen = beta > 0
    section = dust_properties("milky-way-3.1", [486.268, 550.0, 656.461]).cross_section
    reddening = np.exp(visual / (2.5 / np.log(10)) * (section[0] - section[2]) / section[1])
    ratio = alpha[seen] / beta[seen]
    print(
        f"A_V {visual:g}: H-alpha / H-beta {ratio.min():.4f} to {ratio.max():.4f}; 2.86 reddened {2.86 * reddening:.4f}"
    )
    assert seen.sum() > 200
    # 2.86: Osterbrock & Ferland (2006), table 4.2; the fits of both rates are within 1 %, what dust does to 1e-3 (a
    # cell of
    # the wavelengths is as wide as 1 nm, and the rays lean by up to 0.3 degrees).
    assert np.abs(ratio / (2.86 * reddening) - 1).max() < 0.01
    bare = line_radiance(picture((gas(Sphere(radius=size)),), 2.4 * size, 24)[0], ALPHA, "direct")
    law = np.exp(-visual / (2.5 / np.log(10)) * section[2] / section[1])
    np.testing.assert_allclose(alpha[seen], law * bare[seen], rtol=1e-3)
