"""How far what a shader makes of textures is from the field that they were made of."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.image.colour import colour_space, luminance_weights
from skyscatter.solvers.engines.bruneton import cornette_shanks, rayleigh
from skyscatter.solvers.engines.textures import Source, Textures, light_of, rays_of

Array = NDArray[np.float64]

#: Altitudes of observers, as shares of that of the textures' top; elevations of the Sun, from and to [degree]; rays.
ALTITUDES, SUNS, RAYS = (0.0, 0.02, 0.2), ((30.0, 90.0), (5.0, 30.0), (-1.0, 5.0), (-6.0, -1.0)), 400
SEED = 1


def shader_radiance(source: Source, textures: Textures, r: Array, mu: Array, mu_s: Array, nu: Array) -> Array:
    """What a shader finds along rays (n,) by its two look-ups, in linear sRGB (n, 3) [cd m-2]."""
    a, b = (source.layout.scattering_at(x, r, mu, mu_s, nu) for x in (textures.scattering, textures.single_mie))
    return np.asarray(a * rayleigh(nu)[:, None] + b * cornette_shanks(source.asymmetry, nu)[:, None])


def deviations(source: Source, textures: Textures) -> list[dict[str, Any]]:
    """Relative deviations of the luminance of the sky, by altitude and Sun: median, 95th percentile and greatest."""
    random, layout = np.random.default_rng(SEED), source.layout
    weights = luminance_weights(colour_space("srgb"))
    found = []
    for share in ALTITUDES:
        r = np.full(RAYS, layout.bottom + share * (layout.top - layout.bottom))
        edge = -layout.horizon(r[0]) / r[0] + 1e-4
        for low, high in SUNS:
            mu, mu_s = random.uniform(edge, 1.0, RAYS), np.sin(np.radians(random.uniform(low, high, RAYS)))
            across = np.sqrt((1 - mu**2) * (1 - mu_s**2))
            nu = np.clip(mu * mu_s + across * np.cos(random.uniform(0, np.pi, RAYS)), -1.0, 1.0)
            true = sum(light_of(source, *rays_of(r, mu, mu_s, nu)))
            off = np.abs(shader_radiance(source, textures, r, mu, mu_s, nu) @ weights / (true @ weights) - 1)
            found.append({
                "altitude_m": float(r[0] - layout.bottom), "sun_elevations_deg": [low, high],
                "median": float(np.median(off)), "of_95_percent": float(np.percentile(off, 95)),
                "greatest": float(off.max()),
            })  # fmt: skip
    return found
