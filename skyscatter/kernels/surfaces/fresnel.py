"""Reflection by a boundary: Fresnel's equations (Born & Wolf 1999, Principles of Optics, sections 1.5.2 and 14.2)."""

from __future__ import annotations

import math

from skyscatter.kernels.jit import inlined


@inlined
def fresnel_dielectric(cosine, here, there):
    """Reflected share of unpolarised light that meets a boundary from `here`, and the cosine beyond (0 if none).

    `cosine` (not negative) is that of the angle from the normal on this side.
    """
    if here == there:
        return 0.0, cosine
    ratio = here / there
    sine2 = ratio * ratio * (1.0 - cosine) * (1.0 + cosine)
    if sine2 >= 1.0:
        return 1.0, 0.0
    beyond = math.sqrt(1.0 - sine2)
    across = (here * cosine - there * beyond) / max(here * cosine + there * beyond, 1e-300)
    along = (there * cosine - here * beyond) / max(there * cosine + here * beyond, 1e-300)
    return 0.5 * (across * across + along * along), beyond


@inlined
def fresnel_conductor(cosine, n, k):
    """Reflected share of unpolarised light that meets a conductor of relative refractive index n + i k.

    With a^2 = the modulus of w = m^2 - sin^2 and a + i b its root: r_s = (cos - q) / (cos + q), r_p = (m^2 cos - q) /
    (m^2 cos + q), q = a + i b.
    """
    sine2 = (1.0 - cosine) * (1.0 + cosine)
    real, imaginary = n * n - k * k - sine2, 2.0 * n * k
    modulus = math.sqrt(real * real + imaginary * imaginary)
    # The root of the larger part first; the other follows without cancellation.
    if real >= 0.0:
        a = math.sqrt(0.5 * (modulus + real))
        b = imaginary / (2.0 * a) if a > 0.0 else 0.0
    else:
        b = math.sqrt(0.5 * (modulus - real))
        a = imaginary / (2.0 * b)
    across = ((cosine - a) ** 2 + b * b) / max((cosine + a) ** 2 + b * b, 1e-300)
    e, f = (n * n - k * k) * cosine, 2.0 * n * k * cosine
    along = ((e - a) ** 2 + (f - b) ** 2) / max((e + a) ** 2 + (f + b) ** 2, 1e-300)
    return 0.5 * (across + along)
