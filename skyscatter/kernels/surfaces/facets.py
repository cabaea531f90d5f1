"""Light that facets of rough metals and rough glass throw at each other: as a second, broad lobe (Kulla & Conty 2017).

A lobe of single events loses the share M(c) that meets another facet.  Where nothing is absorbed, the lobe
M(c) M(c') c' / (pi m) brings just that back and is the same both ways, with m the mean of M over directions by the
cosine (Kelemen & Szirmay-Kalos 2001, Eurographics short papers).  On metals every further reflection absorbs: with
the mean reflectance F over directions the lobe takes the factor F^2 (1 - m) / (1 - F m).

Glass loses M(c) on either side, and gives it back on both: a share p passes, the rest goes back, each as M(c') of the
side where it leaves.  With m the mean of M, reciprocity asks for  p_a n_a^2 m_a = p_b n_b^2 m_b  of the sides a and b.
Of light from the side of the lower index half of the mean Fresnel reflectance goes back: so random walks between
facets do it (Heitz, Hanika, d'Eon & Dachsbacher 2016, ACM Trans. Graph. 35, 58), to 0.015 of all light.

A metal is a boundary with no index beyond: all is reflected, whatever the angle.

Walks draw as light goes: from a facet; what another facet is in the way of leaves by the broad lobe.  Both together
have the density of the light itself, so a walk that is never absorbed keeps its weight however often it turns.
"""

from __future__ import annotations

import math

from skyscatter.kernels.jit import inlined, merged
from skyscatter.kernels.surfaces.fresnel import fresnel_conductor, fresnel_dielectric

#: Gauss-Jacobi rule of three points for the mean over directions by the cosine.
_COSINES = (0.212340538239153, 0.590533135559265, 0.911412040487296)
_WEIGHTS = (0.139653964720684, 0.458482206064072, 0.401863829215244)


@inlined
def after_more(n, k, lost):
    """Factor of the broad lobe for a conductor of relative index n + i k; `lost` is the mean of M."""
    f = 0.0
    for j in range(3):
        f += _WEIGHTS[j] * fresnel_conductor(_COSINES[j], n, k)
    return f * f * (1.0 - lost) / (1.0 - f * lost)


@inlined
def ratio_at(materials, here, there):
    """Row of the table for the indices of both sides, and the way to the next one."""
    x = (here - there) / (here + there)
    last = materials.lost.shape[1] - 1
    at = 0.5 * last * (1.0 + math.copysign(math.sqrt(abs(x)), x))
    j = min(int(at), last - 1)
    return j, at - j


@inlined
def lost_share(materials, k, here, there, cosine):
    """M(cosine) of light that comes from `here`, and its mean over directions."""
    j, w = ratio_at(materials, here, there)
    last = materials.lost.shape[2] - 1
    x = math.sqrt(cosine) * last
    i = min(int(x), last - 1)
    low, high = materials.lost[k, j], materials.lost[k, j + 1]
    a, b = low[i] + (x - i) * (low[i + 1] - low[i]), high[i] + (x - i) * (high[i + 1] - high[i])
    c, d = materials.lost_mean[k, j], materials.lost_mean[k, j + 1]
    return a + w * (b - a), c + w * (d - c)


@inlined
def passed_share(here, there, lost_here, lost_there):
    """Share p of the light between facets that passes to the other side; of both sides the mean losses are given."""
    if there == 0.0:
        return 0.0
    low, high = min(here, there), max(here, there)
    back = 0.0
    for j in range(3):
        share, _ = fresnel_dielectric(_COSINES[j], low, high)
        back += 0.5 * _WEIGHTS[j] * share
    mine, other = here * here * lost_here, there * there * lost_there
    return (1.0 - back) * min(other / mine, 1.0)


@inlined
def between_facets(materials, k, here, there, cos_o, cos_i):
    """The broad lobe times cosine for photons; `cos_i` is negative on the other side, `there` is 0 of metals."""
    if here == there or materials.lost_mean[k, 0] == 0.0:
        return 0.0
    lost, mean = lost_share(materials, k, here, there, cos_o)
    leaves, other = lost_share(materials, k, there, here, abs(cos_i))
    passed = passed_share(here, there, mean, other)
    if cos_i > 0.0:
        leaves, other = lost_share(materials, k, here, there, cos_i)
        passed = 1.0 - passed
    return passed * lost * leaves / other * abs(cos_i) / math.pi


@inlined
def _below(x, s, step, a, b):
    """Integral of M(c) 2 c dc from the root s of the cosine on, over the part x of a step in which M goes from a to b.

    2 c dc = 4 s^3 ds, and M is a line in the root.
    """
    d, h = b - a, step
    c0, c1 = s * s * s * a, 3.0 * s * s * h * a + s * s * s * d
    c2, c3, c4 = 3.0 * s * h * (h * a + s * d), h * h * (h * a + 3.0 * s * d), h * h * h * d
    return 4.0 * h * x * (c0 + x * (c1 / 2.0 + x * (c2 / 3.0 + x * (c3 / 4.0 + x * c4 / 5.0))))


@merged
def draw_lost(materials, k, here, there, u):
    """A cosine by M(c) c of the side `here`, for an even number u: where the sum over the table comes to that share."""
    j, w = ratio_at(materials, here, there)
    low, high, mean = materials.lost[k, j], materials.lost[k, j + 1], materials.lost_mean[k]
    last = low.size - 1
    step, left = 1.0 / last, u * (mean[j] + w * (mean[j + 1] - mean[j]))
    a = low[0] + w * (high[0] - low[0])
    for i in range(last):
        s, b = i * step, low[i + 1] + w * (high[i + 1] - low[i + 1])
        whole = _below(1.0, s, step, a, b)
        if left < whole or i == last - 1:
            break
        left, a = left - whole, b
    # Halving: the sum rises throughout, but from zero it starts too flat for Newton's steps.
    under, over = 0.0, 1.0
    for _ in range(40):
        x = 0.5 * (under + over)
        if _below(x, s, step, a, b) < left:
            under = x
        else:
            over = x
    root = s + 0.5 * (under + over) * step
    return root * root
