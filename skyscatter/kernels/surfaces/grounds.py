"""Grounds under a sky: land by Rahman, Pinty and Verstraete or by Ross and Li, and the sea by the slopes of its waves.

Values are those of f |cos(n, wi)|, see `kernels.surfaces.bsdf`; both look the same from both sides of their surface.

*Land* by one formula (Rahman, Pinty & Verstraete 1993, J. Geophys. Res. 98, 20791, equations 1-5), with the zenith
cosines m and m', the cosine g of the angle between both directions and the distance G of their tangents:

    f = a / pi (m m' (m + m'))^(k - 1) (1 - b^2) / (1 + b^2 + 2 b g)^(3/2) (1 + (1 - c) / (1 + G)).

By kernels (Roujean, Leroy & Deschamps 1992, J. Geophys. Res. 97, 20455; Wanner, Li & Strahler 1995, J. Geophys. Res.
100, 21077; Lucht, Schaaf & Strahler 2000, IEEE Trans. Geosci. Remote Sens. 38, 977, equations 37-44),

    f = max(a + v K + w L, 0) / pi,

with K of a layer of leaves (Ross, thick) and L of crowns and their shadows (Li, sparse, reciprocal: height over radius
b/r = 1 and h/b = 2).

*Sea* (Cox & Munk 1954, J. Opt. Soc. Am. 44, 838): facets whose slopes are normally distributed, equally in all
directions, with the variance alpha^2 of both components together, each a mirror by Fresnel; of those the share
1 / (1 + L + L') is seen and lit (Mishchenko & Travis 1997, J. Geophys. Res. 102, 16989, equations 14-18; the same as
Smith's for normal slopes).  To that is added what foam and the water below reflect, evenly.
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.surfaces import ROSS_LI, RPV, SEA
from skyscatter.kernels.jit import inlined, kernel, merged
from skyscatter.kernels.surfaces.fresnel import fresnel_dielectric

#: Zenith cosine from which on a view is straight down: the waves are seen as they are.
STRAIGHT_DOWN = 1.0 - 1e-12
#: Least share of the draws that look for the mirrors, where foam shines too.
LEAST_MIRROR = 0.1
#: Share of the draws on land by kernels that are the same in all directions: towards the horizon the kernels of crowns
#: grow as 1 / m, and the variance of draws by the cosine has no bound.
LEVEL_SHARE = 0.25
#: Slopes beyond so many standard deviations are not drawn: one in 1e18.
STEEPEST = 9.0


@inlined
def land_bowl(exponent, asymmetry, hot, m, n, g, tangents):
    """The shape of the formula for land, without the amplitude and 1 / pi."""
    lobe = (1.0 - asymmetry * asymmetry) / (1.0 + asymmetry * asymmetry + 2.0 * asymmetry * g) ** 1.5
    return (m * n * (m + n)) ** (exponent - 1.0) * lobe * (1.0 + (1.0 - hot) / (1.0 + tangents))


@inlined
def leaves(m, n, g):
    """The kernel of a layer of leaves: zenith cosines, and the cosine of the angle between both directions."""
    angle = math.acos(min(max(g, -1.0), 1.0))
    return ((0.5 * math.pi - angle) * g + math.sin(angle)) / (m + n) - 0.25 * math.pi


@inlined
def crowns(m, n, g, tangents):
    """The kernel of crowns and their shadows; `tangents` is the distance of the directions' tangents."""
    both = 1.0 / m + 1.0 / n
    along = g / (m * n) - 1.0
    across = max((1.0 / (m * m) - 1.0) * (1.0 / (n * n) - 1.0) - along * along, 0.0)
    cosine = min(2.0 * math.sqrt(tangents * tangents + across) / both, 1.0)
    shared = (math.acos(cosine) - cosine * math.sqrt(1.0 - cosine * cosine)) * both / math.pi
    return shared - both + 0.5 * (1.0 + g) / (m * n)


