"""Light that facets of rough metals and rough glass throw at each other: as a second, broad lobe (Kulla & Conty 2017).

A lobe of single reflections loses what meets another facet.  With E(c) its share of the light where nothing is
absorbed, the lobe (1 - E(c)) (1 - E(c')) / (pi (1 - mean E)) brings just that back and is the same both ways (Kelemen &
Szirmay-Kalos 2001, Eurographics short papers).  Every further reflection absorbs: with the mean reflectance F over
directions the lobe takes the factor F^2 mean E / (1 - F (1 - mean E)).

Glass loses M(c) on either side, and gives it back on both: a share p passes, the rest goes back, each as M(c') of the
side where it leaves, by the cosine.  With m the mean of M, reciprocity asks for  p_a n_a^2 m_a = p_b n_b^2 m_b  of the
sides a and b.  Of light from the side of the lower index half of the mean Fresnel reflectance goes back: so random
walks between facets do it (Heitz, Hanika, d'Eon & Dachsbacher 2016, ACM Trans. Graph. 35, 58), to 0.015 of all light.
"""

from __future__ import annotations

import math

from skyscatter.solvers.kernels.jit import inlined
from skyscatter.solvers.kernels.surfaces.fresnel import fresnel_conductor, fresnel_dielectric

#: Gauss-Jacobi rule of three points for the mean over directions by the cosine.
_COSINES = (0.212340538239153, 0.590533135559265, 0.911412040487296)
_WEIGHTS = (0.139653964720684, 0.458482206064072, 0.401863829215244)


@inlined
def kept_share(materials, k, cosine):
    """E(cosine) of a material."""
    last = materials.kept.shape[1] - 1
    x = cosine * last
    j = min(int(x), last - 1)
    low = materials.kept[k, j]
    return low + (x - j) * (materials.kept[k, j + 1] - low)


@inlined
def between_facets(materials, k, cos_o, cos_i):
    """The broad lobe times cosine without absorption, the density with which it draws, the single lobe's share."""
    mean = materials.kept_mean[k]
    if mean >= 1.0:
        return 0.0, 0.0, 1.0
    single = kept_share(materials, k, cos_o)
    density = (1.0 - single) * cos_i / math.pi
    return density * (1.0 - kept_share(materials, k, cos_i)) / (1.0 - mean), density, single


@inlined
def after_more(n, k, mean):
    """Factor of the broad lobe for a conductor of relative index n + i k."""
    f = 0.0
    for j in range(3):
        f += _WEIGHTS[j] * fresnel_conductor(_COSINES[j], n, k)
    return f * f * mean / (1.0 - f * (1.0 - mean))


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
    low, high = min(here, there), max(here, there)
    back = 0.0
    for j in range(3):
        share, _ = fresnel_dielectric(_COSINES[j], low, high)
        back += 0.5 * _WEIGHTS[j] * share
    mine, other = here * here * lost_here, there * there * lost_there
    return (1.0 - back) * min(other / mine, 1.0)


@inlined
def between_glass(materials, k, here, there, cos_o, cos_i):
    """The broad lobe of glass times cosine for photons, the density with which it draws, the share of single events.

    `cos_i` is negative on the other side.
    """
    if here == there or materials.lost_mean[k, 0] == 0.0:
        return 0.0, 0.0, 1.0
    lost, mean = lost_share(materials, k, here, there, cos_o)
    leaves, other = lost_share(materials, k, there, here, abs(cos_i))
    passed = passed_share(here, there, mean, other)
    if cos_i > 0.0:
        leaves, other = lost_share(materials, k, here, there, cos_i)
        passed = 1.0 - passed
    density = passed * lost * abs(cos_i) / math.pi
    return density * leaves / other, density, 1.0 - lost
