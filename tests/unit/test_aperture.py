"""Diffraction by an aperture: Airy's numbers, the transform of the pupil itself, and what it makes of pictures."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import jn_zeros

from skyscatter.errors import DomainError
from skyscatter.image import SkyFrame, SpectralImage, observe
from skyscatter.image.aperture import ARCSEC, Aperture
from skyscatter.image.psf import APERTURES, point_spread

NM = 550.0
MIRROR = 2.4
WIDTH = NM * 1e-9 / MIRROR / ARCSEC  # λ / D [arc second]


def test_rings_and_encircled_energy_are_airys() -> None:
    """Born & Wolf, section 8.5.2: dark rings at 1.220, 2.233 and 3.238 λ / D hold 83.8, 91.0 and 93.8 %."""
    clear = Aperture(diameter_m=MIRROR)
    dark = jn_zeros(1, 3) / np.pi
    np.testing.assert_allclose(dark, [1.220, 2.233, 3.238], atol=5e-4)
    inside = 1.0 - clear.outside(dark * WIDTH, NM)
    np.testing.assert_allclose(inside, [0.8378, 0.9099, 0.9376], atol=1e-4)  # four digits are printed
    # no light lies on a dark ring: the share outside stands still there, and nowhere near it
    step = 1e-3 * WIDTH
    falls = [(clear.outside(r - step, NM) - clear.outside(r + step, NM)) / step * WIDTH for r in dark * WIDTH]
    np.testing.assert_allclose(falls, 0.0, atol=1e-4)
    assert clear.outside(0.9 * dark[0] * WIDTH - step, NM) - clear.outside(0.9 * dark[0] * WIDTH + step, NM) > 1e-5


@pytest.mark.parametrize("obstruction", [0.0, 0.33, 0.8])
def test_all_light_is_somewhere(obstruction: float) -> None:
    mirror = Aperture(diameter_m=MIRROR, obstruction=obstruction)
    assert mirror.outside(0.0, NM) == pytest.approx(1.0, abs=1e-9)  # of an integral with 6e4 nodes
    shares = mirror.outside(np.linspace(0.0, 900.0 * WIDTH, 20000), NM)
    assert np.diff(shares).max() < 1e-7  # interpolation
    # far out the mean fall is 2 / (π x (1 - ε)), with ripples of 1 / x
    far = np.pi * 600.0
    assert mirror.outside(600.0 * WIDTH, NM) * far * np.pi / 2 * (1 - obstruction) == pytest.approx(1.0, abs=4e-3)


@pytest.mark.parametrize("spec", [f"airy:{MIRROR}m", "hubble", f"airy:{MIRROR}m:0.2:50mm"])
@pytest.mark.parametrize("pixel", [0.02, 0.5, 4.0])
def test_kernels_keep_the_light(spec: str, pixel: float) -> None:
    mirror = point_spread(spec)
    assert isinstance(mirror, Aperture)
    kernel = mirror.kernel(pixel, 200, NM)
    assert kernel.shape == (401, 401)
    np.testing.assert_array_equal(kernel, kernel[::-1, ::-1])
    # what falls outside the square lies beyond its inscribed circle, and includes all beyond the circumscribed one
    share = 1.0 - 2.0 * mirror.spiked
    beyond = 1.0 - kernel.sum()
    spikes = 2.0 * mirror.spiked
    assert share * mirror.outside(200.5 * np.sqrt(2) * pixel, NM) < beyond
    assert beyond < share * mirror.outside(200.5 * pixel, NM) + spikes


def pupil_kernel(mirror: Aperture, samples: int, pixels: int) -> tuple[np.ndarray, float]:
    """The Fourier transform of the pupil drawn on a grid, summed over pixels of so many samples; and their size."""
    across, size = 800, 4096
    step = mirror.diameter_m / across
    y, x = (np.mgrid[-512:512, -512:512] + 0.5) * step
    r = np.hypot(x, y)
    pupil = (r < mirror.diameter_m / 2) & (r >= mirror.obstruction * mirror.diameter_m / 2)
    pupil &= np.minimum(np.abs(x), np.abs(y)) >= mirror.vane_m / 2
    padded = np.zeros((size, size))
    padded[:1024, :1024] = pupil
    light = np.fft.fftshift(np.abs(np.fft.fft2(padded)) ** 2)
    light /= light.sum()
    first = size // 2 - (samples * pixels + samples // 2)
    part = light[first : first + samples * (2 * pixels + 1), first : first + samples * (2 * pixels + 1)]
    binned = part.reshape(2 * pixels + 1, samples, 2 * pixels + 1, samples).sum(axis=(1, 3))
    return binned, samples * NM * 1e-9 / (size * step) / ARCSEC


def test_rings_are_those_of_the_pupil() -> None:
    mirror = Aperture(diameter_m=MIRROR, obstruction=0.33)
    expected, pixel = pupil_kernel(mirror, 9, 60)
    kernel = mirror.kernel(pixel, 60, NM)
    # the drawn pupil has 800 points across: its edge is rough, and its transform repeats
    assert kernel[60, 60] == pytest.approx(expected[60, 60], rel=5e-3)
    np.testing.assert_allclose(kernel[60, 61:67], expected[60, 61:67], rtol=3e-2)
    y, x = np.mgrid[-60:61, -60:61]
    for radius in (3, 10, 30):
        ring = np.hypot(x, y) < radius
        assert kernel[ring].sum() == pytest.approx(expected[ring].sum(), abs=3e-4)


def test_spikes_hold_the_light_that_vanes_cover() -> None:
    """Wide vanes, to see them: on their axes the light far out, where the interference with the rings averages away."""
    mirror = Aperture(diameter_m=MIRROR, obstruction=0.33, vane_m=0.08)
    expected, pixel = pupil_kernel(mirror, 9, 60)
    kernel, bare = mirror.kernel(pixel, 60, NM), Aperture(diameter_m=MIRROR, obstruction=0.33).kernel(pixel, 60, NM)
    spike = np.s_[59:62, 66:90]
    assert expected[spike].sum() > 3.0 * bare[spike].sum()  # there is something to see
    assert kernel[spike].sum() == pytest.approx(expected[spike].sum(), rel=0.15)  # 1 / 15: rings left to average
    off = np.s_[66:90, 66:90]
    assert kernel[off].sum() == pytest.approx(expected[off].sum(), rel=0.2)  # a fiftieth of the spikes' light
    assert kernel.sum() == pytest.approx(expected.sum(), abs=1e-3)


def test_red_rings_are_wider() -> None:
    cube = np.zeros((61, 61, 2))
    cube[30, 30] = 1.0
    sky = SkyFrame(ra_deg=10.0, dec_deg=20.0, pixel_scale_deg=0.02 / 3600.0)
    seen = observe(SpectralImage(cube, [400.0, 800.0], sky=sky), f"airy:{MIRROR}m")
    mirror = Aperture(diameter_m=MIRROR)
    blue, red = (mirror.kernel(0.02, 30, nm) for nm in (400.0, 800.0))
    # transforms round to 1e-16 of the brightest pixel
    np.testing.assert_allclose(seen.radiance, np.stack([blue, red], axis=-1), atol=1e-14)
    # the pattern depends on angle over wavelength alone
    np.testing.assert_allclose(mirror.kernel(0.04, 30, 800.0), blue, rtol=1e-9, atol=1e-15)
    assert 3.0 < blue[30, 30] / red[30, 30] < 4.0  # 4 for pixels that are small beside the disk
    assert seen.recipe["observation"]["psf"] == {"diameter_m": MIRROR, "obstruction": 0.0, "vane_m": 0.0}


def test_named_apertures() -> None:
    assert point_spread("hubble") is APERTURES["hubble"]
    assert point_spread("airy:7mm") == APERTURES["eye"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("airy", "airy:DIAMETER"),
        ("airy:wide", "airy:2.4m"),
        ("airy:0m", "above 0"),
        ("airy:2m:1", "0 to 0.9"),
        ("airy:2m:nan", "0 to 0.9"),
        ("airy:2m:0.1:1m", "tenth"),
        ("airy:2m:0.1:1mm:3", "airy:DIAMETER"),
        ("hubbel", "hubble or eye"),
    ],
)
def test_refusals(text: str, message: str) -> None:
    with pytest.raises(DomainError, match=message):
        point_spread(text)