@inlined
def wave_lambda(alpha, cosine):
    """Lambda of normally distributed slopes (Mishchenko & Travis 1997, equation 15)."""
    sine = math.sqrt((1.0 - cosine) * (1.0 + cosine))
    if sine * alpha * 10.0 < cosine:
        return 0.0  # less than 1e-44
    a = cosine / (alpha * sine)
    return 0.5 * (math.exp(-a * a) / (a * math.sqrt(math.pi)) - math.erfc(a))


@merged
def mirror_lobe(alpha, side, n, wo, wi, cos_o, cos_i):
    """Reflection by waves without Fresnel's factor, the density with which it is drawn, and the cosine on the facet."""
    hx, hy, hz = wo[0] + wi[0], wo[1] + wi[1], wo[2] + wi[2]
    square = hx * hx + hy * hy + hz * hz
    z = side * (hx * n[0] + hy * n[1] + hz * n[2])
    if not z > 0.0:
        return 0.0, 0.0, 1.0
    facet = min((hx * wo[0] + hy * wo[1] + hz * wo[2]) / math.sqrt(square), 1.0)
    x, y, w = side * hx - z * n[0], side * hy - z * n[1], side * hz - z * n[2]
    slope = (x * x + y * y + w * w) / (z * z)
    normals = math.exp(-slope / (alpha * alpha)) * (square / (z * z)) ** 2 / (math.pi * alpha * alpha)
    here, there = wave_lambda(alpha, cos_o), wave_lambda(alpha, cos_i)
    lobe = normals / (4.0 * cos_o)
    return lobe / (1.0 + here + there), lobe / (1.0 + here), facet


@inlined
def mirror_share(materials, k, i, here, cos_o):
    """Share of the draws under hero i that look for the mirrors."""
    rest = materials.reflectance[k, i]
    share, _ = fresnel_dielectric(cos_o, here, materials.index[k, i])
    return max(share / (share + rest), LEAST_MIRROR) if rest > 0.0 else 1.0


@inlined
def cosines(side, n, wo, wi):
    """Cosines of both directions from the normal on the side that is meant."""
    return side * (n[0] * wo[0] + n[1] * wo[1] + n[2] * wo[2]), side * (n[0] * wi[0] + n[1] * wi[1] + n[2] * wi[2])


@kernel
def ground_value(materials, k, n, side, wo, wi, index_here, out):
    """F |cos(n, wi)| into `out` (wavelength,) [sr-1]."""
    cos_o, cos_i = cosines(side, n, wo, wi)
    if not (cos_o > 0.0 and cos_i > 0.0):
        for i in range(out.size):
            out[i] = 0.0
    elif materials.kind[k] != SEA:
        g = wo[0] * wi[0] + wo[1] * wi[1] + wo[2] * wi[2]
        across = 1.0 / (cos_o * cos_o) + 1.0 / (cos_i * cos_i) - 2.0 * g / (cos_o * cos_i)
        tangents, bowl = math.sqrt(max(across, 0.0)), materials.bowl[k]
        if materials.kind[k] == RPV:
            for i in range(out.size):
                shape = land_bowl(bowl[0, i], bowl[1, i], bowl[2, i], cos_o, cos_i, g, tangents)
                out[i] = materials.reflectance[k, i] * shape * cos_i / math.pi
        else:
            layer, shadows = leaves(cos_o, cos_i, g), crowns(cos_o, cos_i, g, tangents)
            for i in range(out.size):
                factor = materials.reflectance[k, i] + bowl[0, i] * layer + bowl[1, i] * shadows
                out[i] = max(factor, 0.0) * cos_i / math.pi
    else:
        lobe, _, facet = mirror_lobe(materials.roughness[k], side, n, wo, wi, cos_o, cos_i)
        for i in range(out.size):
            share, _ = fresnel_dielectric(facet, index_here[i], materials.index[k, i])
            out[i] = materials.bowl[k, 0, i] * share * lobe + materials.reflectance[k, i] * cos_i / math.pi


