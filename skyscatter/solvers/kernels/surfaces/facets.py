"""Light that facets of rough metals throw at each other: as a second, broad lobe (Kulla & Conty 2017).

A lobe of single reflections loses what meets another facet.  With E(c) its share of the light where nothing is
absorbed, the lobe (1 - E(c)) (1 - E(c')) / (pi (1 - mean E)) brings just that back and is the same both ways (Kelemen &
Szirmay-Kalos 2001, Eurographics short papers).  Every further reflection absorbs: with the mean reflectance F over
directions the lobe takes the factor F^2 mean E / (1 - F (1 - mean E)).
"""

from __future__ import annotations

import math

from skyscatter.solvers.kernels.jit import inlined
from skyscatter.solvers.kernels.surfaces.fresnel import fresnel_conductor

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
