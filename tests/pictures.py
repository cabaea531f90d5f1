"""Made-up views of the ground from above, and veils on them, for the tests and benchmarks of dehazing pictures.

Surfaces are plausible reflectances in red, green and blue, textured by fractal noise and shown as viewers of
satellite images show them: a straight stretch.  The veils follow I = J t + A (1 - t) with A and t chosen here.
"""

from __future__ import annotations

import numpy as np

WAVELENGTHS = np.array([600.0, 545.0, 465.0])

SURFACES = {
    "forest": (0.035, 0.055, 0.03),
    "meadow": (0.07, 0.10, 0.05),
    "soil": (0.20, 0.15, 0.10),
    "sand": (0.42, 0.34, 0.25),
    "water": (0.02, 0.035, 0.045),
    "shoal": (0.06, 0.13, 0.14),
    "concrete": (0.28, 0.27, 0.26),
    "asphalt": (0.08, 0.08, 0.08),
    "roof": (0.30, 0.17, 0.13),
    "white": (0.6, 0.6, 0.6),
    "shadow": (0.015, 0.017, 0.02),
}


def noise(seed: int, size: int, slope: float = 1.8) -> np.ndarray:
    """Fractal noise of zero mean and unit variance; the power falls as frequency to the -2 slope."""
    rng = np.random.default_rng(seed)
    f = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None])
    f[0, 0] = np.inf
    spectrum = (rng.normal(size=f.shape) + 1j * rng.normal(size=f.shape)) * f**-slope
    field = np.fft.irfft2(spectrum, (size, size))
    return (field - field.mean()) / field.std()


def _mixed(shares: dict[str, np.ndarray]) -> np.ndarray:
    total = sum(shares.values())
    return sum(np.multiply.outer(np.array(SURFACES[name]), share / total) for name, share in shares.items())


def _soft(field: np.ndarray, width: float = 0.15) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(np.clip(-field / width, -50, 50)))


def forest(size: int = 192, seed: int = 1) -> np.ndarray:
    """Forest with clearings and a river; crowns shade each other."""
    clearing, crowns = _soft(noise(seed, size) - 0.9), np.exp(0.35 * noise(seed + 1, size, 0.6))
    river = np.exp(-((noise(seed + 2, size, 2.2) / 0.04) ** 2))
    ground = _mixed({"forest": 1 - clearing, "meadow": 0.7 * clearing, "soil": 0.3 * clearing})
    return (1 - river) * ground * crowns + river * np.array(SURFACES["water"])[:, None, None]


def city(size: int = 192, seed: int = 11) -> np.ndarray:
    """Blocks of roofs between streets, with their shadows, and parks."""
    rng = np.random.default_rng(seed)
    out = np.empty((3, size, size))
    out[:] = np.array(SURFACES["asphalt"])[:, None, None]
    park = noise(seed, size, 2.2) > 0.8
    for y in range(2, size - 8, 12):
        for x in range(2, size - 8, 10):
            kind = rng.choice(["roof", "concrete", "soil", "white"], p=[0.35, 0.4, 0.18, 0.07])
            h, w = rng.integers(5, 10), rng.integers(4, 8)
            out[:, y : y + h + 1, x : x + w + 1] = np.array(SURFACES["shadow"])[:, None, None]
            out[:, y : y + h, x : x + w] = np.array(SURFACES[kind])[:, None, None] * rng.uniform(0.7, 1.2)
    out[:, park] = np.array(SURFACES["meadow"])[:, None]
    return out * np.exp(0.1 * noise(seed + 1, size, 0.5))


def fields(size: int = 192, seed: int = 21) -> np.ndarray:
    """Farmland: patches of soil and crops, woods and ponds."""
    a, b, c = noise(seed, size, 1.6), noise(seed + 1, size, 1.6), noise(seed + 2, size, 2.0)
    land = _mixed({"soil": _soft(a), "meadow": _soft(b), "forest": _soft(c - 0.6), "sand": 0.3 * _soft(a - 1.2)})
    pond = _soft(c + 2.0, 0.05)
    land = pond * land + (1 - pond) * np.array(SURFACES["water"])[:, None, None]
    return land * np.exp(0.2 * noise(seed + 3, size, 0.6))


def sea(size: int = 192, seed: int = 31) -> np.ndarray:
    """A coast: sea, shoals, a beach and what is behind it."""
    depth = noise(seed, size, 2.2)
    shares = {
        "water": _soft(depth - 0.1),
        "shoal": np.exp(-(((depth + 0.1) / 0.15) ** 2)),
        "sand": np.exp(-(((depth + 0.5) / 0.12) ** 2)),
        "forest": _soft(-depth - 0.8),
    }
    return _mixed(shares) * np.exp(0.08 * noise(seed + 1, size, 0.8))


SCENES = {"forest": forest, "city": city, "fields": fields, "sea": sea}


def shown(reflectance: np.ndarray) -> np.ndarray:
    """As a viewer of satellite images shows it: stretched so that two pixels in a hundred reach 0.9."""
    return np.clip(0.9 * reflectance / np.quantile(reflectance.max(axis=0), 0.98), 0.0, 1.0)


def front(size: int) -> np.ndarray:
    """One side veiled, one clear."""
    x = (np.arange(size) + 0.5) / size
    return np.tile(_soft(x - 0.5, 0.05), (size, 1))


def patches(size: int, seed: int = 5) -> np.ndarray:
    """Patches of haze of a few of them across the picture."""
    field = noise(seed, size, 2.6)
    return np.clip(0.5 + 0.6 * field, 0.0, 1.6)


VEILS = {
    # name: (optical depth at 550 nm, alpha, airlight of red, green and blue, shape)
    "thin white": (0.25, 0.0, (0.6, 0.6, 0.6), None),
    "white": (0.7, 0.0, (0.65, 0.65, 0.65), None),
    "thick white": (1.3, 0.0, (0.75, 0.75, 0.75), None),
    "blue haze": (0.5, 1.5, (0.6, 0.6, 0.6), None),
    "air": (0.3, 4.0, (0.55, 0.55, 0.55), None),
    "brown": (0.7, 0.0, (0.66, 0.58, 0.45), None),
    "front": (0.9, 0.0, (0.65, 0.65, 0.65), front),
    "patches": (0.7, 0.0, (0.65, 0.65, 0.65), patches),
}


def veiled(picture: np.ndarray, name: str, levels: int = 256) -> np.ndarray:
    """The picture, proportional to light, under one of `VEILS`, rounded to the levels of a file."""
    depth, alpha, airlight, shape = VEILS[name]
    place = (
        np.ones(picture.shape[1:])
        if shape is None
        else shape(max(picture.shape[1:]))[: picture.shape[1], : picture.shape[2]]
    )
    t = np.exp(-depth * place * ((WAVELENGTHS / 550.0) ** -alpha)[:, None, None])
    light = picture * t + np.array(airlight)[:, None, None] * (1.0 - t)
    return np.round(light * (levels - 1)) / (levels - 1)


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """Peak signal to noise of pictures from 0 to 1, dB."""
    return float(-10.0 * np.log10(np.nanmean((np.asarray(a, float) - b) ** 2)))