@kernel
def ground_density(materials, k, n, side, wo, wi, index_here, out):
    """Density [sr-1] with which `wi` is drawn under each hero, into `out` (wavelength,)."""
    cos_o, cos_i = cosines(side, n, wo, wi)
    even = max(cos_i, 0.0) / math.pi
    if cos_i > 0.0 and materials.kind[k] == ROSS_LI:
        even = (1.0 - LEVEL_SHARE) * even + LEVEL_SHARE / (2.0 * math.pi)
    for i in range(out.size):
        out[i] = even
    if cos_o > 0.0 and cos_i > 0.0 and materials.kind[k] == SEA:
        _, drawn, _ = mirror_lobe(materials.roughness[k], side, n, wo, wi, cos_o, cos_i)
        for i in range(out.size):
            mirrors = mirror_share(materials, k, i, index_here[i], cos_o)
            out[i] = mirrors * drawn + (1.0 - mirrors) * even


@kernel
def draw_tilt(c, u):
    """A slope t towards the viewer in standard deviations, with the density (c + t) exp(-t^2 / 2) where that is > 0.

    Its distribution function is inverted by Newton's steps within a bracket.
    """
    root, norm = math.sqrt(0.5), 1.0 / math.sqrt(2.0 * math.pi)
    start = norm * math.exp(-0.5 * c * c)
    below = 0.5 * math.erfc(c * root)
    goal = u * (c * (1.0 - below) + start)
    low, high = max(-c, -STEEPEST), STEEPEST
    t = 0.0 if low < 0.0 else 0.5 * (low + high)
    for _ in range(60):
        thin = norm * math.exp(-0.5 * t * t)
        miss = c * (0.5 * math.erfc(-t * root) - below) + start - thin - goal
        if abs(miss) <= 1e-15 * (1.0 + c) or high - low < 1e-13:
            break
        if miss < 0.0:
            low = t
        else:
            high = t
        slope = (c + t) * thin
        t = t - miss / slope if slope > 0.0 else 0.5 * (low + high)
        if not low < t < high:
            t = 0.5 * (low + high)
    return t


@merged
def draw_wave(alpha, cos_o, u, v):
    """Normal of a facet as the viewer sees them, who stands over the x axis: (x, y, z), see Heitz (2014), section 5."""
    sigma = alpha * math.sqrt(0.5)
    sine = math.sqrt((1.0 - cos_o) * (1.0 + cos_o))
    if cos_o > STRAIGHT_DOWN:
        far = math.sqrt(-2.0 * math.log(max(1.0 - u, 1e-300)))
        x, y = sigma * far * math.cos(2.0 * math.pi * v), sigma * far * math.sin(2.0 * math.pi * v)
    else:
        x = sigma * draw_tilt(min(cos_o / (sigma * sine), 1e6), u)
        # Across, a normal number by its distribution function: the view does not tilt it.
        y = sigma * draw_tilt(1e6, v)
    norm = 1.0 / math.sqrt(1.0 + x * x + y * y)
    return x * norm, y * norm, norm


@merged
def draw_sea(materials, k, n, side, wo, u, v, wi):
    """A direction that the waves reflect, into `wi` (3,); it may lead below the horizon."""
    cos_o = min(side * (n[0] * wo[0] + n[1] * wo[1] + n[2] * wo[2]), 1.0)
    x, y, z = draw_wave(materials.roughness[k], cos_o, u, v)
    ax, ay, az = wo[0] - cos_o * side * n[0], wo[1] - cos_o * side * n[1], wo[2] - cos_o * side * n[2]
    length = math.sqrt(ax * ax + ay * ay + az * az)
    if not length > 1e-9:
        # Straight down any direction across will do.
        flat = abs(n[2]) < 0.9
        ax, ay, az = (n[1], -n[0], 0.0) if flat else (0.0, n[2], -n[1])
        length = math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / length, ay / length, az / length
    bx, by, bz = n[1] * az - n[2] * ay, n[2] * ax - n[0] * az, n[0] * ay - n[1] * ax
    mx = x * ax + y * bx + z * side * n[0]
    my = x * ay + y * by + z * side * n[1]
    mz = x * az + y * bz + z * side * n[2]
    along = 2.0 * (mx * wo[0] + my * wo[1] + mz * wo[2])
    wi[0], wi[1], wi[2] = along * mx - wo[0], along * my - wo[1], along * mz - wo[2]
